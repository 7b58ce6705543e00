"""The files that a scene is made of: what its pictures must not be written over."""

import os
import re
import stat
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

from bakery.system.memory import free_memory

LONGEST = 64 << 20  # bytes of a Mitsuba scene; what is large stands in files that it names


def files_of(path, parameters: Mapping[str, object] | None = None) -> list[Path]:
    """A file and, where it is a Mitsuba scene, every file that a value in it names, also in scenes that it includes.

    path : Mitsuba XML, or any other file
    parameters : `$name` in the scene -> value
    """
    top = Path(path)  # which may be an asset that is still to be baked
    named = _named(top, parameters or {})
    return [top, *(file for file, status in named.items() if file != top and stat.S_ISREG(status.st_mode))]


def unbounded(path, parameters: Mapping[str, object] | None = None) -> str | None:
    """What of a file's parts cannot be read in bounded time and memory, as the end of a sentence; None where all can.

    Whoever opens a pipe waits, and a device such as /dev/zero has no end; `path` and `parameters` as in `files_of`.
    """
    total = 0
    for file, status in _named(path, parameters or {}).items():
        mode = status.st_mode
        if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
            kind = "a pipe" if stat.S_ISFIFO(mode) else "a socket" if stat.S_ISSOCK(mode) else "a device"
            return f"{file}, {kind}; expected a regular file"
        if file.suffix.lower() == ".xml" and status.st_size > LONGEST:
            return f"{file}, a scene of {status.st_size / 1e6:.3g} MB; expected at most {LONGEST >> 20} MiB"
        total += status.st_size
    free = free_memory()
    if free is not None and total > free:
        return f"files of {total / 1e9:.3g} GB in all; {free / 1e9:.3g} GB of memory are free"
    return None


def _named(path, parameters: Mapping[str, object]) -> dict[Path, os.stat_result]:
    """A file, and all that values in it name and that is there, also in scenes that it includes."""
    named: dict[Path, os.stat_result] = {}
    top = Path(path)
    waiting = [top]
    while waiting:
        file = waiting.pop()
        try:
            status = file.stat()
        except (OSError, ValueError):
            continue  # not there, or a text that is no path
        if file in named:
            continue
        named[file] = status
        if file.suffix.lower() == ".xml" and stat.S_ISREG(status.st_mode) and status.st_size <= LONGEST:
            texts, folders = _values(file, parameters)
            # Mitsuba looks in the folder of the whole scene, too
            roots = [file.parent, top.parent]
            roots += [root / folder for folder in folders for root in roots]
            waiting += [root / text for text in texts for root in roots]
    return named


def parameters_of(path) -> set[str]:
    """Names of the parameters of a Mitsuba scene: each `$name` in it, also in scenes that it includes."""
    scenes = [file for file in files_of(path) if file.suffix.lower() == ".xml" and file.stat().st_size <= LONGEST]
    return {name for file in scenes for name in re.findall(r"\$(\w+)", file.read_text(errors="replace"))}


def integrators(path) -> list[str]:
    """Types of the integrators of a Mitsuba scene; [] where it cannot be read."""
    try:
        return [element.get("type", "") for element in ElementTree.parse(path).iter("integrator")]
    except (OSError, ElementTree.ParseError):
        return []  # Mitsuba says what is wrong with it


def sources_of(path, parameters: Mapping[str, object] | None = None) -> list[Path]:
    """The same but for the HDF5 files that a Mitsuba scene names: assets for bakery's plugins, which bakes write."""
    first, *others = files_of(path, parameters)
    return [first, *(file for file in others if file.suffix.lower() != ".h5")]


def _values(file: Path, parameters: Mapping[str, object]) -> tuple[list[str], list[str]]:
    """Every text in a scene that may name a file, and folders in which they are looked for."""
    try:
        elements = list(ElementTree.parse(file).iter())
    except (OSError, ElementTree.ParseError):
        return [], []  # Mitsuba says what is wrong with it
    defaults = {element.get("name"): element.get("value") for element in elements if element.tag == "default"} | dict(parameters)
    named = [(element.tag, element.get(key)) for element in elements for key in ("value", "filename") if element.get(key)]
    for name in sorted(filter(None, defaults), key=len, reverse=True):  # $size before $si
        named = [(tag, text.replace(f"${name}", str(defaults[name]))) for tag, text in named]
    return [text for tag, text in named if tag != "path"], [text for tag, text in named if tag == "path"]
