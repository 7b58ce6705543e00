"""What scenes require of recipes: the union over scenes, the shares of a tolerance, and the rules against what they stand for."""

from types import SimpleNamespace

import numpy as np
import pytest

from bakery.grammar import files
from bakery.physics.multiple import legendre, peaks
from bakery.plan.asked import Asked
from bakery.plan.suffice import Held, lacking, lost
from bakery.run.ensure import asked, told
from bakery.stages.packing.stage import _schedule
from renderers.materials.bodies import requirements as translucent
from renderers.materials.bodies import thin
from renderers.materials.grains import material
from renderers.materials.grains import requirements as granular
from renderers.materials.particles import requirements as discrete
from renderers.scene import budget, requirements
from renderers.scene.requirements import Knob, Need, Required, merged
from tests.conftest import ROOT


def depth(value):
    return Knob("beam.depth", value, str(value), "deep")


def tolerance(value):
    return Knob("tolerance", value, f"{value:g}", "good", larger=False)


def measure(value):
    return Knob("measure", value, value, "all", words=("integrated", "pointwise"))


def scene_of(tolerance=0.1, **stop):
    stop = SimpleNamespace(**({"noise": None, "time": None} | stop))
    return SimpleNamespace(values=SimpleNamespace(tolerance=tolerance, stop=stop, measure="picture"), share=budget.HALF,
                           renderer="")


@pytest.mark.parametrize(("scene", "stated"), [(scene_of(), None), (scene_of(), 0.06), (scene_of(noise=0.03), None),
                                               (scene_of(noise=0.03), 0.05), (scene_of(tolerance=None), None)])
@pytest.mark.parametrize("share", budget.SHARES)
def test_shares_add_up_in_squares(scene, stated, share):
    split = budget.of(scene, share, stated)
    assert split.noise**2 + split.approximations**2 + split.tables**2 == pytest.approx(split.tolerance**2, rel=1e-12)


def test_what_is_out_of_reach_is_shared_out_as_if_it_were_not():
    assert budget.of(scene_of(), approximations=0.2).tables == pytest.approx(0.1 / 2**0.5)  # the method alone is off by more
    assert budget.of(scene_of(noise=0.2)) == (0.1, 0.0, pytest.approx(0.1 / 2**0.5), 0.2, 0.5, "")


@pytest.mark.parametrize(("baking", "expected"), [(1e-3, 1 / 8), (8.0, 1 / 4), (1e6, 1 / 2)])
def test_the_cheapest_split_wins(baking, expected):
    """Tables that take c/error^2 to bake and noise that takes as much to render: against all other shares, by hand."""
    def seconds(split):
        return baking * 1e-2 / split.tables**2

    scene, pixels, pace = scene_of(), 10_000, 5e-5
    found = budget.cheapest(scene, pixels, pace, seconds)
    splits = [budget.of(scene, share) for share in budget.SHARES]
    times = {one.share: seconds(one) + pixels * pace / one.noise**2 for one in splits}
    assert found.share == min(times, key=times.get) == expected and found.why
    # tables of less than half of the rest are out of reach, or any
    assert budget.cheapest(scene, pixels, pace, lambda one: seconds(one) if one.share > 0.2 else np.inf).share >= 1 / 4
    assert budget.cheapest(scene, pixels, pace, lambda one: np.inf).share == budget.HALF
    # where time ends the picture anyway, finer tables are in vain
    assert budget.cheapest(scene_of(time=1.0), pixels, pace, seconds).share == budget.HALF


def test_factors_have_two_figures_and_no_powers():
    assert [budget.as_much(one) for one in (4.321, 99.7, 2e4)] == [f"{one} times as much" for one in ("4.3", "100", "20000")]
    assert [budget.percent(one) for one in (0.0217, 0.997, 12.0)] == ["2.2 %", "100 %", "1200 %"]


def test_the_union_asks_for_most():
    first = [Need("optics", True, "a", (tolerance(0.1), measure("integrated"))), Need("beam", True, "b", (depth(5.0),))]
    second = [Need("optics", True, "c", (tolerance(0.02), measure("pointwise"))), Need("beam", True, "d", (depth(3.0),), "far")]
    optics, beam = merged([first, second], {})
    assert [knob.value for knob in optics.knobs] == [0.02, "pointwise"] and optics.why == "a; c"
    assert beam.knobs == (depth(5.0),) and beam.lacking == "far"


@pytest.mark.parametrize(("method", "seconds", "knobs"), [
    ("auto", 4.0, ("mie",)), ("auto", 40.0, ()), ("goa", 4.0, ()), ("mie", 4.0, ())])
def test_few_spheres_go_by_series_unmeasured(method, seconds, knobs):
    """Classes of particles whose series take about as long as measuring rays; what the recipe says itself stays."""
    required = Required((Need("optics", True, ""), Need("medium", True, ""), Need("discrete", True, "")))
    recipe = SimpleNamespace(phase=SimpleNamespace(method=method))
    asked = []
    optics = requirements._by_series(required, recipe, lambda one: asked.append(one.settings) or seconds).needs[0]
    assert tuple(knob.value for knob in optics.knobs) == knobs
    # what series take is asked with them: otherwise rays would be measured for that
    assert all(settings == {"phase.method": "mie"} for settings in asked)
    # an asset by rays is as good
    held = {"optics": Held({"phase.method": "auto"}, "other", 0.0)}
    step = SimpleNamespace(stage=SimpleNamespace(name="optics", tolerance=lambda recipe: 0.1), input_hash="this",
                           parts={"phase.method": "mie"})
    for knob in optics.knobs:
        assert not lacking(held, [step], {"optics": {"phase.method": "auto"}}, [knob], recipe)
        assert not lost(held, [step], {"optics": {"phase.method": "auto"}}, [knob])


def test_what_is_out_of_reach_is_told_before_the_bake():
    needs = (Need("grains", True, "", (), "the least is asked for"), Need("medium", False, "", (), "never read"),
             Need("packing", True, ""))
    wanted = Asked(stages=("grains", "packing"), needs=needs, remarks=("noise leaves no room",))
    assert told("sand.yaml", wanted) == ["sand.yaml: grains: out of reach: the least is asked for", "noise leaves no room"]


def test_a_stage_that_one_scene_needs_is_needed():
    (beam,) = merged([[Need("beam", False, "dark")], [Need("beam", True, "fog", (depth(5.0),))]], {"beam.depth": 32.0})
    assert beam.needed and beam.why == "fog" and beam.knobs == (depth(5.0),)
    (beam,) = merged([[Need("beam", False, "dark")], [Need("beam", False, "thin")]], {})
    assert not beam.needed and beam.why == "dark; thin"


@pytest.mark.parametrize(("own", "kept"), [(32.0, ()), (2.0, (depth(5.0),)), ("auto", ())])
def test_the_recipes_value_holds_for_scenes_that_leave_it(own, kept):
    """The other scene needs what the recipe says, so a knob only counts where it asks for more."""
    (beam,) = merged([[Need("beam", True, "a", (depth(5.0),))], [Need("beam", True, "b")]], {"beam.depth": own})
    assert beam.knobs == kept


def test_tiles_are_the_same_up_to_the_tolerance_that_grains_may_get():
    assert _schedule(granular.SAME_TILE, None, None) == _schedule(1e-3, None, None) != _schedule(0.03, None, None)


def test_grains_are_as_large_as_at_the_nearest_point_of_a_face():
    """Not of a vertex: a camera above the middle of a large floor, and one beside it."""
    floor = np.array([[[-9.0, -9, 0], [9, -9, 0], [9, 9, 0]], [[-9.0, -9, 0], [9, 9, 0], [-9, 9, 0]]])
    assert material.distance(np.array([1.0, 2, 0.5]), floor) == pytest.approx(0.5)
    assert material.distance(np.array([13.0, 2, 3]), floor) == pytest.approx(5.0)


def test_the_nearest_point_of_triangles_is_trimeshs():
    """Of one triangle each, some of them a line or a point; points above, beside and in the plane."""
    from trimesh.triangles import closest_point

    rng = np.random.default_rng(2)
    triangles, points = rng.normal(size=(300, 3, 3)), 2 * rng.normal(size=(300, 3))
    triangles[:20, 2] = triangles[:20, 1]
    triangles[:5] = triangles[:5, :1]
    points[20:60] = np.einsum("nk,nki->ni", rng.dirichlet(np.ones(3), 40), triangles[20:60])
    expected = np.linalg.norm(closest_point(triangles, points) - points, axis=1)
    assert [material.distance(*each) for each in zip(points, triangles[:, None])] == pytest.approx(expected, abs=1e-12)


def test_what_few_wavelengths_change():
    """Nothing where all wavelengths scatter alike; most of the blue light where only violet scatters."""
    wavelength = np.array([0.405, 0.455, 0.505, 0.555, 0.605, 0.655, 0.705, 0.755])
    theta = np.linspace(0, np.pi, 181)
    grey = SimpleNamespace(wavelength=wavelength, sigma_t=np.ones(8), albedo=np.full(8, 0.9), theta=theta,
                           phase=np.full((8, 181), 1 / (4 * np.pi)))
    assert discrete._of_three(SimpleNamespace(medium=grey, camera=SimpleNamespace(pixel=0.0))) < 1e-12
    violet = SimpleNamespace(**{**vars(grey), "sigma_t": np.eye(8)[0]})
    assert discrete._of_three(SimpleNamespace(medium=violet, camera=SimpleNamespace(pixel=0.0))) > 0.5


@pytest.mark.slow
@pytest.mark.parametrize("g", [0.7, 0.9, 0.95])
def test_caps_of_peaks_are_no_wider_than_the_rule_says(g):
    theta = np.concatenate([[0], np.geomspace(1e-4, np.pi, 1500)])
    phase = (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * np.cos(theta)) ** 1.5)
    about = SimpleNamespace(recipe=SimpleNamespace(medium=SimpleNamespace(phase=SimpleNamespace(type="hg", g=np.array([g])))))
    medium = SimpleNamespace(theta=theta, phase=phase[None])
    needed = legendre.order_needed(legendre.moments(theta, phase, 140))
    for orders in translucent._ORDERS:
        if needed is not None and orders >= needed:
            continue
        clip, cap = peaks.clipped(theta, phase, orders), translucent._cap(about, orders)
        assert clip.angle <= cap * 1.0001 and clip.peak <= translucent._peak(medium, cap)[0], orders


def test_the_recipe_is_read_once(monkeypatch):
    """However often a scene asks what a bake with its knobs takes, and for the medium."""
    original, paths = files._read, []
    monkeypatch.setattr(files, "_read", lambda path, *limit: paths.append(str(path)) or original(path, *limit))

    def require(recipe, medium, seconds):
        required = [Required((Need("medium", True, "", (Knob("tolerance", value, f"{value}%", ""),)),)) for value in (5, 10)]
        assert all(seconds(each) > 0 for each in required) and medium().g[0] > 0
        return required[1]

    wanted = asked(ROOT / "recipes" / "wax.yaml", {}, require)
    assert wanted.recipe.tolerance == 0.1 and sum(path.endswith("wax.yaml") for path in paths) == 1


@pytest.mark.parametrize(("tau", "most"), [(0.2, 3.0), (1.0, 1.4), (5.0, 1.4)])
def test_later_events_in_a_ball_against_photons(tau, most):
    """A ball whose mean chord is tau deep, isotropic scattering, diffuse light from outside; 40,000 photons.

    0.95 to 1.4 times what is counted, to 3 times in thin ones: bodies are not taken for thinner than they are.  Five standard
    errors of the count on top, odds of a false alarm below 1e-6 each.
    """
    rng, n, albedo, radius = np.random.default_rng(1), 40_000, 0.9, 0.75 * tau  # of the mean chord 4 r/3
    place = np.tile([0.0, 0.0, -radius], (n, 1))
    direction = _cosine(rng, n)
    weight, later = np.ones(n), 0.0
    for event in range(1, 4):
        along = np.einsum("nk,nk->n", place, direction)
        out = -along + np.sqrt(np.maximum(along**2 + radius**2 - np.einsum("nk,nk->n", place, place), 0))
        way = rng.exponential(size=n)
        weight = np.where(way < out, weight, 0.0)
        if event == 3:
            later = weight.mean()
        weight *= albedo
        place = place + way[:, None] * direction
        direction = rng.normal(size=(n, 3))
        direction /= np.linalg.norm(direction, axis=1)[:, None]
    said = thin.later(np.array(tau), albedo, 1.0)
    noise = 5 * np.sqrt(later / n)
    assert 0.95 * later - noise < said < most * later + noise


def _cosine(rng, n):
    up, turn = np.sqrt(rng.random(n)), 2 * np.pi * rng.random(n)
    across = np.sqrt(1 - up**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), up], axis=1)
