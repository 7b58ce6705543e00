"""Frames of a sequence: the section `frames` of a scene, and numbers of frames as they are asked for.

    frames:
      count: 48
      rate: 24
      camera.origin: {from: [0, -12, 1.7] m, to: [0, -8, 1.7] m}
      materials[0].time: {from: 0 s, to: 2 s}

A frame is the scene with a value in the place of each key, as `--set` would put it there.  Frames count from 1.  Between `from`
and `to`, and places that it goes `through`, values follow a straight line; the first frame has `from` and the last one `to`.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from bakery.errors import Problem, RecipeError, UsageError
from bakery.grammar import overrides, units
from bakery.grammar.fields import Range as Bounds
from bakery.grammar.fields import describe, in_bounds, nearest, one_of, whole, word
from bakery.grammar.problems import Misplaced
from bakery.grammar.text import Mapping, Node, Place, Scalar, Sequence, show
from bakery.grammar.units import NUMBER_ONLY, Wrong

MOST = 100_000  # frames
RATE = 24.0  # a second, unless a scene says so
NOISE = ("same", "fresh")
_OPTIONS = ("count", "rate", "noise")
_SPREAD = ("from", "through", "to")
_EXAMPLE = "a dotted key such as camera.origin or materials[0].time"
_VALUES = "expected a list of one value a frame, or {from: …, to: …}"
_FIXED = {"film": "a film has frames of one size", "frames": "frames have no frames of their own"}
_COUNT, _NOISE = (kind.__metadata__[0].read for kind in (whole(1, MOST), word(*NOISE)))
_UNIT_BEHIND = re.compile(r"(\s*\[)(.*)\]\s*(\S.*)?", re.DOTALL)


# ---- which frames are asked for


def numbers(text: str) -> tuple[int, ...]:
    """Numbers of frames, ascending, each once: of `7`, `1,5,9`, `1-48`, `1-48:2`, or several of these with commas between.

    Raises UsageError.
    """
    asked: set[int] = set()
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,6})(?:\s*-\s*(\d{1,6})(?:\s*:\s*(\d{1,6}))?)?\s*", part, re.ASCII)
        first, last, step = (int(group) if group else default for group, default in zip(match.groups(), (0, 0, 1))) \
            if match else (0, 0, 0)
        last = last if match and match[2] else first
        if not 1 <= first <= last <= MOST or step < 1:
            raise UsageError(f"--frames: found {show(text)}; expected 1-48, 1,5,9 or 1-48:2, of frames from 1 to {MOST:,}")
        asked.update(range(first, last + 1, step))
    return tuple(sorted(asked))


# ---- the section


@dataclass(frozen=True)
class _Key:
    """A key that frames change: how it is written, where, and the nodes that say its values."""

    key: str
    begin: Place
    items: tuple[Node, ...]  # of a spread its ends, and what is between them
    spread: bool

    def problem(self, fault: str, expected: str) -> Problem:
        return self.begin.problem(fault, expected, key=f"frames.{self.key}")

    def node(self, number: int, count: int) -> Node:
        """The value of a frame."""
        if not self.spread:
            return _copied(self.items[number - 1])
        at = (len(self.items) - 1) * (number - 1) / max(count - 1, 1)
        before = min(int(at), len(self.items) - 2)
        return _between(self.items[before], self.items[before + 1], at - before)


@dataclass(frozen=True)
class Frames:
    """The section `frames` of a scene.

    count : of frames, which have the numbers 1 to count; 0 where that is not known, as something is wrong
    rate : of the film, frames a second
    noise : `same` random numbers in all frames, or `fresh` ones in each
    problems : what is wrong with the section
    """

    count: int = 0
    rate: float = RATE
    noise: str = NOISE[0]
    keys: tuple[_Key, ...] = ()
    problems: tuple[Problem, ...] = field(default=(), repr=False)

    def put(self, root: Mapping, number: int, settings) -> tuple[dict[str, str], list[Problem]]:
        """Puts the values of a frame into the tree of its scene; gives them as text by dotted key, and the keys that have no
        place in the tree.

        settings : keys that were set by hand, which no frame may change without a word
        """
        texts, problems = {}, []
        for key in self.keys:
            if by_hand := next((setting for setting in settings if _overlap(setting, key.key)), None):
                problems.append(key.problem(f"found a key that --set {by_hand} gives as well",
                                            f"expected one of them; --set 'frames.{key.key}=…' would change it in all frames"))
                continue
            node = key.node(number, self.count)
            texts[key.key] = overrides.written(node)
            try:
                overrides.put("frames", root, key.key, node)
            except RecipeError as error:
                problems += [key.problem(problem.found, problem.expected) for problem in error.problems]
        return texts, problems


def read(node: Node) -> Frames:
    """The section; raises `Wrong` where it is no mapping."""
    if not isinstance(node, Mapping):
        raise Wrong(f"found {describe(node)}", f"expected keys with values: {_EXAMPLE}, and count")
    options, keys, problems = {}, [], []
    for name, child in node.items():
        begin = node.names[name]
        try:
            if name in _OPTIONS:
                options[name] = _option(name, child)
            elif "." not in name and "[" not in name:
                raise Wrong(f"found {show(name)}, which is neither an option nor a dotted key",
                            f"expected {one_of([*_OPTIONS, _EXAMPLE])}{nearest(name, _OPTIONS)}")
            else:
                keys.append(_key(name, begin, child))
        except Misplaced as wrong:
            problems.append(wrong.problem(f"frames.{name}"))
        except Wrong as wrong:
            problems.append(begin.problem(wrong.found, wrong.expected, wrong.offset, key=f"frames.{name}"))
    problems += _unfit(node, options, keys) if not problems else ()
    lengths = [len(key.items) for key in keys if not key.spread]
    count = options.get("count", lengths[0] if lengths else 0)
    return Frames(0 if problems else count, options.get("rate", RATE), options.get("noise", NOISE[0]), tuple(keys),
                  tuple(problems))


def _unfit(section: Mapping, options: dict, keys: list[_Key]) -> Iterator[Problem]:
    """What is wrong with the keys together."""
    begin = section.parent.names["frames"]
    if not keys:
        yield begin.problem("found no key that changes", f"expected {_EXAMPLE}", key="frames")
        return
    lists = [key for key in keys if not key.spread]
    if "count" not in options and not lists:
        yield begin.problem("missing", "expected count: how many frames there are", key="frames.count")
        return
    count = options.get("count", len(lists[0].items) if lists else 0)
    of = "count" if "count" in options else f"frames.{lists[0].key}"
    for key in lists:
        if len(key.items) != count:
            yield key.problem(f"found {len(key.items)} values", f"expected {count}, as {of} says, one a frame")


def _option(name: str, node: Node):
    try:
        if not isinstance(node, Scalar):
            raise Wrong(f"found {describe(node)}", "expected one value")
        if name == "rate":
            return in_bounds(node.text, NUMBER_ONLY, Bounds(above=0, most=1000), node.quoted)
        return (_COUNT if name == "count" else _NOISE)(node)
    except Wrong as wrong:
        raise Misplaced(wrong, node) from None


def _key(name: str, begin: Place, node: Node) -> _Key:
    fixed = re.split(r"[.\[]", name)[0]
    if fixed in _FIXED:
        raise Wrong("found a key that frames cannot change", f"expected another one: {_FIXED[fixed]}")
    if isinstance(node, Mapping):
        items = tuple(_ends(node))
        for i in range(len(items) - 1):
            _between(items[i], items[i + 1], 0.5)  # says what has nothing between
        return _Key(name, begin, items, True)
    return _Key(name, begin, tuple(_items(node)), False)


def _items(node: Node) -> Iterator[Node]:
    """The entries of a list, also of one with a unit behind it."""
    if isinstance(node, Sequence) and node:
        yield from node
        return
    match = isinstance(node, Scalar) and not node.quoted and _UNIT_BEHIND.fullmatch(node.text)
    if not match:
        raise Misplaced(Wrong(f"found {describe(node)}", _VALUES), node)
    at, unit = len(match[1]), match[3] or ""
    for entry in match[2].split(","):
        begin = node.place.begin + at + len(entry) - len(entry.lstrip())
        yield Scalar(f"{entry.strip()} {unit}", Place(node.place.source, begin, begin + len(entry.strip()), node.place.key))
        at += len(entry) + 1


def _ends(node: Mapping) -> Iterator[Node]:
    """`from`, all that it goes through, and `to`."""
    for name in node:
        if name not in _SPREAD:
            raise Misplaced(Wrong(f"found the unknown key {show(name)}", f"expected {one_of(_SPREAD)}{nearest(name, _SPREAD)}"),
                            node[name])
    for name in ("from", "to"):
        if name not in node:
            raise Misplaced(Wrong(f"found no {name}", "expected {from: 0 s, to: 2 s}"), node)
    yield node["from"]
    if "through" in node:
        yield from _items(node["through"])
    yield node["to"]


# ---- between two values


def _between(start: Node, end: Node, share: float) -> Node:
    """The value at a share of the way from one to another: of numbers with their unit, or of lists of such."""
    if isinstance(start, Sequence) and isinstance(end, Sequence) and len(start) == len(end):
        between = Sequence(_place_of(start), True)
        for a, b in zip(start, end):
            node = _between(a, b, share)
            node.parent = between
            between.append(node)
        return between
    if not (isinstance(start, Scalar) and isinstance(end, Scalar)):
        raise Misplaced(Wrong(f"found {describe(end)} where from or through has {describe(start)}",
                              "expected values of the same form"), end)
    (a, unit), (b, end_unit) = _quantities(start), _quantities(end)
    if unit != end_unit or len(a) != len(b):
        raise Misplaced(Wrong(f"found {show(end.text)} after {show(start.text)}", "expected as many numbers, in the same unit"),
                        end)
    values = [_text(x if share == 0 else y if share == 1 else (1 - share) * x + share * y) for x, y in zip(a, b)]
    written = values[0] if units.NUMBER.match(start.text.strip()) else f"[{', '.join(values)}]"
    return Scalar(f"{written} {unit}".strip(), _place_of(start))


def _quantities(node: Scalar) -> tuple[list[float], str]:
    """The numbers of `5 um` or of `[1, 2, 3] m`, and their unit as it is written."""
    text = node.text.strip()
    match, number = _UNIT_BEHIND.fullmatch(text), units.NUMBER.match(text)
    written = [entry.strip() for entry in match[2].split(",")] if match else [number[0]] if number else []
    if node.broken or not written or not all(units.NUMBER.fullmatch(entry) for entry in written) \
            or max(map(len, written)) > units.MAX_DIGITS:
        raise Misplaced(Wrong(f"found {describe(node)}, which cannot change gradually",
                              "expected a number, or a list of one value a frame"), node)
    return [float(entry) for entry in written], re.sub(r"\s+", "", match[3] or "" if match else text[number.end():])


def _text(value: float) -> str:
    """A number as scenes write it: whole ones without a point, as some keys take no others."""
    return repr(value).removesuffix(".0")


def _place_of(node: Node) -> Place:
    return Place(node.place.source, node.place.begin, node.place.end, "")


def _copied(node: Node) -> Node:
    """A node like another, which can stand elsewhere in the tree."""
    if isinstance(node, Scalar):
        return Scalar(node.text, _place_of(node), node.quoted, node.broken)
    copy = (Mapping if isinstance(node, Mapping) else Sequence)(_place_of(node), True)
    copy.broken = node.broken
    for step, child in node.items() if isinstance(node, Mapping) else enumerate(node):
        below = _copied(child)
        below.parent = copy
        if isinstance(node, Mapping):
            copy[step] = below
            at = node.names[step]
            copy.names[step] = Place(at.source, at.begin, at.end, "")
        else:
            copy.append(below)
    return copy


def _overlap(key: str, second: str) -> bool:
    """Whether two dotted keys are the same, or one stands below the other."""
    short, long = sorted((key, second), key=len)
    return long.startswith(short) and long[len(short):][:1] in ("", ".", "[")
