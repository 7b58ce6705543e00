"""The smallest and the largest legal value of every key, and an empty list at every key: a plan or a clear error, in moments.

What is squared, inverted or divided by turns up here: `medium.phase.spread: 1e-300 deg`, `packing.radii: []`.
"""

import copy
import json
import math
import typing
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bakery
from bakery.errors import RecipeError
from bakery.grammar import text
from bakery.grammar.fields import Leaf
from bakery.grammar.section import Section
from bakery.recipe import schema
from bakery.run import bake, execute
from tests.conftest import slow
from tests.libradtran import libradtran

HEAD = {"bakery": 1, "name": "x", "description": "", "wavelengths": [0.55, 0.6], "seed": 0, "tolerance": 0.1,
        "measure": "pointwise", "sweep": "none"}
DROP = {"name": "a", "material": "water", "fraction": 1.0, "size": {"distribution": "single", "radius": "1 um"}}
WHITE = {"type": "diffuse", "reflectance": 0.5}
GLASS = {"type": "dielectric", "material": {"n": 1.5, "k": 0.0}, "roughness": 0.1}
NOTHING = {"type": "isotropic"}


def _particles(size: dict, **more) -> dict:
    return {"particles": {"host": "air", "number_density": "1e8 /m^3", "components": [{**DROP, "size": size}]}, **more}


def _grains(shape: dict, surface: dict = WHITE, **more) -> dict:
    grain = {"name": "a", "weight": 1.0, "shape": shape, "surface": surface, **more}
    return {"grains": {"radius": "0.5 mm", "host": "vacuum", "components": [grain]}, "packing": {"fraction": 0.5, "count": 20}}


def _medium(phase: dict, **more) -> dict:
    return {"medium": {"albedo": 0.9, "mean_free_path": "1 mm", "phase": phase}, **more}


LOGNORMAL = {"distribution": "lognormal", "radius": "0.3 um", "sigma": 1.2, "min": "0.1 um", "max": "1 um"}
GAMMA = {"distribution": "gamma", "radius": "0.3 um", "variance": 0.1, "min": "0.1 um", "max": "1 um"}
TABLE = {"distribution": "table", "file": "sizes.csv", "min": "0.1 um", "max": "1 um"}
SINGLE = {"distribution": "single", "radius": "0.3 um"}
EFFECTIVE = {"distribution": "lognormal", "effective_radius": "0.3 um", "effective_variance": 0.1, "min": "0.1 um", "max": "1 um"}
JUNGE = {"distribution": "junge", "exponent": 3, "min": "0.1 um", "max": "1 um"}
BINS = {"distribution": "histogram", "file": "bins.csv", "min": "0.1 um", "max": "1 um"}
MIXED = {"mixing": "bruggeman", "of": [{"material": "water", "share": 0.5}, {"material": {"n": 1.5, "k": 0.1}, "share": 0.5}]}
INCLUDED = {"mixing": "maxwell_garnett", "matrix": "water", "of": [{"material": "soot", "share": 0.5}]}
# together they hold every key of the schema (a test sees to it), each with a value that plans in a moment
BASES = {
    "single": _particles(SINGLE, phase={
        "method": "goa", "orders": 3, "polarized": False, "switch": 100, "edge": "narrow", "rainbow": True, "axis": True,
        "radii": 5, "angles": 9}),
    "lognormal": _particles(LOGNORMAL),
    "gamma": _particles(GAMMA),
    "table": _particles(TABLE),
    "mixture": _particles({"distribution": "mixture", "min": "0.1 um", "max": "1 um", "of": [
        {"share": 0.25, **SINGLE}, {"share": 0.25, **LOGNORMAL}, {"share": 0.25, **GAMMA}, {"share": 0.25, **TABLE}]}),
    "effective lognormal": _particles(EFFECTIVE),
    "effective gamma": _particles(EFFECTIVE | {"distribution": "gamma"}),
    "junge": _particles(JUNGE),
    "histogram": _particles(BINS),
    "more of a mixture": _particles({"distribution": "mixture", "min": "0.1 um", "max": "1 um", "of": [
        {"share": 0.25, **EFFECTIVE}, {"share": 0.25, **EFFECTIVE, "distribution": "gamma"}, {"share": 0.25, **JUNGE},
        {"share": 0.25, **BINS}]}),
    "volumes": {"particles": {"volume_concentration": "1e-6 m^3/m^3", "components": [{**DROP, "material": MIXED}]}},
    "masses": {"particles": {"mass_concentration": "1 g/m^3", "components": [
        {**DROP, "density": "1 g/cm^3", "material": INCLUDED,
         "coating": {"material": "water", "ratio": 1.5, "density": "1 g/cm^3"}}]}},
    "thick coating": _particles(SINGLE) | {"particles": {"number_density": "1e8 /m^3", "components": [
        {**DROP, "size": LOGNORMAL, "coating": {"material": "water", "thickness": "0.1 um"}}]}},
    "grown": {"particles": {"relative_humidity": 0.8, "components": [
        {"name": name, "material": "silica", "size": LOGNORMAL, **amount, **more} for name, amount, more in (
            ("a", {"number_density": "1 /cm^3"}, {"growth": {"kappa": 0.5, "material": "water", "mixing": "volume"}}),
            ("b", {"volume_fraction": 1e-6}, {"growth": {"file": "growth.csv", "mixing": "shell"}}),
            ("c", {"volume_concentration": "1e-6 m^3/m^3"}, {
                "coating": {"material": "water", "volume_share": 0.5}, "growth": {"kappa": 0.5, "mixing": "bruggeman"}}),
            ("d", {"mass_concentration": "1 ug/m^3"}, {"density": "1 g/cm^3"}))]}},
    "indices": {"particles": {"host": {"n": 1.3}, "volume_fraction": 0.01, "components": [
        {**DROP, "material": {"n": 1.5, "k": 0.1}}]}},
    "files": {"particles": {"host": {"file": "clear.csv", "relative_to": "air"}, "volume_fraction": 0.01, "components": [
        {**DROP, "material": {"file": "index.csv"}}]}},
    "file of droplets": {"medium": {"file": "radii.cdf", "mass_concentration": "1 g/m^3", "effective_radius": "7 um"}},
    "file of an aerosol": {"medium": {"file": "humid.cdf", "mass_concentration": "10 ug/m^3", "humidity": 0.5}},
    "hg": _medium({"type": "hg", "g": 0.5}, multiple_scattering={
        "sources": ["point"], "extent": 2, "length": 1, "tolerance": 0.1, "orders": 8, "method": "solver", "photons": "auto"}),
    "beam": _medium({"type": "hg", "g": 0.5}, beam={"depth": 1, "photons": 1000, "tolerance": 0.5}),
    "surface": _medium({"type": "hg", "g": 0.5}, surface={
        "thickness": "1 mm", "boundary": {"index": 1.3, "roughness": 0.2}, "base": {"albedo": 0.5}, "tolerance": 0.1,
        "method": "medium"}),
    "layers": _medium({"type": "hg", "g": 0.5}, surface={"thickness": "1 mm", "base": {"recipe": "under.yaml", "layer": 0}}),
    "layers of an asset": _medium({"type": "hg", "g": 0.5}, surface={"thickness": "1 mm", "base": {"asset": "under.h5"}}),
    "photons": _medium(NOTHING, multiple_scattering={"method": "photons", "photons": 1000}),
    "isotropic": {"medium": {"sigma_s": "1 /mm", "sigma_a": "1 /mm", "phase": NOTHING}},
    "rayleigh": _medium({"type": "rayleigh"}),
    "gaussian": _medium({"type": "gaussian", "spread": "30 deg"}),
    "phase table": _medium({"type": "table", "file": "phase.csv"}),
    "tile": {"packing": {"fraction": [0.2], "count": 20, "cell": [1, 1, 1], "radii": "equal", "growth": 0.1, "equilibration": 1,
                         "seed": 0}},
    "tile of two": {"packing": {"fraction": 0.2, "count": 20, "radii": [{"share": 0.5, "radius": size} for size in (1, 2)]}},
    "tile of many": {"packing": {"fraction": 0.2, "count": 20, "radii": {"distribution": "lognormal", "sigma": 1.2}}},
    "sphere": _grains({"type": "sphere"}, GLASS, interior={"absorption": "1 /mm"}) | {
        "scatterometer": {"tolerance": 0.1, "triangles": "coarse", "paths": 1000, "depth": 100, "engine": "numba"},
        "effective_medium": {"sigma_t": "mean_flight", "walks": 1000}},
    "box": _grains({"type": "box", "size": [1, 1, 1]}, GLASS, interior={"material": "water"}),
    "ellipsoid": _grains({"type": "ellipsoid", "axes": [1, 1, 1]}, {"type": "conductor", "material": "copper", "roughness": 0.1}),
    "superellipsoid": _grains({"type": "superellipsoid", "axes": [1, 1, 1], "exponents": [0.5, 0.5]}),
    "rock": _grains({"type": "rock", "seed": 0, "axes": [1, 1, 1], "corners": 45, "sharpness": 24, "roughness": 0.02}),
    "crystal": _grains({"type": "crystal", "seed": 0, "habit": "cube", "axes": [1, 1, 1], "chips": 2, "depth": 0.2,
                        "sharpness": 60, "roughness": 0.004}),
    "aggregate": _grains({"type": "aggregate", "seed": 0, "arrangement": "cluster", "bodies": 6, "smallest": 0.6, "length": 0,
                          "overlap": 0.35, "blend": 0.05}),
    "mesh": _grains({"type": "mesh", "file": "grain.ply", "repair": "pymeshlab"}),
    "discrete": _particles(SINGLE, discrete={
        "count": 1, "box": ["1 m", "1 m", "1 m"], "method": "stored", "seed": 0, "classes": 1, "tolerance": 0.1,
        "grid": {"file": "grid.npy", "dataset": "density"}}),
    "discrete in a mesh": _particles(SINGLE, discrete={"count": 1, "mesh": {"file": "grain.ply", "unit": "1 m"}}),
}
PLY = """\
ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 4
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
0 0 1
3 0 2 1
3 0 1 3
3 0 3 2
3 1 2 3
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("limits")
    (made / "sizes.csv").write_text("0.1,1\n0.3,2\n1,0\n")
    (made / "bins.csv").write_text("radius_um,dN\n0.1,1\n0.3,2\n1,0\n")
    (made / "growth.csv").write_text("relative_humidity_percent,growth_factor\n0,1\n90,2\n")
    (made / "index.csv").write_text("0.3,1.3\n0.9,1.4\n")
    (made / "clear.csv").write_text("0.3,1.1\n0.9,1.2\n")
    libradtran(made / "radii.cdf", reff=[5, 10])
    libradtran(made / "humid.cdf", hum=[0, 50, 80])
    (made / "phase.csv").write_text("theta_deg,value\n0,2\n180,1\n")
    (made / "grain.ply").write_text(PLY)
    (made / "under.yaml").write_text(json.dumps(HEAD | _medium({"type": "isotropic"}, surface={})))
    bakery.bake(made / "under.yaml", output=made / "under.h5")
    np.save(made / "grid.npy", np.arange(1.0, 9.0).reshape(2, 2, 2))
    return made


def recipe_in(folder, values: dict):
    path = folder / "x.yaml"
    path.write_text(json.dumps(HEAD | values))  # JSON is YAML
    return path


def leaves_of(annotation):
    """The kinds of values that a field's type may have."""
    for part in (*getattr(annotation, "__metadata__", ()), *typing.get_args(annotation)):
        if isinstance(part, Leaf):
            yield part
        else:
            yield from leaves_of(part)


def extremes(leaf: Leaf):
    """The smallest and largest legal values of a leaf, and every word that stands for a value."""
    if leaf.quantity is None:
        kinds = leaf.json.get("anyOf", [leaf.json])
        for kind in kinds:
            yield from {kind[end] for end in ("minimum", "maximum") if end in kind}
            yield from ("vacuum", "copper") if kind.get("enum") == "materials" else kind.get("enum", ())
            yield from (True, False) if kind.get("type") == "boolean" else ()
        return
    bounds, unit = leaf.bounds, leaf.quantity.base
    low = bounds.least if bounds.above is None else math.nextafter(bounds.above, math.inf)
    high = bounds.most if bounds.below is None else math.nextafter(bounds.below, -math.inf)
    numbers = {-1.7e308 if low is None else low, 1.7e308 if high is None else high}
    if low is not None and low <= 0:
        numbers.add(5e-324)  # what 0 is told apart from
    yield from (value if unit == "1" else f"{value!r} {unit}" for value in numbers)


def fields_in(values, path=()):
    """(path, field) of every key below a mapping whose tree was checked."""
    if isinstance(values, text.Mapping):
        for name, child in values.items():
            yield (*path, name), values.model.model_fields[name]
            yield from fields_in(child, (*path, name))
    elif isinstance(values, text.Sequence):
        for i, child in enumerate(values):
            yield from fields_in(child, (*path, i))


def checked(values: dict):
    source = text.Source("x.yaml", json.dumps(HEAD | values))
    tree = text.parse(source).root
    schema.recipe_file().model_validate(tree, context={})
    return tree


def changed(values: dict, path: tuple, value) -> dict:
    made = copy.deepcopy(HEAD | values)
    node = made
    for step in path[:-1]:
        node = node[step]
    node[path[-1]] = value
    return made


def distinct(made):
    """Each variant once: a key may take a value as such or in a list."""
    return {json.dumps(one): one for one in made}.values()


def variants(values: dict):
    """The recipe with one key at one of its ends, or without entries."""
    for path, field in fields_in(checked(values)):
        here = HEAD | values
        for step in path:
            here = here[step]
        yield path, []
        if len(path) == 1 and path[0] in ("bakery", "name", "description", "seed", "measure", "sweep"):
            continue  # the same in every base
        # FieldInfo takes the outermost Annotated apart
        for leaf in [*(part for part in field.metadata if isinstance(part, Leaf)), *leaves_of(field.annotation)]:
            for value in extremes(leaf):
                if not isinstance(here, list):
                    yield path, value
                elif len(here) > 1 or value != here[0]:
                    yield path, [value, *here[1:]]


@cache
def tried() -> dict[str, list]:
    """Base -> its variants, without those that change a key beside the same values as in a base before it."""
    seen, found = set(), {}
    for base, values in BASES.items():
        found[base] = []
        for path, value in distinct(variants(values)):
            beside = HEAD | values
            for step in path[:-1]:
                beside = beside[step]
            plain = {key: other for key, other in beside.items() if not isinstance(other, dict | list)}
            where = base if path[0] in ("wavelengths", "tolerance") else plain  # these two go into every stage
            key = json.dumps([[step for step in path if isinstance(step, str)], value, where])
            if key not in seen:
                seen.add(key)
                found[base].append((path, value))
    return found


def planned(path):
    """The plan of a recipe, or None where it is refused with a place; warnings of NumPy are errors here."""
    try:
        return bake.planned(path, path.with_suffix(".h5"), jobs=2)
    except RecipeError as error:
        assert all(problem.line and (problem.found or problem.expected) for problem in error.problems)
        return None


def test_bases_hold_every_key(folder):
    held = {}
    for values in BASES.values():
        nodes = [checked(values)]
        while nodes:
            node = nodes.pop()
            if isinstance(node, text.Mapping):
                held.setdefault(node.model, set()).update(node)
            nodes += node.values() if isinstance(node, text.Mapping) else node if isinstance(node, text.Sequence) else ()
    kinds, waiting = {schema.recipe_file()}, [Section]
    while waiting:
        below = waiting.pop().__subclasses__()
        kinds |= {kind for kind in below if kind.__module__.startswith(("bakery.grammar.", "bakery.stages."))
                  and not kind.__name__.startswith("_")}
        waiting += below
    missing = {f"{kind.__name__}.{name}" for kind in kinds for name in set(kind.model_fields) - held.get(kind, set())}
    assert not missing


# others take the same functions to like ends
LONG = ("grown", "indices", "sphere", "mixture", "more of a mixture", "single", "masses", "volumes")


@pytest.mark.timeout(60)
@pytest.mark.parametrize("base", [slow(base) if base in LONG else base for base in BASES])
def test_smallest_largest_and_empty(folder, base):
    assert planned(recipe_in(folder, BASES[base])) is not None
    for path, value in tried()[base]:
        planned(recipe_in(folder, changed(BASES[base], path, value)))


@pytest.mark.parametrize("base", ["isotropic", "gaussian", "steep"])
def test_media_bake_at_their_ends(folder, base):
    bases = BASES | {"steep": _medium({"type": "hg", "g": [1 - 1e-9, -1 + 1e-9]})}
    baked = 0
    for path, value in distinct(variants(bases[base])):
        plan = planned(recipe_in(folder, changed(bases[base], path, value))) if path[0] == "medium" else None
        if plan is not None:
            execute(plan, jobs=1)
            baked += 1
    assert baked


@pytest.mark.slow
@settings(max_examples=40, deadline=None, derandomize=True, database=None)
@given(data=st.data())
def test_two_ends_at_once(folder, data):
    """As where sigma_s and sigma_a are both as large as numbers go."""
    base = data.draw(st.sampled_from(sorted(BASES)))
    values = BASES[base]
    for path, value in data.draw(st.lists(st.sampled_from(sorted(distinct(variants(values)), key=repr)), min_size=2, max_size=2)):
        try:
            values = changed(values, path, value)
        except (KeyError, IndexError, TypeError):
            continue  # the first change took away what the second is in
    planned(recipe_in(folder, values))
