"""Wavelengths in the wrong unit are told as a warning, or with the error of the material that has no data there."""

import json

import numpy as np
import pytest

from bakery.errors import RecipeError
from bakery.grammar import tables
from bakery.grammar.files import asset_root
from bakery.recipe import load, wavelengths
from tests.conftest import ROOT

CLEAR = """\
bakery: 1
name: clear
wavelengths: {}
medium:
  albedo: 1
  mean_free_path: 1 mm
  phase: {{type: isotropic}}
"""


@pytest.fixture
def recipe(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def write(listed, text=CLEAR):
        (tmp_path / "clear.yaml").write_text(text.format(listed))
        return "clear.yaml"

    return write


@pytest.mark.parametrize("listed, near", [
    ("[610, 550, 465]", "610, 550, 465 nm"), ("[610, 550] um", "610, 550 nm"), ("1064", "1064 nm"), ("[0.55, 610]", "610 nm"),
    ("0.00055", "0.55 um"), ("5.5e-7", "0.55 um"), ("550 mm", "550 nm"), ("30 um", ""), ("[0.03] um", ""),
])
def test_far_wavelengths_name_the_likely_unit(recipe, listed, near):
    warning, = load(recipe(listed)).warnings
    assert (warning.file, warning.line, warning.key) == ("clear.yaml", 3, "wavelengths")
    assert warning.expected == (f"give the unit that is meant ({near}?)" if near else "is the unit right?")


@pytest.mark.parametrize("listed", ["rgb", "visible8", "[0.61, 0.55]", "[610, 550] nm", "10.6 um", "0.2", "5"])
def test_usual_wavelengths_go_without(recipe, listed):
    assert load(recipe(listed)).warnings == ()


@pytest.mark.parametrize("steps", ["{from: 300 nm, to: 1.1 um, count: 5}", "{from: 0.3, to: 1100 nm, count: 5}"])
def test_wavelengths_in_equal_steps(recipe, steps):
    assert load(recipe(steps)).wavelength == pytest.approx([0.3, 0.5, 0.7, 0.9, 1.1])


@pytest.mark.parametrize("steps, fault", [
    ("{from: 300 nm, to: 900 nm}", "found no count"), ("{from: 0.3, to: 0.9, count: 1}", 'found "1" as count'),
    ("{from: 0.3, to: 0.9, count: 9.5}", 'found "9.5" as count'), ("{from: 0.3, to: 0.9, count: 4097}", "from 2 to 4,096"),
    ("{from: 0.3, to: red, count: 5}", 'found "red"'), ("{from: 0.3, to: 1, cout: 5}", "(count?)"),
    ("{from: 0.5, to: 500 nm, count: 5}", "found the same from and to"), ("{from: [0.3], to: 1, count: 5}", "found a list"),
    ("{from: 0, to: 1, count: 5}", "at least 1e-09"), ("{from: , to: 1, count: 5}", "found nothing"),
])
def test_faulty_steps_are_named(recipe, steps, fault):
    with pytest.raises(RecipeError) as error:
        load(recipe(steps))
    assert fault in str(error.value) and "clear.yaml:3: wavelengths" in str(error.value)


def test_a_table_of_ones_own_shows_that_they_are_meant(recipe, tmp_path):
    (tmp_path / "own.csv").write_text("20,1.3\n700,1.3\n")
    text = ("bakery: 1\nname: clear\nwavelengths: {}\nparticles:\n  host: vacuum\n  volume_fraction: 1%\n  components:\n"
            "    - {{name: a, material: MATERIAL, size: {{distribution: single, radius: 5 um}}}}\n")
    assert load(recipe("[610, 550]", text.replace("MATERIAL", "{{file: own.csv}}"))).warnings == ()
    assert load(recipe("[610, 550]", text.replace("MATERIAL", "{{n: 1.3}}"))).warnings


def test_an_error_of_a_material_names_it_too():
    with pytest.raises(RecipeError, match=r'"water" has no data; expected 0.2 to 1.125 um [(]610, 550 nm[?][)]'):
        load(ROOT / "recipes" / "fog.yaml", {"wavelengths": "[610, 550]"})
    with pytest.raises(RecipeError, match=r'"water" has no data; expected 0.2 to 1.125 um\n'):
        load(ROOT / "recipes" / "fog.yaml", {"wavelengths": "[1.2, 0.5]"})


def test_plan_and_bake_say_it(call, recipe):
    path = recipe("[610, 550, 465]")
    said = "warning: clear.yaml:3: wavelengths: found 610, 550, 465 um, far from what is seen"
    for args in (("plan", path), ("bake", "--dry-run", path), ("bake", path), ("bake", path)):
        status, out, err = call(*args)
        assert status == 0 and err.count(said) == 1 and "warning" not in out
    assert "warning" not in call("bake", "--quiet", path)[2]
    for args in (("plan", path, "--json"), ("bake", path, "--json")):
        told, = json.loads(call(*args)[1])[0]["warnings"]
        assert told["line"] == 3 and "465 nm?" in told["expected"]


def test_near_is_where_materials_are_known():
    ends = []
    for path in (asset_root() / "materials").glob("*.csv"):
        if path.stem != "vacuum":
            ends.append(tables.read(path.read_bytes(), path.name, "", tables.INDEX)[0][[0, -1]])
    low, high = np.min(ends), np.max(ends)
    assert pytest.approx((low, high), rel=0.05) == wavelengths.TABLES
    assert wavelengths.NEAR[0] < low < wavelengths.EYE[0] < wavelengths.EYE[1] < high < wavelengths.NEAR[1]
