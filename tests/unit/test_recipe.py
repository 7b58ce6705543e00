"""Recipes in, checked values out."""

import hashlib
import math
import pickle
import re

import numpy as np
import pytest
import ruamel.yaml

from bakery.errors import RecipeError
from bakery.recipe import json_schema, load
from bakery.stages.medium.section import coefficients as coefficients_of
from bakery.stages.medium.section import phase_keys
from tests.conftest import ROOT

SHIPPED = sorted((ROOT / "recipes").glob("*.yaml"))
EVERYTHING = """\
bakery: 1
name: all
description: |
  every kind of particle
wavelengths: [500 nm, 0.6 um, 0.7]
seed: 7
tolerance: 0.5%
particles:
  host: {n: [1.1, 1.2, 1.3]}
  volume_fraction: 1e-6
  components:
    - name: a
      material: {n: 1.5, k: [0.1, 0.2, 0.3]}
      fraction: 25%
      size: {distribution: single, radius: 60 nm}
    - name: b
      material: {file: own.csv}
      fraction: 0.25
      size: {distribution: gamma, radius: 5 um, variance: 10%, max: 0.02 mm}
    - name: c
      material: ice
      fraction: 0.25
      size: {distribution: table, file: sizes.csv, min: 2 um}
    - name: d
      material: water
      fraction: 0.25
      size:
        distribution: mixture
        of:
          - {share: 0.995, distribution: lognormal, radius: 2 um, sigma: 1.2}
          - {share: 0.5%, distribution: single, radius: 20 um}
        min: 1 um
        max: 30 um
phase: {method: mie, polarized: true}
"""


@pytest.fixture
def write(tmp_path):
    def write(text, name="recipe.yaml"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.fixture
def everything(write):
    write("wavelength_nm,n\n400,1.4\n800,1.6\n", "own.csv")
    write("# measured\n1,0\n2,3\n4,0\n", "sizes.csv")
    return write(EVERYTHING)


def test_every_kind_of_particle(everything, tmp_path):
    recipe = load(everything)
    assert (recipe.name, recipe.seed, recipe.tolerance, recipe.wavelength) == ("all", 7, 0.005, (0.5, 0.6, 0.7))
    assert recipe.description == "every kind of particle\n"
    assert recipe.medium is None
    p = recipe.particles
    assert (p.number_density, p.volume_fraction) == (None, 1e-6)
    assert p.host.n.tolist() == [1.1, 1.2, 1.3] and p.host.k.tolist() == [0, 0, 0]
    a, b, c, d = p.components
    assert [part.name for part in p.components] == ["a", "b", "c", "d"] and [part.fraction for part in p.components] == [0.25] * 4
    assert a.material.n.tolist() == [1.5] * 3 and a.material.k.tolist() == [0.1, 0.2, 0.3]
    assert (a.size.distribution, a.size.radius) == ("single", 0.06)
    assert b.material.n == pytest.approx([1.45, 1.5, 1.55], rel=1e-15) and not b.material.k.any()
    assert (b.size.radius, b.size.variance, b.size.min, b.size.max) == (5.0, 0.1, None, 20.0)
    radius, density = c.size.file
    assert radius.tolist() == [1, 2, 4] and density.tolist() == [0, 3, 0] and c.size.min == 2.0
    assert [part.share for part in d.size.of] == [0.995, 0.005]
    assert [part.distribution for part in d.size.of] == ["lognormal", "single"] and d.size.of[0].sigma == 1.2
    assert (d.size.min, d.size.max) == (1.0, 30.0)
    assert (recipe.phase.method, recipe.phase.orders, recipe.phase.polarized) == ("mie", 3, True)


def test_files_are_hashed_as_read(everything, tmp_path):
    recipe = load(everything)
    keys = [file.key for file in recipe.files]
    assert keys == [f"particles.components[{i}].{rest}" for i, rest in ((1, "material.file"), (2, "material"), (2, "size.file"),
                                                                        (3, "material"))]
    for file in recipe.files:
        assert file.sha256 == hashlib.sha256(file.path.read_bytes()).hexdigest()
    assert recipe.files[0].path == tmp_path / "own.csv"


def test_leaves(everything):
    recipe = load(everything)
    leaves = recipe.leaves
    assert all(type(value) in (str, int, float, bool) for value in leaves.values())
    expected = {"wavelengths[0]": 0.5, "wavelengths[2]": 0.7, "seed": 7, "tolerance": 0.005, "particles.host.n[1]": 1.2,
                "particles.components[0].material.n[2]": 1.5, "particles.components[0].material.k[1]": 0.2,
                "particles.components[0].size.radius": 0.06, "particles.components[1].material.file": "own.csv",
                "particles.components[3].size.of[1].share": 0.005, "particles.components[3].size.max": 30.0,
                "phase.polarized": True, "phase.orders": 3, "particles.components[2].material": "ice"}
    assert expected.items() <= leaves.items()
    assert "particles.components[1].size.min" not in leaves  # no cut is not a value


def test_equal_recipes_have_equal_leaves(write):
    one = load(ROOT / "recipes" / "fog.yaml").leaves
    text = (ROOT / "recipes" / "fog.yaml").read_text()
    for old, new in [
        ("radius: 5 um", "radius: 0.005 mm"),
        ("1e8 /m^3", "100 /cm^3"),
        ("1%", "0.01"),
        ("wavelengths: rgb", "wavelengths: [610, 550, 465] nm"),
        ("  host: air\n", ""),
        ("      material: water", "      fraction: 100%\n      material: water"),
        ("bakery: 1", "seed: 0\nbakery: 1"),
    ]:
        assert old in text
        assert load(write(text.replace(old, new))).leaves == one, new


def test_places(everything, monkeypatch):
    monkeypatch.chdir(everything.parent)
    recipe = load("recipe.yaml")
    for key in ("particles.components[3].size.of[1].radius", "seed", "phase.polarized", "particles.components[0].material.k",
                "wavelengths[1]"):
        line = int(re.fullmatch(r"recipe\.yaml:(\d+)", recipe.where(key))[1])
        assert key.rpartition(".")[2].partition("[")[0] in EVERYTHING.splitlines()[line - 1]
    assert recipe.where("particles.components[0].size.min") == recipe.where("particles.components[0].size")  # left out
    assert recipe.where("phase.orders") == recipe.where("phase")
    assert recipe.where("nothing.at.all") == "recipe.yaml"


def test_text_is_the_file(everything):
    assert load(everything).text == EVERYTHING


def test_recipes_travel_and_stay_as_they_are(everything):
    recipe = load(everything)
    copy = pickle.loads(pickle.dumps(recipe))
    assert copy.leaves == recipe.leaves and copy.where("seed") == recipe.where("seed")
    assert np.array_equal(copy.particles.components[2].material.k, recipe.particles.components[2].material.k)
    with pytest.raises(AttributeError):
        recipe.seed = 1
    with pytest.raises(ValueError, match="read-only"):
        recipe.particles.host.n[0] = 2


MEDIUM = "bakery: 1\nname: m\nwavelengths: [0.5, 0.6]\nmedium:\n  {}\n  phase: {}\n"


@pytest.mark.parametrize(
    "coefficients, sigma_t, albedo",
    [
        ("{albedo: 90%, mean_free_path: 1 mm}", [1000, 1000], [0.9, 0.9]),
        ("{albedo: [0.9, 1], mean_free_path: [0.5, 0.25] mm}", [2000, 4000], [0.9, 1]),
        ('{albedo: [0.9, 1], mean_free_path: "[0.5, 0.25] mm"}', [2000, 4000], [0.9, 1]),
        ("{albedo: 0, mean_free_path: [0.5 mm, 25 cm]}", [2000, 4], [0, 0]),
        ("{sigma_s: [1, 3] /mm, sigma_a: 1 /mm}", [2000, 4000], [0.5, 0.75]),
    ],
)
def test_medium(write, coefficients, sigma_t, albedo):
    inner = coefficients[1:-1]
    parts = re.split(r", (?=mean_free_path|sigma_a)", inner)
    medium = load(write(MEDIUM.format("\n  ".join(parts), "{type: isotropic}"))).medium
    assert coefficients_of(medium)[0] == pytest.approx(sigma_t, rel=1e-15)
    assert coefficients_of(medium)[1] == pytest.approx(albedo, rel=1e-15)


@pytest.mark.parametrize(
    "phase, attribute, value",
    [
        ("{type: hg, g: -0.5}", "g", [-0.5, -0.5]),
        ("{type: hg, g: [0, 0.9]}", "g", [0, 0.9]),
        ("{type: gaussian, spread: 30 deg}", "spread", math.pi / 6),
        ("{type: rayleigh}", "g", None),
        ("{type: isotropic}", "spread", None),
    ],
)
def test_phase_functions(write, phase, attribute, value):
    found = phase_keys(load(write(MEDIUM.format("albedo: 1\n  mean_free_path: 1 m", phase))).medium.phase)[attribute]
    assert found is None if value is None else found == pytest.approx(value)


@pytest.mark.parametrize("table", ["theta_deg,value\n0,4\n90,1\n180,2\n",
                                   "theta_rad, p\n0,4\n1.5707963267948966,1\n3.14159265,2\n"])
def test_phase_table(write, table):
    write(table, "lobe.csv")
    theta, value = load(write(MEDIUM.format("albedo: 1\n  mean_free_path: 1 m",
                                            "{type: table, file: lobe.csv}"))).medium.phase.file
    assert theta.tolist() == [0.0, math.pi / 2, math.pi] and value.tolist() == [4, 1, 2]


# ---- lists with one unit behind them


def test_a_list_with_a_unit_keeps_the_lines_and_columns(write):
    text = ("bakery: 1\nname: m\nmedium:\n  albedo: [0.999, 0.999, 0.999]   # comment [1, 2] mm\n"
            '  mean_free_path: [0.84, x, 0.68] mm  # one unit for all\n  phase: {type: hg, g: 1.5}\n'
            'description: "about [1, 2] mm: thick"\n')
    with pytest.raises(RecipeError) as error:
        load(write(text))
    assert [(p.line, p.column) for p in error.value.problems] == [(5, 26), (6, 24)]
    fixed = text.replace("x", "0.75").replace("1.5", "0.7")
    recipe = load(write(fixed))
    assert coefficients_of(recipe.medium)[0] == pytest.approx([1e6 / 840, 1e6 / 750, 1e6 / 680])
    assert recipe.description == "about [1, 2] mm: thick"


def test_a_quoted_list_counts_its_quote(write):
    with pytest.raises(RecipeError) as error:
        load(
            write(
                'bakery: 1\nname: m\nmedium:\n  albedo: 1\n  mean_free_path: "[0.84, x, 0.68] mm"\n  phase: {type: isotropic}\n'
            )
        )
    assert [(p.line, p.column) for p in error.value.problems] == [(5, 27)]


def test_inside_braces(write):
    text = "bakery: 1\nname: m\nmedium: {albedo: 1, mean_free_path: [1, 2, 3] mm, phase: {type: isotropic}}\n"
    assert coefficients_of(load(write(text)).medium)[0].tolist() == [1000, 500, 1e6 / 3000]


# ---- overrides


def test_overrides_change_values_and_text(write):
    path = ROOT / "recipes" / "fog.yaml"
    recipe = load(path, {"particles.number_density": "2e8 /m^3", "particles.components.droplets.size.radius": "4 um", "seed": "3",
                         "particles.components[0].material": "{n: 1.4, k: [0, 0.1, 0.2]}", "phase.polarized": "true",
                         "wavelengths": "[500, 600, 700] nm", "description": '"a: b # c"',
                         "particles.components[0].size.min": "1 um"})
    assert (recipe.particles.number_density == 2e8 and recipe.seed == 3 and recipe.wavelength == (0.5, 0.6, 0.7)
            and recipe.phase.polarized)
    assert recipe.particles.components[0].size.radius == 4.0 and recipe.particles.components[0].material.k.tolist() == [0, 0.1,
                                                                                                                        0.2]
    assert recipe.where("seed") == "--set seed" and recipe.where("name") == load(path).where("name")
    again = load(write(recipe.text))  # the asset's recipe alone gives the same values
    assert again.leaves == recipe.leaves
    kept = [line for line in path.read_text().splitlines() if line.startswith("#")]
    assert kept and all(line in recipe.text for line in kept), "comments stay"


@pytest.mark.parametrize(
    "key, value",
    [
        ("particles",
         "{number_density: 1e7 /m^3, components: [{name: x, material: ice, size: {distribution: single, radius: 1 um}}]}"),
        ("particles.components", "[{name: x, material: ice, size: {distribution: single, radius: 1 um}}]"),
        ("particles.components[0]", "{name: x, fraction: 25%, material: ice, size: {distribution: single, radius: 1 um}}"),
        ("particles.components[3].size.of[0].radius", "3 um"),
        ("particles.components.d.size.max", "31 um"),
        ("description", "short"),
        ("particles.host", "water"),
        ("particles.components.a.material.n", "1.6"),
        ("wavelengths", "rgb"),
        ("tolerance", "0.02"),
    ],
)
def test_any_value_can_be_overridden(everything, key, value):
    # constants given for three wavelengths do not fit the named ones
    also = {"particles.host": "air", "particles.components.a.material": "ice"} if key == "wavelengths" else {}
    recipe = load(everything, {**also, key: value})
    changed = load(everything).leaves.items() ^ recipe.leaves.items()
    assert changed
    everything.write_text(recipe.text, encoding="utf-8")
    assert load(everything).leaves == recipe.leaves


@pytest.mark.parametrize(
    "key, value, says",
    [
        ("seeds", "3", '--set seeds: seeds: found the unknown key "seeds"'),
        ("tolerence", "2%", "(tolerance?)"),  # which the recipe has
        ("seed", "3.5", '--set seed: seed: found "3.5"; expected a whole number from 0 to 2^53'),
        ("particles.number_density", "5", 'found "5", which has no unit'),
        ("particles.components[1].name", "x", "found particles.components[1]; expected an index below 1"),
        ("particles.components.fog.name", "x", 'found no item "fog" in particles.components; expected particles.components[0] to '
         'particles.components[0], or one of "droplets"'),
        ("name.x", "x", 'found name, which is the value "fog" and has no keys'),
        ("seed", "", "found nothing; expected a value"),
        ("seed", "[1", "--set seed: cannot be read as YAML"),
        ("a b[", "1", 'found the key "a b["; expected a dotted key'),
    ],
)
def test_problems_of_overrides_name_them(key, value, says):
    with pytest.raises(RecipeError) as error:
        load(ROOT / "recipes" / "fog.yaml", {key: value})
    assert says in str(error.value)
    assert [problem.line for problem in error.value.problems] == [None]


# ---- what ships


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_recipes(path):
    recipe = load(path)
    # those of scenes of separate particles bake while one waits for the picture
    tolerance = 0.1 if path.stem.endswith("_particles") else 0.03 if path.stem == "drizzle" or recipe.discrete else 0.01
    assert recipe.name == path.stem and recipe.tolerance == tolerance
    assert path.read_text(encoding="utf-8").startswith("# yaml-language-server: $schema=../assets/schemas/recipe-1.json\n")


def test_all_are_shipped():
    assert {path.stem for path in SHIPPED} >= {"fog", "cirrus", "blowing_snow", "dust", "soot", "bubbles", "haze", "milk", "wax",
                                                   "drizzle", "tile", "tiles", "sand", "wet_sand", "snow_pack", "cane_sugar",
                                                   "white_sugar", "salt", "flour", "glass_beads", "gravel", "copper_shot"}


def fits(value, schema, root) -> bool:
    """Whether a value fits a JSON Schema, as far as ours uses it."""
    if "$ref" in schema and not fits(value, root["$defs"][schema["$ref"].rpartition("/")[2]], root):
        return False
    kinds = {"object": dict, "array": list, "string": str, "integer": int, "number": (int, float), "boolean": bool}
    if "type" in schema and (not isinstance(value, kinds[schema["type"]]) or isinstance(value,
                                                                                        bool) != (schema["type"] == "boolean")):
        return False
    if "enum" in schema and value not in schema["enum"] or "const" in schema and value != schema["const"]:
        return False
    if "anyOf" in schema and not any(fits(value, s, root) for s in schema["anyOf"]):
        return False
    if "oneOf" in schema and sum(fits(value, s, root) for s in schema["oneOf"]) != 1:
        return False
    if isinstance(value, str) and "pattern" in schema and not re.search(schema["pattern"], value):
        return False
    if isinstance(value, (int, float)) and not (schema.get("minimum", value) <= value <= schema.get("maximum", value)):
        return False
    if isinstance(value, list) and not all(fits(item, schema.get("items", {}), root) for item in value):
        return False
    if isinstance(value, dict):
        known = schema.get("properties", {})
        if any(name not in value for name in schema.get("required", ())):
            return False
        named = {name: part for name in value for pattern, part in schema.get("patternProperties", {}).items()
                 if re.search(pattern, name)}
        known = {**named, **known}
        if schema.get("additionalProperties") is False and value.keys() - known.keys():
            return False
        return all(fits(item, known.get(name, {}), root) for name, item in value.items())
    return True


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_editors_accept_what_ships(path):
    value = ruamel.yaml.YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))
    schema = json_schema()
    assert fits(value, schema, schema)
    if path.stem in ("fog", "sand"):
        assert not fits({**value, "wavelenths": "rgb"}, schema, schema)
        assert not fits({**value, "tolerance": "1 um"}, schema, schema)
        assert not fits({key: item for key, item in value.items() if key != "name"}, schema, schema)


def test_editors_accept_every_kind(everything):
    schema = json_schema()
    value = ruamel.yaml.YAML(typ="safe", pure=True).load(EVERYTHING)
    assert fits(value, schema, schema)
    value["particles"]["number_density"] = "100 1/cm^3"
    assert fits(value, schema, schema)
    value["particles"]["components"][0]["size"]["radius"] = 5
    assert not fits(value, schema, schema)


def test_every_key_has_a_description():
    schema = json_schema()
    for name, part in [("recipe", schema), *schema["$defs"].items()]:
        for key, value in part.get("properties", {}).items():
            assert value.get("description"), f"{name}.{key}"


def test_the_page_is_true(write, monkeypatch):
    """Recipes in docs/recipes.md load, and the errors that it shows are what is printed."""
    page = (ROOT / "docs" / "recipes.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```(\w*)\n(.*?)```", page, re.DOTALL)
    recipes = [text for kind, text in blocks if kind == "yaml" and text.startswith("bakery: 1")]
    shown = next(text for kind, text in blocks if kind == "text")
    for text in recipes[:-1]:
        load(write(text))
    with pytest.raises(RecipeError) as error:
        monkeypatch.chdir(write(recipes[-1], "fog.yaml").parent)
        load("fog.yaml")
    assert str(error.value) + "\n" == shown
    numbers = ["zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine"]
    assert f"This recipe has {numbers[len(error.value.problems)]}:" in page
    monkeypatch.chdir(ROOT)
    assert load("recipes/fog.yaml").where("particles.number_density") in page


@pytest.mark.parametrize(("tolerance", "given", "tables", "beams"), [
    ("10%", "{}", 0.1, 0.1), ("1%", "{}", 0.01, 0.03), ("0.5%", "{}", 0.01, 0.03), ("0.5%", "{tolerance: 0.2%}", 0.002, 0.002),
])
def test_defaults_do_not_ask_for_more_than_is_reached(write, tolerance, given, tables, beams):
    """Tables and beams have tolerances of their own: the recipe's, but not below what their methods reach, unless it is given."""
    text = (f"bakery: 1\nname: a\ntolerance: {tolerance}\n"
            "medium: {albedo: 0.9, mean_free_path: 1 mm, phase: {type: isotropic}}\n"
            f"multiple_scattering: {given}\nbeam: {given}\n")
    recipe = load(write(text))
    assert recipe.multiple_scattering.tolerance == recipe.leaves["multiple_scattering.tolerance"] == tables
    assert recipe.beam.tolerance == recipe.leaves["beam.tolerance"] == beams
