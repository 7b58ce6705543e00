"""Files that a recipe reads: only regular ones, only inside the recipe's folder or `assets/`, opened once.

What is hashed is what was read: digest and content come from the same bytes.
"""

from __future__ import annotations

import hashlib
import os
import re
import stat
from dataclasses import dataclass
from pathlib import Path

from bakery.errors import UsageError
from bakery.grammar.text import MAX_BYTES, Source, decode, label_of, show
from bakery.grammar.units import Wrong

MAX_TABLE_BYTES = 64 << 20


@dataclass(frozen=True)
class DataFile:
    """A file that was read: the recipe key that named it, where it lies, SHA-256 of its bytes."""

    key: str
    path: Path
    sha256: str


def asset_root(name: str = "assets") -> Path:
    """The folder `assets`, or `recipes`: inside an installed package, else beside it in the source tree."""
    package = Path(__file__).resolve().parent.parent
    inside = package / f"_{name}"
    return inside if inside.is_dir() else package.parent / name


class Kept(type(Path())):
    """The path of a recipe together with its bytes, so that whoever loads it again, with other values, reads no file."""

    @classmethod
    def of(cls, path: str | os.PathLike, data: bytes) -> Kept:
        """The recipe of a path, or of what stands for one, with its bytes."""
        recipe = cls(path)
        recipe.data = data
        return recipe


class Written(Kept):
    """A recipe that is no file: what stands for its path, with its text.  Files that it names lie in the current folder."""


def read_recipe(path: str | os.PathLike) -> bytes:
    """The bytes of a recipe, at most one more than a recipe may have; UsageError where there is no such regular file."""
    label = label_of(path)
    if (data := getattr(path, "data", None)) is not None:
        return data
    if "\0" in os.fspath(path):
        raise UsageError(f"{label}: not a valid file name; give the path of a recipe")
    try:
        return _read(path, MAX_BYTES + 1)
    except FileNotFoundError:
        raise UsageError(f"{label}: no such file; give the path of a recipe (NAME.yaml)") from None
    except OSError as error:
        raise UsageError(f"{label}: cannot be read ({error.strerror}); give the path of a file that you may read") from None
    except Wrong as wrong:
        raise UsageError(f"{label}: {wrong.found}; {wrong.expected}") from None


def source_of(path: str | os.PathLike, label: str | None = None) -> Source:
    """The text of a recipe or scene, by its path or another name; errors as of `read_recipe`, RecipeError where it is no text."""
    label = label_of(path) if label is None else label
    return Source(label, decode(read_recipe(path), label))


def _read(path: str | os.PathLike, limit: int, flags: int = 0) -> bytes:
    """At most `limit` bytes of a regular file; never waits for a pipe or a device."""
    # O_NONBLOCK: opening a named pipe without a writer would otherwise wait for ever
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK | flags)
    try:
        status = os.fstat(descriptor)
        mode = status.st_mode
        if not stat.S_ISREG(mode):
            kinds = (
                (stat.S_ISDIR, "a folder"),
                (stat.S_ISFIFO, "a pipe"),
                (stat.S_ISCHR, "a device"),
                (stat.S_ISBLK, "a device"),
            )
            kind = next((name for test, name in kinds if test(mode)), "no regular file")
            raise Wrong(f"found {kind}", "expected a regular file")
        with open(descriptor, "rb", closefd=False) as file:
            # read(n) takes n bytes of memory before it looks; a file of the system's own state, as of /proc, says it has none
            return file.read(min(limit, status.st_size + 1) if status.st_size else limit)
    finally:
        os.close(descriptor)


class Folder:
    """The data files of one recipe, each read once."""

    def __init__(self, folder: Path):
        self.folder = folder
        self._known: dict[tuple[str, int], bytes | OSError | Wrong] = {}

    def read(self, key: str, name: str, limit: int = MAX_TABLE_BYTES, noun: str = "table") -> tuple[bytes, DataFile]:
        """A file that the recipe names, with a path relative to the recipe's folder, else to `assets/`; raises `Wrong`.

        It has at most `limit` bytes; `what` names its kind in the message where it has more.
        """
        _refuse_path(name)
        roots = [os.path.realpath(root) for root in (self.folder, asset_root())]
        outside = False
        for root in (self.folder, asset_root()):
            path = Path(root, name)
            real = os.path.realpath(path)
            if not any(real == top or real.startswith(top.rstrip("/") + "/") for top in roots):
                outside = True
            elif os.path.lexists(real):
                return self._read(key, name, path, real, limit, noun)
        if outside:
            raise Wrong(f"found {show(name)}, which leaves the recipe's folder and assets/", "expected a file inside one of them")
        raise Wrong(f"found {show(name)}, and there is no such file", "expected a file in the recipe's folder or in assets/")

    def material(self, key: str, name: str) -> tuple[bytes, DataFile]:
        """The table of a material that comes with bakery."""
        path = asset_root() / "materials" / f"{name}.csv"
        return self._read(key, name, path, os.path.realpath(path), MAX_TABLE_BYTES, "table")

    def _read(self, key: str, name: str, path: Path, real: str, limit: int, noun: str) -> tuple[bytes, DataFile]:
        if (real, limit) not in self._known:
            try:
                # O_NOFOLLOW: the path is resolved already, so a link here was put in its place since
                self._known[real, limit] = _read(real, limit + 1, os.O_NOFOLLOW)
            except (OSError, Wrong) as error:
                self._known[real, limit] = error
        data = self._known[real, limit]
        if isinstance(data, OSError):
            raise Wrong(f"found {show(name)}, which cannot be read ({data.strerror})", "expected a readable file")
        if isinstance(data, Wrong):
            raise Wrong(f"{data.found} under {show(name)}", data.expected)
        if len(data) > limit:
            raise Wrong(f"found {show(name)} of more than {limit >> 20} MiB", f"expected a smaller {noun}")
        return data, DataFile(key, path, hashlib.sha256(data).hexdigest())


def _refuse_path(name: str) -> None:
    rule = (
        "an absolute path"
        if name.startswith("/") or re.match(r"[A-Za-z]:", name)
        else "the home folder"
        if name.startswith("~")
        else "an address"
        if "://" in name
        else "a backslash"
        if "\\" in name
        else "a control character"
        if not name.isprintable()
        else "a path of more than 1,000 characters"
        if len(name.encode("utf-8", "replace")) > 1000
        else "an empty name"
        if not name.strip()
        else ""
    )
    if rule:
        raise Wrong(
            f"found {show(name)}, {rule}", "expected a path relative to the recipe's folder or to assets/, with / between folders"
        )


def materials() -> tuple[str, ...]:
    """Names of the materials that come with bakery."""
    return tuple(sorted(path.stem for path in (asset_root() / "materials").glob("*.csv")))
