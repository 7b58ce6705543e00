"""The walk from particle to particle in a lossless cube lit from above: kernels alone, no surfaces.

Shares of light that leave above, below and at the sides; nothing is absorbed.  Comparisons with chance go wrong once in 1e7
seeds.
"""

import math

import numpy as np
import pytest

from bakery import kernels
from bakery.kernels import NO_DISC, stream_key
from renderers.materials.particles import _transport
from renderers.transport import wavefront
from tests.conftest import slow
from tests.odds import SIGMAS, sigmas
from tests.physics import particles
from tests.physics.particles import averaged


def rays(origin, direction, throughput, states, left_out):
    """What loops over particles take of paths."""
    return _transport.Walk(origin, direction, throughput, states, left_out, np.empty(len(origin)))


def leaving(medium, number, discrete, seed=1):
    """Paths straight down into the cube: shares (3, L) of light that leave above, below, at the sides, and all weights (n, L).

    discrete : whether particles stop light, or the continuous medium
    """
    random = np.random.default_rng(seed)
    origin = np.concatenate([random.random((number, 2)), np.full((number, 1), 2.0)], axis=1)
    direction = np.tile([0.0, 0.0, -1.0], (number, 1))
    weight, states = np.ones((number, len(medium.sigma_t))), np.empty(number, np.uint64)
    wavefront.begin_streams(stream_key(seed, "render.walk", 0), 0, states)
    left_out, inside = np.full((number, 3), np.nan), np.zeros(number, bool)
    ways, weights = [], []
    while len(origin):
        n = len(origin)
        kind, distance, place = np.empty(n, np.int64), np.empty(n), np.empty((n, 3))
        far, depth = np.full(n, np.inf), np.full(n, np.inf if discrete else 0.0)
        paths = rays(origin, direction, weight, states, left_out)
        _transport.collide(medium, paths, far, depth, kind, distance, place, 0, n)
        out = kind == NO_DISC
        ways.append(_face(origin[out], direction[out], inside[out]))
        weights.append(weight[out])
        met = ~out
        kind, origin, direction, weight, states = kind[met], place[met], direction[met], weight[met], states[met]
        nobody = np.zeros(len(kind), bool)
        paths = rays(origin, direction, weight, states, origin)
        _transport.scatter(medium.scatterer, kind, paths, _transport.Guide(direction, nobody), 0, len(kind))
        particle = (kind < len(medium.albedo) - 1)[:, None]
        left_out, inside = np.where(particle, origin, np.nan), np.ones(len(kind), bool)
        assert ((origin >= 0) & (origin <= 1)).all() and len(ways) < 10_000
    ways, weights = np.concatenate(ways), np.concatenate(weights)
    return np.array([weights[ways == way].sum(axis=0) for way in range(3)]) / number, weights


def _face(origin, direction, inside):
    """0 above, 1 below, 2 at the sides: where rays from points in the cube, or from above it, leave it."""
    with np.errstate(divide="ignore"):
        far = np.where(direction == 0, np.inf, ((direction > 0) - origin) / direction)
    axis = far.argmin(axis=1)
    return np.where(~inside, 1, np.where(axis < 2, 2, np.where(direction[:, 2] > 0, 0, 1)))


# above, below, at the sides: the table of physics/discrete-media.md, whose noise is 0.001 and more where particles are few
CASES = {(3, 0.7): (0.072, 0.331, 0.597), (10, 0.0): (0.510, 0.015, 0.475)}


def plain(optical_depth, g, number, random):
    """The continuous cube once more: free flights by their law, Henyey and Greenstein's angles in closed form, NumPy alone."""
    place = np.concatenate([random.random((number, 2)), np.ones((number, 1))], axis=1)
    way, shares = np.tile([0.0, 0.0, -1.0], (number, 1)), np.zeros(3)
    while len(place):
        after = place + random.exponential(1 / optical_depth, len(place))[:, None] * way
        out = ((after < 0) | (after > 1)).any(axis=1)
        shares += np.bincount(_face(place[out], way[out], np.ones(out.sum(), bool)), minlength=3)
        place, way, u = after[~out], way[~out], random.random(int((~out).sum()))
        cosine = 2 * u - 1 if g == 0 else (1 + g * g - ((1 - g * g) / (1 - g + 2 * g * u)) ** 2) / (2 * g)
        across = np.cross(way, random.normal(size=way.shape))
        across /= np.linalg.norm(across, axis=1)[:, None]
        way = cosine[:, None] * way + np.sqrt(1 - cosine**2)[:, None] * across
    return shares / number


@pytest.mark.slow
@pytest.mark.parametrize("depth, g", CASES)
def test_the_continuous_cube(depth, g):
    kinds = particles.of_depth(depth, 1000, phase=particles.henyey_greenstein(g))
    shares, weights = leaving(particles.hashed(kinds), 50_000, discrete=False)
    assert len(weights) == 50_000 and np.abs(weights - 1).max() < 1e-12, "energy"
    other = plain(depth, g, 50_000, np.random.default_rng(4))
    error = np.sqrt(2 * other * (1 - other) / 50_000)
    assert np.all(np.abs(shares[:, 0] - other) < SIGMAS * error)
    assert np.all(np.abs(shares[:, 0] - CASES[depth, g]) < SIGMAS * np.hypot(error / math.sqrt(2), 1e-3))


@pytest.mark.parametrize("number", [slow(3000), 30_000])
@pytest.mark.parametrize("depth, g", CASES)
def test_the_cube_of_particles(depth, g, number):
    """Means of 16 realisations, of 1,500 paths each: their error is 0.004 at most, estimated from their scatter."""
    kinds = particles.of_depth(depth, number, phase=particles.henyey_greenstein(g))
    found = []
    for seed in range(16):
        shares, weights = leaving(particles.hashed(kinds, seed=seed), 1500, discrete=True, seed=seed)
        assert len(weights) == 1500 and np.abs(weights - 1).max() < 1e-12, "energy"
        found.append(shares[:, 0])
    mean, error = averaged(found)
    assert error.max() < 5e-3
    # the noise of the table; and 3,000 particles differ by 0.003 themselves
    allowed = 1e-3 + (0.003 if number == 3000 else 0.0)
    assert np.all(np.abs(mean - CASES[depth, g]) < sigmas(16) * error + allowed)


@pytest.mark.parametrize("discrete", [slow(False), True])
def test_a_path_serves_all_wavelengths(discrete):
    """Discs, albedo and angles differ between three wavelengths; each leaves as it does alone from the same realisations."""
    phase = np.stack([particles.henyey_greenstein(g) for g in (0.8, 0.0, -0.4)])[:, None]
    extinction, albedo = np.array([[3.0], [1.5], [0.5]]) / 2000, np.array([[1.0], [0.8], [0.6]])
    kinds = particles.classes(2000.0, extinction, albedo, phase)
    each = [particles.classes(2000.0, extinction[w:w + 1], albedo[w:w + 1], phase[w:w + 1]) for w in range(3)]
    difference = []
    for seed in range(16):
        together, _ = leaving(particles.hashed(kinds, seed=seed), 1500, discrete, seed)
        alone = [leaving(particles.hashed(one, seed=seed), 1500, discrete, seed + 100)[0] for one in each]
        difference.append(together - np.concatenate(alone, axis=1))
    mean, error = averaged(difference)
    assert error.max() < 0.011
    assert np.all(np.abs(mean) < sigmas(16) * error)


@pytest.mark.parametrize("discrete", [False, True])
def test_light_through_a_density_grid(discrete):
    """What goes straight down through columns of different densities: exp(-tau) of each; 12 realisations."""
    density = np.array([[[0.1, 0.3]], [[1.0, 0.4]]])
    region = kernels.region_grid([0, 0, 0], [1, 1, 1], density)
    kinds = particles.of_depth(2.0, 4000)
    found = []
    for seed in range(12):
        found.append(straight(particles.hashed(kinds, region, seed), discrete, seed))
    # linear between the middles of voxels, constant in the outer halves: along z the mean, along x between the two columns
    x = (np.arange(1000) + 0.5) / 1000
    column = np.interp(x, [0.25, 0.75], density.mean(axis=(1, 2)))
    mean, error = averaged(found)
    assert error < 0.005 and abs(mean - np.exp(-2 * column).mean()) < sigmas(12) * error


def straight(medium, discrete, seed):
    """Share of pencils straight down that nothing stops."""
    n, random = 4000, np.random.default_rng(seed)
    origin = np.concatenate([random.random((n, 2)), np.full((n, 1), 2.0)], axis=1)
    states = np.empty(n, np.uint64)
    wavefront.begin_streams(stream_key(seed, "render.walk", 1), 0, states)
    kind = np.empty(n, np.int64)
    down, depth = np.tile([0.0, 0.0, -1.0], (n, 1)), np.full(n, np.inf if discrete else 0.0)
    paths = rays(origin, down, np.ones((n, 1)), states, np.full((n, 3), np.nan))
    _transport.collide(medium, paths, np.full(n, np.inf), depth, kind, np.empty(n), np.empty((n, 3)), 0, n)
    return np.mean(kind == NO_DISC)
