"""The files that a scene is made of: what its pictures must not be written over."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree


def files_of(path, parameters: Mapping[str, object] | None = None) -> list[Path]:
    """A file and, where it is a Mitsuba scene, every file that a value in it names, also in scenes that it includes.

    Parameters
    ----------
    path : Mitsuba XML, or any other file
    parameters : `$name` in the scene -> value
    """
    files: list[Path] = []
    top = Path(path)
    waiting = [top]
    while waiting:
        file = waiting.pop()
        if file in files:
            continue
        files.append(file)
        if file.suffix.lower() == ".xml":
            # Mitsuba looks in the folder of the whole scene, too
            places = [folder / text for text in _values(file, parameters or {}) for folder in (file.parent, top.parent)]
            waiting += filter(_is_file, places)
    return files


def integrators(path) -> list[str]:
    """Types of the integrators of a Mitsuba scene; [] where it cannot be read."""
    try:
        return [one.get("type", "") for one in ElementTree.parse(path).iter("integrator")]
    except (OSError, ElementTree.ParseError):
        return []  # Mitsuba says what is wrong with it


def sources_of(path, parameters: Mapping[str, object] | None = None) -> list[Path]:
    """The same but for the HDF5 files that a Mitsuba scene names: assets for bakery's plugins, which bakes write."""
    first, *others = files_of(path, parameters)
    return [first, *(file for file in others if file.suffix.lower() != ".h5")]


def _values(file: Path, parameters: Mapping[str, object]) -> list[str]:
    """Every text in a scene that may name a file."""
    try:
        elements = list(ElementTree.parse(file).iter())
    except (OSError, ElementTree.ParseError):
        return []  # Mitsuba says what is wrong with it
    known = {one.get("name"): one.get("value") for one in elements if one.tag == "default"} | dict(parameters)
    texts = [one.get(key) for one in elements for key in ("value", "filename") if one.get(key)]
    for name in sorted(filter(None, known), key=len, reverse=True):  # $size before $si
        texts = [text.replace(f"${name}", str(known[name])) for text in texts]
    return texts


def _is_file(place: Path) -> bool:
    try:
        return place.is_file()
    except (OSError, ValueError):
        return False  # a text that is no path
