"""Files made to do harm, with a first line that fits them: each is refused with one sentence, in little memory.

All are read in one child process that may take 200 MB more than it has after its imports; a child that hangs or dies fails
the tests.
"""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import zlib
from collections.abc import Callable
from functools import cache

import h5py
import numpy as np
import pytest

import bakery
from bakery.asset.verify import verify
from bakery.errors import AssetError
from bakery.stages.members import MissingStage
from bakery.store.files import Files
from bakery.store.read import read
from bakery.store.write import write
from tests.conftest import ROOT
from tests.samples import resealed, sealed_bytes, small_asset


@cache
def bomb() -> bytes:
    """200 MB of zeros, packed."""
    return zlib.compress(bytes(200_000_000), 9)


CASES: dict[str, tuple[str, Callable]] = {}


def case(words: str):
    """Register a function that fills a file; `words` must be in the refusal."""

    def register(fill):
        CASES[fill.__name__.strip("_")] = (words, fill)
        return fill

    return register


def dataset(file, filters=lambda plist: plist.set_fletcher32(), dtype=h5py.h5t.IEEE_F64LE, shape=(4,), chunk=(4,), most=None):
    """A dataset `x` by HDF5's own functions, so that anything can be asked for."""
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plist.set_chunk(chunk)
    filters(plist)
    return h5py.h5d.create(file.id, b"x", dtype, h5py.h5s.create_simple(shape, most or shape), plist)


def plain(file, name: str, data, **more) -> None:
    file.create_dataset(name, data=data, chunks=np.shape(data), fletcher32=True, **more)


@case("soft or external link")
def soft_link(file):
    file["x"] = h5py.SoftLink("/wavelength")


@case("soft or external link")
def soft_circle(file):
    file["x"] = h5py.SoftLink("/x")


@case("soft or external link")
def external_link(file):
    file["x"] = h5py.ExternalLink("/etc/passwd", "/")


@case("linked more than once")
def circular_hard_link(file):
    group = file.create_group("a")
    group.create_group("b")["c"] = group


@case("linked more than once")
def root_in_itself(file):
    file["x"] = file["/"]


@case("linked more than once")
def dataset_twice(file):
    plain(file, "x", [1.0])
    file["y"] = file["x"]


@case("not stored in chunks of this file")
def external_storage(file):
    file.create_dataset("x", shape=(10,), dtype="u1", external=[("/etc/passwd", 0, 10)])


@case("not stored in chunks of this file")
def virtual(file):
    layout = h5py.VirtualLayout(shape=(4,), dtype="f8")
    layout[:] = h5py.VirtualSource("/tmp/other.h5", "x", shape=(4,))
    file.create_virtual_dataset("x", layout)


@case("not stored in chunks of this file")
def contiguous(file):
    file["x"] = np.arange(4.0)


@case("no shape")
def scalar(file):
    file["x"] = 1.0


@case("no shape")
def null_space(file):
    file["x"] = h5py.Empty("f8")


@case("too much for a file of")
def eighty_terabytes(file):
    dataset(file, shape=(10**7, 10**6), chunk=(1000, 1000))


@case("too much for a file of")
def gzip_bomb(file):
    file.create_dataset("x", data=np.zeros(200_000_000, "u1"), chunks=(1 << 24,), compression="gzip", fletcher32=True)


@case("a chunk of")
def gzip_bomb_in_a_small_chunk(file):
    def filters(plist):
        plist.set_deflate(9)
        plist.set_fletcher32()

    dataset(file, filters=filters).write_direct_chunk((0,), bomb() + b"\0\0\0\0")


@case("too much for a file of")
def gzip_bomb_in_a_chunk_larger_than_its_dataset(file):
    def filters(plist):
        plist.set_deflate(9)
        plist.set_fletcher32()

    whole = dataset(file, filters, h5py.h5t.STD_U8LE, (4,), (200_000_000,), (h5py.h5s.UNLIMITED,))
    whole.write_direct_chunk((0,), bomb() + b"\0\0\0\0")


@case("its filters are not")
def deflate_twice(file):
    def filters(plist):
        plist.set_deflate(9)
        plist.set_deflate(9)
        plist.set_fletcher32()

    dataset(file, filters=filters)


@case("its filters are not")
def unknown_filter(file):
    def filters(plist):
        plist.set_filter(40_000, h5py.h5z.FLAG_OPTIONAL, (1, 2))
        plist.set_fletcher32()

    dataset(file, filters=filters)


@case("its filters are not")
def lzf(file):
    file.create_dataset("x", data=np.zeros(100), chunks=(100,), compression="lzf", fletcher32=True)


@case("its filters are not")
def no_checksum(file):
    file.create_dataset("x", data=np.zeros(100), chunks=(100,))


@case("chunks are missing")
def no_chunks(file):
    dataset(file)


@case("cannot be unpacked")
def garbage_for_deflate(file):
    def filters(plist):
        plist.set_deflate(9)
        plist.set_fletcher32()

    dataset(file, filters=filters).write_direct_chunk((0,), b"garbage that is not deflate")


@case("a chunk of 3 bytes where 32 belong")
def short_chunk(file):
    dataset(file).write_direct_chunk((0,), b"abc\0\0\0\0")


@case("a type that assets do not hold")
def object_reference(file):
    file.create_dataset("x", shape=(1,), chunks=(1,), dtype=h5py.ref_dtype, fletcher32=True)


@case("a type that assets do not hold")
def region_reference(file):
    file.create_dataset("x", shape=(1,), chunks=(1,), dtype=h5py.regionref_dtype, fletcher32=True)


@case("variable-length string")
def variable_string(file):
    file.create_dataset("x", data=["text"], chunks=(1,), dtype=h5py.string_dtype())


@case("a type that assets do not hold")
def variable_array(file):
    file.create_dataset("x", shape=(1,), chunks=(1,), dtype=h5py.vlen_dtype("f8"))


@case("a type that assets do not hold")
def compound(file):
    plain(file, "x", np.zeros(2, [("a", "f8"), ("b", "i4")]))


@case("a type that assets do not hold")
def opaque(file):
    plain(file, "x", np.zeros(2, "V8"))


@case("a type that assets do not hold")
def array_type(file):
    dataset(file, dtype=h5py.h5t.array_create(h5py.h5t.IEEE_F64LE, (1000, 1000)))


@case("a type that assets do not hold")
def bitfield(file):
    dataset(file, dtype=h5py.h5t.STD_B8LE)


@case("a type that assets do not hold")
def odd_precision(file):
    odd = h5py.h5t.STD_I32LE.copy()
    odd.set_precision(17)
    dataset(file, dtype=odd)


@case("an enumeration whose values")
def enumeration_with_holes(file):
    file.create_dataset("x", data=np.zeros(1, "u1"), dtype=h5py.enum_dtype({"a": 0, "b": 7}, "u1"), chunks=(1,), fletcher32=True)


@case("an enumeration whose values")
def enumeration_with_wild_names(file):
    file.create_dataset("x", data=np.zeros(1, "u1"), dtype=h5py.enum_dtype({"\x1b[2J": 0}, "u1"), chunks=(1,), fletcher32=True)


@case("neither a group nor a dataset")
def named_type(file):
    file["x"] = np.dtype("f8")


@case("attributes; at most")
def many_attributes(file):
    group = file.create_group("x")
    for i in range(5000):
        group.attrs[f"a{i}"] = i


@case("variable-length string")
def variable_string_attribute(file):
    file.attrs["x"] = "text"


@case("not one fixed-length text")
def array_attribute(file):
    file.attrs["x"] = np.zeros(1000)


@case("a type that assets do not hold")
def reference_attribute(file):
    file.attrs.create("x", file.ref, dtype=h5py.ref_dtype)


@case("not one fixed-length text")
def ten_megabyte_attribute(file):
    file.create_group("x", track_order=True).attrs.create("y", np.bytes_(b"a" * 10_000_000))


@case("not one fixed-length text")
def empty_attribute(file):
    file.attrs["x"] = h5py.Empty("f8")


@case("not UTF-8")
def latin_attribute(file):
    file.attrs["x"] = np.bytes_(b"\xb5m")


@case("nothing else")
def number_as_unit(file):
    plain(file, "x", [1.0])
    file["x"].attrs["units"] = 2


@case("not one fixed-length text")
def integer_beyond_64_bits(file):
    file.attrs["x"] = np.uint64(2**63)


@case("a type that assets do not hold")
def long_double(file):
    file.attrs["x"] = np.longdouble(1)


@case("nothing else")
def foreign_attribute(file):
    plain(file, "x", [1.0])
    file["x"].attrs["scale_factor"] = 2.0


@case("deeper than")
def deep_groups(file):
    group = file
    for _ in range(300):
        group = group.create_group("g")


@case("more than 100000 objects")
def many_links(file):
    file.create_group("g")
    for i in range(100_000):
        file.id.links.create_hard(f"a{i}".encode(), file.id, b"g")


@case("more than 100000 chunks")
def many_chunks(file):
    dataset(file, shape=(200_000,), chunk=(1,), dtype=h5py.h5t.STD_U8LE)


@case("a name is")
def dots(file):
    h5py.h5g.create(file.id, b"..")


@case("a name is")
def escape_sequence(file):
    file.create_group("\x1b[31mred")


@case("a name is")
def undecodable_name(file):
    h5py.h5g.create(file.id, b"\xff\xfe")


@case("content_hash")
def nothing_hashed(file):
    plain(file, "x", [1.0])


def bytes_of(fill) -> bytes:
    buffer = io.BytesIO()
    with h5py.File(buffer, "w", libver="v110", userblock_size=512) as file:
        file.attrs["format"] = np.bytes_(b"bakery-asset")
        file.attrs["format_version"] = 1
        fill(file)
    return resealed(buffer.getvalue())


CHILD = """
import json, resource, sys
import h5py, numpy
from bakery.errors import AssetError
from bakery.store.hashes import root_hash
from bakery.store.files import Files
from bakery.store.read import read
size = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (size + 200_000_000,) * 2)
answers = {}
for line in sys.stdin:
    path = line.strip()
    try:
        read(path)
        answers[path] = "was read"
    except AssetError as error:
        answers[path] = str(error)
print(json.dumps(answers))
"""


@pytest.fixture(scope="module")
def answers(tmp_path_factory):
    """What `read` says of each file of the corpus."""
    folder = tmp_path_factory.mktemp("hostile")
    for name, (_, fill) in CASES.items():
        (folder / f"{name}.h5").write_bytes(bytes_of(fill))
    done = subprocess.run([sys.executable, "-c", CHILD], input="\n".join(str(folder / f"{name}.h5") for name in CASES),
                          env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return {os.path.basename(path)[:-3]: answer for path, answer in json.loads(done.stdout).items()}


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="the memory limit is set from /proc")
@pytest.mark.parametrize("name", CASES)
def test_hostile_file_is_refused(answers, name):
    assert CASES[name][0] in answers[name], answers[name]
    assert "\n" not in answers[name] and "\x1b" not in answers[name]


def test_bomb_is_one():
    """The corpus holds what it says: 200 MB in 200 kB."""
    assert len(bomb()) < 200_000


def foreign(tmp_path):
    """Files that are no assets, with what must be said of them."""
    data = sealed_bytes(small_asset())
    with h5py.File(tmp_path / "plain.h5", "w") as file:
        file["x"] = 1.0
    with h5py.File(tmp_path / "net.nc", "w") as file:
        file.attrs["_NCProperties"] = np.bytes_(b"version=2,netcdf=4.9.2,hdf5=1.14.0")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "empty.h5").write_bytes(b"")
    (tmp_path / "recipe.yaml").write_text("bakery: 1\nname: fog # µm\n")
    (tmp_path / "classic.nc").write_bytes(b"CDF\x01" + bytes(100))
    (tmp_path / "noise.h5").write_bytes(np.random.default_rng(0).bytes(5000))
    (tmp_path / "zeros.h5").write_bytes(bytes(5000))
    (tmp_path / "newer.h5").write_bytes(data.replace(b"bakery-asset 1 ", b"bakery-asset 2 ", 1))
    (tmp_path / "older.h5").write_bytes(data.replace(b"bakery-asset 1 ", b"bakery-asset 0 ", 1))
    (tmp_path / "cut.h5").write_bytes(data[:-1])
    (tmp_path / "line.h5").write_bytes(data[:512])
    (tmp_path / "half.h5").write_bytes(data[:100])
    (tmp_path / "more.h5").write_bytes(data + b"\0")
    (tmp_path / "text.h5").write_bytes(resealed(data[:512] + b"no HDF5 here"))
    return [("plain.h5", "not a bakery asset: it is an HDF5 file"), ("net.nc", "netCDF"), ("classic.nc", "netCDF"),
            ("pipe", "folder, pipe or device"), ("empty.h5", "empty"),
            ("recipe.yaml", "it is a recipe; `bake RECIPE` bakes it into an asset"), ("noise.h5", "not a bakery asset"),
            ("zeros.h5", "not a bakery asset"),
            ("newer.h5", "written by a newer bakery (asset format 2"), ("older.h5", "no longer read"),
            ("cut.h5", "damaged: container"),
            ("line.h5", "damaged: container"), ("half.h5", "damaged: container"), ("more.h5", "damaged: container"),
            ("text.h5", "no HDF5 begins"), ("none.h5", "no such file"), ("", "folder, pipe or device")]


def test_foreign_files(tmp_path):
    for name, words in foreign(tmp_path):
        path = tmp_path / name
        with pytest.raises(AssetError) as caught:
            bakery.open(path)
        assert words in str(caught.value) and str(path) in str(caught.value)
        assert "\n" not in str(caught.value)
        assert verify(path, locate=False), name


@pytest.mark.parametrize("path", ["http://example.org/fog.h5", "s3://bucket/fog.h5", "/dev/null", "/dev/zero"])
def test_what_is_no_file_is_not_opened(path):
    with pytest.raises(AssetError):
        bakery.open(path)
    assert verify(path)


def test_asset_without_a_stage_and_cache_entry(tmp_path):
    root = small_asset()
    del root.members["optics"]
    write(tmp_path / "a.h5", root)
    with pytest.raises(MissingStage, match=r"no stage 'optics'.*`bake RECIPE"):
        _ = bakery.open(tmp_path / "a.h5").optics
    del root.members["wavelength"]
    write(tmp_path / "b.h5", root)
    read(tmp_path / "b.h5")
    with pytest.raises(AssetError, match="cache"):
        bakery.open(tmp_path / "b.h5")


class Unread(Files):
    """Files of which only the beginning may be looked at."""

    def read(self, fd):
        raise AssertionError("was read whole")


@pytest.mark.parametrize(("begins", "words"), [
    (b"\0", "not a bakery asset"), (b"bakery-asset 1 sha256:", "GB of memory are free"),
])
def test_no_file_is_read_that_is_no_asset_or_that_memory_does_not_hold(tmp_path, begins, words):
    """4 TB of nothing, that take no room on the disk."""
    path = tmp_path / "large.h5"
    path.write_bytes(begins)
    os.truncate(path, 4 << 40)
    with pytest.raises(AssetError, match=words):
        read(path, files=Unread())
