"""The scatterometer's rays through Mitsuba against numba's walk, path by path where chance plays no part, and closed forms.

Statistical tests have fixed seeds and compare within `SIGMAS` standard errors of 32 blocks: a false alarm in 1e-6 a
comparison, 2e-4 for the file, should random numbers be drawn anew.
"""

import numpy as np
import pytest

from bakery.physics.grains import points
from bakery.physics.grains.bvh import Mesh
from bakery.physics.grains.scatterometer import CONTRADICTED_MAX, FIGURES, measure
from bakery.physics.grains.surface import conductor, dielectric, diffuse
from bakery.physics.grains.walk import CONTRADICTED, CUT, LEFT, MISSED, Walker
from bakery.physics.shapes import build as shapes
from tests.grain_examples import EXAMPLES
from tests.odds import sigmas
from tests.oracles import mitsuba_walk
from tests.oracles.mitsuba_walk import MitsubaWalker
from tests.physics.test_scatterometer import CUBE, STONE, box, torus

pytestmark = pytest.mark.skipif(bool(mitsuba_walk.missing()), reason=mitsuba_walk.missing())

SIGMAS = sigmas(32, 1e-6)
KEY = (1, 2)
COPPER = [0.27 + 3.41j, 1.03 + 2.59j, 1.25 + 2.48j, np.inf]  # red, green, blue, and a perfect mirror
RING = torus()


def walkers(mesh, surface, mu=(0.0,), **more):
    """The same grain for numba and for Mitsuba."""
    mu = np.broadcast_to(np.asarray(mu, float), max(len(mu), surface.channels.shape[1])).copy()
    return Walker(mesh, surface, mu, **more), MitsubaWalker(mesh.vertices, mesh.faces, surface, mu, **more)


def uniform(count, seed=3):
    return points.points(*points.scrambled(np.random.default_rng(seed)), 0, count)


def example(name, triangles):
    grain = shapes.build(EXAMPLES[name], triangles)
    return Mesh(grain.vertices, grain.faces)


def close(a, b, which):
    """Rays leave on the same lines, to some roundings of float32 (on the sphere, one that grazes it is farther off)."""
    away = np.linalg.norm(a.leave - b.leave, axis=1) * np.einsum("ij,ij->i", a.leave, a.outgoing)
    assert np.quantile(away[which], 0.99) < 2e-6 and away[which].max() < 1e-4


# path by path


@pytest.mark.parametrize("mesh", [CUBE, STONE, RING])
def test_mirrors_take_the_same_paths(mesh):
    """Nothing is left to chance: every record agrees to the rounding of float32, but for rays at an edge."""
    here, there = (w.trace(uniform(20_000), 0, 0, KEY) for w in walkers(mesh, conductor(COPPER)))
    assert np.array_equal(here.start, there.start) and np.array_equal(here.incoming, there.incoming)
    alike = (here.status == there.status) & (here.events == there.events)
    assert np.mean(~alike) < 2e-4
    assert here.events.max() > 1 or mesh is not RING
    turned = np.linalg.norm(here.outgoing - there.outgoing, axis=1)
    near = alike & (turned < 1e-5)
    assert np.mean(alike & ~near) < 2e-4  # those met another facet
    np.testing.assert_allclose(there.weight[near], here.weight[near], rtol=1e-5)
    close(here, there, near & (here.status <= LEFT))


def test_a_glass_that_is_not_there_changes_nothing():
    _, walker = walkers(STONE, dielectric(1.0), mu=(0.0, 2.0))
    paths = walker.trace(uniform(20_000), 0, 0, KEY)
    hit = paths.status != MISSED
    assert np.all(paths.status[hit] == LEFT) and np.all(paths.events[hit] == 2)
    assert np.array_equal(paths.incoming, paths.outgoing)  # to the last bit: float32 is not seen outside
    along = np.einsum("ij,ij->i", paths.start, paths.incoming)[:, None]
    close(paths, paths._replace(leave=paths.start - 2 * along * paths.incoming), hit)
    np.testing.assert_allclose(paths.weight[hit, 1], np.exp(-2 * paths.inside[hit]), rtol=1e-6)


def test_light_leaves_on_the_sphere_and_absorption_is_beers():
    _, walker = walkers(RING, dielectric(1.5), mu=(0.0, 0.3, 5.0))
    paths = walker.trace(uniform(20_000), 0, 0, KEY)
    out = paths.status <= LEFT
    np.testing.assert_allclose(np.linalg.norm(paths.leave[out], axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(paths.outgoing[out], axis=1), 1.0, atol=1e-12)
    left = paths.status == LEFT
    assert np.all(paths.weight[left, 0] == 1)  # energy, not radiance: no factor of the index squared
    np.testing.assert_allclose(paths.weight[left], np.exp(-np.outer(paths.inside[left], walker.mu)), rtol=1e-12)


def test_diffuse_weights_are_powers_of_the_reflectance():
    _, walker = walkers(RING, diffuse([0.3, 0.8, 1.0]))
    paths = walker.trace(uniform(20_000), 0, 0, KEY)
    left = paths.status == LEFT
    np.testing.assert_allclose(paths.weight[left], np.array([0.3, 0.8, 1.0]) ** paths.events[left, None], rtol=1e-12)


def test_one_colour_serves_all_channels():
    here, there = (w.trace(uniform(5000), 0, 0, KEY) for w in walkers(CUBE, conductor(COPPER[0]), mu=(0.0, 1.0)))
    assert there.weight.shape == (5000, 2)
    np.testing.assert_allclose(there.weight, here.weight, rtol=1e-5)


def test_paths_that_are_cut_keep_their_light():
    here, there = (w.trace(uniform(20_000), 0, 0, KEY) for w in walkers(CUBE, dielectric(1.5), mu=(0.5,), events_max=1))
    assert np.count_nonzero(there.status == CUT) > 1000 and np.all(there.events <= 1)
    both = (here.status == CUT) & (there.status == CUT)
    np.testing.assert_allclose(there.weight[both], here.weight[both], rtol=1e-5)


def test_an_open_mesh_is_noticed():
    mesh = Mesh(CUBE.vertices, CUBE.faces[:-1])
    for walker in walkers(mesh, dielectric(1.5)):
        paths = walker.trace(uniform(4096), 0, 0, KEY)
        assert 0.01 < np.mean(paths.status == CONTRADICTED) < 0.5
        assert np.all(paths.weight[paths.status == CONTRADICTED] == 0)


# the same figures


GRAINS = {
    "glass cube": (lambda: CUBE, dielectric(1.5), (0.0, 0.2)),
    "dark cube": (lambda: CUBE, dielectric(1.5), (5.0,)),
    "dark ring": (lambda: RING, diffuse([0.01, 0.03]), (0.0,)),
    "rough rock": (lambda: example("sand", 2000), dielectric(1.5, 0.2), (0.0,)),
    "rough bubble": (lambda: STONE, dielectric(0.75, 0.1), (0.4,)),
    "diffuse aggregate": (lambda: example("snow", 2000), diffuse([0.2, 0.9, 1.0]), (0.0,)),
    "rough copper box": (lambda: box(1, 0.8, 0.6), conductor(COPPER, 0.3), (0.0,)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", GRAINS)
def test_figures_are_numbas(name):
    mesh, surface, mu = GRAINS[name][0](), *GRAINS[name][1:]
    # other entries: with the same ones the errors would count what both have in common twice
    here = measure(mesh, surface, mu, seed=1, tolerance=0.006)
    there = measure(mesh, surface, mu, seed=2, tolerance=0.006, tracer=walkers(mesh, surface, mu)[1])
    for figure in (*FIGURES, "chord", "lambda_o", "inner_path", "forward_delta", "phase"):
        a, b = np.asarray(getattr(here, figure)), np.asarray(getattr(there, figure))
        away = np.abs(a - b) / np.maximum(np.hypot(here.errors[figure], there.errors[figure]), 1e-6)
        assert np.all(away < SIGMAS), f"{figure}: {a} and {b}, {away.max()} standard errors"
    assert there.contradicted < CONTRADICTED_MAX and np.all(there.lost == 0)


@pytest.mark.slow
def test_closed_forms_of_the_glass_cube():
    """2 / pi by Cauchy's formula, mean chord 4/3 of the sphere, and the inner path of index^2 4V/S without trapped modes."""
    found = measure(CUBE, dielectric(1.5), seed=3, tolerance=0.003, tracer=walkers(CUBE, dielectric(1.5))[1])
    assert abs(found.hit_probability - 2 / np.pi) < SIGMAS * found.hit_probability_error
    chords = (1 - found.hit_probability) * found.lambda_delta + found.hit_probability * found.chord
    assert abs(chords - 4 / 3) < 1e-3
    exact = 1.5**2 * 0.769800 * 3 * (1 - np.sqrt(1 - 1 / 1.5**2))
    assert abs(exact - 1.323169) < 1e-5
    assert abs(found.inner_path[0] - exact) < SIGMAS * found.inner_path_error[0]
    assert found.albedo[0] == 1 and abs(found.lambda_s[0] - found.lambda_o[0]) < SIGMAS * np.hypot(
        found.lambda_s_error[0], found.lambda_o_error[0])


def test_unchanged_directions_stand_apart():
    """Parallel faces give the direction back: what float32 blurs lies below `FORWARD`, and nothing else does."""
    _, walker = walkers(CUBE, dielectric(1.5))
    paths = walker.trace(uniform(1 << 16), 0, 0, KEY)
    turned = np.linalg.norm(paths.outgoing - paths.incoming, axis=1)[paths.status == LEFT]
    assert 0.37 < np.mean(turned == 0) < 0.4
    assert np.mean((turned > 0) & (turned < 100 * mitsuba_walk.FORWARD)) < 2e-4
