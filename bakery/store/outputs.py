"""Where a command may write: not over what it reads, not over another of its outputs, not over a file of another kind.

The kind of a file follows from its first bytes, never from its name.  Checked by every command that writes, before anything
is computed.
"""

import os
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

from bakery.errors import UsageError
from bakery.store.container import FORMAT
from bakery.store.write import check_target

HEAD = 1 << 16  # bytes that decide a file's kind
ASSET, PAGE, DEPFILE = "asset", "HTML page", "depfile"


class FileKind(NamedTuple):
    """A kind of files that is not among `KINDS`."""

    name: str  # for people
    recognised: Callable[[bytes], bool]  # function of the first `HEAD` bytes of a file: whether it is one


def begins_as_text(pattern: str):
    """Whether a file begins as text in which a pattern is found."""
    expression = re.compile(pattern.encode(), re.MULTILINE)
    return lambda head: b"\0" not in head and expression.search(head) is not None


# kind -> whether a file that begins so is one.  A damaged asset is an asset: it may be baked again.
KINDS = {
    ASSET: lambda head: head.startswith(FORMAT.encode() + b" "),
    PAGE: lambda head: head.lower().startswith(b"<!doctype html"),
    DEPFILE: begins_as_text(r"\A[^\n]+: \\\n  [^\n]"),  # as bakery writes it: one file a line
    "PNG picture": lambda head: head.startswith(b"\x89PNG\r\n\x1a\n"),
    "EXR picture": lambda head: head.startswith(b"\x76\x2f\x31\x01"),
    "SVG drawing": begins_as_text(r"<svg\b"),
    "CSV table": begins_as_text(r"\A[^\n]*(,|\]\r?$)"),
    "JSON file": begins_as_text(r"\A\s*[\[{]"),
    "PLY file": lambda head: head.startswith(b"ply\n"),
    "recipe": begins_as_text(r"^bakery\s*:"),
    "text": begins_as_text(r""),
}
_BY_SUFFIX = {".html": PAGE, ".png": "PNG picture", ".exr": "EXR picture", ".svg": "SVG drawing", ".csv": "CSV table",
              ".json": "JSON file", ".ply": "PLY file", ".yaml": "recipe", ".txt": "text"}


def named(output: str | os.PathLike | None, default: Path) -> Path:
    """Where a file goes: `default` unless the user says; a closing slash marks a folder, in which it gets that name."""
    shown = os.fspath(output or default)
    return Path(shown) / default.name if shown.endswith("/") else Path(shown)


def check_outputs(outputs: Iterable[tuple[str | os.PathLike, str | FileKind]], inputs: Iterable[str | os.PathLike] = (),
                  overwrite: bool = False) -> None:
    """UsageError unless each output may be written.

    outputs : paths, each with the kind of file that goes there: a key of `KINDS`, or a `FileKind`
    inputs : every file that the command reads
    overwrite : replace files of other kinds; inputs never are
    """
    inputs, before = list(inputs), []
    for path, kind in outputs:
        check_target(path)
        shown = os.fspath(path)
        for path_read in inputs:
            if same_file(path, path_read):
                name = "" if os.fspath(path_read) == shown else f", under the name {os.fspath(path_read)}"
                raise UsageError(f"{shown}: is read by this very call{name}, so it is not written over; name another output")
        for path_read in before:
            if same_file(path, path_read):
                raise UsageError(f"{shown}: two outputs of this call would be this one file; give each its own name")
        if not overwrite and not _may_replace(path, kind):
            name = kind if isinstance(kind, str) else kind.name
            article = "an" if name[0] in "aeHSX" else "a"
            raise UsageError(f"{shown}: an existing file is not {article} {name}, so it is not replaced; "
                             "name another output, or give --overwrite")
        before.append(path)


def by_suffix(paths: Iterable[str | os.PathLike], kinds_by_suffix: Mapping[str, FileKind] | None = None):
    """Paths with the kinds that their endings stand for, those of `own` first: of files whose names bakery chooses."""
    kinds = _BY_SUFFIX | dict(kinds_by_suffix or {})
    return [(path, kinds[Path(path).suffix.lower()]) for path in paths]


def same_file(a: str | os.PathLike, b: str | os.PathLike) -> bool:
    """Whether two paths name one file, by whatever links."""
    if os.path.realpath(a) == os.path.realpath(b):
        return True
    try:
        return os.path.samefile(a, b)
    except OSError:
        return False  # one of them is not there


def _may_replace(path: str | os.PathLike, kind: str | FileKind) -> bool:
    """Whether nothing is there, nothing is in it, or it is of this kind."""
    try:
        with open(path, "rb") as file:
            head = file.read(HEAD)
    except FileNotFoundError:
        return True
    except OSError:
        return False  # what cannot be looked at is not ours to replace
    return not head or (KINDS[kind] if isinstance(kind, str) else kind.recognised)(head)
