"""Kinds of values that a key may have: the leaves of the schema.

Each is a pydantic type that takes a `Scalar` of the tree (or, for lists, a `Sequence`), returns the value in base units, and
carries the JSON Schema that an editor needs.  A value that is well formed is also noted under its dotted key in the validation
context, so that the checks between keys (`recipe.checker`) can run even where another part of the recipe is wrong.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection
from typing import Annotated, Any

from pydantic import BeforeValidator, Discriminator, Field, Tag
from pydantic_core import PydanticCustomError, core_schema

from bakery.grammar import units
from bakery.grammar.text import Mapping, Scalar, Sequence, nearest, show
from bakery.grammar.units import FRACTION, LENGTH, NUMBER_ONLY, Quantity, Wrong

FORMAT = 1
SUM_OF_SHARES = 1e-6  # how far it may be from 1
AUTO = {"auto": "auto"}
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,63}", re.ASCII)
_RESERVED = re.compile(r"(?i)con|prn|aux|nul|com\d|lpt\d")
_NUMBER = r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?"


def _raise(found: str, expected: str, offset: int = 0):
    raise PydanticCustomError("wrong", "wrong", {"found": found, "expected": expected, "offset": offset})


def describe(node: Any) -> str:
    """What stands at a node, in words."""
    if isinstance(node, Mapping):
        return "keys with values"
    if isinstance(node, Sequence):
        return "a list"
    return "nothing" if is_null(node) else show(node.text)


def is_null(node: Any) -> bool:
    """Whether a key is there without a value."""
    return isinstance(node, Scalar) and not node.quoted and node.text in ("", "~", "null", "Null", "NULL")


def scalar(node: Any, expected: str) -> Scalar:
    if node.broken:
        raise PydanticCustomError("reported", "reported")
    if not isinstance(node, Scalar) or is_null(node):
        _raise(f"found {describe(node)}", f"expected {expected}")
    return node


class Leaf:
    """How pydantic sees a value: as its own core schema, which takes less time than to let it look at a function.

    `quantity` and `bounds` of a number give tests its smallest and its largest value.
    """

    def __init__(self, read: Callable, json: dict, quantity: Quantity | None = None, bounds: Range | None = None):
        self.read, self.json, self.quantity, self.bounds = read, json, quantity, bounds

    def __get_pydantic_core_schema__(self, source, handler):
        return core_schema.with_info_plain_validator_function(self.validate)

    def __get_pydantic_json_schema__(self, schema, handler):
        return dict(self.json)

    def validate(self, node: Any, info) -> Any:
        try:
            value = self.read(node)
        except Wrong as wrong:
            _raise(wrong.found, wrong.expected, wrong.offset + bool(wrong.offset and node.quoted))
        info.context[node.place.key] = value
        return value


def leaf(read, schema: dict, quantity: Quantity | None = None, bounds: Range | None = None):
    """A field type: `read(node)` gives the value, which is noted under the node's key."""
    return Annotated[Any, Leaf(read, schema, quantity, bounds)]


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

    def in_degrees(self) -> Range:
        """The same of angles in rad, which people write in degrees."""
        limits = self.above, self.least, self.below, self.most
        return Range(*(limit if limit is None else math.degrees(limit) for limit in limits))

    def schema(self) -> dict:
        limits = {"exclusiveMinimum": self.above, "minimum": self.least, "exclusiveMaximum": self.below, "maximum": self.most}
        return {name: value for name, value in limits.items() if value is not None}

    def __str__(self) -> str:
        low = f"above {self.above:g}" if self.above is not None else f"at least {self.least:g}" if self.least is not None else ""
        high = f"below {self.below:g}" if self.below is not None else f"at most {self.most:g}" if self.most is not None else ""
        return " and ".join(part for part in (low, high) if part)


def in_bounds(text: str, quantity: Quantity, bounds: Range, quoted: bool = False, words: dict | None = None,
              hint: Callable[[float], str] | None = None) -> float:
    """The value of a text within bounds; `hint` says of a value out of bounds what it may mean."""
    value = units.parse(text, quantity)
    if quoted and units.NUMBER.fullmatch(text.strip()):
        raise Wrong(f"found the quoted number {show(text)}, which is text", f"expected {text.strip()} without quotes")
    if not bounds.holds(value):
        unit = "" if quantity.base == "1" else f" {quantity.base}"
        bounds, unit = (bounds.in_degrees(), " deg") if quantity.degrees else (bounds, unit)
        expected = one_of([*(words or ()), f"{quantity.one} {bounds}{unit}"])
        hint_text = hint(value) if hint else _percent(text, [value], quantity, bounds)
        raise Wrong(f"found {show(text)}", f"expected {expected}{hint_text}")
    return value


def _percent(text: str, values: Collection[float], quantity: Quantity, bounds: Range) -> str:
    """` (90 %?)`: bare numbers that would do in percent, or nothing."""
    if quantity is not FRACTION or "%" in text or not all(bounds.holds(value / 100) for value in values):
        return ""
    # an albedo of 1.1 is a slip, not a percentage
    return f" ({text.strip()} %?)" if max(values) >= 2 * (bounds.most or bounds.below) else ""


def _words(words: dict | None) -> list[dict]:
    return [{"enum": list(words)}] if words else []


def _patterns(quantity: Quantity, bounds: Range) -> list[dict]:
    spelled = [re.sub("^/", "1?/", re.escape(unit)) for unit in quantity.powers]
    spelled += [micro + re.escape(unit[1:]) for unit in quantity.powers if unit[0] == "u" for micro in "µμ"]
    text = {"type": "string", "pattern": rf"^\s*{_NUMBER}\s*({'|'.join(spelled)})\s*$"}
    return ([{"type": "number", **bounds.schema()}] if quantity.bare else []) + ([text] if quantity.powers else [])


def number(quantity: Quantity = NUMBER_ONLY, words: dict | None = None, hint: Callable[[float], str] | None = None, **bounds):
    """One value of a quantity, or one of a few words that stand for values; `hint` as in `in_bounds`."""
    limits = Range(**bounds)
    expected = one_of([*(words or ()), units.example(quantity)])

    def read(node):
        node = scalar(node, expected)
        if words and node.text in words:
            return words[node.text]
        if words and not units.NUMBER.match(node.text.strip()):
            raise Wrong(f"found {show(node.text)}", f"expected {expected}" + nearest(node.text, words))
        return in_bounds(node.text, quantity, limits, node.quoted, words, hint)

    return leaf(read, {"anyOf": _words(words) + _patterns(quantity, limits)}, quantity, limits)


def numbers(quantity: Quantity = NUMBER_ONLY, words: dict | None = None, most_entries: int = 4096, steps: bool = False, **bounds):
    """One value, a list of values, or a list with one unit behind it; several floats in any case.

    steps : `{from: …, to: …, count: …}` gives values in equal steps, too
    """
    limits = Range(**bounds)

    def read(node):
        node = scalar(node, f"{units.example(quantity)} or a list")
        if words and node.text in words:
            return words[node.text]
        if words and not units.NUMBER.match(node.text.strip()) and not units.is_list(node.text):
            raise Wrong(f"found {show(node.text)}", f"expected {', '.join(words)}, {units.example(quantity)}, or a list"
                        + nearest(node.text, words))
        if not units.is_list(node.text):
            return (in_bounds(node.text, quantity, limits, node.quoted),)
        values = units.parse_list(node.text, quantity)
        if len(values) > most_entries:
            raise Wrong(f"found {len(values):,} entries", f"expected at most {most_entries:,}")
        if not all(limits.holds(value) for value in values):
            percent = _percent(node.text, values, quantity, limits)
            raise Wrong(f"found {show(node.text)}", f"expected {quantity.plural} {limits}{percent}")
        return values

    text = {"anyOf": _words(words) + _patterns(quantity, limits) + [{"type": "string", "pattern": r"^\s*\[.*\]\s*\S*\s*$"}]}
    listed = Annotated[list[number(quantity, **bounds)], Field(min_length=1, max_length=most_entries)]
    kinds = Annotated[leaf(read, text, quantity, limits), Tag("text")] | Annotated[listed, Tag("list")]
    if steps:
        kinds |= Annotated[_in_steps(quantity, limits, most_entries), Tag("steps")]
    return Annotated[kinds, Discriminator(lambda node: "list" if isinstance(node, (Sequence, list)) else
                                          "steps" if steps and isinstance(node, Mapping) else "text")]


def three(entry):
    """A list of exactly three entries of a kind."""
    return Annotated[list[entry], Field(min_length=3, max_length=3), BeforeValidator(_of_three)]


def _of_three(node):
    if isinstance(node, Sequence) and not node.broken and len(node) != 3:
        _raise(f"found {len(node):,} {'entry' if len(node) == 1 else 'entries'}", "expected 3")
    return node


def _in_steps(quantity: Quantity, limits: Range, most: int):
    """`{from: …, to: …, count: …}`: values in equal steps, both ends among them."""
    names = ("from", "to", "count")

    def read(node):
        for name in node:
            if name not in names:
                raise Wrong(f"found the unknown key {show(name)}", f"expected {one_of(names)}" + nearest(name, names))
        if lacking := [name for name in names if name not in node]:
            raise Wrong(f"found no {lacking[0]}", "expected {from: …, to: …, count: …}")
        low, high = (in_bounds(scalar(node[name], units.example(quantity)).text, quantity, limits) for name in ("from", "to"))
        count = _whole(scalar(node["count"], "a whole number").text)
        if count is None or not 2 <= count <= most:
            raise Wrong(f"found {describe(node['count'])} as count", f"expected a whole number from 2 to {most:,}")
        if low == high:
            raise Wrong("found the same from and to", "expected two values")
        inner = (low + (high - low) * step / (count - 1) for step in range(1, count - 1))
        return low, *inner, high

    return leaf(read, {"type": "object", "required": list(names), "additionalProperties": False, "properties": {
        "from": {"anyOf": _patterns(quantity, limits)}, "to": {"anyOf": _patterns(quantity, limits)},
        "count": {"type": "integer", "minimum": 2, "maximum": most}}})


def word(*choices: str, otherwise: str = ""):
    """One of a few words; `otherwise` says what may stand in their place."""
    expected = one_of(choices) + (f", {otherwise}" if otherwise else "")

    def read(node):
        text = scalar(node, expected).text
        if text not in choices:
            raise Wrong(f"found {show(text)}", f"expected {expected}" + nearest(text, choices))
        return text

    return leaf(read, {"enum": list(choices)})


def takes_auto(field) -> bool:
    """Whether a field is a number that may be left to the stage (auto): a word among others stays a word."""
    return any({"enum": ["auto"]} in getattr(part, "json", {}).get("anyOf", ()) for part in field.metadata)


def one_of(choices) -> str:
    return ", ".join(choices[:-1]) + f" or {choices[-1]}" if len(choices) > 1 else str(choices[0])


def _read_name(node):
    text = scalar(node, "a name").text
    if not _NAME.fullmatch(text):
        raise Wrong(f"found {show(text)}",
                    "expected a name of letters, digits, - and _ that starts with a letter, at most 64 long")
    if _RESERVED.fullmatch(text):
        raise Wrong(f"found {show(text)}, a name that some systems reserve for devices", "expected another name")
    return text


def component_name(**taken: str):
    """A name that is none of those that the asset has taken, which are given with what for."""

    def read(node):
        if isinstance(node, Scalar) and node.text in taken:
            raise Wrong(f"found {show(node.text)}, which the asset uses for {taken[node.text]}", "expected another name")
        return _read_name(node)

    return leaf(read, {"type": "string", "pattern": f"^(?!({'|'.join(taken)})$){_NAME.pattern}$"})


def _read_flag(node):
    node = scalar(node, "true or false")
    if node.quoted or node.text not in ("true", "false"):
        quotes = " without quotes" if node.text in ("true", "false") else ""
        raise Wrong(f"found {show(node.text)}", f"expected true or false{quotes}")
    return node.text == "true"


def whole(least: int, most: int, words: dict | None = None):
    """A whole number, or one of a few words that stand for values."""
    limit = f"{most:,}" if most < 2**53 else "2^53"
    expected = one_of([*(words or ()), f"a whole number from {least:,} to {limit}"])

    def read(node):
        text = scalar(node, expected if words else "a whole number").text
        if words and text in words:
            return words[text]
        value = None if node.quoted else _whole(text)
        if value is None or not least <= value <= most:
            near = nearest(text, words) if words else ""
            raise Wrong(f"found {show(text)}", f"expected {expected}" + (" without quotes" if node.quoted else "") + near)
        return value

    number = {"type": "integer", "minimum": least, "maximum": most}
    return leaf(read, {"anyOf": [*_words(words), number]} if words else number)


def _whole(text: str) -> int | None:
    """The whole number of a text such as 1000 or 1e12; None where it says none."""
    # 20 digits hold every whole number in question, however many digits the text has
    match = re.fullmatch(r"([-+]?\d{1,20})(?:[eE]\+?(\d{1,2}))?", text, re.ASCII)
    return int(match[1]) * 10 ** int(match[2] or 0) if match else None


def _read_format(node):
    text = scalar(node, f"the recipe format, {FORMAT}").text
    if text != str(FORMAT) or node.quoted:
        quotes = " without quotes" if node.quoted else ""
        raise Wrong(f"found {show(text)}", f"this version of bakery reads recipe format {FORMAT}{quotes}")
    return FORMAT


Text = leaf(lambda node: scalar(node, "a line of text").text, {"type": "string"})
Name = leaf(_read_name, {"type": "string", "pattern": f"^{_NAME.pattern}$"})
ComponentName = component_name(theta="its angles")
GrainName = component_name(theta="its angles", radius="the radii", radius_share="the shares of the radii")
Path = leaf(lambda node: scalar(node, "the name of a file").text, {"type": "string"})
Material = leaf(lambda node: scalar(node, "the name of a material").text, {"enum": "materials"})  # filled in by jsonschema.py
Flag = leaf(_read_flag, {"type": "boolean"})
Format = leaf(_read_format, {"const": FORMAT})


def _geometric(value: float) -> str:
    hint = f"; exp({value:g}) = {math.exp(value):.4g} where {value:g} is that of ln r" if 0 < value < 1 else ""
    return f", the geometric standard deviation{hint}"


GeometricDeviation = number(above=1, most=10, hint=_geometric)
Length = number(LENGTH, above=0)
Share = number(FRACTION, above=0, most=1)
