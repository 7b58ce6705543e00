"""Mistakes that new users make: what was found, and what would do."""

import numpy as np
import pytest

import bakery
from bakery.asset.compare import compare
from tests.conftest import MILK

DROPLETS = "particles.components.droplets"


@pytest.mark.parametrize(("setting", "says"), [
    (f"{DROPLETS}.material={{n: 1.33-0.01j}}",
     'found "1.33-0.01j", a complex number; expected real ones: n: 1.33, k: 0.01 is n + ik'),
    (f"{DROPLETS}.material={{n: 1.33 + 1e-3i}}", "n: 1.33, k: 1e-3"),
    (f"{DROPLETS}.size={{distribution: single, diameter: 10 um}}", 'found the unknown key "diameter"; expected'),
    ("particles.number_density=100", "(100 /cm^3?)"),
    ("particles.number_density=1e8", "(1e8 /m^3?)"),
    ("seed=1.5", 'found "1.5"; expected a whole number from 0 to 2^53'),
])
def test_values(call, drops, setting, says):
    status, out, err = call("plan", drops, "--set", setting)
    assert (status, out) == (2, "") and says in err


def test_a_diameter_is_twice_a_radius(call, drops):
    err = call("plan", drops, "--set", f"{DROPLETS}.size={{distribution: single, diameter: 10 um}}")[2]
    assert "(radius: 5 um?)" in err and "missing" not in err  # what it stands for is not missing


def test_g_belongs_to_a_phase_function(call, milk):
    milk.write_text(milk.read_text().replace("phase: {type: hg, g: 0.7}", "g: 0.7"))
    err = call("plan", milk)[2]
    assert "(phase: {type: hg, g: 0.7}?)" in err and "missing" not in err


@pytest.mark.parametrize("text", ["1000", "1e3", "1E+3"])
def test_whole_numbers_may_have_an_exponent(call, drops, text):
    assert call("plan", drops, "--set", f"seed={text}")[0] == 0
    from bakery.recipe import load

    assert load(drops, {"seed": text}).seed == 1000


def test_values_of_a_sweep_are_a_list(call, drops):
    err = call("plan", drops, "--sweep", f"{DROPLETS}.size.radius=2um,20um")[2]
    assert 'found "2um,20um", several values; expected a list: [2um,20um]' in err


@pytest.mark.parametrize("words", [("plot",), ("inspect",), ("query", "medium/g"), ("report",), ("export", "--to", "csv")])
def test_a_recipe_is_no_asset(call, milk, words):
    status, out, err = call(words[0], milk, *words[1:])
    assert (status, out) == (2, "") and "it is a recipe; `bake RECIPE` bakes it into an asset" in err


def test_a_recipe_is_no_scene(call, milk):
    for words in (("compare", milk, "--methods", "a,b"), ("render", milk)):
        status, out, err = call(*words)
        assert (status, out) == (2, "") and f"{milk}: is a recipe; `bake {milk}` bakes it" in err and "`bake new scene`" in err


def test_a_page_is_html(call, milk, tmp_path):
    assert call(milk, "-o", tmp_path / "milk.h5")[0] == 0
    status, out, err = call("report", tmp_path / "milk.h5", "-o", tmp_path / "milk.pdf")
    assert (status, out) == (2, "") and f"the page is HTML: use {tmp_path / 'milk.html'}" in err
    assert not (tmp_path / "milk.pdf").exists()


def test_columns_of_a_pipe(call, milk, tmp_path, monkeypatch):
    """Lines of any length, unless the environment says how many columns there are."""
    monkeypatch.delenv("COLUMNS", raising=False)
    assert call(milk, "-o", tmp_path / "milk.h5")[0] == 0
    long = call("inspect", tmp_path / "milk.h5")[1]
    monkeypatch.setenv("COLUMNS", "70")
    short = call("inspect", tmp_path / "milk.h5")[1]
    assert max(map(len, long.splitlines())) > 100 and short.split() == long.split()
    assert all(len(line) <= 70 or not line.strip().count(" ") for line in short.splitlines())
    for words in ("0", "-5", "many", ""):
        monkeypatch.setenv("COLUMNS", words)
        assert call("inspect", tmp_path / "milk.h5")[1] == long


def test_a_dict_and_a_text_are_recipes(tmp_path, monkeypatch):
    """The same asset as of the file; files that they name lie in the current folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file.yaml").write_text(MILK.format(name="milk", g=0.7))
    bakery.bake("file.yaml", "file.h5")
    recipe = {"bakery": 1, "name": "milk", "wavelengths": "rgb", "tolerance": "1%", "medium": {
        "albedo": np.array([0.9998, 0.9995, 0.998]), "mean_free_path": "[0.84, 0.75, 0.68] mm",
        "phase": {"type": "hg", "g": np.float64(0.7)}}}
    bakery.bake(recipe, "milk.h5")
    bakery.bake(MILK.format(name="milk", g=0.7), "text.h5")
    bakery.bake(bakery.open("milk.h5").recipe, "again.h5")
    assert all(compare("file.h5", other) == [] for other in ("milk.h5", "text.h5", "again.h5"))
    family = bakery.open(bakery.bake(recipe | {"sweep": {"medium.phase.g": [0.1, 0.2]}}, "family.h5"))
    assert list(family.axes) == ["g"]
    with pytest.raises(bakery.RecipeError, match=r'<recipe>:7: medium.albedo: found "2"'):
        bakery.bake(recipe | {"medium": recipe["medium"] | {"albedo": 2}})
    for wrong in (3, None, {"bakery": object()}, {"tolerance": float("nan")}):
        with pytest.raises(bakery.UsageError, match="dict"):
            bakery.bake(wrong)
