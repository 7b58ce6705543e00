"""Machines that share a cache: through a real server of objects, and through a folder; with faults of both."""

import json
import os
import random
import re
import socket
import subprocess
import sys
import threading

import pytest

from bakery.store.read import read
from tests.conftest import ROOT
from tests.robustness.objects import BUCKET, Server, environment

pytestmark = pytest.mark.slow
COMPUTED, CACHED = ["computed"] * 2, ["from the cache"] * 2
NOBODY, ONCE = "http://127.0.0.1:9", {"AWS_MAX_ATTEMPTS": "1"}  # an endpoint without a server, and no second try
NEEDED = 'the extra store, and moto, which `make test-slow` installs: pip install ".[store]" "moto[server]"'


@pytest.fixture(scope="module")
def objects():
    """A server of objects."""
    for package in ("s3fs", "moto", "flask"):
        pytest.importorskip(package, reason=NEEDED)
    with Server() as server:
        yield server


@pytest.fixture
def store(objects, tmp_path):
    """Address, endpoint and a client of a store that is empty."""
    objects.address = f"s3://{BUCKET}/{tmp_path.name}"
    return objects


@pytest.fixture
def bake(command, tmp_path):
    """Bakes a recipe on a machine of a name: its report of each stage, the lines about the cache, the asset's content hash."""

    def run(recipe, machine, address, endpoint="", **more):
        output, home = tmp_path / f"{machine}.h5", tmp_path / machine
        home.mkdir(exist_ok=True)
        done = command(recipe, "-o", output, "--json", env=environment(home, address, endpoint, **more))
        assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr
        sources = [step["source"] for step in json.loads(done.stdout)[0]["steps"]]
        return sources, lines(done.stderr), read(output).attributes["content_hash"]

    return run


def lines(text):
    return [line for line in text.splitlines() if re.search(r"cache: |warning", line, re.IGNORECASE)]


def stored(server):
    """The keys of the store."""
    prefix = server.address.removeprefix(f"s3://{BUCKET}/")
    return re.findall(rb"<Key>([^<]+)</Key>", server.call("GET", f"{BUCKET}?list-type=2&prefix={prefix}/"))


def test_machines_share_a_store(store, bake, drops, tmp_path, command):
    first = bake(drops, "a", store.address, store.endpoint)
    second = bake(drops, "b", store.address, store.endpoint)
    assert first[:2] == (COMPUTED, []) and second[:2] == (CACHED, [])
    assert len(stored(store)) == 2 and len(list((tmp_path / "b" / "cache" / "bakery").glob("*.h5"))) == 2
    # what was fetched stays: no store is needed any more
    (tmp_path / "b.h5").unlink()
    assert bake(drops, "b", store.address, NOBODY)[:2] == (CACHED, [])

    there = environment(tmp_path / "b", store.address, store.endpoint)
    info = json.loads(command("cache", "info", "--json", env=there).stdout)
    assert info["entries"] == info["shared"]["entries"] == 2 and info["bytes"] == info["shared"]["bytes"] > 1000
    assert info["folder"] == str(tmp_path / "b" / "cache" / "bakery") and info["shared"]["address"] == store.address
    cleared = command("cache", "clear", env=there)
    assert cleared.stdout == "2 entries removed\n" and f"{store.address} is shared and unchanged" in cleared.stderr
    assert len(stored(store)) == 2
    away = command("cache", "info", env=there | ONCE | {"AWS_ENDPOINT_URL": NOBODY})
    assert away.returncode == 0 and f"shared: {store.address}: Could not connect" in away.stdout and not away.stderr


def test_machines_share_a_folder(bake, drops, tmp_path):
    place = tmp_path / "net"
    address = f"file://{place}"
    assert bake(drops, "a", address)[1] == [f"cache: {address}: no such folder; mount it, or make it by hand; going on with "
                                            f"{tmp_path / 'a' / 'cache' / 'bakery'} alone"]
    place.mkdir()
    (place / ".optics-0.h5.0123456789abcdef.part").write_bytes(b"of a writer that died, its lock held by nobody here")
    first, second = bake(drops, "b", address), bake(drops, "c", address)
    assert first[:2] == (COMPUTED, []) and second[:2] == (CACHED, []) and len(list(place.glob("*.h5"))) == 2


@pytest.mark.parametrize("damage", ["bit", "other"])
def test_a_damaged_entry_is_told_and_replaced(store, bake, drops, damage):
    _, _, expected = bake(drops, "a", store.address, store.endpoint)
    medium, optics = sorted(key.decode() for key in stored(store))
    data = store.call("GET", f"{BUCKET}/{optics}")
    place = random.Random(1).randrange(len(data))
    store.call("PUT", f"{BUCKET}/{optics}", {
        "bit": data[:place] + bytes([data[place] ^ 4]) + data[place + 1:],
        "other": store.call("GET", f"{BUCKET}/{medium}")}[damage])
    sources, said, found = bake(drops, "b", store.address, store.endpoint)
    assert sources == ["computed", "from the cache"] and found == expected
    assert len(said) == 1 and optics in said[0] and said[0].endswith("computed again and replaced")
    assert bake(drops, "c", store.address, store.endpoint) == (CACHED, [], expected)


WORKER = """
import sys, shutil, random
import numpy as np
from bakery.run import shared
from bakery.run.cache import Cache
from bakery.store.tree import Dataset, Group

shared.ANSWER = shared.LOST = 240.0  # twelve at once are slow
chance, said, found = random.Random(int(sys.argv[1])), [], 0
cache = Cache(say=said.append)
for turn in range(10):
    shutil.rmtree(cache.where, ignore_errors=True)  # another machine each time
    for key in chance.sample(["1" * 64, "2" * 64, "3" * 64], 3):
        values = np.full(40_000, float(key[0])) + np.arange(40_000)
        entry = cache.get("dig", key)
        if entry:
            found += 1
            assert np.array_equal(entry[0]["values"].data, values), key
        if chance.random() < 0.5:
            noise = Group({"writer": Dataset(np.random.default_rng().random(5000), "1", "differs from writer to writer")})
            cache.put("dig", key, Group({"values": Dataset(values, "1", "what is computed")}, {"input_hash": key}), noise)
assert not said, said
print(found)
"""


@pytest.mark.parametrize("kind", ["objects", "folder"])
def test_many_readers_and_writers(kind, request, tmp_path):
    """Twelve processes read and replace three entries: each finds the old one, the new one or none, and nobody complains."""
    if kind == "objects":
        server = request.getfixturevalue("store")
        address, endpoint = server.address, server.endpoint
    else:
        address, endpoint = f"file://{tmp_path / 'net'}", ""
        (tmp_path / "net").mkdir()
    workers = []
    for i in range(12):
        home = tmp_path / str(i)
        home.mkdir()
        workers.append(subprocess.Popen([sys.executable, "-c", WORKER, str(i)], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                        text=True, env={**os.environ, "PYTHONPATH": str(ROOT),
                                                        **environment(home, address, endpoint)}))
    found = 0
    for worker in workers:
        out, err = worker.communicate(timeout=250)
        assert worker.returncode == 0 and not err, err
        found += int(out)
    assert found > 12 * 10 * 2  # of 3 in a turn; all but those before the first was written
    assert kind == "objects" or len(list((tmp_path / "net").iterdir())) == 3


def test_the_server_dies_in_the_middle_of_a_bake(objects, bake, drops, tmp_path):
    _, _, expected = bake(drops, "a", "", "")
    home = tmp_path / "b"
    home.mkdir()
    with Server() as server:
        child = subprocess.Popen([sys.executable, "-c", (
            "import sys\nfrom bakery.run import execute\n"
            "from bakery.run.bake import planned\nfrom bakery.run.cache import Cache\n"
            "cache = Cache(say=lambda text: print(text, flush=True))\n"
            f"plan = planned({str(drops)!r}, {str(tmp_path / 'b.h5')!r}, cache=cache)\nprint('planned', flush=True)\n"
            "sys.stdin.readline()\nexecute(plan, cache=cache)\n")], text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE, env={**os.environ, "PYTHONPATH": str(ROOT),
                                         **environment(home, server.address, server.endpoint, **ONCE)})
        assert child.stdout.readline() == "planned\n"
        server.kill()
        out, err = child.communicate("go on\n", timeout=250)
    assert child.returncode == 0 and not err, err
    said = out.splitlines()
    assert len(said) == 1 and said[0].startswith(f"cache: {server.address}: ") and said[0].endswith(" alone"), said
    assert read(tmp_path / "b.h5").attributes["content_hash"] == expected
    assert len(list((home / "cache" / "bakery").glob("*.h5"))) == 2


def test_a_server_that_never_answers(objects, bake, drops):
    """One warning: what is silent is not asked once a stage."""
    met, silent = [], socket.create_server(("127.0.0.1", 0))

    def accept():
        while True:
            try:
                met.append(silent.accept()[0])
            except OSError:
                return

    threading.Thread(target=accept, daemon=True).start()
    try:
        sources, said, _ = bake(drops, "a", "s3://silent/cache", f"http://127.0.0.1:{silent.getsockname()[1]}")
    finally:
        silent.shutdown(socket.SHUT_RDWR)
        silent.close()
        for connection in met:
            connection.close()
    assert sources == COMPUTED and len(said) == 1 and "s3://silent/cache: no answer within 10 s; going on with" in said[0]
    assert len(met) <= 2  # the library tries again as the process ends


@pytest.mark.parametrize("fault, told", [
    ("bucket", "The specified bucket does not exist; going on with"),
    ("credentials", "Unable to locate credentials; going on with"),
    ("refused", 'Could not connect to the endpoint URL: "http://127.0.0.1:9/'),
])
def test_a_store_that_is_not_to_be_had_is_told_once(store, bake, drops, fault, told):
    address = "s3://no-such-bucket/cache" if fault == "bucket" else store.address
    endpoint = NOBODY if fault == "refused" else store.endpoint
    more = {"AWS_ACCESS_KEY_ID": "", "AWS_SECRET_ACCESS_KEY": ""} if fault == "credentials" else {}
    sources, said, _ = bake(drops, "a", address, endpoint, **ONCE, **more)
    assert sources == COMPUTED and len(said) == 1 and said[0].startswith(f"cache: {address}: {told}"), said


@pytest.mark.parametrize("action, told", [
    ("s3:PutObject", "can be read, not written (Forbidden); what is baked stays in"),
    ("s3:GetObject", "Forbidden; going on with"),
])
def test_rights(store, bake, drops, milk, action, told):
    assert bake(drops, "a", store.address, store.endpoint)[0] == COMPUTED
    store.deny(action)
    try:
        if action == "s3:PutObject":
            assert bake(drops, "b", store.address, store.endpoint)[:2] == (CACHED, [])
            sources, said, _ = bake(milk, "c", store.address, store.endpoint)
        else:
            sources, said, _ = bake(drops, "b", store.address, store.endpoint)
    finally:
        store.deny()
    assert set(sources) == {"computed"} and len(said) == 1 and said[0].startswith(f"cache: {store.address}: {told}"), said
