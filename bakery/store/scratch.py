"""Folders in the temporary folder, gone at the end; those of killed processes are removed by the next that asks for one.

A folder is locked as long as its process lives: the kernel frees the lock however that ends.
"""

import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from bakery.store.files import FILES, Files

_FOLDER = re.compile(r"bakery-(?:bake|draft|family|frame|frames|pilot|place|scene)-[a-z0-9_]{8}")


@contextmanager
def folder(purpose: str, files: Files = FILES) -> Iterator[Path]:
    """A new folder of one's own, `bakery-PURPOSE-…`; PURPOSE is one of those in `_FOLDER`."""
    sweep(files)
    path, lock = _locked(f"bakery-{purpose}-", files)
    try:
        yield Path(path)
    finally:
        shutil.rmtree(path, ignore_errors=True)
        _close(lock, files)


def sweep(files: Files = FILES) -> None:
    """Remove such folders of this user whose process has died."""
    parent = tempfile.gettempdir()
    with suppress(OSError):
        for name in files.list(parent):
            if _FOLDER.fullmatch(name):
                _remove_unheld(os.path.join(parent, name), files)


def _remove_unheld(path: str, files: Files) -> None:
    with suppress(OSError):
        lock = _opened(path)
        try:
            if os.fstat(lock).st_uid == os.geteuid() and files.lock(lock, wait=False):
                shutil.rmtree(path, ignore_errors=True)
        finally:
            _close(lock, files)


def _locked(prefix: str, files: Files) -> tuple[str, int | None]:
    while True:
        path = tempfile.mkdtemp(prefix=prefix)
        try:
            lock = _opened(path)
        except OSError:
            if not os.path.isdir(path):
                continue
            return path, None  # folders have no locks here: what is left behind stays
        # Another process's sweep may take the folder in the moment before it is locked: then it holds the lock until it is gone.
        files.lock(lock, wait=True)
        if os.path.isdir(path):
            return path, lock
        _close(lock, files)


def _opened(path: str) -> int:
    """A folder, not a link to one; OSError where the system opens no folders (Windows)."""
    return os.open(path, os.O_RDONLY | getattr(os, "O_DIRECTORY", 0) | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0))


def _close(lock: int | None, files: Files) -> None:
    if lock is not None:
        with suppress(OSError):
            files.close(lock)
