"""The one write path: a file is put in its place whole and checked, or not at all."""

import os
import re
import secrets
import stat
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import BinaryIO

from bakery.errors import AssetError, BakeryError, StoreError, UsageError
from bakery.store.container import PIECE, opened
from bakery.store.files import FILES, Files, free_space
from bakery.store.hashes import seal
from bakery.store.image import image
from bakery.store.read import parse
from bakery.store.tree import Group, text

__all__ = ["check_target", "free_space", "new_part", "place", "sweep", "text", "write", "write_all"]

_PART = re.compile(r"\..+\.[0-9a-f]{16}\.part", re.DOTALL)


def write(path: str | os.PathLike, root: Group, *, check: Callable[[Group], Iterable[str]] | None = None,
          files: Files = FILES) -> None:
    """Write an asset; its content hashes are filled in.  See `place`."""
    check_target(path)
    place(path, image(seal(root)), check=check, files=files)


def place(path: str | os.PathLike, data: bytes | BinaryIO, *, check: Callable[[Group], Iterable[str]] | None = None,
          files: Files = FILES) -> None:
    """Write the bytes of an asset, which may come from an open file.

    The file is built beside its final place, read back from the disk, its hashes recomputed, `check(root)` asked for broken
    rules, and only then renamed.  Readers that have the old file open keep it.  Of two writers at once the last one wins.

    Raises
    ------
    UsageError : nothing can be written there
    StoreError : the system refused, or what is on the disk is not what was meant; what stood at `path` still stands there
    """
    shown = os.fspath(path)
    check_target(shown)
    target = os.path.realpath(shown)  # a symbolic link stays, the file that it names is replaced
    try:
        with new_part(target, files) as (fd, part):
            write_all(files, fd, data)
            del data  # its tables are read back, which take as much again
            _check_written(shown, part, check, files)
            files.sync(fd)
            files.replace(part, target)
    except OSError as error:
        raise _refused(shown, error) from error
    try:
        files.sync_folder(os.path.dirname(target))
    except OSError as error:
        raise StoreError(f"{shown}: was written, but its folder could not be synced ({error.strerror or error}): "
                         "a power cut now might bring the old file back") from error


def check_target(path: str | os.PathLike) -> None:
    """UsageError if no asset can be written at a path: asked before anything is computed."""
    shown = os.fspath(path)
    if not shown or "\0" in shown:
        raise UsageError(f"{shown!r}: not the name of a file")
    if shown == "-":
        raise UsageError("-: outputs are files, not standard output; name one")
    target = os.path.realpath(shown)
    folder = os.path.dirname(target)
    try:
        mode = os.stat(shown).st_mode  # not of `target`: /dev/stdout leads to a pipe that has no path
    except FileNotFoundError:
        mode = stat.S_IFREG
    except OSError as error:
        raise UsageError(f"{shown}: cannot be written: {error.strerror}") from None
    if stat.S_ISDIR(mode):
        name = f"NAME{os.path.splitext(shown)[1] or '.h5'}"
        raise UsageError(f"{shown}: is a folder; name the file to write, such as {os.path.join(shown, name)}")
    if not stat.S_ISREG(mode):
        raise UsageError(f"{shown}: a pipe or device; an asset is written to a file, which is then renamed into its place")
    if shown.endswith(os.sep) or not os.path.isdir(folder):
        raise UsageError(f"{shown}: its folder does not exist: {folder}; make it first")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise UsageError(f"{shown}: no right to write in {folder}; name a file in a folder of yours (-o)")


@contextmanager
def new_part(target: str, files: Files = FILES) -> Iterator[tuple[int, str]]:
    """A new, locked file beside the target, gone at the end unless it was renamed."""
    folder, name = os.path.split(target)
    sweep(folder, files)
    fd, part = _create(folder, name, files)
    try:
        yield fd, part
    except BaseException:  # interrupts and exits too: nothing half stays behind
        with suppress(OSError):
            files.remove(part)
        with suppress(OSError):
            files.close(fd)
        raise
    with suppress(OSError):  # synced and in its place: nothing is lost any more
        files.close(fd)


def _create(folder: str, name: str, files: Files) -> tuple[int, str]:
    while True:
        part = os.path.join(folder, f".{name[:40]}.{secrets.token_hex(8)}.part")
        fd = files.create(part)
        try:
            # Another writer's sweep may take the file in the moment before it is locked: then it holds the lock until the
            # file is gone.
            files.lock(fd, wait=True)
            if os.path.exists(part):
                return fd, part
        except BaseException:
            with suppress(OSError):
                files.remove(part)
            with suppress(OSError):
                files.close(fd)
            raise
        files.close(fd)


def sweep(folder: str, files: Files = FILES) -> None:
    """Remove what killed writers left in a folder: part files whose lock, freed by the kernel on death, can be had."""
    with suppress(OSError):
        for name in files.list(folder):
            if _PART.fullmatch(name):
                with suppress(OSError, ValueError):
                    path = os.path.join(folder, name)
                    fd = files.open(path)
                    try:
                        if files.lock(fd, wait=False):
                            files.remove(path)
                    finally:
                        files.close(fd)


def _check_written(shown: str, part: str, check: Callable[[Group], Iterable[str]] | None, files: Files) -> None:
    """StoreError unless what is on the disk reads back with its hashes right and breaks no rule."""
    fd = files.open(part)
    try:
        with files.stream(fd) as file:  # not as bytes: a family of many wavelengths has as many in its tables
            root = parse(part, file)
    except AssetError as error:
        raise StoreError(f"{shown}: not written: what came back from the disk is wrong: {error}") from error
    finally:
        files.close(fd)
    broken = list(check(root)) if check else []
    if broken:
        raise StoreError(f"{shown}: not written: {'; '.join(broken)}")


def write_all(files: Files, fd: int, data: bytes | BinaryIO) -> None:
    file = opened(data)
    file.seek(0)
    while piece := memoryview(file.read(PIECE)):
        while piece:
            piece = piece[files.write(fd, piece):]


def _refused(path: str, error: OSError) -> BakeryError:
    try:
        space = f"; {free_space(path) / 1e6:.0f} MB are free there"
    except OSError:
        space = ""
    return StoreError(f"{path}: not written: {error.strerror or error}{space}{unchanged(path)}")


def unchanged(path: str | os.PathLike) -> str:
    """What a message adds on a file that was not written, where another one stands."""
    return "; the old file is unchanged" if os.path.exists(path) else ""
