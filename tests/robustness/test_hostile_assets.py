"""Files made to do harm, with a first line that fits them: each is refused with one sentence, in little memory.

All are read in one child process that may take 200 MB more than it has after its imports; a child that hangs or dies fails
the tests.
"""

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


def dataset(file, filters=(), dtype=h5py.h5t.IEEE_F64LE, shape=(4,), chunk=(4,), most=None):
    """A dataset `x` by HDF5's own functions, so that anything can be asked for; `filters` go before the checksum."""
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plist.set_chunk(chunk)
    for add in filters:
        add(plist)
    plist.set_fletcher32()
    return h5py.h5d.create(file.id, b"x", dtype, h5py.h5s.create_simple(shape, most or shape), plist)


def plain(file, name: str, data, **more) -> None:
    file.create_dataset(name, data=data, chunks=np.shape(data), fletcher32=True, **more)


def of_type(file, dtype) -> None:
    file.create_dataset("x", shape=(1,), chunks=(1,), dtype=dtype, fletcher32=True)


def deflate(plist) -> None:
    plist.set_deflate(9)


def circle(file) -> None:
    group = file.create_group("a")
    group.create_group("b")["c"] = group


def twice(file) -> None:
    plain(file, "x", [1.0])
    file["y"] = file["x"]


def virtual(file) -> None:
    layout = h5py.VirtualLayout(shape=(4,), dtype="f8")
    layout[:] = h5py.VirtualSource("/tmp/other.h5", "x", shape=(4,))
    file.create_virtual_dataset("x", layout)


def odd_precision(file) -> None:
    odd = h5py.h5t.STD_I32LE.copy()
    odd.set_precision(17)
    dataset(file, dtype=odd)


def with_attribute(file, name: str, value) -> None:
    plain(file, "x", [1.0])
    file["x"].attrs[name] = value


def deep(file) -> None:
    for _ in range(300):
        file = file.create_group("g")


def many_links(file) -> None:
    file.create_group("g")
    for i in range(100_000):
        file.id.links.create_hard(f"a{i}".encode(), file.id, b"g")


# name -> what must be in the refusal, and what fills the file
CASES: dict[str, tuple[str, Callable]] = {
    "soft_link": ("soft or external link", lambda file: file.__setitem__("x", h5py.SoftLink("/wavelength"))),
    "soft_circle": ("soft or external link", lambda file: file.__setitem__("x", h5py.SoftLink("/x"))),
    "external_link": ("soft or external link", lambda file: file.__setitem__("x", h5py.ExternalLink("/etc/passwd", "/"))),
    "circular_hard_link": ("linked more than once", circle),
    "root_in_itself": ("linked more than once", lambda file: file.__setitem__("x", file["/"])),
    "dataset_twice": ("linked more than once", twice),
    "external_storage": ("not stored in chunks of this file", lambda file: file.create_dataset(
        "x", shape=(10,), dtype="u1", external=[("/etc/passwd", 0, 10)])),
    "virtual": ("not stored in chunks of this file", virtual),
    "contiguous": ("not stored in chunks of this file", lambda file: file.__setitem__("x", np.arange(4.0))),
    "scalar": ("no shape", lambda file: file.__setitem__("x", 1.0)),
    "null_space": ("no shape", lambda file: file.__setitem__("x", h5py.Empty("f8"))),
    "eighty_terabytes": ("too much for a file of", lambda file: dataset(file, shape=(10**7, 10**6), chunk=(1000, 1000))),
    "gzip_bomb": ("too much for a file of", lambda file: file.create_dataset(
        "x", data=np.zeros(200_000_000, "u1"), chunks=(1 << 24,), compression="gzip", fletcher32=True)),
    "gzip_bomb_in_a_small_chunk": ("a chunk of", lambda file: dataset(file, [deflate]).write_direct_chunk(
        (0,), bomb() + b"\0\0\0\0")),
    "gzip_bomb_in_a_chunk_larger_than_its_dataset": ("too much for a file of", lambda file: dataset(
        file, [deflate], h5py.h5t.STD_U8LE, (4,), (200_000_000,), (h5py.h5s.UNLIMITED,)).write_direct_chunk(
            (0,), bomb() + b"\0\0\0\0")),
    "deflate_twice": ("its filters are not", lambda file: dataset(file, [deflate, deflate])),
    "unknown_filter": ("its filters are not", lambda file: dataset(
        file, [lambda plist: plist.set_filter(40_000, h5py.h5z.FLAG_OPTIONAL, (1, 2))])),
    "lzf": ("its filters are not", lambda file: plain(file, "x", np.zeros(100), compression="lzf")),
    "no_checksum": ("its filters are not", lambda file: file.create_dataset("x", data=np.zeros(100), chunks=(100,))),
    "no_chunks": ("chunks are missing", dataset),
    "garbage_for_deflate": ("cannot be unpacked", lambda file: dataset(file, [deflate]).write_direct_chunk(
        (0,), b"garbage that is not deflate")),
    "short_chunk": ("a chunk of 3 bytes where 32 belong", lambda file: dataset(file).write_direct_chunk((0,), b"abc\0\0\0\0")),
    "object_reference": ("a type that assets do not hold", lambda file: of_type(file, h5py.ref_dtype)),
    "region_reference": ("a type that assets do not hold", lambda file: of_type(file, h5py.regionref_dtype)),
    "variable_string": ("variable-length string", lambda file: file.create_dataset(
        "x", data=["text"], chunks=(1,), dtype=h5py.string_dtype())),
    "variable_array": ("a type that assets do not hold", lambda file: file.create_dataset(
        "x", shape=(1,), chunks=(1,), dtype=h5py.vlen_dtype("f8"))),
    "compound": ("a type that assets do not hold", lambda file: plain(file, "x", np.zeros(2, [("a", "f8"), ("b", "i4")]))),
    "opaque": ("a type that assets do not hold", lambda file: plain(file, "x", np.zeros(2, "V8"))),
    "array_type": ("a type that assets do not hold", lambda file: dataset(
        file, dtype=h5py.h5t.array_create(h5py.h5t.IEEE_F64LE, (1000, 1000)))),
    "bitfield": ("a type that assets do not hold", lambda file: dataset(file, dtype=h5py.h5t.STD_B8LE)),
    "odd_precision": ("a type that assets do not hold", odd_precision),
    "enumeration_with_holes": ("an enumeration whose values", lambda file: plain(
        file, "x", np.zeros(1, "u1"), dtype=h5py.enum_dtype({"a": 0, "b": 7}, "u1"))),
    "enumeration_with_wild_names": ("an enumeration whose values", lambda file: plain(
        file, "x", np.zeros(1, "u1"), dtype=h5py.enum_dtype({"\x1b[2J": 0}, "u1"))),
    "named_type": ("neither a group nor a dataset", lambda file: file.__setitem__("x", np.dtype("f8"))),
    "many_attributes": ("attributes; at most", lambda file: file.create_group("x").attrs.update(
        {f"a{i}": i for i in range(5000)})),
    "variable_string_attribute": ("variable-length string", lambda file: file.attrs.update(x="text")),
    "array_attribute": ("not one fixed-length text", lambda file: file.attrs.update(x=np.zeros(1000))),
    "reference_attribute": ("a type that assets do not hold", lambda file: file.attrs.create(
        "x", file.ref, dtype=h5py.ref_dtype)),
    "ten_megabyte_attribute": ("not one fixed-length text", lambda file: file.create_group("x", track_order=True).attrs.create(
        "y", np.bytes_(b"a" * 10_000_000))),
    "empty_attribute": ("not one fixed-length text", lambda file: file.attrs.update(x=h5py.Empty("f8"))),
    "latin_attribute": ("not UTF-8", lambda file: file.attrs.update(x=np.bytes_(b"\xb5m"))),
    "number_as_unit": ("nothing else", lambda file: with_attribute(file, "units", 2)),
    "integer_beyond_64_bits": ("not one fixed-length text", lambda file: file.attrs.update(x=np.uint64(2**63))),
    "long_double": ("a type that assets do not hold", lambda file: file.attrs.update(x=np.longdouble(1))),
    "foreign_attribute": ("nothing else", lambda file: with_attribute(file, "scale_factor", 2.0)),
    "deep_groups": ("deeper than", deep),
    "many_links": ("more than 100000 objects", many_links),
    "many_chunks": ("more than 100000 chunks", lambda file: dataset(
        file, shape=(200_000,), chunk=(1,), dtype=h5py.h5t.STD_U8LE)),
    "dots": ("a name is", lambda file: h5py.h5g.create(file.id, b"..")),
    "escape_sequence": ("a name is", lambda file: file.create_group("\x1b[31mred")),
    "undecodable_name": ("a name is", lambda file: h5py.h5g.create(file.id, b"\xff\xfe")),
    "nothing_hashed": ("content_hash", lambda file: plain(file, "x", [1.0])),
}


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


def test_foreign_files(tmp_path):
    data = sealed_bytes(small_asset())
    with h5py.File(tmp_path / "plain.h5", "w") as file:
        file["x"] = 1.0
    with h5py.File(tmp_path / "net.nc", "w") as file:
        file.attrs["_NCProperties"] = np.bytes_(b"version=2,netcdf=4.9.2,hdf5=1.14.0")
    os.mkfifo(tmp_path / "pipe")
    stand = {"plain.h5": "not a bakery asset: it is an HDF5 file", "net.nc": "netCDF", "pipe": "folder, pipe or device",
             "none.h5": "no such file", "": "folder, pipe or device"}
    for name, content, words in (
        ("empty.h5", b"", "empty"), ("classic.nc", b"CDF\x01" + bytes(100), "netCDF"),
        ("recipe.yaml", "bakery: 1\nname: fog # µm\n".encode(), "it is a recipe; `bake RECIPE` bakes it into an asset"),
        ("noise.h5", np.random.default_rng(0).bytes(5000), "not a bakery asset"), ("zeros.h5", bytes(5000), "not a bakery asset"),
        ("newer.h5", data.replace(b"bakery-asset 1 ", b"bakery-asset 2 ", 1), "written by a newer bakery (asset format 2"),
        ("older.h5", data.replace(b"bakery-asset 1 ", b"bakery-asset 0 ", 1), "no longer read"),
        ("cut.h5", data[:-1], "damaged: container"), ("line.h5", data[:512], "damaged: container"),
        ("half.h5", data[:100], "damaged: container"), ("more.h5", data + b"\0", "damaged: container"),
        ("text.h5", resealed(data[:512] + b"no HDF5 here"), "no HDF5 begins"),
    ):
        (tmp_path / name).write_bytes(content)
        stand[name] = words
    for name, words in stand.items():
        path = tmp_path / name
        with pytest.raises(AssetError) as caught:
            bakery.open(path)
        assert words in str(caught.value) and str(path) in str(caught.value) and "\n" not in str(caught.value)
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
