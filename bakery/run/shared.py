"""A cache that several machines share: a folder on a network disk, or an object store.

Nothing here locks or compares clocks of two machines.  An entry is put in its place by one rename or one upload, so that readers
see an old one, a new one or none; of two writers the last one wins.  Entries are bytes here: who reads them checks them.  A store
that is slow, absent or closed to us costs one warning, and is not asked again by the same run.
"""

import errno
import os
import secrets
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

from bakery.errors import StoreError, UsageError
from bakery.run.entries import has_form
from bakery.system.disks import is_network

ANSWER = 10.0  # s that a store may take to answer
RATE = 1e6  # bytes/s that a transfer has to reach besides
PROMPT, LOST = 0.5, 30.0  # s that an answer may take without being slow; s that slow ones may take of a run
PACKAGES = {"s3": "s3fs", "gs": "gcsfs", "az": "adlfs"}  # what fsspec needs for an object store
_FULL = {errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOSPC, errno.EDQUOT, errno.EFBIG}  # no reason to stop reading
_DAY = 86400.0


def is_shared(address: str) -> bool:
    """Whether a value of BAKERY_CACHE names a store behind the cache, not the cache's own folder."""
    return "://" in address or is_network(address)


class Shared:
    """Entries by name, in a place that may fail at any time.

    address : as BAKERY_CACHE has it: a folder, `file:///FOLDER`, `s3://BUCKET/PREFIX`, `gs://…`, `az://…`
    local : folder of the cache in front of it, for messages
    say : takes remarks for the user

    Raises UsageError : another address, or a package that it needs is not installed
    """

    def __init__(self, address: str, local: Path, say: Callable[[str], None] = lambda text: None):
        self._place, self._local, self._say = _place_of(address), local, say
        self.address = address.rstrip("/")
        self._open = self._writable = True
        self._lost = 0.0
        self._lock = threading.Lock()  # of several threads of a run one warns

    def has(self, name: str) -> bool:
        """Whether there is an entry, without a look inside."""
        return self._size(name) is not None

    def fetch(self, name: str) -> bytes | None:
        """The bytes of an entry, unchecked; None where there is none to be had."""
        size = self._size(name)
        if size is None:
            return None
        answer = self._asked(lambda: self._place.read(name, size), size)
        return self._value(answer)

    def keep(self, name: str, data: bytes) -> None:
        """Put an entry in its place, or in that of the one that is there."""
        if not (self._open and self._writable):
            return
        error = self._asked(lambda: self._place.write(name, data), len(data)).exception()
        if error is None:
            return
        if isinstance(error, OSError) and error.errno in _FULL or isinstance(error, PermissionError):
            with self._lock:
                first, self._writable = self._writable, False
            if first:
                self._say(f"cache: {self.address}: can be read, not written ({_reason(error)}); what is baked stays in "
                          f"{self._local}")
        else:
            self._close(error)

    def entries(self) -> list[tuple[str, int]]:
        """Name and bytes of each entry.

        Raises StoreError : the store does not answer, or not to us
        """
        error = (answer := self._asked(self._place.names)).exception()
        if error is not None:
            raise StoreError(f"{self.address}: {_reason(error)}") from error
        return [(name, size) for name, size in answer.result() if has_form(name)]

    def _size(self, name: str) -> int | None:
        return self._value(self._asked(lambda: self._place.size(name))) if self._open else None

    def _value(self, answer: Future):
        """What was answered; None for an entry that is not there, and from a store that failed."""
        error = answer.exception()
        if error is None:
            return answer.result()
        if not isinstance(error, FileNotFoundError):
            self._close(error)
        return None

    def _asked(self, function: Callable, size: int = 0) -> Future:
        """The finished call of a function, by a thread that is left behind where it takes too long."""
        loaded, answer, allowed = threading.Event(), Future(), size / RATE
        # a daemon: neither a disk that hangs nor a server that is silent keeps the process from ending
        threading.Thread(target=_answer, args=(self._place.load, loaded, function, answer), daemon=True).start()
        loaded.wait()  # importing may take long where the disk is slow, and says nothing of the store
        start = time.monotonic()
        try:
            answer.exception(ANSWER + allowed)
        except TimeoutError:
            late = Future()
            late.set_exception(_NoAnswer(f"no answer within {ANSWER + allowed:.0f} s"))
            return late
        self._lost += max(0.0, time.monotonic() - start - allowed - PROMPT)
        if self._lost > LOST:
            self._close(_NoAnswer(f"its answers are slow, {self._lost:.0f} s so far"))
        return answer

    def _close(self, error: BaseException) -> None:
        with self._lock:
            first, self._open = self._open, False
        if first:
            self._say(f"cache: {self.address}: {_reason(error)}; going on with {self._local} alone")


class _NoAnswer(Exception):
    """A store took too long."""


def _answer(load: Callable, loaded: threading.Event, function: Callable, answer: Future) -> None:
    try:
        try:
            load()
        finally:
            loaded.set()
        answer.set_result(function())
    except BaseException as error:  # a library's own kinds too: they are told by whoever waits, in a line
        answer.set_exception(error)


def _reason(error: BaseException) -> str:
    """An error in one line."""
    text = getattr(error, "strerror", None) or str(error)
    return " ".join(text.split()) or type(error).__name__


def _place_of(address: str) -> "Folder | Objects":
    """Where entries lie by name; each call raises what the system or a library does, FileNotFoundError for a missing entry."""
    scheme, separator, path = address.partition("://")
    if not separator:
        return Folder(Path(address).absolute())
    if scheme == "file" and path.startswith("/"):
        return Folder(Path(path))
    root = path.strip("/")
    if scheme not in PACKAGES or not root or path.startswith("/"):  # s3:///x names no bucket
        stores = ", ".join(f"{schemes}://BUCKET/PREFIX" for schemes in PACKAGES)
        raise UsageError(f'BAKERY_CACHE: found "{address}"; expected a folder, file:///FOLDER for one that is shared, or an '
                         f"object store {stores}")
    missing = [package for package in ("fsspec", PACKAGES[scheme]) if find_spec(package) is None]
    if missing:
        extra = '; the extra store has it: pip install ".[store]" in the folder of bakery\'s sources' if scheme == "s3" else ""
        raise UsageError(f"BAKERY_CACHE: {address} needs the package {' and '.join(missing)}{extra}")
    return Objects(scheme, root)


class Folder:
    """Entries as files of a folder, which is made by hand: else one that is not mounted would be made up on the local disk."""

    def __init__(self, folder: Path):
        self._folder, self._swept = folder, False

    def load(self) -> None:
        pass

    def size(self, name: str) -> int:
        self._look()
        return self._path(name).stat().st_size

    def read(self, name: str, size: int) -> bytes:
        try:
            return self._path(name).read_bytes()
        except OSError as error:
            if error.errno == errno.ESTALE:  # replaced by another machine in this moment
                return self._path(name).read_bytes()
            raise

    def write(self, name: str, data: bytes) -> None:
        self._look()
        part = self._folder / f".{name[:40]}.{secrets.token_hex(8)}.part"
        try:
            with open(part, "xb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            self._sweep(part)
            os.replace(part, self._path(name))
        except BaseException:
            with suppress(OSError):
                part.unlink()
            raise

    def names(self) -> list[tuple[str, int]]:
        self._look()
        return [(path.name, path.stat().st_size) for path in self._folder.glob("*.h5")]

    def _path(self, name: str) -> Path:
        return self._folder / name

    def _look(self) -> None:
        if not self._folder.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, "no such folder; mount it, or make it by hand")

    def _sweep(self, part: Path) -> None:
        """Remove what writers left that died a day ago, once.  A lock would not tell: it may hold on its own machine only."""
        if self._swept:
            return
        self._swept = True
        now = part.stat().st_mtime  # by the clock that stamped the others too
        for leftover in self._folder.glob(".*.part"):
            with suppress(OSError):
                if now - leftover.stat().st_mtime > _DAY:
                    leftover.unlink()


class Objects:
    """Entries as objects of a store, through fsspec: one upload puts an object in its place whole or not at all."""

    def __init__(self, scheme: str, root: str):
        self._scheme, self._root, self._store = scheme, root, None

    def load(self) -> None:
        import fsspec

        if self._store is None:
            # what others write must be seen: nothing is remembered of listings, or of another run's connection
            self._store = fsspec.filesystem(self._scheme, use_listings_cache=False, skip_instance_cache=True)

    def size(self, name: str) -> int:
        return self._store.info(f"{self._root}/{name}")["size"]

    def read(self, name: str, size: int) -> bytes:
        # with a start it is one request: several for parts of a large object could meet two versions of it
        return self._store.cat_file(f"{self._root}/{name}", start=0) if size else b""

    def write(self, name: str, data: bytes) -> None:
        self._store.pipe_file(f"{self._root}/{name}", data)

    def names(self) -> list[tuple[str, int]]:
        try:
            entries = self._store.ls(self._root, detail=True)
        except FileNotFoundError:
            self._store.info(self._root.split("/")[0])  # FileNotFoundError without the bucket, else there are no entries yet
            return []
        return [(entry["name"].rpartition("/")[2], entry["size"]) for entry in entries if entry["name"].endswith(".h5")]
