"""Diffuse light in a mesh: distances, decays in closed form, and pictures against those of the medium without diffusion.

Comparisons with chance go wrong once in 1e7 seeds; seeds are fixed.
"""

import numpy as np
import pytest

from bakery import kernels
from bakery.physics.granular.diffusion import decay
from bakery.physics.granular.distance import distance_to_triangles
from bakery.system.compiled import njit
from renderers.materials.grains import medium
from renderers.mitsuba.world import World
from tests.odds import SIGMAS, sigmas
from tests.physics.particles import THETA, Sky, camera, henyey_greenstein
from tests.physics.test_aggregate import CUBE, bumpy, tile, winding
from tests.physics.test_granular_medium import continuous
from tests.physics.test_granular_render import COLOURS, SCENE, passes

BALL = bumpy(10.0, (0.3, 0.2, 0.1))


def diffusing(how):
    """The same medium, in which light diffuses."""
    return medium.Continuous(how.medium, how.occupied, COLOURS, diffuse=True)


@njit
def distances(aggregate, diffuse, points, limit, enough, found):
    """Distances (n, 2) to the mesh, up to a limit, and what is said to be clear."""
    aggregate, diffuse = kernels.lent(aggregate), kernels.lent(diffuse)
    room, p = kernels.aggregate_scratch(), np.empty(3)
    for n in range(len(points)):
        for k in range(3):
            p[k] = points[n, k]
        found[n, 0] = distance_to_triangles(aggregate.tree, aggregate.middle, aggregate.scale, p, limit, room[0])
        found[n, 1] = kernels.clear_in_mesh(aggregate, diffuse, p, enough, room)


def test_the_nearest_triangle_is_that_of_trimesh():
    """Inside and outside, at corners and edges; no sphere that is clear reaches the mesh, or other things."""
    import trimesh

    how, random = diffusing(continuous(1.0, 1.0, mesh=BALL)), np.random.default_rng(1)
    vertices, faces = BALL
    points = np.concatenate([random.uniform(vertices.min(axis=0), vertices.max(axis=0), (300, 3)), vertices[::9],
                             1.01 * vertices[::7], vertices[faces].mean(axis=1)[::11]])
    found = np.empty((len(points), 2))
    distances(how.medium.aggregate, how.diffuse, points, 4.0, 0.0, found)
    _, expected, _ = trimesh.proximity.closest_point_naive(trimesh.Trimesh(vertices, faces, process=False), points)
    assert np.allclose(found[:, 0], np.minimum(expected, 4.0), rtol=0, atol=1e-7) and (expected > 4).sum() > 20
    inside = winding(points, vertices, faces) & (expected > 1e-6)
    assert np.all(found[inside, 1] <= expected[inside]) and np.all(found[inside, 1] > 0.6 * expected[inside])
    less = np.empty((len(points), 2))
    distances(how.medium.aggregate, how.diffuse, points, 4.0, 3.0, less)
    assert np.array_equal(less[found[:, 1] >= 3], found[found[:, 1] >= 3]) and np.all(less[found[:, 1] < 3, 1] < 3)


def test_spheres_do_not_reach_other_things():
    """A voxel that holds something is never nearer than what is said to be clear."""
    aggregate = kernels.aggregate(*tile(0.5, 40), *bumpy(40.0))
    occupied = np.zeros(aggregate.voxels.shape, np.uint8)
    occupied[tuple(n // 2 for n in occupied.shape)] = 1
    found = kernels.diffuse_in_mesh(aggregate, np.ones(1), np.ones(1), *_isotropic(), occupied)
    random = np.random.default_rng(2)
    middle = aggregate.low + (np.array(occupied.shape) // 2 + 0.5) * aggregate.edge
    points = middle + random.uniform(-15, 15, (500, 3))
    clear = np.empty((500, 2))
    distances(aggregate, found, points, 1.0, 0.0, clear)
    away = np.linalg.norm(np.maximum(np.abs(points - middle) - aggregate.edge / 2, 0), axis=1)
    assert np.all(clear[:, 1] <= away) and clear[:, 1].max() > 5


def _isotropic():
    v, _, phase, _ = kernels.phase_layout(THETA, henyey_greenstein(0.0))
    return v, phase[None]


@pytest.mark.parametrize("k", [1e-4, 0.1, 0.52542951, 0.9])
def test_isotropic_light_decays_as_it_should(k):
    """albedo = k / artanh k (Case & Zweifel 1967); 0.52543 is that of 0.9."""
    assert decay(k / np.arctanh(k), np.eye(1, 64)[0]) == pytest.approx(k, rel=1e-6)


@pytest.mark.parametrize("albedo, g", [(0.9, 0.65), (0.99, 0.8), (0.5, -0.3)])
def test_the_decay_is_that_of_the_transport_equation(albedo, g):
    """L (1 - k mu) = albedo * integral of p L has a solution: the operator, in Gauss's directions, has the eigenvalue 1."""
    mu, weight = np.polynomial.legendre.leggauss(64)
    turn = (np.arange(200) + 0.5) * np.pi / 200
    cosine = mu[:, None, None] * mu[:, None] + np.sqrt((1 - mu**2)[:, None, None] * (1 - mu**2)[:, None]) * np.cos(turn)
    ring = ((1 - g * g) / 2 / (1 + g * g - 2 * g * cosine) ** 1.5).mean(axis=2)
    k = decay(albedo, g ** np.arange(64))
    assert np.linalg.eigvals(albedo * ring * weight / (1 - k * mu)[:, None]).real.max() == pytest.approx(1, abs=1e-6)
    assert decay(1.0, g ** np.arange(64)) == 0
    assert decay(1 - 1e-9, g ** np.arange(64)) == pytest.approx(np.sqrt(3e-9 * (1 - g)), rel=1e-6)


@pytest.mark.parametrize("x", [0.0, 1e-9, 0.999e-3, 1.001e-3, 1.0, 30.0, 1e4])
def test_what_is_left_at_the_middle_of_a_sphere(x):
    """A wave exp(x z) is a solution; its mean over the unit sphere is sinh(x)/x times that at the middle."""
    nodes, weight = np.polynomial.legendre.leggauss(200)
    mean = np.sum(weight * np.exp(x * (nodes - 1))) / 2 if x < 100 else 1 / (2 * x)  # over e^x
    assert kernels.diffuse_share(x) * mean * np.exp(min(x, 700)) == pytest.approx(1 if x < 700 else 0, rel=1e-12)


def compared(how, sky, view, size, count):
    """Ratio of mean radiances with diffusion to those without, by wavelength, and its standard error."""
    found = [passes(sky, one, view, size, range(count)).mean(axis=(1, 2)) for one in (diffusing(how), how)]
    (a, da), (b, db) = ((one.mean(axis=0), one.std(axis=0, ddof=1) / np.sqrt(count)) for one in found)
    return a / b, a / b * np.hypot(da / a, db / b)


VIEW = camera((24, 24), (0.0, -45.0, 5.0), (0.0, 0.0, 0.0), 26)


@pytest.mark.slow
def test_nothing_is_lost_by_diffusion():
    """Lossless in light from everywhere: 1, at all wavelengths."""
    how = diffusing(continuous([1.0, 1.5, 3.0], 1.0, [0.0, 0.3, 0.65], mesh=BALL))
    found = passes(Sky(above=1, below=1), how, VIEW, (24, 24), range(60)).mean(axis=(1, 2))
    error = found.std(axis=0, ddof=1) / np.sqrt(60)
    assert error.max() < 8e-3 and np.all(np.abs(found.mean(axis=0) - 1) < SIGMAS * error)


@pytest.mark.slow
@pytest.mark.parametrize("albedo, g", [([0.97, 0.9, 0.7], 0.65), ([1.0, 0.999, 0.99], 0.65), ([1.0, 0.97, 0.9], 0.0)],
                         ids=str)
def test_diffusion_is_that_of_the_medium(albedo, g):
    """Lit from above: off by less than 1.5 % and noise; a decay by exp(-x) would be seen."""
    how = continuous(1 / (1 - g), albedo, g, mesh=BALL)
    ratio, error = compared(how, Sky(above=1, below=0.2), VIEW, (24, 24), 80)
    assert error.max() < 0.008 and np.all(np.abs(ratio - 1) < 0.015 + SIGMAS * error)


@pytest.mark.slow
def test_diffusion_seen_from_inside():
    """All light comes by spheres, 41, 13 and 1.4 % of it gets there: an albedo too many, or none ahead, would be seen."""
    how = continuous(1 / 0.35, [0.99, 0.97, 0.9], 0.65, mesh=BALL)
    ratio, error = compared(how, Sky(above=1, below=1), camera((48, 48), (0.0, -5.0, 0.0), (0.0, 0.0, 0.0), 60), (48, 48), 40)
    assert error.max() < 0.02 and np.all(np.abs(ratio - 1) < np.array([0.01, 0.03, 0.08]) + SIGMAS * error)


def test_a_thin_body_does_not_diffuse():
    """Nowhere deep enough: the same paths as without."""
    how = continuous(1.0, 0.9, mesh=((CUBE[0] - 0.5) * [20.0, 20.0, 2.9], CUBE[1]))
    view, sky = camera((24, 24), (0.0, -45.0, 9.0), (0.0, 0.0, 0.0), 26), Sky(above=1)
    assert np.array_equal(*(passes(sky, one, view, (24, 24), [0]) for one in (how, diffusing(how))))


@pytest.mark.slow
@pytest.mark.parametrize("sigma_t, albedo", [([1.0, 3.0, 9.0], [0.0, 0.5, 1.0]), (1e-9, 1.0), (0.0, 0.5), (5.0, 0.0),
                                             ([0.0, 5.0, 5.0], [1.0, 1.0, 1 - 1e-15]), (1e4, 0.99)], ids=str)
def test_extremes(sigma_t, albedo):
    """Wavelengths that differ, empty and black media: finite, and not more than the sky sends."""
    how = diffusing(continuous(sigma_t, albedo, 0.3, mesh=BALL))
    found = passes(Sky(above=1, below=1), how, VIEW, (24, 24), range(3))
    assert np.isfinite(found).all() and np.all(found >= 0) and np.all(found.mean(axis=(0, 1, 2)) < 1.1)


@pytest.mark.slow
def test_surfaces_in_a_body_that_diffuses(tmp_path):
    """A floor through it, a lamp, a sky: block by block as without diffusion, to 2 % and noise."""
    (tmp_path / "scene.xml").write_text(SCENE.replace("MORE", ""))
    world = World(tmp_path / "scene.xml", size=(36, 48))
    how = continuous(6.0, [0.999, 0.99, 0.9], 0.4, world, bumpy(4.0))
    ours = diffusing(how)
    assert how.occupied.any() and ours.diffuse.free.size
    found = [passes(world, one, world.camera, (36, 48), range(12)).reshape(12, 4, 9, 4, 12, 3).mean(axis=(2, 4))
             for one in (how, ours)]
    (a, da), (b, db) = ((one.mean(axis=0), one.std(axis=0, ddof=1) / np.sqrt(12)) for one in found)
    assert np.all(np.abs(a - b) < 0.02 * a + sigmas(12) * np.hypot(da, db))
    assert np.median(np.hypot(da, db) / a) < 0.03
