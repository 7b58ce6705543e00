"""YAML text to a tree in which every key and every value knows its line and column.

The tree is built from ruamel.yaml's events, so nothing is resolved behind the user's back: a scalar stays text until a field of
the schema says what it should be.  What a recipe has no use for is refused here: anchors and aliases, tags, merge keys, several
documents, duplicate keys.  Size, depth and number of values are bounded before any work is done on them.
"""

from __future__ import annotations

import os
import re
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field

from bakery.errors import Problem, RecipeError

MAX_BYTES, MAX_LINES, MAX_DEPTH, MAX_NODES = 1 << 20, 50_000, 32, 20_000
ASSET = b"bakery-asset "  # how an asset begins (bakery/store/container.py)
_SHOWN = 140  # characters of a line in a message
_FORBIDDEN = re.compile("[^\t\n\r\x20-\x7e\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]|[\u2028\u2029\ufeff]")
# a list followed by one unit, `[0.84, 0.75, 0.68] mm` or `[1, 2] 1/mm`: never valid YAML otherwise, because text cannot follow
# a closing bracket
_LIST_WITH_UNIT = re.compile(r"""\[[^][{}"'#\0]*\][ \t]*(?:1?[ \t]*/[ \t]*)?"""
                             r"""[^\s\d\0,:#'"&*!|>@`\[\]{}][^\s\0,:#'"\[\]{}]*(?=[ \t]*(?:[,\]}\n\r\0]|[ \t]#|$))""")


def show(text, limit: int = 60) -> str:
    """`text` fit for a terminal: quoted, control and formatting characters escaped, shortened."""
    text = str(text)
    if len(text) > limit:
        text = text[: limit - 1] + "…"
    return '"' + "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text) + '"'


def closest(text: str, names, likeness: float = 0.6) -> str:
    """The nearest known word, or nothing."""
    import difflib

    return next(iter(difflib.get_close_matches(str(text)[:64].lower(), [str(k) for k in names], 1, likeness)), "")


def nearest(text: str, names, likeness: float = 0.6) -> str:
    """` (fog?)`: the nearest known word, or nothing."""
    near = closest(text, names, likeness)
    return f" ({near}?)" if near else ""


@dataclass
class Source:
    """A text that values come from: a file, or an override (then lines are not numbered)."""

    label: str
    text: str = field(repr=False)
    numbered: bool = True

    def __post_init__(self):
        self._starts = [0] + [m.end() for m in re.finditer(r"\r\n|\r|\n", self.text)]

    def position(self, index: int) -> tuple[int, int]:
        """Line and column, from 1."""
        line = bisect_right(self._starts, index)
        return line, index - self._starts[line - 1] + 1

    def excerpt(self, line: int, column: int) -> str:
        """The line with a caret under the column."""
        end = self._starts[line] if line < len(self._starts) else len(self.text)
        text = self.text[self._starts[line - 1] : end].rstrip("\r\n")
        begin = max(0, column - 1 - _SHOWN // 2) if len(text) > _SHOWN else 0
        part = text[begin : begin + _SHOWN]
        shown = "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" if c != "\t" else " " for c in part)
        return f"  {shown}\n  {' ' * (column - 1 - begin)}^"

    def problem(self, index: int | None, key: str, found: str, expected: str = "") -> Problem:
        """A problem at a place of this text (None: no place in particular)."""
        if index is None:
            return Problem(self.label, None, None, key, found, expected)
        line, column = self.position(index)
        excerpt = self.excerpt(line, column)
        return Problem(self.label, *((line, column) if self.numbered else (None, None)), key, found, expected, excerpt)


@dataclass(eq=False)
class Place:
    """Where a node of the tree stands: text, first and last index, dotted key."""

    source: Source
    begin: int
    end: int
    key: str

    def problem(self, found: str, expected: str = "", offset: int = 0, key: str | None = None) -> Problem:
        return self.source.problem(self.begin + offset, self.key if key is None else key, found, expected)

    def __str__(self) -> str:
        if not self.source.numbered:
            return self.source.label
        return f"{self.source.label}:{self.source.position(self.begin)[0]}"


@dataclass(eq=False)
class Scalar:
    """One value as text; `broken` where a problem was already reported and nothing more can be said."""

    text: str
    place: Place
    quoted: bool = False
    broken: bool = False
    parent: Mapping | Sequence | None = field(default=None, repr=False)


class Mapping(dict):
    """Keys in order; `names` holds the place of each key, `model` the part of the schema that it is checked against."""

    def __init__(self, where: Place, flow: bool):
        super().__init__()
        self.place, self.flow, self.names, self.model, self.parent, self.broken = where, flow, {}, None, None, False


class Sequence(list):
    """Items in order."""

    def __init__(self, where: Place, flow: bool):
        super().__init__()
        self.place, self.flow, self.parent, self.broken = where, flow, None, False


Node = Scalar | Mapping | Sequence


def decode(data: bytes, label: str) -> str:
    """The text of a file; RecipeError if it is an asset, too large or no clean UTF-8."""
    if data.startswith(ASSET):
        raise RecipeError([Problem(label, None, None, "", "found an asset",
                                   "expected a recipe, which is text; `bake inspect` shows what an asset holds")])
    if len(data) > MAX_BYTES:
        raise RecipeError([Problem(label, None, None, "", f"found {len(data):,} bytes", f"a recipe has at most {MAX_BYTES:,}")])
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise RecipeError([Problem(label, line, None, "", f"found the byte 0x{data[error.start]:02x}, which is not UTF-8",
                                   "save the recipe as UTF-8")]) from None
    if (lines := len(re.findall(r"\r\n|\r|\n", text))) > MAX_LINES:
        raise RecipeError([Problem(label, None, None, "", f"found {lines:,} lines", f"a recipe has at most {MAX_LINES:,}")])
    for word in text.split():
        if len(word) > 1000 and "!" in word:  # the parser takes time in the square of a tag's length
            raise RecipeError([Source(label, text).problem(text.index(word), "",
                                                           "found a word of more than 1,000 characters with a !",
                                                           "recipes have no tags; write a shorter text")])
    forbidden = list(_forbidden(text, label))
    if forbidden:
        raise RecipeError(forbidden)
    return text


def _forbidden(text: str, label: str):
    source = None
    for count, match in enumerate(_FORBIDDEN.finditer(text)):
        source = source or Source(label, text)
        if count == 20:
            break
        yield source.problem(match.start(), "", f"found the control character U+{ord(match.group()):04X}",
                             "expected text without control characters")


@dataclass
class Tree:
    """The root of a recipe's tree and the problems met while it was built."""

    root: Node | None
    problems: list[Problem] = field(default_factory=list)


def parse(source: Source, key: str = "") -> Tree:
    """The tree of one YAML document; RecipeError where the text cannot be read on.  `key` prefixes the keys of the nodes."""
    import ruamel.yaml
    from ruamel.yaml.error import YAMLError

    class Scanner(ruamel.yaml.scanner.Scanner):
        """Reads a list with a unit as one scalar."""

        def fetch_flow_sequence_start(self):
            match = _LIST_WITH_UNIT.match(self.reader.buffer, self.reader.pointer)
            if match is None:
                return super().fetch_flow_sequence_start()
            self.save_possible_simple_key()
            self.allow_simple_key = False
            begin = self.reader.get_mark()
            self.reader.forward(len(match.group()))
            self.tokens.append(ruamel.yaml.tokens.ScalarToken(match.group(), True, begin, self.reader.get_mark()))

    yaml = ruamel.yaml.YAML(typ="safe", pure=True)
    yaml.Scanner = Scanner
    try:
        return _Builder(source, key).build(yaml.parse(source.text))
    except YAMLError as error:
        raise RecipeError([_syntax_problem(source, error)]) from None
    except (ValueError, OverflowError) as error:  # escapes such as "\U99999999" or %YAML 9999…
        raise RecipeError([source.problem(None, "", f"cannot be read as YAML ({show(error)})",
                                          "expected a plain YAML document")]) from None


_HINTS = (
    ("that cannot start any token", "indent with spaces, and quote text that starts with a special character"),
    ("mapping values are not allowed", "write one `key: value` a line, and quote text that holds a colon"),
    ("could not find expected ':'", "expected `key: value`"),
    ("expected ',' or '}'", "close the brace, or put a comma between the entries"),
    ("expected ',' or ']'", "close the bracket, or put a comma between the entries"),
    ("expected <block end>", "start the keys of one level in the same column"),
    ("while scanning a quoted scalar", "close the quotes"),
)


def _syntax_problem(source: Source, error) -> Problem:
    message = " ".join(str(part) for part in (getattr(error, "context", None), getattr(error, "problem", None)) if part) or str(
        error
    )
    message = re.sub(r"\s+", " ", message)
    marks = [mark for mark in (getattr(error, "problem_mark", None), getattr(error, "context_mark", None)) if mark]
    # where the text ends too early, the place to look at is where the unfinished thing began
    mark = marks[-1 if "stream" in message else 0] if marks else None
    hint = next((hint for part, hint in _HINTS if part in message), "expected a plain YAML document")
    if mark and source.text[: mark.index].rstrip(" \t").endswith("]"):
        hint = 'expected nothing behind the bracket but one unit; quote a list with its unit if in doubt: "[1, 2, 3] mm"'
    shown = "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in message[:160])
    return source.problem(min(mark.index, len(source.text)) if mark else None, "", f"cannot be read as YAML: {shown}", hint)


class _Builder:
    """Events to tree, without recursion."""

    def __init__(self, source: Source, key: str):
        self.source, self.prefix, self.problems, self.count, self.refused = source, key, [], 0, set()
        self.root, self.stack = None, []  # stack of [node, name waiting for its value or None]

    def build(self, events) -> Tree:
        documents = 0
        for event in events:
            kind = type(event).__name__
            if kind == "DocumentStartEvent":
                documents += 1
                if documents > 1:
                    self._report(event, "found a second document", "expected one recipe a file")
                    break
                if event.version or event.tags:
                    self._report(event, "found a % directive", "expected a plain YAML document")
            elif kind in ("ScalarEvent", "AliasEvent", "MappingStartEvent", "SequenceStartEvent"):
                self._node(event, kind)
            elif kind in ("MappingEndEvent", "SequenceEndEvent"):
                node, _ = self.stack.pop()
                node.place.end = event.end_mark.index
        return Tree(self.root, self.problems)

    def _report(self, event, found: str, expected: str, key: str = "") -> None:
        if len(self.problems) < 100:
            self.problems.append(self.source.problem(min(event.start_mark.index, len(self.source.text)), key, found, expected))

    def _node(self, event, kind: str) -> None:
        self.count += 1
        if self.count > MAX_NODES:
            self._stop(event, f"found more than {MAX_NODES:,} values", "expected a smaller recipe; long tables go into CSV files")
        if len(self.stack) >= MAX_DEPTH and kind != "ScalarEvent":
            self._stop(event, f"found more than {MAX_DEPTH} levels of nesting", "expected fewer lists and keys inside each other")
        parent = self.stack[-1] if self.stack else None
        if parent and isinstance(parent[0], Mapping) and parent[1] is None:
            self._name(event, kind, parent)
            return
        key = self._key(parent)
        where = Place(self.source, event.start_mark.index, event.end_mark.index, key)
        self._refuse(event, kind, key)
        if kind == "ScalarEvent":
            node = Scalar(event.value, where, quoted=event.style in ("'", '"', "|", ">"), broken=_special(event))
        elif kind == "AliasEvent":
            node = Scalar("", where, broken=True)
        else:
            node = (Mapping if kind == "MappingStartEvent" else Sequence)(where, bool(event.flow_style))
            node.broken = _special(event)
        self._attach(node, parent)
        if not isinstance(node, Scalar):
            self.stack.append([node, None])

    def _stop(self, event, found: str, expected: str) -> None:
        self._report(event, found, expected)
        raise RecipeError(self.problems[-1:])

    def _name(self, event, kind: str, parent: list) -> None:
        """The event stands where a key is expected."""
        mapping = parent[0]
        if kind != "ScalarEvent":
            self._stop(event, "found a key that is no plain word", "expected `key: value`")
        name, key = event.value, join(mapping.place.key, event.value)
        self._refuse(event, kind, key)
        if name == "<<":
            self._report(event, "found the merge key <<", "write the values out", key)
        if name in mapping.names:
            self._report(event, f"found the key a second time (first in {mapping.names[name]})", "give each key once", key)
        else:
            mapping.names[name] = Place(self.source, event.start_mark.index, event.end_mark.index, key)
        parent[1] = name

    def _refuse(self, event, kind: str, key: str) -> None:
        """What recipes have no use for; the first of each kind says it for all."""
        if kind == "AliasEvent":
            feature, shown = "alias", "*" + event.anchor
        elif _special(event):
            feature, shown = "tag", str(event.tag)
        elif event.anchor:
            feature, shown = "anchor", "&" + event.anchor
        else:
            return
        if feature not in self.refused:
            self.refused.add(feature)
            self._report(event, f"found the {feature} {show(shown)}",
                         f"recipes have no {feature}{'es' if feature == 'alias' else 's'}; write the value out", key)

    def _key(self, parent: list | None) -> str:
        if parent is None:
            return self.prefix
        node, name = parent
        return f"{node.place.key}[{len(node)}]" if isinstance(node, Sequence) else join(node.place.key, name)

    def _attach(self, node: Node, parent: list | None) -> None:
        node.parent = parent and parent[0]
        if parent is None:
            self.root = node
        elif isinstance(parent[0], Sequence):
            parent[0].append(node)
        else:
            parent[0].setdefault(parent[1], node)  # a key's second value was reported with the key
            parent[1] = None


def _special(event) -> bool:
    """Whether the node carries a tag that its author wrote."""
    return getattr(event, "tag", None) is not None


def join(key: str, name: str) -> str:
    """The dotted key of a name below a key, fit for messages."""
    shown = name if re.fullmatch(r"[\w-]{1,64}", name) else show(name)
    return f"{key}.{shown}" if key else shown


def owner(node: Node) -> Place:
    """The place to speak of when something is missing in a node: its key, or itself in a list and at the top."""
    if isinstance(node.parent, Mapping):
        return next((node.parent.names[name] for name, child in node.parent.items() if child is node), node.place)
    return node.place


def label_of(path) -> str:
    """A path as the user gave it, fit for messages."""
    return show(os.fspath(path), 400)[1:-1]


def mappings(*nodes: Node | None) -> Iterator[Mapping]:
    """Those of the nodes that are mappings."""
    return (node for node in nodes if isinstance(node, Mapping))
