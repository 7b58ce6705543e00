"""Packed grains in recipes: every shape, surface and option, in and out."""

import hashlib
import inspect
import math
import pickle
import re
import subprocess
import sys

import pytest
import ruamel.yaml

from bakery.errors import RecipeError
from bakery.physics.shapes import build as shapes
from bakery.physics.shapes import limits
from bakery.recipe import json_schema, load
from bakery.stages.grains import section as grain_section
from tests.conftest import ROOT, slow
from tests.grain_examples import EXAMPLES
from tests.unit.test_recipe import fits

GRAINS = """\
bakery: 1
name: grains
wavelengths: [0.5, 0.6]
tolerance: 2%
grains:
  radius: 0.5 mm
  host: water
  components:
    - name: a
      weight: 50%
      shape: {type: box, size: [1, 2, 3]}
      surface: {type: dielectric, material: ice, roughness: 0.1}
      interior: {absorption: [0.1, 2] /mm}
    - name: b
      weight: 0.2
      shape: {type: superellipsoid, exponents: 0.3}
      surface: {type: diffuse, reflectance: [10%, 0.9]}
    - name: c
      weight: 0.2
      shape: {type: sphere}
      surface: {type: conductor, material: {n: 0.2, k: [3, 4]}}
    - name: d
      weight: 0.1
      shape: {type: rock, sharpness: inf}
      surface: {type: dielectric, material: {n: 1.5, k: 0.1}}
      interior: {material: ice}
packing: {fraction: [0.6, 0.5]}
"""
ONE = """\
bakery: 1
name: one
grains:
  radius: 0.5 mm
  components:
    - name: grain
      shape: SHAPE
      surface: {type: dielectric, material: ice}
packing: {fraction: 0.6}
"""
CUBE = b"OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"


@pytest.fixture
def write(tmp_path):
    def write(text, name="recipe.yaml"):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


@pytest.fixture
def shape(write):
    """What a recipe with one grain says of its shape."""

    def shape(values):
        if not isinstance(values, str):
            values = "{" + ", ".join(f"{key}: {list(v) if isinstance(v, tuple) else v}" for key, v in values.items()) + "}"
        return grain_section.shape_keys(load(write(ONE.replace("SHAPE", values))).grains.components[0].shape)

    return shape


def test_every_kind_of_grain(write):
    recipe = load(write(GRAINS))
    grains = recipe.grains
    assert grains.radius == 500.0 and grains.host.name == "water" and grains.host.n == pytest.approx([1.337, 1.333], abs=1e-3)
    assert recipe.packing.fraction == (0.6, 0.5) and recipe.medium is None and recipe.particles is None
    a, b, c, d = grains.components
    assert [(part.name, part.weight) for part in grains.components] == [("a", 0.5), ("b", 0.2), ("c", 0.2), ("d", 0.1)]
    assert a.shape == {"type": "box", "size": (1.0, 2.0, 3.0)}
    assert (a.surface.type, a.surface.roughness) == ("dielectric", 0.1)
    assert a.surface.material.n == pytest.approx([1.3130, 1.3094], abs=1e-3)  # absolute, not relative to the host
    absorbed = [grain_section.absorption(part.interior, recipe.wavelength) for part in grains.components]
    assert absorbed[0].tolist() == [100.0, 2000.0]
    assert b.shape == {"type": "superellipsoid", "axes": (1.0, 1.0, 1.0), "exponents": (0.3, 0.3)}
    assert b.surface.type == "diffuse"
    assert b.surface.reflectance.tolist() == [0.1, 0.9] and absorbed[1].tolist() == [0, 0]
    assert c.shape == {"type": "sphere"} and c.surface.type == "conductor"
    assert c.surface.material.n.tolist() == [0.2, 0.2] and c.surface.material.k.tolist() == [3, 4]
    assert grain_section.shape_keys(d.shape)["sharpness"] == math.inf and d.surface.material.k.tolist() == [0.1, 0.1]
    # Warren & Brandt 2008: k = 5.889e-10 at 0.5 um and 5.73e-9 at 0.6 um; 4 pi k / wavelength, the surface's k does not count
    assert absorbed[3] == pytest.approx([4 * math.pi * 5.889e-10 / 0.5e-6, 4 * math.pi * 5.73e-9 / 0.6e-6], rel=2e-3)


def test_options_have_defaults(write):
    recipe = load(write(GRAINS))
    s = recipe.scatterometer
    assert (s.tolerance, s.triangles, s.paths, s.depth, s.engine) == (0.01, 20_000, None, 100_000, "numba")
    assert (recipe.effective_medium.sigma_t, recipe.effective_medium.walks) == ("auto", None)
    more = "scatterometer: {tolerance: 0.3%, triangles: fine, paths: 5000, depth: 7, engine: numba}\n"
    more += "effective_medium: {sigma_t: random_walk, walks: 5000}\n"
    recipe = load(write(GRAINS + more))
    s = recipe.scatterometer
    assert (s.tolerance, s.triangles, s.paths, s.depth, s.engine) == (0.003, 200_000, 5000, 7, "numba")
    assert (recipe.effective_medium.sigma_t, recipe.effective_medium.walks) == ("random_walk", 5000)
    fog = load(ROOT / "recipes" / "fog.yaml")
    assert fog.grains is None and fog.scatterometer.triangles == 20_000


@pytest.mark.parametrize("name", sorted(shapes.SHAPES))
def test_keys_and_defaults_are_those_of_the_functions(name, write, shape):
    found = {key: p.default for key, p in inspect.signature(shapes.SHAPES[name]).parameters.items() if key != "triangles"}
    if name == "mesh":
        write(CUBE, "x.off")
        assert shape("{type: mesh, file: x.off}") == {"type": "mesh", "data": CUBE, "kind": "off"}
        assert set(found) == {"data", "kind", "repair"} and found["repair"] is None
    else:
        assert shape(f"{{type: {name}}}") == {"type": name, **found}


RANGES = [
    ("superellipsoid", "exponents", limits.EXPONENTS),
    ("rock", "seed", limits.SEED),
    ("rock", "corners", limits.CORNERS),
    ("rock", "sharpness", limits.SHARPNESS),
    ("rock", "roughness", limits.NOISE),
    ("crystal", "chips", limits.CHIPS),
    ("crystal", "depth", limits.DEPTH),
    slow("aggregate", "bodies", limits.BODIES),
    ("aggregate", "smallest", limits.SMALLEST),
    slow("aggregate", "length", limits.LENGTH),
    slow("aggregate", "overlap", limits.OVERLAP),
    slow("aggregate", "blend", limits.BLEND),
]


@pytest.mark.parametrize("name, key, ends", RANGES)
def test_what_a_recipe_takes_can_be_built(name, key, ends, shape):
    for value, beyond in zip(ends, (-1, 1), strict=True):
        given = shape({"type": name, key: value})
        assert given[key] == (value, value) if key == "exponents" else given[key] == value
        if (key, value) != ("smallest", 0.05):  # bodies finer than the triangles: the stage tells
            shapes.build(given, 2000)
        outside = value + beyond * (1 if isinstance(value, int) else 1e-3)
        with pytest.raises(RecipeError, match=f"shape.{key}: found"):
            shape({"type": name, key: outside})


def test_an_aggregate_too_fine_for_a_grid_is_refused_with_advice(shape):
    """By the recipe, at its place, not by the stage; its bodies decide, which the advice makes larger or fewer."""
    fine = "{type: aggregate, arrangement: star, bodies: 64, smallest: 0.05, length: 10, seed: 1}"
    with pytest.raises(RecipeError, match="shape: found an aggregate whose details of .* of the whole are too small to be "
                                          "resolved; .* would do; expected a larger smallest, a shorter length or fewer bodies"):
        shape(fine)
    for key, value in (("smallest", "0.3"), ("length", "2"), ("bodies", "2")):
        shape(re.sub(rf"{key}: [\d.]+", f"{key}: {value}", fine))


def test_words_are_those_of_the_functions(shape):
    assert set(limits.HABITS) == set(shapes.HABITS)
    for habit in limits.HABITS:
        shapes.build(shape(f"{{type: crystal, habit: {habit}}}"), 300)
    for arrangement in limits.ARRANGEMENTS:
        shapes.build(shape(f"{{type: aggregate, arrangement: {arrangement}, length: 1}}"), 300)
    for level, triangles in limits.LEVELS.items():
        assert f"{level} ({triangles:,})" in grain_section.Scatterometer.model_fields["triangles"].description
    assert shape("{type: ellipsoid, axes: [10000, 1, 10000]}")["axes"] == (1e4, 1.0, 1e4)


@pytest.mark.parametrize("name", sorted(EXAMPLES))
def test_example_grains_can_be_written(name, shape):
    given = shape(EXAMPLES[name])
    assert given.items() >= EXAMPLES[name].items()


# ---- mesh files


def test_mesh_files(write, tmp_path):
    write(CUBE, "a.off"), write(CUBE, "B.OFF")
    (tmp_path / "deep").mkdir()
    write(b"solid\n", "deep/c.STL")
    grain = "    - {{name: {}, weight: 0.25, shape: {{type: mesh, file: {}}}, surface: {{type: diffuse, reflectance: 1}}}}\n"
    parts = "".join(grain.format(*pair) for pair in (("a", "a.off"), ("b", "B.OFF"), ("c", "deep/c.STL"), ("d", "./a.off")))
    text = f"bakery: 1\nname: m\ngrains:\n  radius: 1 mm\n  components:\n{parts}packing: {{fraction: 0.5}}\n"
    recipe = load(write(text))
    found = [grain_section.shape_keys(part.shape) for part in recipe.grains.components]
    assert [shape["kind"] for shape in found] == ["off", "off", "stl", "off"]
    assert found[0]["data"] == CUBE and found[3]["data"] is found[0]["data"]  # read once
    assert found[2]["data"] == b"solid\n"  # whether it makes a grain is told where it is built
    keys = [f"grains.components[{i}].shape.file" for i in range(4)]
    files = {file.key: file for file in recipe.files if file.key in keys}
    assert [files[key].sha256 for key in keys[:3:2]] == [hashlib.sha256(data).hexdigest() for data in (CUBE, b"solid\n")]
    assert [files[key].path.name for key in keys] == ["a.off", "B.OFF", "c.STL", "a.off"]
    assert [recipe.leaves[key] for key in keys] == ["a.off", "B.OFF", "deep/c.STL", "./a.off"]
    assert len(repr(recipe.grains)) < 2000  # not the meshes themselves
    assert len(shapes.build(found[1], 100).faces) == 4
    copy = pickle.loads(pickle.dumps(recipe))
    assert grain_section.shape_keys(copy.grains.components[0].shape) == found[0]


def test_meshes_that_are_too_large(write, tmp_path, monkeypatch):
    monkeypatch.setattr(limits, "BYTES", 1 << 20)
    monkeypatch.setattr(grain_section, "MESHES", 1 << 20)
    with open(tmp_path / "large.ply", "wb") as file:
        file.truncate((1 << 20) + 1)  # sparse
    with pytest.raises(RecipeError, match='file: found "large.ply" of more than 1 MiB; expected a smaller mesh'):
        load(write(ONE.replace("SHAPE", "{type: mesh, file: large.ply}")))
    for name in ("a.ply", "b.ply"):
        write(b"ply\n" + bytes(600_000), name)
    part = "    - {name: b, weight: 0.5, shape: {type: mesh, file: FILE}, surface: {type: diffuse, reflectance: 1}}\n"
    two = ONE.replace("SHAPE", "{type: mesh, file: a.ply}\n      weight: 0.5").replace("packing", part + "packing")
    assert load(write(two.replace("FILE", "a.ply"))).grains
    with pytest.raises(RecipeError, match='found meshes of more than 1 MiB together with "b.ply"; expected smaller files'):
        load(write(two.replace("FILE", "b.ply")))


# ---- leaves, overrides, editors


def test_every_value_is_a_leaf(write):
    recipe = load(write(GRAINS))
    leaves = recipe.leaves
    assert all(type(value) in (str, int, float, bool) for value in leaves.values())
    assert all(math.isfinite(value) for value in leaves.values() if isinstance(value, float))
    expected = {
        "grains.radius": 500.0,
        "grains.host": "water",
        "grains.components[0].shape.size[2]": 3.0,
        "grains.components[0].surface.roughness": 0.1,
        "grains.components[0].interior.absorption[1]": 2000.0,
        "grains.components[1].shape.exponents[1]": 0.3,
        "grains.components[1].surface.reflectance[0]": 0.1,
        "grains.components[2].surface.material.k[1]": 4.0,
        "grains.components[2].surface.roughness": 0.0,
        "grains.components[3].interior.material": "ice",
        "grains.components[3].shape.sharpness": "inf",
        "grains.components[3].shape.corners": 45,
        "scatterometer.tolerance": 0.01,
        "scatterometer.triangles": 20_000,
        "scatterometer.paths": "auto",
        "scatterometer.depth": 100_000,
        "scatterometer.engine": "numba",
        "effective_medium.sigma_t": "auto",
        "effective_medium.walks": "auto",
    }
    assert expected.items() <= leaves.items()
    exponents = [key for key in leaves if "exponents" in key]
    assert len(exponents) == 2  # not one a wavelength
    assert not any(key.startswith(("scatterometer", "effective")) for key in load(ROOT / "recipes" / "tile.yaml").leaves)


@pytest.mark.parametrize("old, new", [
    ("radius: 0.5 mm", "radius: 500 um"),
    ("[0.1, 2] /mm", "[1, 20] /cm"),
    ("exponents: 0.3", "exponents: [0.3, 0.3]"),
    ("exponents: 0.3", "axes: [1, 1, 1], exponents: [0.3]"),
    ("{type: sphere}", "\n        type: sphere"),
    ("packing", "scatterometer: {tolerance: 1%, triangles: middle}\neffective_medium: {walks: auto}\npacking"),
    ("sharpness: inf", "sharpness: inf, seed: 0"),
])
def test_equal_recipes_have_equal_leaves(write, old, new):
    assert old in GRAINS
    assert load(write(GRAINS.replace(old, new))).leaves == load(write(GRAINS)).leaves


def test_the_recipes_tolerance_carries_the_grains(write):
    assert load(write(GRAINS), {"tolerance": "10%"}).scatterometer.tolerance == 0.05
    own = GRAINS + "scatterometer: {tolerance: 0.1%}\n"
    assert load(write(own), {"tolerance": "10%"}).scatterometer.tolerance == 0.001


def test_editors_accept_every_kind(write):
    schema = json_schema()
    # the list with one unit behind it is no YAML in the eyes of editors
    text = GRAINS.replace("[0.1, 2] /mm", '"[0.1, 2] /mm"')
    value = ruamel.yaml.YAML(typ="safe", pure=True).load(text)
    value["scatterometer"] = {"triangles": "coarse", "paths": 5000, "tolerance": "1%"}
    value["effective_medium"] = {"walks": "auto"}
    assert fits(value, schema, schema)
    for section, key, wrong in (("scatterometer", "triangles", "finest"), ("scatterometer", "depth", 0),
                                ("effective_medium", "sigma_t", "mean"), ("grains", "radius", 5)):
        assert not fits({**value, section: {**value[section], key: wrong}}, schema, schema), key


def test_the_repair_of_a_mesh_counts_only_where_it_is_asked_for(write, shape):
    write(CUBE, "x.off")
    plain = load(write(ONE.replace("SHAPE", "{type: mesh, file: x.off}")))
    asked = load(write(ONE.replace("SHAPE", "{type: mesh, file: x.off, repair: pymeshlab}")))
    assert dict(asked.leaves) == {**plain.leaves, "grains.components[0].shape.repair": "pymeshlab"}  # so old input hashes stay
    assert shape("{type: mesh, file: x.off, repair: pymeshlab}")["repair"] == "pymeshlab"
    with pytest.raises(RecipeError, match='found "pymeshlap"; expected pymeshlab'):
        load(write(ONE.replace("SHAPE", "{type: mesh, file: x.off, repair: pymeshlap}")))


def test_reading_grains_loads_nothing_heavy():
    code = ("import sys\nfrom bakery.recipe import load\nload('recipes/sand.yaml')\n"
            "heavy = {'numba', 'scipy', 'h5py', 'matplotlib', 'mitsuba', 'trimesh'} & set(sys.modules)\n"
            "assert not heavy, heavy\n")
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)
