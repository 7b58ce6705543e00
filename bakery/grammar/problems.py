"""What is wrong with a tree, in words: pydantic's errors become problems with a line, a key, what was found and what would do."""

from collections.abc import Iterator

from pydantic import BaseModel, ValidationError

from bakery.errors import Problem
from bakery.grammar import units
from bakery.grammar.fields import describe, nearest, one_of
from bakery.grammar.section import Section, likely, meant
from bakery.grammar.text import Mapping, Node, Scalar, Sequence, Source, owner, show


class Misplaced(Exception):
    """A `units.Wrong` with the place that it is about."""

    def __init__(self, wrong: units.Wrong, node: Node):
        super().__init__(wrong.found)
        self._wrong, self._node = wrong, node

    def problem(self, key: str) -> Problem:
        """Of a dotted key."""
        wrong, quoted = self._wrong, getattr(self._node, "quoted", False)
        return self._node.place.problem(wrong.found, wrong.expected, wrong.offset + bool(wrong.offset and quoted), key=key)


def distinct(problems: list[Problem]) -> list[Problem]:
    """Each problem once."""
    return list({(p.file, p.line, p.column, p.key, p.found): p for p in problems}.values())


def no_keys(source: Source, root: Node | None, begins: str) -> Problem:
    """What is wrong with a text that is no mapping.  begins : how one begins, in words."""
    content, at = ("nothing", None) if root is None else (describe(root), root.place.begin)
    return source.problem(at, "", f"found {content}", f"expected `key: value` lines; {begins}")


def validated(model: type[BaseModel], root: Mapping) -> tuple[BaseModel | None, dict, list[Problem]]:
    """A tree as a model, None where something is wrong; its well-formed values by dotted key; and what is wrong."""
    values: dict = {}
    try:
        return model.model_validate(root, context=values), values, []
    except ValidationError as error:
        return None, values, [problem for fault in error.errors(include_url=False) for problem in translate(fault)]


def translate(error: dict) -> Iterator[Problem]:
    """One of pydantic's errors in our words."""
    node, kind = error["input"], error["type"]
    if kind == "reported" or node.broken and kind != "extra_forbidden":
        return
    if kind == "wrong":
        context = error["ctx"]
        yield node.place.problem(context["found"], context["expected"], context["offset"])
    elif kind == "missing":
        name = str(error["loc"][-1])
        if name in meant(node) or _elsewhere(node):
            return  # said with the unknown key that stands for it
        description = node.model.model_fields[name].description if node.model else ""
        yield owner(node).problem("missing", f"expected {name}: {_lower(description)}", key=_below(node, name))
    elif kind == "extra_forbidden":
        yield from _unknown(node)
    elif kind == "choice":
        key, *choices = error["msg"].split("|")
        yield _choice(node, key, choices)
    elif kind == "list_type":
        yield owner(node).problem(f"found {describe(node)}", "expected a list")
    elif kind in ("too_short", "too_long"):
        limits = error["ctx"]
        number = limits.get("min_length", limits.get("max_length"))
        yield owner(node).problem(
            f"found {len(node):,} entries", f"expected at {'least' if kind == 'too_short' else 'most'} {number:,}"
        )
    else:  # a mapping is expected
        name = error.get("ctx", {}).get("class_name", "")
        fields = Section.named.get(name)
        keys = f": {', '.join(fields.model_fields)}" if fields else ""
        yield owner(node).problem(f"found {describe(node)}", f"expected keys with values{keys}")


def _lower(description: str) -> str:
    acronym = description[1:2].isupper()  # CSV
    return (description if acronym else description[:1].lower() + description[1:]).rstrip(".")


def _below(node: Mapping, name: str) -> str:
    return f"{node.place.key}.{name}" if node.place.key else name


def _unknown(node: Node) -> Iterator[Problem]:
    parent = node.parent
    name = next(name for name, child in parent.items() if child is node)
    if name == "<<":
        return  # reported as a merge key
    if misplaced := _elsewhere(parent):
        key, *words = misplaced
        if name == key:
            yield owner(node).problem(*words)
        return
    every = list(parent.model.model_fields) if parent.model else []
    near = likely(parent, name)
    hint = f" ({_as_meant(node, name, near)}?)" if near else nearest(name, every)  # which --set may mean, though it is there
    yield owner(node).problem(f"found the unknown key {show(name)}", f"expected {one_of(every)}{hint}")


def _elsewhere(node: Mapping) -> tuple[str, str, str] | None:
    return node.model.elsewhere(node) if node.model else None


def _as_meant(node: Node, name: str, key: str) -> str:
    """The key that an unknown one seems to stand for, with its value where that is said in another way."""
    text = node.text.strip() if isinstance(node, Scalar) else ""
    number = units.NUMBER.match(text)
    if name == "diameter" and number:
        return f"{key}: {float(number[0]) / 2:g}{text[number.end():]}"
    return f"{key}: {{type: hg, g: {text}}}" if (name, key) == ("g", "phase") and number else key


def _choice(node: Node, key: str, choices: list[str]) -> Problem:
    if not key:
        return owner(node).problem(f"found {describe(node)}", f"expected {one_of(choices)}")
    if not isinstance(node, Mapping):
        return owner(node).problem(f"found {describe(node)}", f"expected keys with values, such as {{{key}: {choices[0]}, …}}")
    if key not in node:
        return owner(node).problem("missing", f"expected {key}: {one_of(choices)}", key=_below(node, key))
    chosen = node[key]
    near = nearest(chosen.text, choices) if isinstance(chosen, Scalar) else ""
    return chosen.place.problem(f"found {describe(chosen)}", f"expected {one_of(choices)}{near}")


def places(node: Node) -> Iterator:
    """The place of every key and item below a node."""
    if isinstance(node, Mapping):
        yield from (node.names[name] if not isinstance(child, Scalar) else child.place for name, child in node.items())
        for child in node.values():
            yield from places(child)
    elif isinstance(node, Sequence):
        for child in node:
            yield child.place
            yield from places(child)
