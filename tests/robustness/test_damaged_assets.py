"""Corrupted and forged assets: found by `open` and by `verify`, never a wrong value."""

import io
import json
import os
import random
import subprocess
import sys
from contextlib import contextmanager

import h5py
import numpy as np
import pytest

import bakery
from bakery.asset.verify import _broken, contract, verify
from bakery.errors import AssetError
from bakery.store.tree import Dataset, Group, text
from bakery.store.write import write
from tests.conftest import ROOT, slow
from tests.samples import resealed, sealed_bytes, small_asset, with_member


@pytest.fixture(scope="module")
def sound():
    """The bytes of an undamaged asset."""
    return sealed_bytes(small_asset())


def flip(data: bytes, at: int, bit: int) -> bytes:
    return data[:at] + bytes([data[at] ^ 1 << bit]) + data[at + 1:]


def corruptions(data: bytes, rounds: int, seed: int):
    """Seeded corruptions of each kind: (what, bytes)."""
    draw = random.Random(seed)
    for _ in range(rounds):
        at = draw.randrange(len(data))
        yield f"bit at {at}", flip(data, at, draw.randrange(8))
    for _ in range(rounds // 5):
        at = draw.randrange(len(data) - 8)
        yield f"8 bytes at {at}", data[:at] + draw.randbytes(8) + data[at + 8:]
        at = draw.randrange(len(data) // 512) * 512
        yield f"512 zeros at {at}", data[:at] + bytes(512) + data[at + 512:]
        yield "cut short", data[:draw.randrange(len(data))]
        yield "appended", data + draw.randbytes(draw.randrange(1, 100))


def test_any_corruption_is_found(tmp_path, sound):
    """400 flipped bits and 320 other corruptions of the file as it is."""
    path = tmp_path / "fog.h5"
    for what, data in corruptions(sound, 400, seed=1):
        assert data != sound or "zeros" in what
        path.write_bytes(data)
        if data == sound:
            continue
        with pytest.raises(AssetError) as caught:
            bakery.open(path)
        assert str(path) in str(caught.value) and "\n" not in str(caught.value), what
        assert verify(path, locate=False), what


CHILD = """
import json, sys
from bakery.errors import AssetError
from bakery.store.hashes import root_hash, seal
from bakery.store.read import parse
from tests.robustness.test_damaged_assets import corruptions
from tests.samples import resealed, sealed_bytes, small_asset
sound = sealed_bytes(small_asset())
right = seal(small_asset()).attributes["content_hash"]
counts = {"refused": 0, "right": 0, "wrong": []}
for what, data in corruptions(sound, int(sys.argv[1]), seed=2):
    try:
        root = parse("fog.h5", resealed(data) if len(data) > 512 else data)
    except AssetError as error:
        counts["refused"] += 1
    else:
        # unused bytes and provenance may change; what a renderer gets may not
        if root_hash(root) == right and root.attributes["content_hash"] == right:
            counts["right"] += 1
        else:
            counts["wrong"].append(what)
print(json.dumps(counts))
"""


@pytest.mark.parametrize("rounds", [slow(70), pytest.param(2500, marks=pytest.mark.soak)])
def test_corruption_under_a_digest_that_fits(rounds):
    """The digest is computed again after the corruption: hashes inside, HDF5's checksums and the structure are what is left.

    In a process of its own: should the HDF5 library crash it, this test fails.
    """
    done = subprocess.run([sys.executable, "-c", CHILD, str(rounds)], env={**os.environ, "PYTHONPATH": str(ROOT)}, text=True,
                          capture_output=True, timeout=60 + rounds / 5)
    assert done.returncode == 0, done.stderr
    counts = json.loads(done.stdout)
    assert counts["wrong"] == []
    assert counts["refused"] > rounds and counts["right"] > 0


def chunk_of(data: bytes, path: str) -> int:
    """A place in the middle of a dataset's first chunk."""
    with h5py.File(io.BytesIO(data), "r") as file:
        chunk = file[path].id.get_chunk_info(0)
        return chunk.byte_offset + chunk.size // 2


@pytest.mark.parametrize("place", ["medium/phase", "optics/droplets/radius", "recipe"])
def test_verify_names_the_dataset_that_is_hit(tmp_path, sound, place, verified_here):
    (tmp_path / "fog.h5").write_bytes(flip(sound, chunk_of(sound, place), 3))
    broken = verify(tmp_path / "fog.h5")
    assert broken[0].startswith("container: ") and broken[1].startswith(f"{place}: "), broken
    assert len(broken) == 2


@contextmanager
def edited(data: bytes):
    """The file opened for writing with h5py; afterwards `.data` holds it with a first line that fits."""

    class Edit:
        pass

    edit, buffer = Edit(), io.BytesIO(data)
    with h5py.File(buffer, "r+") as edit.file:
        yield edit
    edit.data = resealed(buffer.getvalue())


def swap(file) -> None:
    for old, new in (("sigma_a", "x"), ("sigma_s", "sigma_a"), ("x", "sigma_s")):
        file.move(f"medium/{old}", f"medium/{new}")


EDITS = {
    "dataset renamed": lambda file: file.move("medium/sigma_a", "medium/sigma_b"),
    "dataset moved": lambda file: file.move("medium/sigma_a", "optics/sigma_a"),
    "datasets swapped": swap,
    "dataset more": lambda file: file["medium"].create_dataset("extra", data=[1.0], chunks=(1,), fletcher32=True),
    "unit": lambda file: file["optics/droplets/radius"].attrs.modify("units", np.bytes_(b"mm")),
    "version": lambda file: file.attrs.modify("format_version", 2),
    "format": lambda file: file.attrs.modify("format", np.bytes_(b"bakery-other")),
    "value": lambda file: file["medium/phase"].__setitem__((0, 5), 1.0000001 * file["medium/phase"][0, 5]),
    "tolerance": lambda file: file["medium"].attrs.modify("tolerance", 0.5),
    "no hash": lambda file: file.attrs.__delitem__("content_hash"),
}


@pytest.mark.parametrize("change", EDITS.values(), ids=EDITS)
def test_edits_with_ordinary_tools_are_found(tmp_path, sound, change):
    with edited(sound) as edit:
        change(edit.file)
    (tmp_path / "fog.h5").write_bytes(edit.data)
    with pytest.raises(AssetError):
        bakery.open(tmp_path / "fog.h5")
    assert found(tmp_path / "fog.h5")


def found(path):
    """What `verify` finds in a file that crashes nothing: without the process of its own, that takes half a second."""
    try:
        return _broken(str(path))
    except AssetError as error:
        return [str(error)]


def scaled(path: str, factor) -> Group:
    root = small_asset()
    dataset = root[path]
    return with_member(root, path, Dataset(dataset.data * factor, dataset.units, dataset.description))


@pytest.mark.parametrize(("path", "factor"), [("medium/phase", 1.001), ("medium/cdf", 0.99), ("medium/albedo", 0.9),
                                              ("medium/sigma_t", 1.1), ("medium/g", 0.9)])
def test_physics_finds_what_was_hashed_anew(tmp_path, path, factor):
    """Integrity is in order; only the stages' own rules can tell."""
    write(tmp_path / "fog.h5", scaled(path, factor))
    bakery.open(tmp_path / "fog.h5")
    broken = found(tmp_path / "fog.h5")
    assert broken and all(line.startswith("medium") for line in broken), broken


def stage_without(name: str) -> Group:
    root = small_asset()
    attributes = {key: value for key, value in root["medium"].attributes.items() if key != name}
    return with_member(root, "medium", Group(root["medium"].members, attributes))


def numbers(value, units="1", description="numbers") -> Dataset:
    return Dataset(np.array(value), units, description)


@pytest.mark.parametrize(("root", "words"), [
    (with_member(small_asset(), "medium/sigma_t", None), "medium/sigma_t: missing"),
    (with_member(small_asset(), "optics/droplets/radius", None), "optics/droplets/radius: missing"),
    (with_member(small_asset(), "optics/droplets", None), "optics/COMPONENT/radius: missing"),
    (with_member(small_asset(), "medium/sigma_t", numbers([1.0, 1.0], "1/mm")),
     "medium/sigma_t: its units are '1/mm', not '1/m'"),
    (with_member(small_asset(), "medium/more", numbers([1.0], "")), "medium/more: no units"),
    (with_member(small_asset(), "medium/more", numbers([1.0], "1", "")), "medium/more: no description"),
    (with_member(small_asset(), "medium/g_error", numbers([1.0])), "medium/g_error: not of the shape of medium/g"),
    (with_member(small_asset(), "medium/sigma_t_error", numbers([1.0, 1.0], "1")), "medium/sigma_t_error: its units are '1'"),
    (with_member(small_asset(), "medium/h_error", numbers([1.0])), "medium/h_error: standard errors of nothing"),
    (with_member(small_asset(), "medium/h_bias", numbers([1.0])), "medium/h_bias: biases of nothing"),
    (with_member(small_asset(), "medium/g_error", numbers([1.0, -1.0])), "medium/g_error: negative standard errors"),
    (with_member(small_asset(), "medium/more", numbers([np.nan])), "medium/more: not finite"),
    (with_member(small_asset(), "more", numbers([1.0])), "more: does not belong"),
    (with_member(small_asset(), "wavelength", numbers([0.0], "um")), "wavelength: not positive"),
    (with_member(small_asset(), "recipe", numbers([0.0])), "recipe: missing, or not UTF-8"),
    (with_member(small_asset(), "recipe", Dataset(np.array([255], np.uint8), "utf-8", "recipe")), "recipe: not UTF-8"),
    (with_member(small_asset(), "provenance", None), "provenance: missing"),
    (with_member(small_asset(), "medium/kind", Dataset(np.array([3], np.uint8), "1", "kind", ("a", "b"))),
     "medium/kind: a value"),
    (with_member(small_asset(), "medium/note", text("a", "two\nlines")), "medium/note: no description in one line"),
    (stage_without("tolerance"), "medium: attribute `tolerance` is missing"),
    (stage_without("stage"), "medium: its attribute `stage` is None"),
], ids=lambda value: value if isinstance(value, str) else "")
def test_contract(root, words):
    from bakery.store.hashes import seal

    assert any(line.startswith(words) for line in contract(seal(root))), contract(seal(root))


def test_a_sound_asset_passes(tmp_path, verified_here):
    write(tmp_path / "fog.h5", small_asset())
    assert verify(tmp_path / "fog.h5") == []


@pytest.mark.slow
def test_verify_says_what_its_process_finds(tmp_path, sound):
    """A fault of the structure, one of the hashes, one of the physics."""
    for change in (EDITS["format"], EDITS["value"]):
        with edited(sound) as edit:
            change(edit.file)
        (tmp_path / "fog.h5").write_bytes(edit.data)
        assert verify(tmp_path / "fog.h5") == found(tmp_path / "fog.h5") != []
    write(tmp_path / "fog.h5", scaled("medium/phase", 1.001))
    assert verify(tmp_path / "fog.h5") == found(tmp_path / "fog.h5") != []


@pytest.mark.parametrize(("script", "words"), [
    ("kill -SEGV $$", "damaged: the process that read it was ended by signal 11"),
    ("sleep 60", "damaged: reading it did not end within 0.2 s"),
    ("echo Oops >&2; exit 1", "could not be verified: the process that read it ended with status 1 (Oops)"),
])
def test_a_library_that_crashes_or_hangs_is_a_finding(tmp_path, sound, monkeypatch, script, words):
    """The process that reads is replaced by one that dies or never answers."""
    child = tmp_path / "python"
    child.write_text(f"#!/bin/sh\n{script.replace('sleep', 'exec sleep')}\n")
    child.chmod(0o755)
    (tmp_path / "fog.h5").write_bytes(sound)
    monkeypatch.setattr(sys, "executable", str(child))
    broken = verify(tmp_path / "fog.h5", time_limit=0.2 if "sleep" in script else 30)
    assert len(broken) == 1 and broken[0].startswith("container: ") and words in broken[0]
