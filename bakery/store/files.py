"""Every file call of the store goes through one object, so that a test can make the n-th one fail."""

import os
import shutil
import stat
from pathlib import Path
from typing import BinaryIO

try:
    import fcntl
except ImportError:  # no kernel locks here: leftovers of killed writers then stay, nothing else changes
    fcntl = None


class Files:
    """System calls as the store needs them; each raises OSError as the system gives it."""

    def create(self, path: str) -> int:
        """A new file, open for writing, with the mode that the umask leaves; FileExistsError if the name is taken."""
        return os.open(path, os.O_CREAT | os.O_EXCL | os.O_RDWR | getattr(os, "O_CLOEXEC", 0), 0o666)

    def write(self, fd: int, data: memoryview) -> int:
        return os.write(fd, data)

    def sync(self, fd: int) -> None:
        os.fsync(fd)

    def close(self, fd: int) -> None:
        os.close(fd)

    def open(self, path: str) -> int:
        """A regular file, open for reading; never waits for the other end of a pipe."""
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise NotRegular(path)
        fd = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0))
        if not stat.S_ISREG(os.fstat(fd).st_mode):
            os.close(fd)
            raise NotRegular(path)
        return fd

    def size(self, fd: int) -> int:
        return os.fstat(fd).st_size

    def head(self, fd: int, count: int) -> bytes:
        """The first bytes of a file, which is then read from its beginning all the same."""
        return os.pread(fd, count, 0)

    def read(self, fd: int) -> bytes:
        """The whole file."""
        with open(fd, "rb", buffering=0, closefd=False) as file:
            return file.readall()

    def stream(self, fd: int) -> BinaryIO:
        """The file for reading piece by piece; it stays open when that is closed."""
        return open(fd, "rb", closefd=False)

    def lock(self, fd: int, wait: bool) -> bool:
        """Whether this process now holds the file's lock, which the kernel frees when the process ends.

        False where another holds it (unless it may wait) and on a file system without locks.
        """
        if fcntl is None:
            return False
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except OSError:
            return False
        return True

    def replace(self, source: str, target: str) -> None:
        os.replace(source, target)

    def remove(self, path: str) -> None:
        os.unlink(path)

    def list(self, folder: str) -> list[str]:
        return os.listdir(folder)

    def sync_folder(self, folder: str) -> None:
        """Makes a rename last through a power cut; nothing to do where a folder cannot be opened (Windows)."""
        if os.name != "posix":
            return
        fd = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(fd)
        finally:
            os.close(fd)


class NotRegular(OSError):
    """A folder, pipe, socket or device where a file was expected."""


FILES = Files()


def free_space(path: str | os.PathLike) -> int:
    """Bytes that may still be written at a path or, where it does not exist yet, in its nearest existing folder."""
    folder = Path(os.path.abspath(path))
    while not folder.exists():
        folder = folder.parent
    return shutil.disk_usage(folder).free
