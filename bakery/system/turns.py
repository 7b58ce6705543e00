"""Turns of processes: of those that want to do the same thing, the first does it and the others wait.

A turn is a byte of one file that all processes of a user lock, by the hash of what is done; whoever ends, well or not, has no
turn any more.  Where no file can be locked, nobody waits: the same is done twice, with the same outcome.
"""

import hashlib
import os
import time
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import cache

try:
    import fcntl
except ImportError:  # not on Windows
    fcntl = None

_PATIENCE = 300.0  # seconds after which a process that holds a turn is taken to stand still
_LOOK = 0.01  # seconds between looks whether a turn is free

_held: dict[int, int] = {}  # byte -> how often this process has it, within itself


@cache
def _file(_process: int) -> int | None:
    """A descriptor of the file; None where there can be none."""
    from platformdirs import user_cache_path

    try:
        folder = user_cache_path("bakery", appauthor=False)
        folder.mkdir(parents=True, exist_ok=True)
        return os.open(folder / "turns", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError:
        return None


def _byte(name: str) -> int:
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:7], "big")


def _lock(byte: int) -> bool | None:
    """Whether the turn is ours now; None where nothing can be locked."""
    file = _file(os.getpid()) if fcntl else None
    if file is None:
        return None
    try:
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, byte)
        return True
    except (BlockingIOError, PermissionError):
        return False
    except OSError:
        return None


@contextmanager
def of(name: str, waiting: AbstractContextManager | None = None):
    """The turn of what `name` says, inside of the `with`; `waiting` is entered while another process has it.

    One thread of a process at a time: numba's lock of the process sees to that.
    """
    byte = _byte(name)
    if byte not in _held and _lock(byte) is False:
        with waiting or nullcontext():
            until = time.monotonic() + _PATIENCE
            while _lock(byte) is False and time.monotonic() < until:
                time.sleep(_LOOK)
    _held[byte] = _held.get(byte, 0) + 1
    try:
        yield
    finally:
        _held[byte] -= 1
        if not _held[byte]:
            del _held[byte]
            _give_back(byte)


def taken(name: str) -> bool:
    """Whether another process has the turn just now."""
    byte = _byte(name)
    if byte in _held:
        return False
    state = _lock(byte)
    if state:
        _give_back(byte)
    return state is False


def _give_back(byte: int):
    file = _file(os.getpid()) if fcntl else None
    if file is not None:
        try:
            fcntl.lockf(file, fcntl.LOCK_UN, 1, byte)
        except OSError:
            pass  # it was never ours
