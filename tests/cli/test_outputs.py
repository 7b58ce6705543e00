"""No command writes over what it reads, over another of its outputs, or over a file of another kind; paths alone on stdout."""

import errno
import os

import pytest

import bakery
from bakery.errors import UsageError
from bakery.export.formats import exporters
from bakery.store.outputs import KINDS, check_outputs
from bakery.store.write import write
from renderers import scene
from tests.conftest import DROPS, MILK
from tests.renders import HAZE
from tests.samples import small_asset, with_member

NOTES = "What I measured on Monday, and must not lose.\n"
TABLE = "theta_deg,value\n0,4\n90,1\n180,2\n"


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder with a recipe that reads a table, an asset, a scene and notes; every file's bytes by its name."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "milk.yaml").write_text(MILK.format(name="milk", g=0.7))
    (tmp_path / "drops.yaml").write_text(DROPS.format(name="drops", tolerance="5%", radius="0.5 um"))
    (tmp_path / "trades").mkdir()
    (tmp_path / "trades" / "trade.csv").write_bytes(b"\0mine")
    (tmp_path / "other.yaml").write_text(MILK.format(name="other", g=0.5))
    (tmp_path / "notes.txt").write_text(NOTES)
    (tmp_path / "theirs.h5").write_bytes(b"\x89HDF\r\n\x1a\n somebody's measurements")
    (tmp_path / "scene.yaml").write_text("bakery_scene: 2\nname: street\nasset: milk.h5\nfog: {density: {type: uniform}}\n")
    (tmp_path / "soft.h5").symlink_to("milk.yaml")
    os.link(tmp_path / "milk.yaml", tmp_path / "hard.h5")
    write(tmp_path / "a.h5", with_member(small_asset(), "optics", None))
    return {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}


def unchanged(folder, place):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()} == place


@pytest.mark.parametrize(("words", "said"), [
    ("milk.yaml -o milk.yaml", "read by this very call"),
    ("milk.yaml -o ./milk.yaml", "read by this very call"),
    ("milk.yaml -o soft.h5", "under the name milk.yaml"),
    ("milk.yaml -o hard.h5", "under the name milk.yaml"),
    ("milk.yaml -o milk.yaml --overwrite", "read by this very call"),
    ("milk.yaml --depfile milk.yaml", "read by this very call"),
    ("milk.yaml --scene scene.yaml --depfile scene.yaml", "read by this very call"),
    ("milk.yaml --scene scene.yaml -o scene.yaml --overwrite", "read by this very call"),
    ("milk.yaml -o d.h5 --depfile d.h5", "two outputs"),
    ("milk.yaml -o d.h5 --depfile ./d.h5", "two outputs"),
    ("milk.yaml -o notes.txt", "not an asset"),
    ("milk.yaml -o other.yaml", "not an asset"),
    ("milk.yaml -o theirs.h5", "not an asset"),
    ("milk.yaml -o theirs.h5 --dry-run", "not an asset"),
    ("plan milk.yaml -o theirs.h5", "not an asset"),
    ("milk.yaml --depfile notes.txt", "not a depfile"),
    ("milk.yaml --depfile a.h5", "not a depfile"),
    ("milk.yaml --depfile none/milk.d", "folder does not exist"),
    ("milk.yaml -o -", "not standard output"),
    ("milk.yaml --depfile -", "not standard output"),
    ("report a.h5 -o a.h5", "read by this very call"),
    ("report a.h5 -o milk.yaml", "not an HTML page"),
    ("report a.h5 -o theirs.h5", "not an HTML page"),
    ("report a.h5 -o -", "not standard output"),
    ("plot a.h5 -o -", "not to standard output"),
    ("export a.h5 --to csv -o -", "not to standard output"),
    ("trade drops.yaml -o -", "not to standard output"),
    ("trade drops.yaml -o trades", "trade.csv: an existing file is not a CSV table"),
])
def test_what_is_not_written_over(call, place, tmp_path, words, said):
    """One message, status 2, every file as it was, and nothing new."""
    status, out, err = call(*words.split())
    assert status == 2 and not out and said in err and "Traceback" not in err, err
    assert unchanged(tmp_path, place)


def test_a_recipe_does_not_become_anothers_input(call, place, tmp_path):
    """Each output of a call is held against the inputs of all of its recipes."""
    recipe = MILK.format(name="tabled", g=0).replace("{type: hg, g: 0}", "{type: table, file: table.h5}")
    (tmp_path / "tabled.yaml").write_text(recipe)
    (tmp_path / "table.yaml").write_text(MILK.format(name="table", g=0.7))
    (tmp_path / "table.h5").write_text(TABLE)
    for words in (("table.yaml", "tabled.yaml", "-o", "./"), ("tabled.yaml", "-o", "table.h5"),
                  ("tabled.yaml", "-o", "x.h5", "--depfile", "table.h5")):
        status, out, err = call(*words, "--overwrite")
        assert status == 2 and not out and "table.h5: is read by this very call" in err, err
    assert (tmp_path / "table.h5").read_text() == TABLE and not (tmp_path / "x.h5").exists()


@pytest.mark.parametrize(("words", "name"), [
    ("milk.yaml -o notes.txt", "notes.txt"), ("milk.yaml --depfile notes.txt", "notes.txt"),
    ("report a.h5 --no-render -o notes.txt", "notes.txt"), ("milk.yaml -o theirs.h5", "theirs.h5")])
def test_overwrite_says_that_it_may_go(call, undrawn, place, tmp_path, words, name):
    status, _, err = call(*words.split(), "--overwrite")
    assert status == 0 and (tmp_path / name).read_bytes() != place[name], err
    assert call(*words.split())[0] == 0  # now it is of the kind that goes there


def test_what_is_replaced_without_a_word(call, place, tmp_path):
    """An asset, a damaged one too, an empty file, a depfile of ours."""
    (tmp_path / "empty.h5").write_bytes(b"")
    (tmp_path / "damaged.h5").write_bytes(place["a.h5"][:700])
    for name in ("a.h5", "empty.h5", "damaged.h5"):
        for _ in range(2):
            assert call("milk.yaml", "-o", name, "--depfile", "milk.d")[0] == 0
        assert bakery.open(name).name == "milk"


@pytest.mark.parametrize("words", ["plot a.h5 -o out", "export a.h5 --to csv -o out"])
def test_folders(call, undrawn, place, tmp_path, words):
    """A second call replaces what the first wrote; a file of another kind among them stops it before anything is written."""
    status, first, err = call(*words.split())
    assert status == 0 and call(*words.split())[:2] == (0, first), err
    for path in first.splitlines():
        assert os.path.isfile(path)
    victim = first.splitlines()[-1]
    with open(victim, "wb") as file:
        file.write(b"\0 mine")
    before = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "out").iterdir()}
    status, out, err = call(*words.split())
    assert status == 2 and not out and f"{victim}: an existing file is not a" in err
    assert before == {path.name: path.stat().st_mtime_ns for path in (tmp_path / "out").iterdir()}
    assert call(*words.split(), "--overwrite")[:2] == (0, first)


def test_an_asset_among_the_pictures_of_its_own_folder(call, place, tmp_path):
    """The name of a picture may be that of the asset."""
    os.rename(tmp_path / "a.h5", tmp_path / "x_coefficients.csv")
    (tmp_path / "x.h5").symlink_to("x_coefficients.csv")
    status, _, err = call("plot", "x.h5", "-o", ".")
    assert status == 2 and "x_coefficients.csv: is read by this very call, under the name x.h5" in err


def test_from_python(place, tmp_path):
    for output, said in (("milk.yaml", "read by this very call"), ("notes.txt", "not an asset"), ("-", "standard output")):
        with pytest.raises(UsageError, match=said):
            bakery.bake("milk.yaml", output)
    assert unchanged(tmp_path, place)
    assert bakery.open(bakery.bake("milk.yaml", "notes.txt", overwrite=True)).name == "milk"


def test_each_kind_is_told_from_the_others(tmp_path):
    """Examples of what bakery writes: each is of its kind, and taken for no other that has a fixed beginning."""
    examples = {"HTML page": b"<!DOCTYPE html>\n", "depfile": b"a.h5: \\\n  a.yaml\n\na.yaml:\n", "asset": b"bakery-asset 1 sha",
                "PNG picture": b"\x89PNG\r\n\x1a\n", "EXR picture": b"\x76\x2f\x31\x01\x02", "PLY file": b"ply\nformat\xff\0",
                "SVG drawing": b'<?xml version="1.0"?>\n<svg>', "CSV table": b"theta [rad]\n1\n", "JSON file": b"[{}]",
                "OBJ file": b"# radii\no ice\nv 1 1 1\n", "XYZ file": b"12\nLattice\n", "recipe": b"# fog\nbakery: 1\n",
                "Mitsuba scene": b"<?xml version='1.0'?>\n<scene>", "pbrt file": b"# fog\nMakeNamedMedium \"fog\"\n",
                "MaterialX document": b"<?xml version='1.0'?>\n<materialx>", "USD layer": b"#usda 1.0\n",
                "Blender script": b"# A baked medium for Cycles in Blender 5.\n", "text": b"whatever",
                "BRDF tensor file": b"tensor_file\0\1\0",
                "NumPy archive": b"PK\x03\x04\x2d\0", "NetCDF file": b"CDF\x02\0\0\0\0",
                "libRadtran layer": b"550.000000 7.8e+00 0.999999811529 1.00000000e+00 8.4e-01\n"}
    declared = {kind.name: kind for exporter in exporters().values() for kind in exporter.kinds.values()}
    kinds = dict(zip(KINDS, KINDS)) | declared
    assert examples.keys() == kinds.keys()
    for kind, data in examples.items():
        (tmp_path / "file").write_bytes(data)
        for other, asked in kinds.items():
            if other == kind:
                check_outputs([(tmp_path / "file", asked)])
            elif other not in ("text", "JSON file", "CSV table", "OBJ file"):
                with pytest.raises(UsageError, match="an existing file is not an? " + other):
                    check_outputs([(tmp_path / "file", asked)])
    for data in (NOTES.encode(), MILK.encode(), b"\0\1"):
        (tmp_path / "file").write_bytes(data)
        for kind in ("asset", "HTML page", "depfile", "PNG picture", "EXR picture", "SVG drawing", "JSON file", "PLY file"):
            with pytest.raises(UsageError):
                check_outputs([(tmp_path / "file", kind)])


@pytest.mark.parametrize(("words", "name"), [
    ("milk.yaml", "milk.h5"), ("plan milk.yaml", "milk.h5"), ("render a.h5", "a.png"), ("render haze.yaml", "haze.png"),
    ("plan haze.yaml", "haze.png"), ("render room.xml", "room.png"), ("report a.h5 --no-render", "a.html"),
    ("compare haze.yaml --methods single,isotropic", "haze_compare.html"), ("trade haze.yaml", "haze_trade.html"),
])
def test_a_closing_slash_marks_a_folder_for_the_default_name(call, place, tmp_path, monkeypatch, words, name):
    """Seen by what is refused: a folder that is not there, and in one that is a file of another kind by that name."""
    monkeypatch.setitem(scene.RENDERERS, "toy", "tests.toy_renderer")
    (tmp_path / "haze.yaml").write_text(HAZE)
    (tmp_path / "room.xml").write_text('<scene version="3.0.0"/>')
    (tmp_path / "milk.h5").write_bytes((tmp_path / "a.h5").read_bytes())
    status, _, message = call(*words.split(), "-o", "gone/")
    assert status == 2 and message.startswith(f"gone/{name}: ") and not (tmp_path / "gone").exists(), message
    (tmp_path / "trades" / name).write_text(NOTES)
    status, _, message = call(*words.split(), "-o", "trades/")
    assert status == 2 and message.startswith(f"trades/{name}: an existing file is not "), message
    assert (tmp_path / "trades" / name).read_text() == NOTES


def test_paths_alone_on_standard_output(call, place):
    """`bake inspect $(bake milk.yaml)` works whether or not there was work to do."""
    for _ in range(2):
        status, out, _ = call("milk.yaml")
        assert status == 0 and call("inspect", *out.split())[0] == 0


@pytest.mark.parametrize("arguments", [("plot",), ("export", "--to", "csv")], ids=["plot", "export"])
def test_a_full_disk_leaves_no_empty_folder(call, tmp_path, monkeypatch, undrawn, arguments):
    """Of the folders made for pictures and tables none is left, one that stood there is; nor are the tables that fit."""
    asset, count = tmp_path / "fog.h5", [0]
    write(asset, small_asset())

    def full(_):
        count[0] += 1
        if arguments[0] == "plot" or count[0] % 2 == 0:  # the second file of each export
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("bakery.store.files.os.fsync", full)
    for there in (tmp_path / "new" / "deep", tmp_path):
        status, _, message = call(*arguments, asset, "-o", there)
        assert status == 3 and "not written: No space left on device" in message
        assert [path.name for path in tmp_path.iterdir()] == ["fog.h5"]
