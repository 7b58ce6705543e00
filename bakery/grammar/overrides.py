"""Values given on the command line (`--set KEY=VALUE`): into the tree, and into the text that the asset keeps.

The tree takes the new nodes as they are, so a problem in one names `--set KEY` and all others keep the lines of the file.  The
text is edited in place, so that comments stay and the asset's recipe alone gives the same values.
"""

import json
import re
from collections.abc import Mapping as MappingType

from bakery.errors import Problem, RecipeError
from bakery.grammar import text
from bakery.grammar.text import Mapping, Node, Place, Scalar, Sequence, Source, Tree, show

_STEP = re.compile(r"([^.\[\]]+)|\[(\d{1,6})\]")
_OF_KEYS = ("sweep.", "frames.")  # what stands below is a key itself: one step, dots and all
_PLAIN = re.compile(r"~|[-+.]?[\w/][\w/+.^%µμ° -]*", re.ASCII)


def apply(source: Source, tree: Tree, overrides: MappingType[str, str]) -> tuple[str, list[Problem]]:
    """Put the overrides into the tree; returns the text with all of them and the problems met."""
    edited, problems = source.text, []
    for key, value in overrides.items():
        label = f"--set {show(key, 200)[1:-1]}"
        try:
            path = _path(label, key)
            new = _value(label, key, str(value))
            if isinstance(tree.root, Mapping):
                path = _put(label, tree.root, path, new)
                edited = _edit(source.label, edited, path, new)
        except RecipeError as error:
            problems += error.problems
    if overrides and not problems and not _same(text.parse(Source(source.label, edited)).root, tree.root):
        raise _wrong("--set", "found a recipe whose layout leaves no place for the value", "change the value in the file")
    return edited, problems


def put(label: str, root: Mapping, key: str, new: Node) -> str:
    """Replace or add the node at a dotted key; returns the key with the indices of named items.

    Raises RecipeError, in the name of `label`, where the tree has no place for it.
    """
    return _dotted(_put(label, root, _path(label, key), new))


def _wrong(label: str, found: str, expected: str) -> RecipeError:
    return RecipeError([Problem(label, None, None, "", found, expected)])


def _path(label: str, key: str) -> list[str | int]:
    path, at = [], 0
    for above in _OF_KEYS:
        if key.startswith(above) and len(key) > len(above):
            return [above[:-1], key[len(above):]]
    while at < len(key):
        match = _STEP.match(key, at)
        if not match or len(path) == text.MAX_DEPTH:
            break
        path.append(match[1] if match[1] is not None else int(match[2]))
        at = match.end()
        at += key[at : at + 1] == "." and at + 1 < len(key)
    if at < len(key) or not path:
        raise _wrong(label, f"found the key {show(key)}", "expected a dotted key such as particles.components[0].size.radius")
    return path


def _value(label: str, key: str, value: str) -> Node:
    data = value.encode("utf-8", "surrogateescape")
    source = Source(label, text.decode(data, label), numbered=False)
    parsed = text.parse(source)
    if parsed.problems:
        raise RecipeError(parsed.problems)
    if parsed.root is None:
        raise _wrong(label, "found nothing", "expected a value, --set KEY=VALUE")
    return parsed.root


def _put(label: str, root: Mapping, path: list[str | int], new: Node) -> list[str | int]:
    """Replace or add the node at the path; returns the path with the indices of named items."""
    node, exact = root, []
    for depth, step in enumerate(path):
        step = _step(label, node, step, path[:depth])
        exact.append(step)
        if depth == len(path) - 1:
            break
        if isinstance(node, Mapping) and step not in node:
            below = Mapping(Place(new.place.source, new.place.begin, new.place.begin, _dotted(exact)), flow=True)
            _attach(node, step, below, new.place)
        node = node[step]
    _rekey(new, _dotted(exact))
    _attach(node, step, new, new.place)
    return exact


def _step(label: str, node: Node, step: str | int, above: list) -> str | int:
    at = _dotted(above)
    if isinstance(node, Sequence):
        if isinstance(step, str):
            names = [item["name"].text for item in node if isinstance(item, Mapping) and isinstance(item.get("name"), Scalar)]
            if names.count(step) != 1:
                raise _wrong(
                    label,
                    f"found no item {show(step)} in {at}",
                    f"expected {at}[0] to {at}[{len(node) - 1}]"
                    + (f", or one of {', '.join(map(show, names))}" if names else ""),
                )
            return next(i for i, item in enumerate(node) if isinstance(item, Mapping) and item["name"].text == step)
        if step >= len(node):
            raise _wrong(label, f"found {at}[{step}]", f"expected an index below {len(node)}")
        return step
    if isinstance(node, Scalar):
        raise _wrong(label, f"found {at}, which is the value {show(node.text)} and has no keys", "expected the key of a value")
    if isinstance(step, int):
        raise _wrong(label, f"found [{step}] after {at or 'nothing'}, which is no list", "expected a key")
    return step


def _attach(parent: Mapping | Sequence, step: str | int, node: Node, location: Place) -> None:
    parent[step] = node
    node.parent = parent
    if isinstance(parent, Mapping):
        parent.names[step] = Place(location.source, location.begin, location.begin, node.place.key)


def _dotted(path: list[str | int]) -> str:
    key = ""
    for step in path:
        key = f"{key}[{step}]" if isinstance(step, int) else text.join(key, step)
    return key


def _rekey(node: Node, key: str) -> None:
    node.place.key = key
    if isinstance(node, Mapping):
        for name, child in node.items():
            below = text.join(key, name)
            _rekey(child, below)
            node.names[name].key = below
    elif isinstance(node, Sequence):
        for i, child in enumerate(node):
            _rekey(child, f"{key}[{i}]")


# ---- the text


def _edit(label: str, document: str, path: list[str | int], new: Node) -> str:
    """The text with the node at the path replaced, or added to the mapping above it."""
    source = Source(label, document)
    node, line = text.parse(source).root, written(new)
    for depth, step in enumerate(path):
        if isinstance(node, Mapping) and step not in node:
            for name in reversed(path[depth + 1 :]):
                line = f"{{{_word(name)}: {line}}}"
            return _insert(source, node, f"{_word(step)}: {line}")
        node = node[step]
    begin = node.place.begin
    end = begin + len(document[begin : node.place.end].rstrip())  # a block ends where the next key starts
    space = " " if begin and not document[begin - 1].isspace() and document[begin - 1] not in "[{" else ""
    return document[:begin] + space + line + document[end:]


def _insert(source: Source, mapping: Mapping, entry: str) -> str:
    document = source.text
    if mapping.flow:
        at = mapping.place.begin + 1
        return document[:at] + entry + (", " if mapping else "") + document[at:]
    at = min(location.begin for location in mapping.names.values())
    indent = source.position(at)[1] - 1
    return document[:at] + entry + "\n" + " " * indent + document[at:]


def written(node: Node) -> str:
    """A value on one line, as `--set` would take it."""
    if isinstance(node, Mapping):
        return "{" + ", ".join(f"{_word(name)}: {written(child)}" for name, child in node.items()) + "}"
    if isinstance(node, Sequence):
        return "[" + ", ".join(map(written, node)) + "]"
    return json.dumps(node.text, ensure_ascii=False) if node.quoted else _word(node.text)


def _word(plain: str) -> str:
    return plain if _PLAIN.fullmatch(plain) else json.dumps(plain, ensure_ascii=False)


def _same(a: Node, b: Node) -> bool:
    """Whether two trees say the same."""
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        return a.keys() == b.keys() and all(_same(a[name], b[name]) for name in a)
    if isinstance(a, Sequence) and isinstance(b, Sequence):
        return len(a) == len(b) and all(map(_same, a, b))
    return (
        isinstance(a, Scalar)
        and isinstance(b, Scalar)
        and a.text == b.text
        and (a.quoted == b.quoted or not (_PLAIN.fullmatch(a.text) or a.text == ""))
    )
