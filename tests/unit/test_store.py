"""The store: what goes in comes out, the same bytes each time, hashes over everything that counts."""

import hashlib
import io
import os
import re
import stat
import threading

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from bakery.errors import AssetError, StoreError, UsageError
from bakery.store.container import Limits, user_block
from bakery.store.hashes import broken_hashes, content_hash, root_hash, seal
from bakery.store.image import CHUNK, chunk_shape, image
from bakery.store.read import read
from bakery.store.tree import Dataset, Group, read_text, text
from bakery.store.write import check_target, free_space, write
from tests.conftest import where_rights_bind
from tests.samples import sealed_bytes, small_asset, with_member


def assert_same(a: Group, b: Group) -> None:
    assert list(a.members) == list(b.members)
    assert a.attributes == b.attributes
    for (path, one), (_, other) in zip(a.walk(), b.walk(), strict=True):
        if isinstance(one, Group):
            assert one.attributes == other.attributes, path
            assert {k: type(v) for k, v in one.attributes.items()} == {k: type(v) for k, v in other.attributes.items()}
            assert list(one.members) == list(other.members), path
        else:
            assert (one.units, one.description, one.choices) == (other.units, other.description, other.choices), path
            assert one.data.dtype == other.data.dtype and one.data.shape == other.data.shape, path
            assert one.data.tobytes() == other.data.tobytes(), path


@pytest.mark.parametrize("data", [
    np.array([-0.0, np.nan, np.inf, 5e-324]), np.arange(7, dtype=np.float32), np.array([1.5], np.float16),
    np.arange(6, dtype=np.int16).reshape(2, 3), np.array([2**63], np.uint64), np.array([True, False]), np.array([1 + 2j, 3]),
    np.array([b"ab", b"c"]), np.zeros((0, 3)), np.zeros((2, 0)), np.ones((3, CHUNK // 8 + 5)), np.zeros((70, 70, 70)),
    np.arange(12.0).reshape(3, 4).T,
], ids=lambda data: f"{data.dtype}{data.shape}")
def test_types_and_shapes(tmp_path, data):
    write(tmp_path / "a.h5", Group({"x": Dataset(data, "1", "numbers")}))
    back = read(tmp_path / "a.h5")["x"].data
    assert back.dtype == data.dtype and back.shape == data.shape and back.tobytes() == np.ascontiguousarray(data).tobytes()
    assert not back.flags.writeable


def test_scalars_and_byte_order_are_normalised(tmp_path):
    big_endian = np.array([1.0, 2.0], ">f8")
    write(tmp_path / "a.h5", Group({"x": Dataset(np.array(2.5), "1", "one"), "y": Dataset(big_endian, "1", "two")}))
    root = read(tmp_path / "a.h5")
    assert root["x"].data.shape == (1,)
    assert root["y"].data.dtype.str == "<f8" and root["y"].data.tolist() == [1.0, 2.0]


names = some.from_regex(r"\A[A-Za-z][A-Za-z0-9_-]{0,20}\Z")
strings = some.text(some.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=30)
values = strings | some.integers(-2**63, 2**63 - 1) | some.floats(allow_nan=False) | some.booleans()
attributes = some.dictionaries(names.filter(lambda name: name != "content_hash"), values, max_size=12)
datasets = some.builds(Dataset, some.lists(some.floats(), min_size=1, max_size=4).map(np.array), strings, strings)
trees = some.recursive(some.builds(Group, some.dictionaries(names, datasets, max_size=3), attributes),
                       lambda inner: some.builds(Group, some.dictionaries(names, inner | datasets, max_size=3), attributes),
                       max_leaves=5)


@settings(max_examples=12, deadline=None, derandomize=True)
@given(trees)
def test_any_tree_comes_back(tmp_path_factory, tree):
    tree = Group({"tree": tree})
    path = tmp_path_factory.mktemp("tree") / "a.h5"
    write(path, tree)
    assert_same(read(path), seal(tree))


def test_same_tree_same_bytes():
    assert sealed_bytes(small_asset()) == sealed_bytes(small_asset())


def test_order_of_members_stays_and_does_not_enter_the_hash(tmp_path):
    one = Dataset(np.ones(1), "1", "one")
    forward, backward = Group({"b": one, "a": one, "c": one}), Group({"c": one, "a": one, "b": one})
    write(tmp_path / "a.h5", forward)
    assert list(read(tmp_path / "a.h5").members) == ["b", "a", "c"]
    assert content_hash(forward) == content_hash(backward)


def test_content_hash_by_the_definition_on_the_format_page():
    """The hash of a small tree, spelt out with hashlib alone."""
    dataset = Dataset(np.array([1.0, 2.0]), "um", "radii")
    group = Group({"radius": dataset}, {"stage": "optics", "version": 3, "content_hash": "whatever"})
    stated = (f"dataset\nattribute description utf-8 {b'radii'.hex()}\nattribute units utf-8 {b'um'.hex()}\n"
              "data <f8 shape 2\n").encode() + np.array([1.0, 2.0], "<f8").tobytes()
    inner = hashlib.sha256(stated).hexdigest()
    outer = (f"group\nattribute stage utf-8 {b'optics'.hex()}\nattribute version <i8 0300000000000000\n"
             f"member radius {inner}\n")
    assert content_hash(group) == hashlib.sha256(outer.encode()).hexdigest()


def test_hash_sees_everything_that_counts():
    root = small_asset()
    radius = root["optics/droplets/radius"]
    method = root["optics/droplets/method"]
    changed = [
        with_member(root, "optics/droplets/radius", Dataset(np.nextafter(radius.data, 100), "um", radius.description)),
        with_member(root, "optics/droplets/radius", Dataset(radius.data, "m", radius.description)),
        with_member(root, "optics/droplets/radius", Dataset(radius.data, "um", "diameters")),
        with_member(root, "optics/droplets/radius", Dataset(radius.data[:, None], "um", radius.description)),
        with_member(root, "optics/droplets/radius", Dataset(radius.data.view("<i8"), "um", radius.description)),
        with_member(root, "optics/droplets/radius", None),
        with_member(root, "optics/droplets/diameter", radius),
        with_member(root, "optics/droplets/method", Dataset(method.data, "1", method.description, ("rayleigh", "goa", "mie"))),
        with_member(root, "optics", Group(root["optics"].members, root["optics"].attributes | {"tolerance": 0.02})),
        with_member(root, "wavelength", Dataset(np.array([0.61, 0.466]), "um", "wavelengths in vacuum")),
        with_member(root, "recipe", text("name: mist", "the recipe's text")),
        Group(root.members, root.attributes | {"name": "mist"}),
    ]
    hashes = {root_hash(tree) for tree in [root, *changed]}
    assert len(hashes) == len(changed) + 1
    assert root_hash(with_member(root, "provenance", Group())) == root_hash(root)


def test_seal_is_idempotent_and_what_broken_hashes_checks():
    root = seal(small_asset())
    assert_same(seal(root), root)
    assert broken_hashes(root) == []
    wrong = with_member(root, "medium/g", Dataset(root["medium/g"].data / 2, "1", root["medium/g"].description))
    assert [line.split(":")[0] for line in broken_hashes(wrong)] == ["medium"]
    wrong = with_member(root, "wavelength", Dataset(root["wavelength"].data / 2, "um", "wavelengths in vacuum"))
    assert broken_hashes(wrong)[0].startswith("the root")


def test_file_is_plain_hdf5_for_ordinary_readers(tmp_path):
    write(tmp_path / "fog.h5", small_asset())
    data = (tmp_path / "fog.h5").read_bytes()
    line, rest = data[:512].split(b"\n", 1)
    assert re.fullmatch(rb"bakery-asset 1 sha256:[0-9a-f]{64}", line) and set(rest) == {10}
    assert line.split(b":")[1].decode() == hashlib.sha256(data[512:]).hexdigest()
    with h5py.File(tmp_path / "fog.h5", "r") as file:
        assert file.attrs["format"] == b"bakery-asset" and file.attrs["format_version"] == 1
        method = file["optics/droplets/method"]
        assert h5py.check_enum_dtype(method.dtype) == {"rayleigh": 0, "mie": 1, "goa": 2}
        assert file["optics/droplets/radius"].attrs["units"] == b"um"
        assert bytes(file["recipe"][...]).decode().startswith("bakery: 1")
        assert list(file) == ["recipe", "wavelength", "optics", "medium", "provenance"]

        def rules(name, found):
            if isinstance(found, h5py.Dataset):
                assert found.chunks and found.fletcher32, name
                assert found.compression in (None, "gzip"), name

        file.visititems(rules)


def test_our_unpacking_agrees_with_the_library(tmp_path):
    """Several chunks in each direction, cut at the edges, with and without deflate."""
    draw = np.random.default_rng(3)
    noisy, smooth = draw.random((5, 40_000, 3)), np.round(draw.random((700, 900)), 2)
    write(tmp_path / "a.h5", Group({"noisy": Dataset(noisy, "1", "x"), "smooth": Dataset(smooth, "1", "y")}))
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["noisy"].compression is None and file["smooth"].compression == "gzip"
        assert file["noisy"].id.get_num_chunks() > 1 < file["smooth"].id.get_num_chunks()
        ours = read(tmp_path / "a.h5")
        for name in ("noisy", "smooth"):
            assert np.array_equal(file[name][...], ours[name].data)


@pytest.mark.parametrize("shape", [(1,), (5, 7), (3, 10**6), (10**4, 10**4), (2, 3, 10**7), (10**7, 1), (600, 2, 400)])
def test_chunks_are_at_most_a_megabyte_and_no_smaller_than_needed(shape):
    chunk = chunk_shape(shape, 8)
    assert 8 * np.prod(chunk) <= CHUNK
    assert chunk == shape or 8 * np.prod(chunk) > CHUNK / 4


def test_text_survives():
    for string in ("", "µm, Rayleigh–Gans\n", "a\0b"):
        assert read_text(text(string, "any")) == string


@pytest.mark.parametrize("root", [
    Group({"..": Group()}), Group({"a/b": Group()}), Group({"": Group()}), Group({"x" * 65: Group()}),
    Group({"x": Dataset(np.array(["text"]), "1", "unicode")}), Group({"x": Dataset(np.array([object()]), "1", "object")}),
    Group({}, {"a": "x" * 70_000}), Group({}, {"a": "nul\0"}), Group({}, {"a": [1]}), Group({}, {"a b": 1}),
    Group({"x": Dataset(np.array([0.5]), "1", "y", ("one", "two"))}),
])
def test_what_the_format_forbids_is_not_written(tmp_path, root):
    with pytest.raises(ValueError):
        write(tmp_path / "a.h5", root)
    assert not list(tmp_path.iterdir())


def test_check_stops_the_write(tmp_path):
    path = tmp_path / "fog.h5"
    path.write_bytes(b"old")
    with pytest.raises(StoreError, match=r"fog.h5: not written: albedo above 1"):
        write(path, small_asset(), check=lambda root: ["albedo above 1"])
    assert path.read_bytes() == b"old" and [p.name for p in tmp_path.iterdir()] == ["fog.h5"]
    seen = []
    write(path, small_asset(), check=lambda root: seen.append(root["medium/g"].data.copy()) or [])
    assert np.array_equal(seen[0], small_asset()["medium/g"].data)


def test_mode_follows_the_umask_and_a_link_stays(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "link.h5").symlink_to(tmp_path / "real" / "fog.h5")
    before = os.umask(0o027)
    try:
        write(tmp_path / "link.h5", small_asset())
    finally:
        os.umask(before)
    assert (tmp_path / "link.h5").is_symlink()
    assert stat.S_IMODE((tmp_path / "real" / "fog.h5").stat().st_mode) == 0o640
    assert read(tmp_path / "link.h5").attributes["name"] == "fog"


def test_targets_are_refused_before_anything_is_computed(tmp_path):
    (tmp_path / "file").write_text("")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "dir.png").mkdir()
    for path, words in [(tmp_path, "is a folder; .*NAME.h5"), (tmp_path / "dir.png", "is a folder; .*dir.png/NAME.png"),
                        (tmp_path / "none" / "a.h5", "folder does not exist"), ("", "not the name"),
                        (tmp_path / "file" / "a.h5", "Not a directory"), (tmp_path / "pipe", "pipe or device"),
                        ("a\0b", "not the name"), ("/dev/null", "pipe or device"), (tmp_path / ("n" * 300), "name too long"),
                        (f"{tmp_path}/none/", "does not exist")]:
        with pytest.raises(UsageError, match=words):
            check_target(path)
    reading, writing = os.pipe()
    try:  # as /dev/stdout is where output is piped: opening it to see what is there would wait for ever
        with pytest.raises(UsageError, match="pipe or device"):
            check_target(f"/dev/fd/{writing}")
    finally:
        os.close(reading)
        os.close(writing)
    check_target(tmp_path / "new.h5")
    assert free_space(tmp_path / "none" / "a.h5") > 0


def test_a_folder_without_right_to_write_is_refused(tmp_path):
    check_target(tmp_path / "a.h5")

    def check(folder):
        check_target(folder / "a.h5")
        folder.chmod(0o555)
        with pytest.raises(UsageError, match="no right to write"):
            check_target(folder / "a.h5")
        folder.chmod(0o755)

    where_rights_bind(check)


def test_writers_at_once_all_succeed(tmp_path):
    roots = [Group({"x": Dataset(np.full(1000, i), "1", "number of the writer")}) for i in range(6)]
    failed = []

    def work(root):
        try:
            for _ in range(4):
                write(tmp_path / "a.h5", root)
                read(tmp_path / "a.h5")
        except Exception as error:
            failed.append(error)

    threads = [threading.Thread(target=work, args=(root,)) for root in roots]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failed
    assert [p.name for p in tmp_path.iterdir()] == ["a.h5"]
    assert len(set(read(tmp_path / "a.h5")["x"].data)) == 1


def test_limits_can_be_raised(tmp_path):
    many = Group({f"x{i}": Dataset(np.zeros(1), "1", "zero") for i in range(20)})
    write(tmp_path / "a.h5", many)
    with pytest.raises(AssetError, match="more than 10 objects"):
        read(tmp_path / "a.h5", limits=Limits(objects=10))
    with pytest.raises(AssetError, match="unpacks to"):
        read(tmp_path / "a.h5", limits=Limits(slack=0, ratio=0))
    assert len(read(tmp_path / "a.h5", limits=Limits(objects=50)).members) == 20


def test_first_line_is_made_for_any_body():
    assert len(user_block(b"")) == 512
    assert image(seal(Group()))[:14] == b"bakery-asset 1"
    with h5py.File(io.BytesIO(bytes(image(seal(Group())))), "r") as file:
        assert len(file) == 0


def digest_by_the_format_page(found, without=()) -> str:
    """`content_hash` from docs/asset-format.md alone, with h5py and hashlib."""
    lines = []
    for name in sorted(found.attrs):
        if name != "content_hash":
            value = found.attrs[name]
            if isinstance(value, bytes):
                lines.append(f"attribute {name} utf-8 {value.hex()}\n")
            elif isinstance(value, np.bool_):
                lines.append(f"attribute {name} |b1 {int(value):02x}\n")
            else:
                kind = "<i8" if isinstance(value, np.integer) else "<f8"
                lines.append(f"attribute {name} {kind} {np.array(value, kind).tobytes().hex()}\n")
    if isinstance(found, h5py.Dataset):
        values = found[...]
        names = h5py.check_enum_dtype(found.dtype)
        choices = " enum " + ",".join(sorted(names, key=names.get)) if names else ""
        head = "dataset\n" + "".join(lines) + f"data {values.dtype.str}{choices} shape{''.join(f' {n}' for n in values.shape)}\n"
        return hashlib.sha256(head.encode() + values.tobytes()).hexdigest()
    members = [f"member {name} {digest_by_the_format_page(found[name])}\n" for name in sorted(found) if name not in without]
    return hashlib.sha256("".join(["group\n", *lines, *members]).encode()).hexdigest()


def test_hashes_of_a_file_by_the_format_page(tmp_path):
    write(tmp_path / "fog.h5", with_member(small_asset(), "medium/flag", Dataset(np.array([True, False]), "1", "a boolean")))
    with h5py.File(tmp_path / "fog.h5", "r") as file:
        assert file.attrs["content_hash"].decode() == digest_by_the_format_page(file, without=("provenance",))
        for stage in ("optics", "medium"):
            assert file[stage].attrs["content_hash"].decode() == digest_by_the_format_page(file[stage])
