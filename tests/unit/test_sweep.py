"""The key `sweep` of recipes: what it takes, what it refuses, and where it says so."""

import pytest

from bakery.errors import RecipeError
from bakery.family.axes import file_name, in_words, settings
from bakery.recipe import json_schema, load

FOG = """\
bakery: 1
name: fog
wavelengths: [0.55]
particles:
  number_density: 1e8 /m^3
  components:
    - name: drops
      material: water
      size: {distribution: gamma, radius: 5 um, variance: 0.1}
"""
RADIUS, OTHER, VARIANCE = ("particles.components.drops.size.radius", "particles.components.drops.size.variance",
                           "particles.components[0].size.variance")


@pytest.fixture
def recipe(tmp_path, monkeypatch):
    """Writes fog.yaml with lines below `sweep:`."""
    monkeypatch.chdir(tmp_path)

    def write(*lines):
        (tmp_path / "fog.yaml").write_text(FOG + "sweep:\n" + "".join(f"  {line}\n" for line in lines))
        return "fog.yaml"

    return write


def values(sweep):
    return [[list(key.values) for key in axis.keys] for axis in sweep.axes]


@pytest.mark.parametrize("text, found", [
    ("[2, 4, 8] um", [2e-6, 4e-6, 8e-6]),
    ('"[2, 4, 8] um"', [2e-6, 4e-6, 8e-6]),
    ("[2 um, 0.004 mm, 8e3 nm]", [2e-6, 4e-6, 8e-6]),
    ("{from: 2 um, to: 8 um, count: 3}", [2e-6, pytest.approx(4e-6, rel=1e-12), 8e-6]),
    ("3 um", [3e-6]),
])
def test_values(recipe, text, found):
    sweep = load(recipe(f"{RADIUS}: {text}")).sweep
    assert values(sweep) == [[found]]
    assert (sweep.axes[0].first.name, sweep.axes[0].first.units) == ("radius", "m")
    assert sweep.axes[0].first.key == "particles.components[0].size.radius"
    assert sweep.tolerance == 0.01 and sweep.refine


def test_every_value_is_that_of_the_recipe(recipe):
    path = recipe(f"{OTHER}: [5%, 10%]", f"{RADIUS}: [2, 4] um", "tolerance: 3%", "refine: false")
    whole = load(path)
    assert (whole.sweep.tolerance, whole.sweep.refine) == (0.03, False)
    assert whole.particles.components[0].size.radius == 2.0  # of the first point
    point = load(path, settings(whole.sweep.axes, (4e-6, 0.1)))
    assert point.sweep is None and "none" in point.text
    assert (point.particles.components[0].size.radius, point.particles.components[0].size.variance) == (4.0, 0.1)
    between = load(path, settings(whole.sweep.axes, (3.3e-6, 0.07)))
    assert between.particles.components[0].size.radius == 3.3
    assert file_name(whole.sweep.axes, (3.3e-6, 0.07)) == "radius_3.3e-06-variance_0.07.h5"
    assert in_words(whole.sweep.axes, (3.3e-6, 0.07)) == "radius 3.3 um, variance 0.07"


def test_keys_in_step(recipe):
    path = recipe(f"{VARIANCE}: [0.2, 0.05]", f"{RADIUS}: [2, 8] um", "combine: zip")
    (axis,) = load(path).sweep.axes
    assert [key.name for key in axis.keys] == ["radius", "variance"]
    at = load(path, settings([axis], (4e-6,))).particles.components[0].size
    assert at.radius == 4.0 and at.variance == pytest.approx(0.1)  # half-way, in logarithms


def test_a_sweep_is_set_and_unset(recipe):
    path = recipe(f"{RADIUS}: [2, 4] um")
    assert load(path, {"sweep": "none"}).particles.components[0].size.radius == 5.0
    assert values(load(path, {f"sweep.{OTHER}": "[0.1, 0.2]"}).sweep) == [[[2e-6, 4e-6]], [[0.1, 0.2]]]


@pytest.mark.parametrize("lines, says", [
    ([f"{RADIUS}: [2, 4]"], 'fog.yaml:11: particles.components[0].size.radius: found "2", which has no unit; lengths take nm'),
    ([f"{RADIUS}: [4, 2] um"], f'fog.yaml:11: sweep.{RADIUS}: found "2 um" after "4 um"; expected ascending values'),
    ([f"{RADIUS}: [2 um, 4 /m]"], f'fog.yaml:11: sweep.{RADIUS}: found "4 /m" beside "2 um"; expected lengths throughout'),
    ([f"{VARIANCE}: [0.1, 0.5]"], 'fog.yaml:11: particles.components[0].size.variance: found "0.5"; expected a fraction'),
    (["particles.components.drops.size.radus: [2, 4] um"], 'fog.yaml:11: particles.components[0].size.radus: found the '
     'unknown key "radus"'),
    (["particles.components.rain.size.radius: [2, 4] um"], 'fog.yaml:11: sweep.particles.components.rain.size.radius: found no '
     'item "rain" in particles.components'),
    (["particles.components.drops.material: [water, ice]"], 'found "water"; expected a number: only numbers can be interpolated'),
    ([f"{RADIUS}: [2, 4] um", "tolernce: 1%"], 'fog.yaml:12: sweep.tolernce: found "tolernce", which is neither an option nor a '
     'dotted key; expected combine, refine, tolerance or a dotted key such as particles.components.droplets.size.radius '
     '(tolerance?)'),
    (["seed: [1, 2]"], 'fog.yaml:11: sweep.seed: found "seed", which cannot be swept'),
    (["phase.orders: [2, 3]"], "fog.yaml:11: sweep.phase.orders: found a key that cannot be swept"),
    ([f"{RADIUS}: {{from: 2 um, until: 8 um, count: 3}}"], 'fog.yaml:11: sweep.particles.components.drops.size.radius: found the '
     'unknown key "until"; expected from, to or count'),
    ([f"{RADIUS}: {{from: 2 um, to: 8 um, count: 20000}}"], "expected a whole number from 2 to 10,000"),
    ([f"{RADIUS}: [2, 4] um", f"{VARIANCE}: [0.1, 0.2, 0.3]", "combine: zip"], "found 3 values beside 2"),
    ([f"{RADIUS}: {{from: 2 um, to: 8 um, count: 200}}", f"{VARIANCE}: {{from: 0.1, to: 0.2, count: 100}}"],
     "found 20,000 points"),
    ([f"{OTHER}: [0.1, 0.2]", f"{VARIANCE}: [0.2, 0.3]"], f"fog.yaml:12: sweep.{VARIANCE}: found the key of sweep.{OTHER} once "
     "more; expected each key once"),
    (["tolerance: 1%"], "found no key to sweep"),
    ([f"{RADIUS}: [2, 4] um", "tolerance: 90%"], 'fog.yaml:12: sweep.tolerance: found "90%"'),
    ([f"{RADIUS}: [2, 4] um", "combine: zipp"], 'fog.yaml:12: sweep.combine: found "zipp"; expected product or zip (zip?)'),
])
def test_what_is_refused(recipe, lines, says):
    with pytest.raises(RecipeError) as error:
        load(recipe(*lines))
    assert says in str(error.value)


def test_all_problems_at_once(recipe):
    with pytest.raises(RecipeError) as error:
        load(recipe(f"{RADIUS}: [2, 4] um", f"{VARIANCE}: [0.4, 0.5]", ""), {"wavelengths": "[-1]"})
    found = [problem.key for problem in error.value.problems]
    assert found.count("particles.components[0].size.variance") == 2 and "wavelengths[0]" in found


def test_other_units_are_the_same_points(recipe):
    one, other = (load(recipe(f"{RADIUS}: {text}")).sweep for text in ("[0.5, 2] um", "[500, 2000] nm"))
    assert values(one) == values(other) == [[[5e-7, 2e-6]]]


def test_editors_know_the_key():
    options = json_schema()["properties"]["sweep"]["anyOf"]
    assert options[0] == {"enum": ["none"]} and set(options[1]["properties"]) == {"tolerance", "refine", "combine"}
