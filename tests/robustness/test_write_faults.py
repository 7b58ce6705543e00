"""Writes that go wrong: whatever fails, and whenever, the old asset or the new one stands there whole, and nothing else."""

import errno
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest

from bakery.errors import AssetError, StoreError
from bakery.store.files import FILES, Files
from bakery.store.hashes import seal
from bakery.store.image import image, packed
from bakery.store.put import put
from bakery.store.read import read
from bakery.store.tree import Dataset, Group
from bakery.store.write import place, write
from tests.conftest import ROOT, slow
from tests.samples import small_asset


class Failing(Files):
    """The n-th call fails, once or, as on a dead disk, with all after it; writes take at most 2 kB a call."""

    CALLS = ("create", "write", "sync", "close", "open", "read", "stream", "replace", "remove", "list", "sync_folder")

    def __init__(self, n: int, number: int, for_good: bool):
        self.n, self.number, self.for_good, self.count, self.failed = n, number, for_good, 0, []

    def _step(self, name: str) -> None:
        self.count += 1
        if self.count == self.n or (self.for_good and self.count > self.n):
            self.failed.append(name)
            raise OSError(self.number, os.strerror(self.number))

    def close(self, fd):
        super().close(fd)  # the system lets go of the file even when it reports an error
        self._step("close")

    def write(self, fd, data):
        self._step("write")
        return super().write(fd, data[:2_000])


def _counted(name):
    def call(self, *args):
        self._step(name)
        return getattr(Files, name)(self, *args)

    return call


for _name in set(Failing.CALLS) - {"close", "write"}:
    setattr(Failing, _name, _counted(_name))


def entries(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("for_good", [False, True], ids=["once", "for good"])
@pytest.mark.parametrize("number", [errno.EIO, errno.ENOSPC, errno.EACCES, errno.EDQUOT])
def test_nth_failing_call(tmp_path, number, for_good):
    path = tmp_path / "fog.h5"
    old, new = (Group({"x": Dataset(np.arange(5.0), "1", "some numbers")}, {"name": name}) for name in ("old", "new"))
    write(path, old)
    before = path.read_bytes()
    open_files = len(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else None
    hit = set()
    for n in range(1, 100):
        # what a killed writer left: the sweep's calls are among those that fail
        (tmp_path / ".fog.h5.0123456789abcdef.part").write_bytes(b"half")
        files = Failing(n, number, for_good)
        try:
            write(path, new, files=files)
        except StoreError as error:
            message = str(error)
            hit.update(files.failed)
            assert str(path) in message and os.strerror(number) in message, (n, files.failed)
            if "was written" in message:  # the rename was done, only its durability is open
                assert "sync_folder" in files.failed and read(path).attributes["name"] == "new"
            else:
                assert "MB are free" in message
                assert path.read_bytes() == before, (n, files.failed)
        else:
            hit.update(files.failed)
            assert read(path).attributes["name"] == "new"
            if not files.failed:
                break
        if not for_good and "remove" not in files.failed:
            assert len([name for name in entries(tmp_path) if name.endswith(".part")]) <= (n <= 5), (n, files.failed)
        path.write_bytes(before)
    else:
        pytest.fail("the write never succeeded")
    assert n > 12 and {"create", "write", "sync", "stream", "replace", "sync_folder"} <= hit
    assert entries(tmp_path) == ["fog.h5"]
    if open_files is not None:
        assert len(os.listdir("/proc/self/fd")) == open_files


@pytest.mark.parametrize("interruption", [KeyboardInterrupt, SystemExit, MemoryError])
def test_interrupts_leave_nothing(tmp_path, interruption):
    class Interrupted(Files):
        def sync(self, fd):
            raise interruption

    with pytest.raises(interruption):
        write(tmp_path / "fog.h5", small_asset(), files=Interrupted())
    assert entries(tmp_path) == []


def test_what_the_disk_garbles_is_not_put_in_place(tmp_path):
    class Garbling(Files):
        def write(self, fd, data):
            data = bytearray(data)
            data[len(data) // 2] ^= 1
            return super().write(fd, memoryview(data))

    with pytest.raises(StoreError, match="came back from the disk is wrong"):
        write(tmp_path / "fog.h5", small_asset(), files=Garbling())
    assert entries(tmp_path) == []


WRITER = """
import sys
from bakery.store.write import place, write
from tests.samples import small_asset
root = small_asset()
print("ready", flush=True)
while True:
    write(sys.argv[1], root)
"""


def start(script: str, *args: object) -> subprocess.Popen:
    process = subprocess.Popen([sys.executable, "-c", script, *map(str, args)], env={**os.environ, "PYTHONPATH": str(ROOT)},
                               stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "ready\n"
    return process


@pytest.mark.slow
def test_killed_writers(tmp_path):
    """Six writers, each killed at a random moment: old or new, and the next write tidies up."""
    path = tmp_path / "fog.h5"
    write(path, Group({"x": Dataset(np.arange(5.0), "1", "the old asset")}))
    wanted = {read(path).attributes["content_hash"]}
    write(tmp_path / "new.h5", small_asset())
    wanted.add(read(tmp_path / "new.h5").attributes["content_hash"])
    moments = random.Random(7)
    for _ in range(6):
        process = start(WRITER, path)
        time.sleep(moments.uniform(0.0, 0.03))
        process.send_signal(signal.SIGKILL)
        process.communicate()
        assert read(path).attributes["content_hash"] in wanted
    write(path, small_asset())
    assert entries(tmp_path) == ["fog.h5", "new.h5"]


HOLDER = """
import sys
from bakery.store.files import Files
from bakery.store.write import place, write
from tests.samples import small_asset
class Waiting(Files):
    def sync(self, fd):
        print("ready", flush=True)
        sys.stdin.read()
        super().sync(fd)
write(sys.argv[1], small_asset(), files=Waiting())
"""


def test_part_of_a_living_writer_is_left_alone_that_of_a_dead_one_not(tmp_path):
    process = start(HOLDER, tmp_path / "a.h5")
    write(tmp_path / "b.h5", small_asset())
    assert len(entries(tmp_path)) == 2 and entries(tmp_path)[0].endswith(".part")
    process.communicate(timeout=60)
    assert process.returncode == 0
    assert entries(tmp_path) == ["a.h5", "b.h5"]

    process = start(HOLDER, tmp_path / "a.h5")
    process.kill()
    process.communicate()
    assert len(entries(tmp_path)) == 3
    (tmp_path / ".mine.part").write_text("not bakery's")
    write(tmp_path / "b.h5", small_asset())
    assert entries(tmp_path) == [".mine.part", "a.h5", "b.h5"]


PICTURE = """
import os, sys
from bakery.store.put import put
os.fsync = lambda fd: (print("ready", flush=True), sys.stdin.read())
put(sys.argv[1], b"a picture")
"""


def test_what_a_killed_writer_of_small_files_leaves_goes_with_the_next(tmp_path):
    """Pictures and tables: their hidden parts stayed for good."""
    process = start(PICTURE, tmp_path / "a.png")
    put(tmp_path / "b.png", b"of another writer")
    assert len(entries(tmp_path)) == 2 and "b.png" in entries(tmp_path)
    process.kill()
    process.communicate()
    put(tmp_path / "b.png", b"again")
    assert entries(tmp_path) == ["b.png"]


def test_part_that_a_sweep_takes_before_it_is_locked(tmp_path):
    """Between creation and lock another writer takes the new file for a dead one's."""
    taken = []

    class Overtaken(Files):
        def create(self, path):
            fd = super().create(path)
            if not taken:
                locked = threading.Event()

                def sweep():
                    other = FILES.open(path)
                    taken.append(FILES.lock(other, wait=False))
                    locked.set()
                    time.sleep(0.2)  # long enough for a writer that does not wait for the lock to go wrong
                    FILES.remove(path)
                    FILES.close(other)

                threading.Thread(target=sweep).start()
                assert locked.wait(30)
            return fd

    write(tmp_path / "a.h5", small_asset(), files=Overtaken())
    assert taken == [True] and entries(tmp_path) == ["a.h5"]


FULL = """
import resource, signal, sys
from bakery.errors import StoreError
from bakery.store.write import place, write
from tests.samples import small_asset
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, 30_000))
try:
    write(sys.argv[1], small_asset())
except StoreError as error:
    print(error)
"""


@pytest.mark.parametrize("old", [True, False])
def test_a_file_that_may_not_grow(tmp_path, old):
    """The limit on file size stands for a full disk: part of the file is written, then no more."""
    path = tmp_path / "fog.h5"
    if old:
        path.write_bytes(b"old")
    done = subprocess.run([sys.executable, "-c", FULL, str(path)], env={**os.environ, "PYTHONPATH": str(ROOT)},
                          capture_output=True, text=True, timeout=60)
    assert "not written: File too large" in done.stdout and done.stderr == ""
    assert ("the old file is unchanged" in done.stdout) == old
    assert entries(tmp_path) == ["fog.h5"] * old and (not old or path.read_bytes() == b"old")


def test_reader_keeps_what_it_opened(tmp_path):
    path = tmp_path / "fog.h5"
    write(path, small_asset())
    fd = FILES.open(str(path))
    before = read(path)["medium/g"].data
    changed = small_asset()
    changed.members["wavelength"] = Dataset(np.array([0.5, 0.4]), "um", "wavelengths in vacuum")
    old = path.read_bytes()
    write(path, changed)
    assert FILES.read(fd) == old
    FILES.close(fd)
    assert np.array_equal(before, small_asset()["medium/g"].data)
    assert read(path)["wavelength"].data[0] == 0.5


@pytest.mark.parametrize("number", [errno.EIO, errno.EACCES])
def test_a_disk_that_cannot_be_read(tmp_path, number):
    write(tmp_path / "fog.h5", small_asset())
    for n in range(1, 10):
        files = Failing(n, number, False)
        try:
            read(tmp_path / "fog.h5", files=files)
        except StoreError as error:
            assert os.strerror(number) in str(error)
        except AssetError as error:
            pytest.fail(f"a failing disk is no damaged asset: {error}")
        else:
            break
    assert n == 4


def test_bytes_by_way_of_a_file_are_those_in_memory(tmp_path):
    root = seal(small_asset())
    with packed(root, tmp_path) as file:
        place(tmp_path / "fog.h5", file)
    assert (tmp_path / "fog.h5").read_bytes() == image(root) and entries(tmp_path) == ["fog.h5"]


@pytest.mark.parametrize("step", [slow(1), 5])
def test_a_disk_that_fills_up_while_a_file_is_packed(tmp_path, monkeypatch, step):
    """Each write in turn, or every fifth, fails, for good: an error that says so, never the end of the process, which is what
    HDF5 makes of it."""
    temporary, root = tempfile.TemporaryFile, seal(small_asset())

    class Full:
        def __init__(self, file, after):
            self.file, self.writes = file, after

        def __getattr__(self, name):
            return getattr(self.file, name)

        def write(self, data):
            self.writes -= 1
            if self.writes < 0:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return self.file.write(data)

    for after in range(0, 1000, step):
        @contextmanager
        def full(after=after, **options):
            with temporary(**options) as file:
                yield Full(file, after)

        monkeypatch.setattr(tempfile, "TemporaryFile", full)
        try:
            with packed(root, tmp_path):
                break
        except OSError as error:
            assert error.errno == errno.ENOSPC
    assert 20 < after < 999 and entries(tmp_path) == []
