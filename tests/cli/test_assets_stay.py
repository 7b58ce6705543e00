"""No asset is made worse: not by a scene that needs less, not by another recipe of its name, not by another file's recipe."""

import json
import os
import shutil

import pytest

import bakery
from bakery import recipe
from bakery.run.ensure import ensured
from bakery.store.read import read
from renderers import scene as scenes
from renderers.scene import assets
from renderers.scene.requirements import Need, Required
from tests.cli.test_requirements import RECIPE, SCENE, place  # noqa: F401  a fixture
from tests.conftest import DROPS, MILK, slow

TABLES = "multiple_scattering: {tolerance: 30%, orders: 4, extent: 1, length: 0.5}\n"


@pytest.fixture
def wax(place):  # noqa: F811
    """A scene of a body of wax; its recipe asks for tables that bake in a moment."""
    (place / "wax.yaml").write_text(RECIPE.format(name="wax", path="0.5 mm") + TABLES)
    (place / "s.yaml").write_text(SCENE.replace("20%", "100%").replace("vrl+tables", "paths"))
    return place


def state(folder):
    """Bytes and time of every asset."""
    return {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in folder.glob("*.h5")}


@pytest.mark.slow
def test_a_render_leaves_a_finer_asset_with_tables_alone(call, wax):
    """Method paths reads no tables and 100 % asks for little: both stay, and the very file is used."""
    assert call(wax / "wax.yaml", "-o", wax / "wax.h5", "--set", "tolerance=1%")[0] == 0
    before = state(wax)
    status, out, err = call("render", wax / "s.yaml", "--json")
    assert status == 0 and f'"asset": "{wax / "wax.h5"}"' in out, err
    assert state(wax) == before and set(bakery.open(wax / "wax.h5").stages) == {"medium", "multiple"}


@pytest.mark.parametrize("change, used", [
    slow((), True), (("tolerance=1%",), True), (("tolerance=50%",), False), slow(("medium.albedo=0.5",), False),
    slow(("seed=3",), True), slow(("wavelengths=[0.6]",), False)])
def test_what_stands_beside_is_used_where_it_is_good_enough(call, wax, change, used):
    """Else the scene's own goes into the cache.  What stands is never written; only tables depend on the seed."""
    (wax / "s.yaml").write_text((wax / "s.yaml").read_text().replace("100%", "5%"))
    words = [part for one in change for part in ("--set", one)]
    assert call(wax / "wax.yaml", "-o", wax / "wax.h5", "--stage", "medium", *words)[0] == 0
    before = state(wax)
    status, out, err = call("render", wax / "s.yaml", "--json", "--quality", "draft")
    assert status == 0 and (f'"asset": "{wax / "wax.h5"}"' in out) is used, err
    assert state(wax) == before


@pytest.mark.slow
def test_another_recipe_of_the_name_keeps_its_asset(call, wax):
    """`name:` is what is shown, not where a file goes."""
    (wax / "mine").mkdir()
    (wax / "mine" / "candle.yaml").write_text(RECIPE.format(name="wax", path="9 mm"))
    assert call(wax / "mine" / "candle.yaml", "-o", wax / "wax.h5")[0] == 0
    before = state(wax)
    status, out, err = call("render", wax / "s.yaml", "--json")
    assert status == 0 and "scenes" in out, err
    assert state(wax) == before


def test_a_scene_is_baked_once_and_beside_nothing(call, wax, monkeypatch):
    """The second render finds it; where the cache cannot be written, the scene is rendered all the same."""
    before = set(wax.iterdir())
    assert "medium: " in call("render", wax / "s.yaml")[2]
    assert set(wax.iterdir()) - before == {wax / "lit.png", wax / "lit.exr"}
    assert "medium: " not in call("render", wax / "s.yaml")[2]
    (wax / "no").touch()
    monkeypatch.setattr("bakery.run.cache.places", lambda: (wax / "no" / "cache", None))
    status, _, err = call("render", wax / "s.yaml")
    assert status == 0 and "is baked for this run alone" in err


@pytest.mark.slow
def test_a_damaged_asset_of_a_scene_is_baked_again(call, wax):
    assert call("render", wax / "s.yaml")[0] == 0
    (kept,) = (os.path.join(os.environ["BAKERY_CACHE"], "scenes", name) for name in
               os.listdir(os.path.join(os.environ["BAKERY_CACHE"], "scenes")))
    whole = read(kept).attributes["content_hash"]
    with open(kept, "r+b") as file:
        file.truncate(900)
    assert call("render", wax / "s.yaml")[0] == 0 and read(kept).attributes["content_hash"] == whole


def test_a_recipe_is_read_once_for_each_set_of_values(wax, monkeypatch):
    """From what the scene asks for to the bake: as it stands, as a draft, and once for each share of the tolerance."""
    (wax / "s.yaml").write_text((wax / "s.yaml").read_text().replace("method: paths", "method: vrl+tables"))
    calls, load = [], recipe.load

    def counted(path, settings=None, **options):
        calls.append(tuple(sorted((settings or {}).items())))
        return load(path, settings, **options)

    monkeypatch.setattr("bakery.recipe.load", counted)
    assets.baked(scenes.load(wax / "s.yaml"))
    assert 3 <= len(calls) == len(set(calls)) <= 6, calls


def test_assets_of_scenes_are_counted_and_cleared(call, milk, tmp_path, monkeypatch):
    """Under the name `scenes`; one by its name alone is none."""
    monkeypatch.setenv("BAKERY_CACHE", str(tmp_path / "cache"))
    asset = ensured(milk, require=lambda *_: Required((Need("medium", True, "it is read"),)))
    assert asset.parent == tmp_path / "cache" / "scenes" and set(bakery.open(asset).stages) == {"medium"}
    other = asset.with_name(f"milk-{64 * '0'}.h5")
    shutil.copy(asset, other)
    found = json.loads(call("cache", "info", "--json")[1])
    assert {name: stage["entries"] for name, stage in found["stages"].items()} == {"medium": 1, "scenes": 1}
    assert found["others"] == 1
    assert call("cache", "clear", "--yes")[1] == "2 entries removed\n" and other.exists() and not asset.exists()


def test_a_bake_for_a_scene_loses_nothing(call, wax):
    """As good or better: untouched.  Better in something: status 2, but for --overwrite; `plan` says the same."""
    output = "-o", wax / "wax.h5"
    assert call(wax / "wax.yaml", *output)[0] == 0
    whole = (wax / "wax.h5").read_bytes()
    words = wax / "wax.yaml", *output, "--scene", wax / "s.yaml"
    assert "up to date" in call("plan", *words)[1] and call(*words)[0] == 0 and (wax / "wax.h5").read_bytes() == whole
    (wax / "s.yaml").write_text((wax / "s.yaml").read_text().replace("100%", "1%"))
    status, _, err = call(*words, "--set", "medium.phase.g=0.2", "--force")
    assert status == 2 and "wax.h5: holds more than the scene needs (multiple), so it is not replaced" in err
    assert call("plan", *words, "--force")[0] == 2 and (wax / "wax.h5").read_bytes() == whole
    assert call(*words, "--force", "--overwrite")[0] == 0 and set(bakery.open(wax / "wax.h5").stages) == {"medium"}


# ---- bakes by themselves


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fog.yaml").write_text(MILK.format(name="fog", g=0.7))
    return tmp_path


def g_of(asset):
    return round(float(bakery.open(asset).medium.g[0]), 4)


def test_the_output_follows_the_file(call, folder):
    """A copy under another name is another recipe, whatever it calls itself."""
    assert call("fog.yaml")[1] == "fog.h5\n"
    before = state(folder)
    (folder / "my second try.yaml").write_text(MILK.format(name="fog", g=0.2))
    assert call("my second try.yaml")[1] == "my second try.h5\n"
    assert call("my second try.yaml", "-o", "./")[1] == "my second try.h5\n"
    assert read("my second try.h5").attributes["name"] == "fog"
    assert {path: one for path, one in state(folder).items() if path.name == "fog.h5"} == before


def test_an_edited_recipe_is_baked_over_its_asset(call, folder):
    """Also coarser, also after both were moved, and where the recipe alone was: the user asks for it."""
    for g, words in ((0.7, ()), (0.5, ()), (0.5, ("--tolerance", "50%"))):
        (folder / "fog.yaml").write_text(MILK.format(name="fog", g=g))
        assert call("fog.yaml", *words)[0] == 0
    (folder / "there").mkdir()
    for name in ("fog.yaml", "fog.h5"):
        shutil.move(name, "there")
    (folder / "there" / "fog.yaml").write_text(MILK.format(name="fog", g=0.4))
    assert call("there/fog.yaml", "-o", "there/")[0] == 0
    shutil.move("there/fog.yaml", ".")
    (folder / "fog.yaml").write_text(MILK.format(name="fog", g=0.3))
    assert call("fog.yaml", "-o", "there/")[0] == 0 and g_of("there/fog.h5") == 0.3


@pytest.mark.parametrize("other, words", [
    ("mist.yaml", ("-o", "fog.h5")), ("b/fog.yaml", ()), ("b/fog.yaml", ("--sweep", "medium.phase.g=[0.1, 0.2]"))])
def test_the_asset_of_another_recipe_is_not_replaced(call, folder, other, words):
    """Of another file name, or of another folder where the first recipe still is; but for --overwrite."""
    assert call("fog.yaml")[0] == 0
    before = state(folder)
    (folder / "b").mkdir()
    (folder / other).write_text(MILK.format(name="fog", g=0.2))
    for command in ((), ("plan",)):
        status, out, err = call(*command, other, *words)
        assert status == 2 and not out and "fog.h5: holds the asset of another recipe, " in err and "fog.yaml" in err
    assert state(folder) == before
    if "--sweep" not in words:
        assert call(other, *words, "--overwrite")[0] == 0 and g_of("fog.h5") == 0.2


def test_a_member_of_a_family_is_never_another_recipes_asset(call, folder):
    """Refused before anything is computed."""
    (folder / "sand.yaml").write_text(MILK.format(name="sand", g=0.9))
    (folder / "fog").mkdir()
    assert call("sand.yaml", "-o", "fog/g_0.1.h5")[0] == 0
    before = (folder / "fog" / "g_0.1.h5").read_bytes()
    status, _, err = call("fog.yaml", "--sweep", "medium.phase.g=[0.1, 0.2]", "--set", "sweep.refine=false")
    assert status == 2 and "g_0.1.h5: holds the asset of another recipe" in err
    assert (folder / "fog" / "g_0.1.h5").read_bytes() == before


def test_a_coarser_bake_of_particles_by_a_scene_is_none(call, folder, monkeypatch):
    """A tolerance stands in each stage: one that is finer is as good, of whichever stage."""
    from bakery.plan import wanted
    from bakery.plan.suffice import lacking, lost
    from bakery.recipe import load
    from bakery.run.standing import asset_at, held

    (folder / "drops.yaml").write_text(DROPS.format(name="drops", tolerance="5%", radius="0.5 um"))
    assert call("drops.yaml")[0] == 0
    stages = held(asset_at(folder / "drops.h5"))

    def of(**settings):
        recipe = load("drops.yaml", settings)
        return wanted(recipe), recipe

    own = {one.stage.name: one.parts for one in of()[0]}
    for settings, good, loses in (({"tolerance": "20%"}, True, True), ({"tolerance": "1%"}, False, False),
                                  ({"measure": "integrated"}, True, True), ({"seed": "1"}, True, False),
                                  ({"particles.number_density": "2e8 /m^3", "tolerance": "20%"}, False, True),
                                  ({"particles.host": "water", "tolerance": "20%"}, False, False)):
        steps, recipe = of(**settings)
        assert (not lacking(stages, steps, own, [], recipe), bool(lost(stages, steps, own, []))) == (good, loses), settings
    assert "optics with tolerance 0.05" in lost(stages, of(tolerance="20%")[0], own, [])


def test_tables_of_what_has_changed_are_nothing_to_lose(call, wax):
    """A recipe whose medium is another by now: its tables are out of date, of whatever the scene needs."""
    words = wax / "wax.yaml", "-o", wax / "wax.h5"
    assert call(*words)[0] == 0
    (wax / "wax.yaml").write_text((wax / "wax.yaml").read_text().replace("0.9", "0.5"))
    assert call(*words, "--scene", wax / "s.yaml")[0] == 0 and set(bakery.open(wax / "wax.h5").stages) == {"medium"}


def test_a_family_is_of_its_recipe_too(call, folder):
    """Neither an asset nor a family of another recipe takes its place; an edited one does."""
    sweep = "--sweep", "medium.phase.g=[0.1, 0.2]", "--set", "sweep.refine=false"
    assert call("fog.yaml", *sweep)[0] == 0
    before = state(folder)
    (folder / "mist.yaml").write_text(MILK.format(name="fog", g=0.2))
    for words in ((), sweep):
        status, _, err = call("mist.yaml", "-o", "fog.h5", *words)
        assert status == 2 and "fog.h5: holds the asset of another recipe, " in err and state(folder) == before
    (folder / "fog.yaml").write_text((folder / "fog.yaml").read_text().replace("0.9998", "0.9"))
    assert call("fog.yaml", *sweep)[0] == 0 and state(folder) != before
