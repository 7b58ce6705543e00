"""Moments of densities along rays, against quadrature by mpmath and SciPy and against Mitsuba's grids."""

import math

import mpmath
import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from renderers.fog import density
from renderers.fog.density import Grid, Height, Uniform
from renderers.scene import grids
from tests.exr import library

ENDLESS = np.array([math.inf])


def rays(seed, count, spread):
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(count, 3))
    return rng, rng.normal(size=(count, 3)) * spread, direction / np.linalg.norm(direction, axis=1, keepdims=True)


def test_uniform():
    assert np.allclose(Uniform(2.0).integrals(np.zeros(3), np.eye(3)[:1], [3.0]), [[6, 9, 18]], rtol=1e-15)
    assert np.isinf(Uniform(2.0).integrals(np.zeros(3), np.eye(3)[:1], ENDLESS)).all()
    assert (Uniform(0.0).integrals(np.zeros(3), np.eye(3)[:1], ENDLESS) == 0).all()


def test_height_against_quadrature():
    """Rays up, down, through `base`, and as good as level; 1e-12 is rounding in the recurrences, 1.6e-13 was seen."""
    fog = Height(1.7, 2.0, 6.0, (0.0, 1.0, 0.5))
    up = np.array(fog.up)
    rng, origin, direction = rays(1, 20, 10.0)
    level = slice(0, 8)  # slopes from 1e-18, where the exponential is a constant, to 1e-1
    direction[level] -= (direction[level] @ up)[:, None] * up
    direction[level] += (10.0 ** rng.uniform(-18, -1, 8) * rng.choice([-1, 1], 8))[:, None] * up
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    distance = 10 ** rng.uniform(-3, 2.5, 20)
    found = fog.integrals(origin, direction, distance)
    for o, d, z, row in zip(origin, direction, distance, found):
        start, slope = float(o @ up) - 2.0, float(d @ up)
        parts = sorted({*np.linspace(0, z, 6), *([-start / slope] if slope and 0 < -start / slope < z else [])})
        for n in range(3):
            exact = mpmath.quad(lambda t: 1.7 * mpmath.exp(-max(start + slope * t, 0) / 6) * (z - t) ** n, parts)
            assert row[n] == pytest.approx(float(exact), rel=1e-12)


@pytest.mark.parametrize("x", [0.0, 1e-300, 1e-9, 0.5, 1 - 1e-9, 1.0, 1 + 1e-9, 3.0, 50.0, 1e4])
def test_the_exponential_on_both_sides_of_the_seam(x):
    with mpmath.workdps(40):
        for n in range(3):
            falling = mpmath.quad(lambda u: mpmath.exp(-x * u) * (1 - u) ** n, [0, min(1, 40 / max(x, 1)), 1])
            growing = mpmath.quad(lambda u: mpmath.exp(-x * u) * u**n, [0, min(1, 40 / max(x, 1)), 1])
            assert density._falling(np.array([x]), np.array([1.0]))[0, n] == pytest.approx(float(falling), rel=2e-14)
            if x > 0:
                assert density._growing(np.array([x]), np.array([1.0]))[0, n] == pytest.approx(float(growing), rel=2e-14)


def test_height_without_end():
    fog = Height(1.0, -5.0, 6.0)
    down, level, up = fog.integrals(np.zeros(3), np.array([[0, 0, -1.0], [0, 1, 0], [0, 0, 1]]), np.full(3, math.inf))
    assert np.isinf(down).all() and np.isinf(level).all()
    assert up[0] == pytest.approx(6 * math.exp(-5 / 6), rel=1e-14) and np.isinf(up[1:]).all()
    # a kilometre above fog of 1 m there is nothing, and nothing overflows on the way down
    high = Height(1.0, 0.0, 1.0).integrals(np.array([0, 0, 1e3]), np.array([[0, 0, -1.0]]), np.array([1e3]))[0]
    assert high == pytest.approx([1, 1, 2], rel=1e-12)


def twin(grid, origin, direction, distance):
    """S_n by SciPy's interpolation and eight Gauss points between all planes on which the interpolant has a kink."""
    lo, hi = np.array(grid.lo), np.array(grid.hi)
    axes, values = [], np.pad(np.asarray(grid.values, float), 1, mode="edge")
    for n, a, b in zip(grid.values.shape, lo, hi):
        axes.append(np.concatenate([[a], a + (np.arange(n) + 0.5) * (b - a) / n, [b]]))
    look = RegularGridInterpolator(axes, values, bounds_error=False, fill_value=0.0)
    kinks = [0.0, distance]
    for axis in range(3):
        if direction[axis]:
            kinks += list((axes[axis] - origin[axis]) / direction[axis])
    kinks = np.unique(np.clip(kinks, 0, distance))
    node, weight = np.polynomial.legendre.leggauss(8)
    width = np.diff(kinks)[:, None] / 2
    t, w = ((kinks[:-1] + kinks[1:])[:, None] / 2 + width * node).ravel(), (width * weight).ravel()
    rho = grid.scale * look(origin + t[:, None] * direction)
    return [float(np.sum(w * rho * (distance - t) ** n)) for n in range(3)]


@pytest.mark.parametrize("shape", [(5, 4, 6), (1, 3, 1)])
def test_grid_against_quadrature(shape):
    rng, origin, direction = rays(2, 60, 2.0)
    grid = Grid(rng.random(shape).astype(np.float32), (-1.0, 0.0, 2.0), (1.0, 3.0, 4.0), 2.5)
    origin[20:] = rng.uniform(grid.lo, grid.hi, (40, 3))
    direction[::6] = np.eye(3)[rng.integers(0, 3, 10)] * rng.choice([-1, 1], (10, 1))  # along the axes, in planes of nodes too
    origin[30] = [-1, 1.5, 3]
    distance = rng.uniform(0, 6, 60)
    found = grid.integrals(origin, direction, distance)
    exact = np.array([twin(grid, *ray) for ray in zip(origin, direction, distance)])
    assert (exact[:, 0] > 0).sum() > 35
    assert np.allclose(found, exact, rtol=1e-12, atol=1e-13)


def test_grid_without_end_and_at_points():
    rng, origin, direction = rays(3, 40, 1.0)
    grid = Grid(rng.random((4, 4, 4), np.float32), (-1, -1, -1), (1, 1, 1))  # as other tests have it, whose kernels these are
    long = grid.integrals(origin, direction, np.full(40, 20.0))
    endless = grid.integrals(origin, direction, np.full(40, math.inf))
    met = long[:, 0] > 0
    assert 20 < met.sum() < 40 and grid.reach([3, 0, 0]) == pytest.approx(math.hypot(4, 1, 1))
    assert np.allclose(endless[:, 0], long[:, 0], rtol=1e-13)
    assert np.isinf(endless[met, 1:]).all() and (endless[~met] == 0).all()
    assert grid.at([[0, 0, 2], [1.001, 0, 0]]).tolist() == [0, 0]
    assert grid.at([-0.75, -0.25, 0.25]) == pytest.approx(grid.values[0, 1, 2], rel=1e-12)


def test_as_mitsuba_reads_it(tmp_path):
    """The same VOL file, trilinear and clamped: the same densities to float32, in the half cells at the faces too."""
    mi = library()
    rng = np.random.default_rng(5)
    values = rng.random((5, 3, 4)).astype(np.float32)
    mi.VolumeGrid(np.ascontiguousarray(values.T)[..., None]).write(str(tmp_path / "a.vol"))
    back, lo, hi = grids.read(tmp_path / "a.vol")
    assert np.array_equal(back, values) and (lo, hi) == ((0, 0, 0), (1, 1, 1))
    volume = mi.load_dict({"type": "gridvolume", "filename": str(tmp_path / "a.vol"), "filter_type": "trilinear",
                           "wrap_mode": "clamp", "raw": True})
    points = rng.random((50, 3))
    ours = Grid(values, (0, 0, 0), (1, 1, 1)).at(points)
    for point, value in zip(points, ours):
        at = mi.Interaction3f()
        at.p = mi.Point3f(*point.tolist())
        assert np.ravel(volume.eval_1(at))[0] == pytest.approx(value, rel=3e-5)
