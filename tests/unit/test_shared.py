"""A cache that machines share, without machines: what is asked of a store, and what becomes of its faults."""

import itertools
import os
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

from bakery.errors import UsageError
from bakery.run import shared
from bakery.run.cache import Cache
from bakery.run.shared import Folder, Objects, Shared
from bakery.store.tree import Dataset, Group
from bakery.system.disks import is_network

KEY = "1" * 64


def entry(value):
    return Group({"values": Dataset(np.full(3, value), "1", "what is computed")}, {"input_hash": KEY}), Group()


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """A cache of a machine of a name, in front of the folder `net`, and what it says."""

    def make(name):
        monkeypatch.setenv("BAKERY_CACHE", f"file://{tmp_path / 'net'}")
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / name))
        said = []
        return Cache(say=said.append), said

    (tmp_path / "net").mkdir()
    return make


def test_machines_share_entries(machine, tmp_path):
    a, said_a = machine("a")
    b, said_b = machine("b")
    assert a.get("dig", KEY) is None and not b.has("dig", KEY)
    a.put("dig", KEY, *entry(1.0))
    assert b.has("dig", KEY) and b.get("dig", KEY)[0]["values"].data[0] == 1.0
    assert len(a.entries()) == len(b.entries()) == 1 and b.where == tmp_path / "b" / "bakery"
    (tmp_path / "net" / a.path("dig", KEY).name).unlink()
    assert b.get("dig", KEY), "what was fetched stays"
    a.put("dig", KEY, *entry(1.0))
    b.path("dig", KEY).write_bytes(b"damaged")
    assert b.get("dig", KEY) and said_b.pop().endswith("moved aside and fetched or computed again")
    assert len(b.clear()) == 2 and b.has("dig", KEY)
    assert not said_a and not said_b


@pytest.mark.parametrize("chosen, network, where, behind", [
    ("", True, "own/bakery", None), ("{}/net", False, "net", None), ("{}/net", True, "own/bakery", "{}/net"),
    ("{}/own/bakery", True, "own/bakery", None), ("file://{}/net/", False, "own/bakery", "file://{}/net"),
])
def test_where_the_cache_is(tmp_path, monkeypatch, chosen, network, where, behind):
    monkeypatch.setenv("BAKERY_CACHE", chosen.format(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "own"))
    monkeypatch.setattr(shared, "is_network", lambda path: network)
    cache = Cache()
    assert cache.where == tmp_path / where
    assert (cache.shared and cache.shared.address) == (behind and behind.format(tmp_path))


@pytest.mark.parametrize("damage", ["bit", "cut", "name"])
def test_a_damaged_entry_is_no_entry(machine, tmp_path, damage):
    a, _ = machine("a")
    a.put("dig", KEY, *entry(1.0))
    place = tmp_path / "net" / a.path("dig", KEY).name
    data = bytearray(place.read_bytes())
    if damage == "bit":
        data[len(data) // 2] ^= 1
    b, said = machine("b")
    key = "2" * 64 if damage == "name" else KEY
    place.with_name(b.path("dig", key).name).write_bytes(data[:1000] if damage == "cut" else data)
    assert b.get("dig", key) is None and not b.entries()
    assert len(said) == 1 and f"net/dig-{key}.h5: " in said[0] and said[0].endswith("computed again and replaced")
    b.put("dig", KEY, *entry(2.0))
    assert machine("c")[0].get("dig", KEY)[0]["values"].data[0] == 2.0


def test_a_folder_takes_no_notice_of_dead_writers_or_of_clocks(tmp_path):
    folder = Folder(tmp_path)
    dead, alive = (tmp_path / f".dig.h5.{letter * 16}.part" for letter in "ab")
    for part in (dead, alive):
        part.write_bytes(b"half")
    os.utime(dead, (0, time.time() - 2 * 86400))
    folder.write("dig.h5", b"whole")
    os.utime(tmp_path / "dig.h5", (0, time.time() + 1e6))  # written by a machine whose clock is ahead
    folder.write("dig.h5", b"anew")
    assert folder.names() == [("dig.h5", 4)] and folder.size("dig.h5") == 4 and folder.read("dig.h5", 4) == b"anew"
    assert not dead.exists() and alive.exists()


class Faulty:
    """A store whose calls raise or wait, and that counts them."""

    def __init__(self, size=None, write=None, wait=None):
        self.calls, self._size, self._write, self._wait = [], size, write, wait

    def load(self):
        pass

    def size(self, name):
        self.calls.append("size")
        if self._wait:
            self._wait.wait(20)
        if self._size:
            raise self._size
        return 3

    def read(self, name, size):
        self.calls.append("read")
        return b"abc"

    def write(self, name, data):
        self.calls.append("write")
        if self._write:
            raise self._write


@pytest.fixture
def store(monkeypatch, tmp_path):
    """What is shared, with a store put in its place; what it says."""

    def make(place):
        said = []
        monkeypatch.setattr(shared, "_place_of", lambda address: place)
        return Shared("s3://b/p/", tmp_path, said.append), said

    return make


@pytest.mark.parametrize("error, told", [
    (OSError(5, "Input/output error"), "Input/output error"), (RuntimeError("no\n  credentials"), "no credentials"),
    (KeyError(), "KeyError"), (PermissionError("Forbidden"), "Forbidden"),
])
def test_a_store_that_fails_is_told_and_asked_once(store, tmp_path, error, told):
    place = Faulty(size=error)
    cache, said = store(place)
    for _ in range(2):
        assert not cache.has("a.h5") and cache.fetch("a.h5") is None
        cache.keep("a.h5", b"abc")
    assert said == [f"cache: s3://b/p: {told}; going on with {tmp_path} alone"] and place.calls == ["size"]


def test_an_entry_that_is_not_there_is_no_fault(store):
    place = Faulty(size=FileNotFoundError("a.h5"))
    cache, said = store(place)
    assert cache.fetch("a.h5") is None
    cache.keep("a.h5", b"abc")
    assert not said and place.calls == ["size", "write"]


@pytest.mark.parametrize("error", [PermissionError("Access Denied"), OSError(30, "Access Denied")])
def test_a_store_that_cannot_be_written_is_read(store, tmp_path, error):
    place = Faulty(write=error)
    cache, said = store(place)
    for _ in range(2):
        cache.keep("a.h5", b"abc")
        assert cache.fetch("a.h5") == b"abc"
    assert said == [f"cache: s3://b/p: can be read, not written (Access Denied); what is baked stays in {tmp_path}"]
    assert place.calls == ["write", "size", "read", "size", "read"]


def test_of_many_threads_one_warns(store, monkeypatch):
    monkeypatch.setattr(shared, "ANSWER", 0.05)
    place = Faulty(wait=threading.Event())
    cache, said = store(place)
    threads = [threading.Thread(target=cache.has, args=("a.h5",)) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    place._wait.set()
    assert len(said) == 1


def test_a_store_that_is_silent_is_waited_for_once(store, monkeypatch):
    monkeypatch.setattr(shared, "ANSWER", 0.01)
    place = Faulty(wait=threading.Event())
    cache, said = store(place)
    assert not cache.has("a.h5") and not cache.has("a.h5")
    place._wait.set()
    assert len(said) == 1 and "no answer within" in said[0] and place.calls == ["size"]


def test_a_store_that_is_slow_is_given_up(store, monkeypatch):
    ticks = itertools.count(0, 8)  # s from one look at the clock to the next
    monkeypatch.setattr(shared, "time", SimpleNamespace(monotonic=lambda: next(ticks)))
    cache, said = store(Faulty())
    assert sum(cache.has("a.h5") for _ in range(100)) == 5
    assert len(said) == 1 and "its answers are slow, 38 s so far" in said[0]


@pytest.mark.parametrize("address", ["memory://cache", "s3://", "s3:///x", "https://host/cache", "file://host/cache", "://x"])
def test_what_is_no_place_for_a_cache(address, monkeypatch, call, milk):
    monkeypatch.setenv("BAKERY_CACHE", address)
    status, _, message = call(milk)
    assert status == 2 and message.startswith(f'BAKERY_CACHE: found "{address}"; expected a folder, ')
    assert message.count("\n") == 1


@pytest.mark.parametrize("below", ["", "/cache/mine"])
def test_a_file_is_no_place_for_a_cache(tmp_path, monkeypatch, call, milk, below):
    (tmp_path / "taken").touch()
    monkeypatch.setenv("BAKERY_CACHE", f"{tmp_path}/taken{below}")
    status, out, message = call(milk, "-o", tmp_path / "milk.h5")
    assert status == 2 and not out and not (tmp_path / "milk.h5").exists()
    assert message == (f'BAKERY_CACHE: found "{tmp_path}/taken{below}", but {tmp_path}/taken is no folder; expected a '
                       "folder, there or to be made\n")


def test_without_the_extra_it_is_named(monkeypatch, tmp_path):
    monkeypatch.setattr(shared, "find_spec", lambda package: None if package == "s3fs" else True)
    with pytest.raises(UsageError, match=r"^BAKERY_CACHE: s3://b/p needs the package s3fs; the extra store has it: pip install"):
        Shared("s3://b/p", tmp_path)
    monkeypatch.setattr(shared, "find_spec", lambda package: True)
    assert isinstance(Shared("s3://b/p/", tmp_path)._place, Objects)


def test_disks_of_the_network(tmp_path):
    mounts = tmp_path / "mounts"
    mounts.write_text("/dev/vda / ext4 rw 0 0\nhost:/a /net/a\\040b nfs4 rw 0 0\n/dev/vdb /net/a\\040b/local xfs rw 0 0\n"
                      "auto /home autofs rw 0 0\nhost:/c /srv nfs rw 0 0\n/dev/vdc /srv ext4 rw 0 0\n")
    found = {path: is_network(path, mounts) for path in (
        "/var", "/net", "/net/a b", "/net/a b/cache/not/there", "/net/a b/local/cache", "/net/a bc", "/home/u", "/srv/cache")}
    assert [path for path, is_one in found.items() if is_one] == ["/net/a b", "/net/a b/cache/not/there", "/home/u"]
    assert not is_network("/net/a b", tmp_path / "no such file")
    (tmp_path / "link").symlink_to("/net/a b")
    assert is_network(tmp_path / "link" / "cache", mounts)
