"""`bake new`: recipes to start from, each of which passes the checks."""

import json

import pytest

from bakery.recipe import load
from bakery.recipe.starting import KINDS, SHIPPED, starts
from tests.conftest import ROOT, slow

RECIPES = [name for name, start in starts().items() if start.folder == KINDS and name != "scene"]


@pytest.mark.parametrize("kind", RECIPES)
def test_what_is_written_passes_the_checks(kind, call, tmp_path):
    path = tmp_path / "mine.yaml"
    status, out, err = call("new", kind, "-o", path)
    assert (status, out.split(), err) == (0, [str(path)], "")
    text = path.read_text(encoding="utf-8")
    head, about, *_ = lines = text.splitlines()
    assert head == f"# yaml-language-server: $schema={ROOT}/assets/schemas/recipe-1.json"
    assert about.startswith("# ") and "\nname: mine\n" in text
    # every section has a comment above it
    assert all(lines[i - 1].startswith("#") or "#" in line for i, line in enumerate(lines)
               if line[:1].isalpha() and not line.startswith(("name:", "description:")))
    recipe = load(path)
    assert not recipe.warnings and (recipe.sweep is not None) == (kind == "family")


def test_tables_are_written_beside_a_published_material(call, tmp_path):
    status, out, _ = call("new", "opac_fog", "-o", tmp_path / "haze.yaml", "--json")
    assert status == 0 and json.loads(out)["files"] == [str(tmp_path / name) for name in ("haze.yaml", "haze.csv")]
    assert load(tmp_path / "haze.yaml").name == "haze"
    assert call("new", "opac_fog", "-o", tmp_path / "more.yaml")[0] == 0  # has a table of its own


def test_two_scenes_stand_in_one_folder(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert call("new", "scene", "-o", "a.yaml")[1].split() == ["a.yaml", "a.xml"]
    assert call("new", "scene", "-o", "b.yaml")[1].split() == ["b.yaml", "b.xml"]
    text = (tmp_path / "b.yaml").read_text(encoding="utf-8")
    assert "mitsuba: b.xml" in text and "bake render b.yaml writes b.png and b.exr" in text and "recipe: particles.yaml" in text
    first, second = [line for line in text.splitlines() if line.startswith(("bakery_scene:", "name:"))]
    assert first.index("#") == second.index("#")
    assert call("new", "scene", "-o", "a_name_that_is_longer_than_the_column_of_comments.yaml")[0] == 0
    long = (tmp_path / "a_name_that_is_longer_than_the_column_of_comments.yaml").read_text(encoding="utf-8")
    assert "name: a_name_that_is_longer_than_the_column_of_comments # bake" in long


def test_a_closing_slash_marks_a_folder(call, tmp_path, monkeypatch):
    assert call("new", "fog", "-o", f"{tmp_path}/")[:2] == (0, f"{tmp_path}/fog.yaml\n")
    assert load(tmp_path / "fog.yaml").name == "fog"
    monkeypatch.chdir(tmp_path)
    assert call("new", "sand", "-o", ".")[:2] == (0, "sand.yaml\n")  # so does a folder that is there
    status, _, err = call("new", "fog", "-o", f"{tmp_path}/missing/")
    assert status == 2 and "its folder does not exist" in err


@pytest.mark.parametrize("name", [slow(name) for name, start in starts().items() if start.folder != KINDS])
def test_published_materials_can_be_started_from(name, call, tmp_path):
    assert call("new", name, "-o", tmp_path / "mine.yaml")[0] == 0
    assert load(tmp_path / "mine.yaml").name == "mine"


def test_the_list_has_all(call):
    status, out, _ = call("new")
    assert status == 0 and all(f"\n  {name} " in out for name in starts()) and len(starts()) > 45
    listed = json.loads(call("new", "--json")[1])
    assert {"name": "fog", "published": False, "shipped": False, "scene": False, "about": "Fog: water droplets in air."} in listed
    assert {each["name"] for each in listed if each["published"]} >= {"espresso", "opac_fog", "skin_1"}


def test_a_recipe_that_ships(call, tmp_path):
    """By its name or its file's; a kind of the same name goes first."""
    shipped = {name for name, start in starts().items() if start.folder == SHIPPED}
    assert {"snow_pack", "wax", "clouds"} <= shipped == {path.stem for path in (ROOT / "recipes").glob("*.yaml")} - set(
        name for name, start in starts().items() if start.folder != SHIPPED)
    for kind in "marble", "marble.yaml":
        assert call("new", kind, "-o", tmp_path / "stone.yaml", "--overwrite")[0] == 0
        recipe = load(tmp_path / "stone.yaml")
        assert recipe.name == "stone" and recipe.medium.albedo.tolist() == [0.999, 0.998, 0.997]


@pytest.mark.parametrize(("args", "said"), [
    (("fgo",), "no recipe or scene that ships (fog?)"),
    (("fog", "-o", "fog.h5"), "expected fog.yaml"),
    (("fog", "-o", "a b.yaml"), 'found "a b"'),
    (("fog", "-o", "missing/fog.yaml"), "its folder does not exist"),
    (("fog",), "fog.yaml: exists already; choose another file with -o, or replace it with --overwrite"),
])
def test_what_cannot_be_written_is_told(args, said, call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fog.yaml").write_text("mine")
    status, out, err = call("new", *args)
    assert status == 2 and not out and said in err and len(err.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["fog.yaml"] and (tmp_path / "fog.yaml").read_text() == "mine"


def test_overwrite_writes_over_it(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fog.yaml").write_text("mine")
    assert call("new", "fog", "--overwrite")[0] == 0 and load("fog.yaml").name == "fog"


@pytest.mark.slow
def test_a_scene_finds_its_recipe(call, tmp_path, monkeypatch):
    pytest.importorskip("mitsuba", reason='pip install ".[mitsuba]"')
    monkeypatch.chdir(tmp_path)
    assert call("new", "particles")[0] == 0
    assert call("new", "scene")[1].split() == ["scene.yaml", "scene.xml"]
    status, out, err = call("plan", "particles.yaml", "--scene", "scene.yaml")
    assert status == 0 and "discrete" in out, err
