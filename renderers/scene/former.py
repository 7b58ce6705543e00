"""Scenes of format 1, which had a section for each renderer, as texts of format 2.

`discrete`, `granular` or `translucent` becomes the list `materials`; fog keeps its section.  Comments stay, in lines of their
own.
"""

import json
from collections.abc import Iterator

from bakery.grammar.text import Mapping, Node, Scalar, Sequence

SECTIONS = ("discrete", "granular", "translucent")
_WIDEST = 120  # characters of an entry in one line
_MATERIAL = ("asset", "recipe")


def converted(document: str, root: Mapping) -> str | None:
    """The text of a scene of format 1 in format 2; None where it is none.

    document : of the scene
    root : its tree
    """
    section = next((name for name in SECTIONS if name in root), None)
    version = root.get("bakery_scene")
    old = isinstance(version, Scalar) and version.text == "1"
    if not old and (section is None or "materials" in root):
        return None
    entries = [] if section is None else _entries(document, section, root)
    if entries is None:
        return None
    lines = []
    for name, chunk in _chunks(document, root):
        if name == "bakery_scene":
            key, colon, value = chunk.partition(":")
            lines.append(key + colon + value.replace("1", "2", 1))
        elif section is None or name not in (section, *_MATERIAL):
            lines.append(chunk)
        else:
            lines += [f"{comment}\n" for comment in _comments(chunk)]
            lines += _written(entries, root[section]) if name == section else []
    return "".join(lines)


# ---- entries


def _entries(document: str, section: str, root: Mapping) -> list[dict[str, str]] | None:
    """Key -> value as text, of each entry; None where the section is not what it should be."""
    former = root[section]
    listed = {"granular": "where", "translucent": "bodies"}.get(section)
    places = former.get(listed) if isinstance(former, Mapping) and listed else None
    places = list(places) if isinstance(places, Sequence) else [places if listed else former]
    if not isinstance(former, Mapping) or not all(isinstance(entry, Mapping) for entry in places):
        return None
    return [_entry(document, section, root, entry, alone=len(places) == 1) for entry in places]


def _entry(document: str, section: str, root: Mapping, volume: Mapping, alone: bool) -> dict[str, str]:
    texts, former = {name: _text(document, node) for name, node in volume.items()}, root[section]
    if section != "discrete":
        inside = [name for name in ("mesh", "unit", "shape") if name in texts]
        texts["where"] = "{" + ", ".join(f"{name}: {texts[name]}" for name in inside) + "}"
        for name in inside:
            del texts[name]
        shared = [name for name in former if name not in ("where", "bodies", "boundary") and (name != "method" or alone)]
        texts |= {name: _text(document, former[name]) for name in shared}
    if not set(_MATERIAL) & set(volume):
        texts |= {name: _text(document, root[name]) for name in _MATERIAL if name in root}
    if section == "translucent" and "boundary" in former:
        index = texts.get("boundary", "{}")[1:-1]
        texts["boundary"] = "{" + ", ".join(filter(None, (index, f"tables: {_text(document, former['boundary'])}"))) + "}"
    first = ("where", *_MATERIAL, "method")
    return {name: texts[name] for name in (*(name for name in first if name in texts), *texts)}


def _text(document: str, node: Node) -> str:
    """A node on one line."""
    if isinstance(node, Mapping):
        return "{" + ", ".join(f"{name}: {_text(document, child)}" for name, child in node.items()) + "}"
    if isinstance(node, Sequence):
        return "[" + ", ".join(_text(document, child) for child in node) + "]"
    verbatim = document[node.place.begin : node.place.end].strip()
    return json.dumps(node.text, ensure_ascii=False) if "\n" in verbatim else verbatim


# ---- text


def _chunks(document: str, root: Mapping) -> Iterator[tuple[str, str]]:
    """What stands before the first key, under "", and each key of the top with all that stands up to the next one."""
    if root.flow:
        yield from ((name, f"{name}: {_text(document, node)}\n") for name, node in root.items())
        return
    begins = sorted((root.names[name].begin, name) for name in root)
    yield "", document[: begins[0][0]]
    for (begin, name), (end, _) in zip(begins, [*begins[1:], (len(document), "")]):
        chunk = document[begin:end]
        yield name, chunk if chunk.endswith("\n") else chunk + "\n"


def _comments(chunk: str) -> Iterator[str]:
    """Comments of a chunk, each from its #."""
    for line in chunk.splitlines():
        before, mark, comment = line.partition("#")
        if mark and (not before or before[-1].isspace()):
            yield mark + comment


def _written(entries: list[dict[str, str]], former: Mapping) -> Iterator[str]:
    """The list `materials`, and before it the method of several entries."""
    if len(entries) > 1 and isinstance(former.get("method"), Scalar):
        yield f"method: {former['method'].text}\n"
    yield "materials:\n"
    for entry in entries:
        line = ", ".join(f"{name}: {text}" for name, text in entry.items())
        if len(line) <= _WIDEST:
            yield f"  - {{{line}}}\n"
            continue
        for mark, (name, text) in zip(("  - ", *["    "] * len(entry)), entry.items()):
            yield f"{mark}{name}: {text}\n"
