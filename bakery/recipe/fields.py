"""Kinds of values that a key may have: the leaves of the schema.

Each is a pydantic type that takes a `Scalar` of the tree (or, for lists, a `Sequence`), returns the value in base units, and
carries the JSON Schema that an editor needs.  A value that is well formed is also noted under its dotted key in the validation
context, so that the checks between keys (`checks.py`) can run even where another part of the recipe is wrong.
"""

from __future__ import annotations

import difflib
import re
from typing import Annotated, Any

from pydantic import Discriminator, Field, PlainValidator, Tag, ValidationInfo, WithJsonSchema
from pydantic_core import PydanticCustomError

from bakery.recipe import units
from bakery.recipe.text import Mapping, Scalar, Sequence, show
from bakery.recipe.units import FRACTION, LENGTH, NUMBER_ONLY, Quantity, Wrong

FORMAT = 1
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,63}", re.ASCII)
_RESERVED = re.compile(r"(?i)con|prn|aux|nul|com\d|lpt\d")
_NUMBER = r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?"


def _raise(found: str, expected: str, offset: int = 0):
    raise PydanticCustomError("wrong", "wrong", {"found": found, "expected": expected, "offset": offset})


def describe(node: Any) -> str:
    """What stands at a node, in words."""
    if isinstance(node, Mapping):
        return "a mapping"
    if isinstance(node, Sequence):
        return "a list"
    return "nothing" if is_null(node) else show(node.text)


def is_null(node: Any) -> bool:
    """Whether a key is there without a value."""
    return isinstance(node, Scalar) and not node.quoted and node.text in ("", "~", "null", "Null", "NULL")


def scalar(node: Any, expected: str) -> Scalar:
    if node.broken:
        raise PydanticCustomError("told", "told")
    if not isinstance(node, Scalar) or is_null(node):
        _raise(f"found {describe(node)}", f"expected {expected}")
    return node


def leaf(read, schema: dict):
    """A field type: `read(node)` gives the value, which is noted under the node's key."""

    def validate(node: Any, info: ValidationInfo):
        try:
            value = read(node)
        except Wrong as wrong:
            _raise(wrong.found, wrong.expected, wrong.offset + bool(wrong.offset and node.quoted))
        info.context[node.place.key] = value
        return value

    return Annotated[Any, PlainValidator(validate), WithJsonSchema(schema)]


class Range:
    """Bounds of a number and how to say them."""

    def __init__(self, above=None, least=None, below=None, most=None):
        self.above, self.least, self.below, self.most = above, least, below, most

    def holds(self, value: float) -> bool:
        return (
            (self.above is None or value > self.above)
            and (self.least is None or value >= self.least)
            and (self.below is None or value < self.below)
            and (self.most is None or value <= self.most)
        )

    def schema(self) -> dict:
        found = {"exclusiveMinimum": self.above, "minimum": self.least, "exclusiveMaximum": self.below, "maximum": self.most}
        return {name: value for name, value in found.items() if value is not None}

    def __str__(self) -> str:
        low = f"above {self.above:g}" if self.above is not None else f"at least {self.least:g}" if self.least is not None else ""
        high = f"below {self.below:g}" if self.below is not None else f"at most {self.most:g}" if self.most is not None else ""
        return " and ".join(part for part in (low, high) if part)


def one(text: str, quantity: Quantity, bounds: Range, quoted: bool = False) -> float:
    value = units.parse(text, quantity)
    if quoted and units.NUMBER.fullmatch(text.strip()):
        raise Wrong(f"found the quoted number {show(text)}, which is text", f"expected {text.strip()} without quotes")
    if not bounds.holds(value):
        unit = "" if quantity.base == "1" else f" {quantity.base}"
        raise Wrong(f"found {show(text)}", f"expected {quantity.one} {bounds}{unit}")
    return value


def _patterns(quantity: Quantity, bounds: Range) -> list[dict]:
    spelled = [re.escape(unit) for unit in quantity.powers] + (["µm", "μm"] if "um" in quantity.powers else [])
    text = {"type": "string", "pattern": rf"^\s*{_NUMBER}\s*({'|'.join(spelled)})\s*$"}
    return ([{"type": "number", **bounds.schema()}] if quantity.bare else []) + ([text] if quantity.powers else [])


def number(quantity: Quantity = NUMBER_ONLY, auto: bool = False, **bounds):
    """One value of a quantity; with `auto` also that word."""
    limits = Range(**bounds)

    def read(node):
        node = scalar(node, ("auto or " if auto else "") + units.example(quantity))
        return "auto" if auto and node.text == "auto" else one(node.text, quantity, limits, node.quoted)

    return leaf(read, {"anyOf": [{"const": "auto"}] * auto + _patterns(quantity, limits)})


def numbers(quantity: Quantity = NUMBER_ONLY, words: dict | None = None, most_entries: int = 4096, **bounds):
    """One value, a list of values, or a list with one unit behind it; several floats in any case."""
    limits = Range(**bounds)

    def read(node):
        node = scalar(node, f"{units.example(quantity)} or a list")
        if words and node.text in words:
            return words[node.text]
        if words and not units.NUMBER.match(node.text.strip()) and not units.is_list(node.text):
            raise Wrong(
                f"found {show(node.text)}",
                f"expected {one_of(list(words))}, or a list in {quantity.base}" + nearest(node.text, words),
            )
        if not units.is_list(node.text):
            return (one(node.text, quantity, limits, node.quoted),)
        values = units.parse_list(node.text, quantity)
        if not all(limits.holds(value) for value in values):
            raise Wrong(f"found {show(node.text)}", f"expected {quantity.plural} {limits}")
        return values

    text = {
        "anyOf": ([{"enum": list(words)}] if words else [])
        + _patterns(quantity, limits)
        + [{"type": "string", "pattern": r"^\s*\[.*\]\s*\S*\s*$"}]
    }
    listed = Annotated[list[number(quantity, **bounds)], Field(min_length=1, max_length=most_entries)]
    return Annotated[
        Annotated[leaf(read, text), Tag("text")] | Annotated[listed, Tag("list")],
        Discriminator(lambda node: "list" if isinstance(node, (Sequence, list)) else "text"),
    ]


def word(*choices: str):
    """One of a few words."""

    def read(node):
        text = scalar(node, one_of(choices)).text
        if text not in choices:
            raise Wrong(f"found {show(text)}", f"expected {one_of(choices)}" + nearest(text, choices))
        return text

    return leaf(read, {"enum": list(choices)})


def one_of(choices) -> str:
    return ", ".join(choices[:-1]) + f" or {choices[-1]}" if len(choices) > 1 else str(choices[0])


def nearest(text: str, known) -> str:
    """` (fog?)`: the nearest known word, or nothing."""
    near = difflib.get_close_matches(str(text)[:64].lower(), [str(k) for k in known], 1, 0.6)
    return f" ({near[0]}?)" if near else ""


def _read_text(node):
    return scalar(node, "a line of text").text


def _read_name(node):
    text = scalar(node, "a name").text
    if not _NAME.fullmatch(text):
        raise Wrong(
            f"found {show(text)}", "expected a name of letters, digits, - and _ that starts with a letter, at most 64 long"
        )
    if _RESERVED.fullmatch(text):
        raise Wrong(f"found {show(text)}, a name that some systems reserve for devices", "expected another name")
    return text


def _read_component_name(node):
    if isinstance(node, Scalar) and node.text == "theta":
        raise Wrong('found "theta", which the asset uses for its angles', "expected another name")
    return _read_name(node)


def _read_flag(node):
    node = scalar(node, "true or false")
    if node.quoted or node.text not in ("true", "false"):
        raise Wrong(
            f"found {show(node.text)}", "expected true or false" + (" without quotes" if node.text in ("true", "false") else "")
        )
    return node.text == "true"


def whole(least: int, most: int, auto: bool = False):
    """A whole number; with `auto` also that word."""

    def read(node):
        text = scalar(node, "a whole number").text
        if auto and text == "auto":
            return text
        # 20 digits hold every whole number in question, however many digits the text has
        if node.quoted or not re.fullmatch(r"[-+]?\d{1,20}", text, re.ASCII) or not least <= int(text) <= most:
            limit = f"{most:,}" if most < 2**53 else "2^53"
            raise Wrong(
                f"found {show(text)}",
                ("expected auto or " if auto else "expected ") + f"a whole number from {least} to {limit}"
                + (" without quotes" if node.quoted else ""),
            )
        return int(text)

    number = {"type": "integer", "minimum": least, "maximum": most}
    return leaf(read, {"anyOf": [{"const": "auto"}, number]} if auto else number)


def _read_format(node):
    text = scalar(node, f"the recipe format, {FORMAT}").text
    if text != str(FORMAT) or node.quoted:
        quotes = " without quotes" if node.quoted else ""
        raise Wrong(f"found {show(text)}", f"this version of bakery reads recipe format {FORMAT}{quotes}")
    return FORMAT


Text = leaf(_read_text, {"type": "string"})
Name = leaf(_read_name, {"type": "string", "pattern": f"^{_NAME.pattern}$"})
ComponentName = leaf(_read_component_name, {"type": "string", "pattern": f"^(?!theta$){_NAME.pattern}$"})
Path = leaf(lambda node: scalar(node, "the name of a file").text, {"type": "string"})
Material = leaf(lambda node: scalar(node, "the name of a material").text, {"enum": "materials"})  # filled in by jsonschema.py
Flag = leaf(_read_flag, {"type": "boolean"})
Format = leaf(_read_format, {"const": FORMAT})
Length = number(LENGTH, above=0)
Share = number(FRACTION, above=0, most=1)
