"""Stages `grains` and `medium` from grains: what they store against closed forms, and what they refuse or remark."""

import math
import sys
from contextlib import suppress

import numpy as np
import pytest

import bakery
from bakery.asset.verify import _broken
from bakery.errors import StageError, UsageError
from bakery.physics.grains import traces
from bakery.physics.granular import sizes
from bakery.recipe import load
from bakery.run.executors import Context, threads
from bakery.stages import conform
from bakery.stages.effective import stage as effective
from bakery.stages.grains import stage as grains
from bakery.store.tree import Dataset, Group

RECIPE = """\
bakery: 1
name: packed
wavelengths: {wavelengths}
tolerance: {tolerance}
grains:
  radius: 0.5 mm
  components: [{components}]
packing: {{fraction: {fraction}, count: 32{packing}}}
{more}
"""
BALL = "{{name: {name}, weight: {weight}, shape: {{type: sphere}}, surface: {{type: dielectric, material: {{n: {n}}}}}{more}}}"
CUBE = BALL.replace("sphere", "box")


def component(kind=BALL, name="glass", weight=1.0, n=1.5, more=""):
    return kind.format(name=name, weight=weight, n=n, more=more)


def recipe(tmp_path, components, tolerance="10%", fraction=0.63, packing="", more="", wavelengths="[0.55]"):
    path = tmp_path / "packed.yaml"
    path.write_text(RECIPE.format(components=components, tolerance=tolerance, fraction=fraction, packing=packing, more=more,
                                  wavelengths=wavelengths))
    return path


@pytest.fixture
def bake(tmp_path):
    def run(components, **settings):
        path = tmp_path / "packed.h5"
        with suppress(StageError):  # written, although it misses a tolerance
            bakery.bake(recipe(tmp_path, components, **settings), output=path)
        assert not _broken(str(path))
        return bakery.open(path)

    return run


def grains_of(path, map=None):
    """The `grains` group of a recipe, without packing anything."""
    given = load(path)
    context = Context(grains.STAGE.tolerance(given), given.seed)
    if map:
        context.map = map
    result = grains.compute(grains.inputs(given, {}), context)
    return Group(result.members), result


@pytest.mark.slow
def test_balls_are_exact(bake):
    """Glass balls of index 1.5 and 1.46 at fraction 0.63 (the second as printed for glass beads by Meng et al. 2015)."""
    asset = bake(component())
    glass = asset.grains["glass"]
    assert float(glass.hit_probability) == 1 and float(glass.paths) == 0
    assert glass.lambda_s == pytest.approx([1.42435480], rel=1e-8) and glass.g == pytest.approx([0.65008941], rel=1e-8)
    assert glass.mean_square == pytest.approx([2.84887315], rel=1e-8)
    assert 5e-4 * asset.medium.sigma_t_mean_flight == pytest.approx([0.453017], abs=1e-6)  # sigma_t R
    assert asset.medium.albedo == 1 and float(asset.medium.void_chord) == pytest.approx(0.783069 * 5e-4, rel=1e-6)
    # the table: bins of one degree about 30, 60 and 120 degrees are not the values there, but near
    assert glass.phase(np.radians([30.0, 60.0, 120.0]))[0] == pytest.approx([0.34608, 0.073795, 0.003403], rel=0.01)
    assert 5e-4 * bake(component(n=1.46)).medium.sigma_t_mean_flight == pytest.approx([0.4498], abs=2e-3)


@pytest.mark.slow
def test_mixture_takes_conditional_means(bake):
    """A white ball that is always hit with a black one: albedos weigh by hits, which here go by cross section alone."""
    white = "{name: white, weight: 0.5, shape: {type: sphere}, surface: {type: diffuse, reflectance: 1}}"
    dark = "{name: dark, weight: 0.5, shape: {type: sphere}, surface: {type: diffuse, reflectance: 0.5}}"
    asset = bake(f"{white}, {dark}")
    assert asset.medium.albedo == pytest.approx([0.75], rel=1e-12)
    # light that leaves: two thirds from the white one; both have g = -4/9 and no mean way
    assert asset.medium.g == pytest.approx([-4 / 9], abs=1e-3) and asset.medium.lambda_s == pytest.approx([0], abs=1e-15)
    assert asset.grains["dark"].lossless.g == pytest.approx([-4 / 9], abs=1e-9)


def test_cube_covers_closed_forms(bake):
    """z-scores below 5: a false alarm in 1e6 runs; 31 degrees of freedom make it a few in 1e5."""
    asset = bake(component(CUBE, more=", interior: {absorption: 1e-9 /mm}"), tolerance="2%")
    cube = asset.grains["glass"]
    for name, true in (("hit_probability", 2 / math.pi), ("lambda_delta", 0.84897), ("lambda_s", 1.38850), ("g", 0.43807),
                       ("mean_square", 3.0468), ("inner_path", 1.323169)):
        assert abs(float(cube[name]) - true) < 5 * float(cube.error[name]) + 4e-4, name
    assert float(cube.error["g"]) <= 0.01 and cube.attributes == {}
    attributes = asset.grains.attributes
    assert attributes["tolerance"] == 0.01 and 0 < attributes["achieved_error"] <= 0.01
    # the share that goes straight on stands in the medium's table as a narrow peak
    share = float(cube.forward_delta)
    assert share == pytest.approx(0.388, abs=0.005)
    medium = asset.medium
    assert medium.theta[1] == grains.PEAK and medium.cdf[0, 1] == pytest.approx(share, abs=1e-5)
    assert medium.g == pytest.approx(cube.g, abs=2e-3)
    assert np.array_equal(medium.theta, asset.grains.theta)
    way = float(medium.lambda_beta) + medium.albedo * medium.lambda_s
    assert medium.sigma_t_mean_flight == pytest.approx(1 / way, rel=1e-12)


@pytest.mark.slow
def test_absorption_goes_by_the_size_of_the_grain(bake):
    """Balls of two sizes: the small ones absorb as a recipe of their own says."""
    inside = ", interior: {absorption: 1 /mm}"
    asset = bake(component(more=inside), packing=", radii: [{share: 0.75, radius: 1}, {share: 0.25, radius: 3}]")
    glass = asset.grains["glass"]
    assert asset.grains.radius == pytest.approx([1 / 3e3, 1e-3]) and asset.grains.radius_share == pytest.approx([0.75, 0.25])
    alone = bake(component(more=inside).replace("1 /mm", "2 /mm"))  # at 0.5 mm: twice the radius, half the coefficient
    assert glass.by_radius.albedo[1] == pytest.approx(alone.grains["glass"].albedo, rel=1e-12)
    assert (np.diff(glass.by_radius.albedo, axis=0) < 0).all()
    assert glass.by_radius.phase(0.3).shape == (2, 1)
    # cross sections: 0.75 to 0.25 * 9
    share = np.array([0.25, 0.75])
    assert asset.medium.albedo == pytest.approx(share @ glass.by_radius.albedo, rel=1e-12)


def test_wavelengths_that_share_paths(tmp_path):
    """Equal indices are traced once, different ones apart; each wavelength finds its own channel."""
    path = recipe(tmp_path, component(CUBE, n="[1.5, 1.4, 1.5]", more=", interior: {absorption: '[1, 2, 3] /mm'}"),
                  wavelengths="rgb")
    given = grains.inputs(load(path), {})
    made = traces.traces(given["components"][0], np.array([5e-4]), 3, 1e-4)
    assert sorted(trace.rows for trace in made) == [(0, 2), (1,)]
    group, _ = grains_of(path)
    albedo, g = group["glass/albedo"].data, group["glass/lossless/g"].data
    assert albedo[0] > albedo[1] > albedo[2] and g[0] == g[2] != g[1]


def test_same_bytes_on_any_number_of_workers(tmp_path):
    path = recipe(tmp_path, component(CUBE))
    alone, _ = grains_of(path)
    with threads(3) as pool:
        many, _ = grains_of(path, Context(0.05, 0, pool).map)
    for place, member in alone.walk():
        if isinstance(member, Dataset):
            assert np.array_equal(member.data, many[place].data), place


def test_paths_that_are_cut_are_told(tmp_path):
    group, result = grains_of(recipe(tmp_path, component(CUBE), more="scatterometer: {depth: 3, paths: 16384}"))
    lost = float(group["glass/lost"].data[0])
    assert 0.01 < lost < 1 and result.achieved_error >= lost and "scatterometer.depth" in result.notes[0]
    assert group["glass/albedo"].data[0] == pytest.approx(1 - lost, rel=1e-9)
    assert int(group["glass/paths"].data[0]) == 16384 and not result.missed


@pytest.mark.parametrize("absorption", ["0 /mm", "1e3 /mm", "1e9 /mm"])
def test_from_clear_to_opaque(bake, tmp_path, absorption):
    given = component(CUBE, n=2.42, more=f", interior: {{absorption: {absorption}}}")
    if absorption == "1e9 /mm":
        cube = bake(given).tree["grains/glass"]
        # only what is reflected at the first meeting
        assert cube["forward_delta"].data[0] == 0 and cube["inner_path"].data[0] == pytest.approx(0, abs=1e-9)
    else:
        group, _ = grains_of(recipe(tmp_path, given))
        assert not list(grains.check(group))
        cube = group["glass"]
    albedo = cube["albedo"].data[0]
    assert 0 < albedo <= 1 and np.isfinite(cube["lambda_s"].data).all() and (albedo == 1) == (absorption == "0 /mm")


def test_a_torn_mesh_is_repaired_where_the_recipe_says_so(tmp_path, monkeypatch):
    """A tetrahedron without one of its sides."""
    (tmp_path / "torn.off").write_text("OFF 4 3 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n")
    kind = CUBE.replace("type: box", "type: mesh, file: torn.off")
    with pytest.raises(StageError, match="grain glass: torn.off: not closed: face 0 .*; `repair: pymeshlab` may mend it"):
        grains_of(recipe(tmp_path, component(kind)))
    path = recipe(tmp_path, component(kind.replace("torn.off", "torn.off, repair: pymeshlab")))
    with pytest.raises(StageError, match="its holes take more than 10% of the surface"):  # it was asked, and obeys our limits
        grains_of(path)
    monkeypatch.setitem(sys.modules, "pymeshlab", None)
    monkeypatch.setattr(traces, "traces", None)  # told before anything is made or traced
    with pytest.raises(UsageError, match=r"pip install \"\.\[repair\]\""):
        grains_of(path)


def test_matched_index(bake, tmp_path):
    asset = bake(component(CUBE, n=1.0))
    assert float(asset.grains["glass"].forward_delta) == 1 and asset.medium.g == pytest.approx([1], abs=1e-6)
    assert "random_walk" not in asset.medium and "flies on for ever" in asset.provenance.medium.notes
    path = recipe(tmp_path, component(CUBE, n=1.0), more="effective_medium: {sigma_t: random_walk}")
    with pytest.raises(StageError, match="mean_flight would do"):
        bakery.bake(path, output=tmp_path / "no.h5")
    assert not (tmp_path / "no.h5").exists()


@pytest.mark.slow
def test_an_index_that_a_table_cannot_show_is_not_called_exact(bake):
    """Index 1.003: 1 - g is 1.57e-4, and 2.02e-4 by a table with an angle a degree; nothing walks for minutes."""
    asset = bake(component(n=1.003))
    away, table = 1 - asset.grains["glass"].g[0], 1 - asset.medium.g[0]
    assert away == pytest.approx(1.5744e-4, rel=1e-3) and table == pytest.approx(2.02e-4, rel=0.01)
    assert asset.medium.attributes["achieved_error"] == pytest.approx(table / away - 1, rel=1e-6)
    assert "random_walk" not in asset.medium


@pytest.mark.slow
def test_sigma_t_of_the_random_walk(bake):
    """Opaque white balls send light back and forth between neighbours: it spreads far less than Eq. 4 says."""
    white = "{name: white, shape: {type: sphere}, surface: {type: diffuse, reflectance: 1}}"
    asset = bake(white, tolerance="3%", more="effective_medium: {sigma_t: random_walk}")
    medium = asset.medium
    assert 1.05 < medium.sigma_t / medium.sigma_t_mean_flight < 1.4  # M is 10 to 50 % less
    assert medium.attributes["achieved_error"] <= 0.03
    assert medium.sigma_t_second_moment == pytest.approx(medium.sigma_t_mean_flight, rel=1e-12)  # nothing is set over
    assert np.array_equal(bake(white, tolerance="3%").medium.sigma_t, medium.sigma_t)  # the default
    plain = bake(white, tolerance="3%", more="effective_medium: {sigma_t: mean_flight}")
    own = plain.medium.attributes["achieved_error"]
    assert own == pytest.approx(float(medium.sigma_t[0] / medium.sigma_t_mean_flight[0]) - 1, abs=0.05) and own > 0.05
    assert "effective_medium.sigma_t: random_walk matches it" in plain.provenance.medium.missed
    # nothing of a white ball is statistical: how far sigma_t is off is what the walk found
    assert plain.medium.sigma_t_mean_flight_error == pytest.approx(0, abs=1e-9 * plain.medium.sigma_t_mean_flight[0])
    assert plain.medium.sigma_t_error == pytest.approx(plain.medium.sigma_t_mean_flight_error, abs=0)
    assert plain.medium.sigma_t_bias / plain.medium.sigma_t == pytest.approx([own], rel=1e-9)
    assert medium.sigma_t_bias == 0 and medium.sigma_t_error > 0


@pytest.mark.slow
def test_needles_are_not_walked_among(bake, tmp_path):
    """Where light hits fewer grains than the tolerance a walk takes minutes: sigma_t is that of Eq. 4, that share its error."""
    needle = "{name: needle, shape: {type: ellipsoid, axes: [1, 0.02, 0.02]}, surface: {type: dielectric, material: {n: 1.5}}}"
    more = "scatterometer: {triangles: 1300, tolerance: 10%}"
    asset = bake(needle, more=more)
    medium = asset.medium
    hit = float(asset.grains["needle"].hit_probability)
    assert hit == pytest.approx(0.0157, rel=0.05) and medium.attributes["achieved_error"] >= hit
    assert "random_walk" not in medium and np.array_equal(medium.sigma_t, medium.sigma_t_mean_flight)
    assert "there was no random walk" in asset.provenance.medium.notes
    given = load(recipe(tmp_path, needle, more=more))
    walk = load(recipe(tmp_path, needle, more=more + "\neffective_medium: {sigma_t: random_walk}"))
    assert effective.cost(given).seconds == 0 < 1 < effective.cost(walk).seconds
    thick = load(recipe(tmp_path, needle.replace("0.02, 0.02", "0.8, 0.65"), more=more))
    assert grains.STAGE.cost(given).seconds > 5 * grains.STAGE.cost(thick).seconds


def test_a_needle_of_another_kind_is_refused_before_it_is_measured(tmp_path):
    """Proportions of an ellipsoid or a box say so in the recipe; of other shapes the mesh has to be made."""
    thin = component("{{name: {name}, weight: {weight}, shape: {{type: superellipsoid, axes: [1, 1e-3, 1e-3], exponents: 4}}, "
                     "surface: {{type: dielectric, material: {{n: {n}}}}}}}", name="thin")
    with pytest.raises(StageError, match="grain thin: superellipsoid: 0.00016 of the rays .* a thicker grain would do"):
        grains_of(recipe(tmp_path, thin))


def test_classes_of_a_law():
    from bakery.physics.packing import radii
    from bakery.physics.packing.law import Law

    radius, share = sizes.classes(Law("lognormal", sigma=1.5))
    r = radii.lognormal(1.5, 4096)
    assert share.sum() == pytest.approx(1, abs=1e-12) and (np.diff(radius) > 0).all()
    assert share @ radius**3 / (share @ radius**2) == pytest.approx((r**3).sum() / (r**2).sum(), rel=1e-12)
    # light that meets a grain and is absorbed a little: <1 - exp(-R)> by cross section, to second order of the classes' widths
    by_class, exact = (np.sum(w * x**2 * np.exp(-x)) / np.sum(w * x**2) for w, x in ((share, radius), (np.ones_like(r), r)))
    assert by_class == pytest.approx(exact, rel=0.01)
    assert sizes.classes(Law("list", of=((0.25, 2.0), (0.75, 4.0))))[0] == pytest.approx([4 / 7, 8 / 7])


def test_rules_find_what_is_wrong(tmp_path):
    group, _ = grains_of(recipe(tmp_path, component(CUBE)))
    assert not list(grains.check(group))

    def broken(name, change):
        part = dict(group["glass"].members)
        part[name] = Dataset(change(part[name].data.copy()), part[name].units, part[name].description)
        return "; ".join(conform.broken(grains.STAGE, Group({**group.members, "glass": Group(part)})))

    assert "hit_probability: holds" in broken("hit_probability", lambda x: x + 1)
    assert "not 4/3" in broken("lambda_delta", lambda x: x + 0.2)
    assert "phase integrates" in broken("phase", lambda x: 1.1 * x)
    assert "outside of the bounding sphere" in broken("vertices", lambda x: 1.005 * x)
    assert "faces: holds" in broken("faces", lambda x: x + 100)
    assert "counterclockwise" in broken("faces", lambda x: x[:, ::-1])
    assert "not closed" in broken("faces", lambda x: x[1:])
    assert "weights add up to 0.5" in broken("weight", lambda x: 0.5 * x)


def test_errors_against_converged_values(tmp_path):
    coarse, _ = grains_of(recipe(tmp_path, component(CUBE), more="scatterometer: {paths: 16384}"))
    fine, _ = grains_of(recipe(tmp_path, component(CUBE), tolerance="2%"))
    errors = grains.measures(coarse, fine)
    assert 0.005 < errors["error"] < 0.2 and errors["error"] == pytest.approx(max(
        0.5 * v if k == "phase" else v for k, v in errors.items() if k != "error"))
    assert grains.measures(fine, fine)["error"] == 0
    assert errors["hit_probability"] < 5 * float(coarse["glass/hit_probability_error"].data[0]) / 0.63
    assert {output.path for output in effective.OUTPUTS} >= {"random_walk/hits", "fraction"}
