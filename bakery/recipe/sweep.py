"""The key `sweep`: several values of some keys, each combination of which is a recipe of its own.

The values are put into the tree where they belong, so whatever a section says of one names the line on which it stands.
"""

import math
import re
from collections import Counter
from collections.abc import Sequence as SequenceOf
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from bakery.errors import Problem, RecipeError
from bakery.family.axes import Axis, Sweep, Swept
from bakery.grammar import units
from bakery.grammar.fields import Flag, Range, describe, in_bounds, nearest, one_of, whole, word
from bakery.grammar.overrides import put
from bakery.grammar.problems import Misplaced, distinct
from bakery.grammar.text import Mapping, Node, Place, Scalar, Sequence, Source, Tree, show
from bakery.grammar.units import FRACTION, Quantity, Wrong
from bakery.recipe.build import check
from bakery.recipe.model import Recipe

MOST_POINTS, MOST_KEYS = 10_000, 4
_PROBES = 200  # recipes that are checked whole before anything is baked; the others when their turn comes
_CLOSE = 1e-6  # relative distance of two values below which they are no two points
_OPTIONS = ("combine", "refine", "tolerance")
_RANGE = ("from", "to", "count")
_EXAMPLE = "a dotted key such as particles.components.droplets.size.radius"
_COUNT, _COMBINE = whole(2, MOST_POINTS), word("product", "zip")


@dataclass
class _Key:
    """A swept key as it is written: its place, and a text, a place and a value in SI units for each point."""

    written: str
    place: Place
    quantity: Quantity
    texts: list[str]
    places: list[Place]
    values: list[float]
    key: str = ""

    def node(self, index: int) -> Scalar:
        where = self.places[index]
        return Scalar(self.texts[index], Place(where.source, where.begin, where.end, ""))

    def problem(self, fault: str, expected: str) -> Problem:
        return self.place.problem(fault, expected, key=f"sweep.{self.written}")


@dataclass
class _Read:
    """What stands below `sweep`, and what is wrong with it."""

    keys: list[_Key] = field(default_factory=list)
    options: dict = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)


def sweeps(tree: Tree) -> bool:
    """Whether a recipe has several points."""
    return isinstance(tree.root, Mapping) and isinstance(tree.root.get("sweep"), Mapping)


def checked(path: Path, source: Source, tree: Tree, text: str, problems: list[Problem], keep_going: bool = False) -> Recipe:
    """The recipe of the first point of a sweep, and the sweep; arguments as of `build.check`.

    keep_going : points that are wrong are left to their turn, where others are not

    All values of each key are tried, up to 200 recipes.  Raises RecipeError with every problem.
    """
    read = _read(tree.root["sweep"])
    groups = _groups(read)
    read.problems += _unfit(read, groups)
    if read.problems:
        raise RecipeError(distinct(tree.problems + problems + read.problems))
    first, wrong = None, []  # of the points that are wrong: what is swept there, and the problems
    probes = list(_probes([len(group[0].values) for group in groups]))
    for indices in probes:
        swept = [(key, index) for group, index in zip(groups, indices, strict=True) for key in group]
        try:
            for key, index in swept:
                key.key = _put(tree.root, key, index)
            recipe = check(path, source, tree, text, problems)
            first = first or recipe
        except RecipeError as error:
            wrong.append((swept, error.problems))
    faults = [] if keep_going and first else _described(wrong, len(probes))
    for key in read.keys if not faults else ():
        faults += _fixed(key, first)
    faults += _twice(read.keys) if not faults else ()
    if faults:
        raise RecipeError(distinct(faults))
    names = _names([key.key for key in read.keys])
    axes = tuple(Axis(tuple(Swept(key.key, names[key.key], key.quantity.base, tuple(key.texts), tuple(key.values))
                            for key in group)) for group in groups)
    tolerance = read.options.get("tolerance", first.tolerance)
    where = {key.key: f"{key.place}: sweep.{key.written}" for key in read.keys}
    return replace(first, sweep=Sweep(axes, tolerance, read.options.get("refine", True), where))


def json_schema() -> dict:
    """What editors know of the key."""
    value = {"anyOf": [{"type": "number"}, {"type": "string"}]}
    spread = {"type": "object", "additionalProperties": False, "required": list(_RANGE), "properties": {
        "from": value, "to": value, "count": {"type": "integer", "minimum": 2, "maximum": MOST_POINTS}}}
    return {"anyOf": [{"enum": ["none"]}, {
        "type": "object", "additionalProperties": False,
        "properties": {
            "tolerance": {**value, "description": "Error of the interpolation between points."},
            "refine": {"type": "boolean", "description": "Whether points are added where that error is too large."},
            "combine": {"enum": ["product", "zip"], "description": "Every combination of the values, or all keys in step."}},
        "patternProperties": {r"^[^.]+\..+$": {"anyOf": [value, {"type": "array", "items": value}, spread]}}}]}


# ---- what is written


def _read(section: Mapping) -> _Read:
    read = _Read()
    for name, node in section.items():
        where = section.names[name]
        try:
            if name in _OPTIONS:
                read.options[name] = _option(name, node)
            elif "." in name:
                read.keys.append(_key(name, where, node))
            else:
                read.problems.append(_unknown(name, where))
        except Misplaced as wrong:
            read.problems.append(wrong.problem(f"sweep.{name}"))
    if not read.keys and not read.problems:
        read.problems.append(section.parent.names["sweep"].problem("found no key to sweep", f"expected {_EXAMPLE}, or none"))
    return read


def _unknown(name: str, where: Place) -> Problem:
    common = name in ("bakery", "name", "description", "wavelengths", "seed", "tolerance", "measure")
    fault = f"found {show(name)}, which " + ("cannot be swept" if common else "is neither an option nor a dotted key")
    return where.problem(fault, f"expected {one_of([*_OPTIONS, _EXAMPLE])}" + nearest(name, _OPTIONS), key=f"sweep.{name}")


def _value(kind, node: Node):
    """A value of one of the schema's kinds."""
    return kind.__metadata__[0].read(node)


def _option(name: str, node: Node):
    try:
        if not isinstance(node, Scalar):
            raise Wrong(f"found {describe(node)}", "expected one value")
        if name == "tolerance":
            return in_bounds(node.text, FRACTION, Range(least=1e-6, most=0.5), node.quoted)
        return _value(Flag if name == "refine" else _COMBINE, node)
    except Wrong as wrong:
        raise Misplaced(wrong, node) from None


def _key(name: str, where: Place, node: Node) -> _Key:
    items = list(_spread(node)) if isinstance(node, Mapping) else list(_items(node))
    quantity = _numbers(items[0])[0]
    values = []
    for item in items:
        numbers, value = _numbers(item)
        if numbers is not quantity:
            raise Misplaced(Wrong(f"found {show(item.text)} beside {show(items[0].text)}",
                                  f"expected {quantity.plural} throughout"), item)
        values.append(value)
    return _Key(name, where, quantity, [item.text for item in items], [item.place for item in items], values)


def _numbers(item: Node) -> tuple[Quantity, float]:
    """Quantity and value in SI units of one entry."""
    try:
        if not isinstance(item, Scalar):
            raise Wrong(f"found {describe(item)}", "expected a number")
        if "," in item.text:
            raise Wrong(f"found {describe(item)}, several values", f"expected a list: [{item.text}]")
        if item.broken or not units.NUMBER.match(item.text.strip()):
            raise Wrong(f"found {describe(item)}", "expected a number: only numbers can be interpolated")
        quantity = units.quantity_of(item.text)
        return quantity, units.parse(item.text, quantity)
    except Wrong as wrong:
        raise Misplaced(wrong, item) from None


def _items(node: Node):
    """The entries of a list, of a list with one unit behind it, or a single one."""
    if isinstance(node, Sequence):
        if not node:
            raise Misplaced(Wrong("found an empty list", "expected values"), node)
        yield from node
        return
    match = re.fullmatch(r"(\s*\[)(.*)\]\s*(\S.*)?", node.text, re.DOTALL)
    if not match:
        yield node
        return
    at, unit = len(match[1]) + node.quoted, match[3] or ""
    for entry in match[2].split(","):
        begin = node.place.begin + at + len(entry) - len(entry.lstrip())
        where = Place(node.place.source, begin, begin + len(entry.strip()), node.place.key)
        if not units.NUMBER.fullmatch(entry.strip()):
            raise Misplaced(Wrong(f"found {show(entry.strip())} in a list with one unit",
                                  f"expected numbers, as in [1, 2, 3] {unit}"), Scalar(entry, where))
        yield Scalar(f"{entry.strip()} {unit}".strip(), where)
        at += len(entry) + 1


def _spread(node: Mapping):
    """The entries of {from, to, count}: in equal steps of the logarithm where both ends are positive, else of the value."""
    for name in node:
        if name not in _RANGE:
            raise Misplaced(Wrong(f"found the unknown key {show(name)}", f"expected {one_of(_RANGE)}" + nearest(name, _RANGE)),
                            node[name])
    for name in _RANGE:
        if name not in node:
            raise Misplaced(Wrong(f"found no {name}", "expected {from: 2 um, to: 16 um, count: 4}"), node)
    (quantity, low), (second_quantity, high) = _numbers(node["from"]), _numbers(node["to"])
    if second_quantity is not quantity:
        raise Misplaced(Wrong(f"found {show(node['to'].text)} beside {show(node['from'].text)}",
                              f"expected {quantity.plural} throughout"), node["to"])
    try:
        count = _value(_COUNT, node["count"])
    except Wrong as wrong:
        raise Misplaced(wrong, node["count"]) from None
    inner = (np.geomspace if min(low, high) > 0 else np.linspace)(low, high, count)[1:-1]
    yield node["from"]
    yield from (Scalar(f"{float(value)!r} {quantity.base}".removesuffix(" 1"), node["from"].place) for value in inner)
    yield node["to"]


# ---- what holds


def _groups(read: _Read) -> list[list[_Key]]:
    """The keys of each axis, in an order that the order in the recipe does not change; first the one whose values ascend."""
    keys = sorted(read.keys, key=lambda key: key.written)
    if read.options.get("combine") != "zip":
        return [[key] for key in keys]
    return [sorted(keys, key=lambda key: key.values != sorted(key.values))]


def _unfit(read: _Read, groups: SequenceOf[list[_Key]]):
    """What is wrong with the keys together."""
    for group in groups:
        for key in group:
            if len(key.values) != len(group[0].values):
                yield key.problem(f"found {len(key.values)} values beside {len(group[0].values)} of sweep.{group[0].written}",
                                  "expected as many: with combine: zip all keys take theirs in step")
        for i, (value, next_) in enumerate(zip(group[0].values, group[0].values[1:]) if group else ()):
            if not next_ - value > _CLOSE * max(abs(value), abs(next_)):
                yield group[0].problem(f"found {show(group[0].texts[i + 1])} after {show(group[0].texts[i])}",
                                       "expected ascending values")
                break
    count = math.prod(len(group[0].values) for group in groups if group)
    if len(read.keys) > MOST_KEYS:
        yield read.keys[MOST_KEYS].problem(f"found {len(read.keys)} keys", f"expected at most {MOST_KEYS}")
    elif count > MOST_POINTS:
        yield read.keys[0].problem(f"found {count:,} points", f"expected at most {MOST_POINTS:,}")


def _probes(lengths: SequenceOf[int]):
    """Index of a value on each axis: all first ones, then all others of one axis after the other, or some of them."""
    yield (0,) * len(lengths)
    per_key = max(_PROBES // max(len(lengths), 1), 2)
    for axis, length in enumerate(lengths):
        for index in sorted(set(np.linspace(1, length - 1, min(per_key, length - 1)).astype(int).tolist())) if length > 1 else ():
            yield tuple(index if i == axis else 0 for i in range(len(lengths)))


def _described(wrong: SequenceOf[tuple[list[tuple[_Key, int]], list[Problem]]], points: int) -> list[Problem]:
    """The problems of all points; those of some say which values are swept there, where another key is blamed."""
    counts = Counter(replace(problem, excerpt="") for _, problems in wrong for problem in distinct(problems))
    told, seen = [], set()
    for swept, problems in wrong:
        values = ", ".join(f"{key.written} is {key.texts[index]}" for key, index in swept)
        for problem in problems:
            same = replace(problem, excerpt="")
            if same in seen:
                continue
            seen.add(same)
            # its own value is in the message, and what is wrong everywhere is no matter of the sweep
            plain = counts[same] == points or any(problem.key in (key.key, f"sweep.{key.written}") for key, _ in swept)
            told.append(problem if plain else replace(problem, found=f"{problem.found}, where the sweep says that {values}"))
    return told


def _put(root: Mapping, key: _Key, index: int) -> str:
    try:
        return put("sweep", root, key.written, key.node(index))
    except RecipeError as error:
        raise RecipeError([key.problem(problem.found, problem.expected) for problem in error.problems]) from None


def _fixed(key: _Key, recipe: Recipe):
    """What speaks against a key that takes its values."""
    value = recipe.leaves.get(key.key, recipe.leaves.get(f"{key.key}[0]"))
    if not isinstance(value, float):
        yield key.problem("found a key that cannot be swept",
                          "expected one that takes any number in a range, such as a radius, a density, an albedo")


def _twice(keys: SequenceOf[_Key]):
    """Keys that are one, written in two ways."""
    first = {}
    for key in keys:
        earlier = first.setdefault(key.key, key)
        if earlier is not key:
            yield key.problem(f"found the key of sweep.{earlier.written} once more", "expected each key once")


def _names(keys: SequenceOf[str]) -> dict[str, str]:
    """Short names of dotted keys: their last words, as many as make them distinct."""
    words = {key: re.findall(r"\w+", key) for key in keys}
    count = 1
    while len({tuple(parts[-count:]) for parts in words.values()}) < len(words):
        count += 1
    return {key: "_".join(parts[-count:])[-64:] for key, parts in words.items()}
