"""Separate particles: places against SciPy's tests and exact laws, classes against exact moments, grains against Campbell.

Each comparison with chance goes wrong once in 1e7 seeds (`ODDS`); seeds are fixed.  Seeded defects show that they can fail.
"""

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy import integrate, ndimage, special, stats
from scipy.spatial import ConvexHull, cKDTree

from bakery.physics.averages import Aim, Component, averages
from bakery.physics.averages.spheres import Rays
from bakery.physics.discrete import classes, graininess, realise, statistics
from bakery.physics.discrete.realise import Region
from bakery.physics.medium.phase import phase_at
from bakery.physics.shapes.build import build
from bakery.physics.shapes.radial import icosphere
from bakery.physics.sizes import Gamma, Lognormal, Population, Single, Table
from bakery.physics.sizes.distributions import Part
from bakery.stages.measures import integrated_difference
from tests.odds import ODDS, SIGMAS

BOX = Region((0.3, 0.2, 0.1))


def place(region, number, seed=1, **more):
    return realise.realised(region, np.atleast_1d(number), seed, **more)


@pytest.fixture(scope="module")
def many():
    return place(BOX, 300_000)


# ---- places


def test_coordinates_are_uniform(many):
    assert many.dtype == np.float32 and (many >= 0).all() and (many < BOX.edge).all()
    for axis, length in enumerate(BOX.edge):
        assert stats.kstest(many[:, axis].astype(float), "uniform", (0, length)).pvalue > ODDS


def test_neighbours_are_as_far_as_of_independent_places(many):
    """Nearest neighbours in a periodic box: 1 - exp(-4/3 pi n r^3)."""
    random = np.random.default_rng(2)
    own = many[random.permutation(len(many))[:43_000]].astype(float)  # every seventh would be one of each cell: too even
    some = random.permutation(len(own))[:500]  # few enough to share hardly any neighbours
    nearest = cKDTree(own, boxsize=BOX.edge).query(own[some], k=2)[0][:, 1]
    n = len(own) / math.prod(BOX.edge)
    assert stats.kstest(nearest, lambda r: -np.expm1(-4 / 3 * np.pi * n * r**3)).pvalue > ODDS
    jittered = (np.stack(np.meshgrid(*[np.arange(12)] * 3), -1).reshape(-1, 3) + 0.5) / 12 + 0.02 * own[:1728]
    far = cKDTree(jittered).query(jittered[:500], k=2)[0][:, 1]
    assert stats.kstest(far, lambda r: -np.expm1(-4 / 3 * np.pi * 1728 * r**3)).pvalue < ODDS, "a lattice passes for chance"


def test_counts_in_cells_are_those_of_chance(many):
    observed, share = statistics.in_cells(BOX, many)
    assert observed.sum() == len(many) and len(observed) > 1000
    square, p = stats.chisquare(observed, len(many) * share)
    assert p > ODDS and stats.chi2.cdf(square, len(observed) - 1) > ODDS
    figure = statistics.dispersion(observed, share)
    assert figure.value == pytest.approx(square / (len(observed) - 1), rel=1e-12)
    assert abs(figure.value - 1) < SIGMAS * figure.error


def test_clumps_are_seen():
    clumped = np.random.default_rng(4).permutation(place(BOX, 20_000))
    clumped[::2] = clumped[1::2]  # pairs at one place: twice the variance
    figure = statistics.dispersion(*statistics.in_cells(BOX, clumped))
    assert figure.value > 1.8 and figure.value - 1 > 20 * figure.error


def test_the_error_of_the_dispersion_is_that_of_chance():
    """Against 4000 draws of NumPy's multinomial: the variance of a chi-square is known to 1/sqrt(2000) there."""
    share = np.array([0.02, 0.03, 0.05, 0.1, 0.3, 0.5])
    found = [statistics.dispersion(row, share) for row in np.random.default_rng(5).multinomial(300, share, 4000)]
    values = np.array([one.value for one in found])
    assert abs(values.mean() - 1) < SIGMAS * found[0].error / math.sqrt(4000)
    assert values.std() == pytest.approx(found[0].error, rel=SIGMAS / math.sqrt(1000))  # twice that of normal numbers


def test_numbers_are_poisson():
    drawn = [int(realise.numbers(seed, [1.0], 12.0).sum()) for seed in range(3000)]
    edges = np.arange(5, 21)
    observed = np.bincount(np.clip(drawn, 4, 21), minlength=22)[4:]
    expected = 3000 * np.concatenate([[stats.poisson.cdf(4, 12)], stats.poisson.pmf(edges, 12), [stats.poisson.sf(20, 12)]])
    assert stats.chisquare(observed, expected).pvalue > ODDS
    assert realise.numbers(0, [0.5, 0.5], 3.0, count=7).sum() == 7


def test_classes_are_drawn_by_their_share():
    share = np.array([0.6, 0.3, 0.0999, 1e-4])
    number = realise.numbers(3, share, 0.0, count=200_000)
    assert stats.chisquare(number, 200_000 * share).pvalue > ODDS


def test_workers_do_not_decide(many):
    with ThreadPoolExecutor(3) as pool:
        assert np.array_equal(place(BOX, 300_000, map=lambda function, tasks: list(pool.map(function, *zip(*tasks)))), many)
    ball = body()
    with ThreadPoolExecutor(3) as pool:
        shuffled = place(ball, [3000, 4], map=lambda function, tasks: list(pool.map(function, *zip(*tasks))))
    assert np.array_equal(shuffled, place(ball, [3000, 4]))
    assert not np.array_equal(place(BOX, 10, seed=1), place(BOX, 10, seed=2))


def test_particles_of_a_class_stand_by_cells(many):
    side = (math.prod(BOX.edge) / len(many)) ** (1 / 3)
    cells = np.round(np.array(BOX.edge) / side)
    at = np.floor(many.astype(float) * cells / BOX.edge)
    index = (at[:, 0] * cells[1] + at[:, 1]) * cells[2] + at[:, 2]
    assert np.mean(np.diff(index) < 0) < 1e-4  # rounding to float32 across a wall
    assert np.mean(np.diff(np.random.default_rng(0).permutation(index)) < 0) > 0.4


@pytest.mark.parametrize("number", [[0], [1], [0, 1, 0]])
def test_none_and_one(number):
    for region in (BOX, Region(BOX.edge, np.array([[[0.0, 1.0]]], np.float32)), body()):
        found = place(region, number)
        assert found.shape == (sum(number), 3)
        assert region.at(found.astype(float)).all()


# ---- densities and meshes


def body(radius=0.05):
    vertices, faces = icosphere(300)
    vertices = radius * (vertices - vertices.min(axis=0))
    return Region(tuple(vertices.max(axis=0)), None, vertices, faces)


def test_a_grid_s_law_is_kept():
    density = np.array([0.0, 1.0, 0.2, 0.6], np.float32).reshape(4, 1, 1)
    region = Region((4.0, 1.0, 2.0), density)
    assert region.volume == pytest.approx(2 * integrate.quad(lambda x: np.interp(x, [0.5, 1.5, 2.5, 3.5], density.ravel()), 0, 4,
                                                             points=[0.5, 1.5, 2.5, 3.5])[0], rel=1e-7)
    found = place(region, 20_000)
    fine = np.linspace(0, 4, 4001)
    cumulated = np.concatenate([[0], np.cumsum(np.interp((fine[1:] + fine[:-1]) / 2, [0.5, 1.5, 2.5, 3.5], density.ravel()))])
    assert stats.kstest(found[:, 0].astype(float), lambda x: np.interp(x, fine, cumulated / cumulated[-1])).pvalue > ODDS
    assert stats.kstest(found[:, 0].astype(float), "uniform", (0, 4)).pvalue < ODDS
    assert stats.kstest(found[:, 2].astype(float), "uniform", (0, 2)).pvalue > ODDS
    observed, share = statistics.in_cells(region, found)
    assert share.sum() == pytest.approx(1, abs=1e-12)
    figure = statistics.dispersion(observed, share)
    assert abs(figure.value - 1) < SIGMAS * figure.error


def test_shares_of_cells_are_integrals_of_the_density():
    density = np.random.default_rng(3).random((3, 2, 4)).astype(np.float32)
    region = Region((1.0, 2.0, 0.5), density / density.max())
    observed, share = statistics.in_cells(region, place(region, 200))
    cells = statistics._lattice(region, 200)
    first = np.array(region.edge) / cells  # the cell at the origin, by Gauss-Legendre in pieces small enough for the kinks
    node, weight = np.polynomial.legendre.leggauss(40)
    at = [0.5 * (node + 1) * length for length in first]
    x, y, z = np.meshgrid(*at, indexing="ij")
    values = region.at(np.stack([x.ravel(), y.ravel(), z.ravel()], 1)).reshape(40, 40, 40)
    mean = np.einsum("ijk,i,j,k", values, *[weight / 2] * 3)
    assert share[0] == pytest.approx(mean * math.prod(first) / region.volume, rel=2e-3)


def test_a_mesh_holds_its_particles():
    ball = body()
    hull = ConvexHull(ball.vertices)
    assert ball.volume == pytest.approx(hull.volume, rel=1e-9)
    found = place(ball, 20_000).astype(float)
    assert (found @ hull.equations[:, :3].T + hull.equations[:, 3] < 1e-8).all()
    inner = np.linalg.norm(found - np.array(ball.edge) / 2, axis=1) < 0.03
    share = 4 / 3 * math.pi * 0.03**3 / hull.volume
    assert stats.binomtest(int(inner.sum()), len(found), share).pvalue > ODDS
    figure = statistics.dispersion(*statistics.in_cells(ball, found))
    assert abs(figure.value - 1) < SIGMAS * figure.error
    shifted = found * [1, 1, 0.8] + [0, 0, 0.01]
    worse = statistics.dispersion(*statistics.in_cells(ball, shifted))
    assert worse.value - 1 > 10 * worse.error


@pytest.mark.parametrize("spec", [{"type": "rock", "seed": 3}, {"type": "superellipsoid", "exponents": [0.5, 0.5]}])
def test_a_mesh_s_inside_is_that_of_its_winding(spec):
    """Points anywhere and beside the surface, 1e-5 of the box away: the solid angle of the mesh is 4 pi inside and 0 outside."""
    made, random = build(spec, 200), np.random.default_rng(4)
    vertices = made.vertices - made.vertices.min(axis=0)
    region = Region(tuple(vertices.max(axis=0)), None, vertices, made.faces)
    corners = vertices[made.faces]
    face = random.integers(len(corners), size=300)
    across = np.cross(corners[face, 1] - corners[face, 0], corners[face, 2] - corners[face, 0])
    across *= (1e-5 * random.choice([-1, 1], 300) / np.linalg.norm(across, axis=1))[:, None]
    near = np.einsum("nc,ncd->nd", random.dirichlet((3, 3, 3), 300), corners[face]) + across
    points = np.concatenate([random.random((700, 3)) * region.edge, near])
    points = points[((points > 0) & (points < region.edge)).all(axis=1)]
    a, b, c = np.moveaxis(corners[None] - points[:, None, None], 2, 0)
    la, lb, lc = (np.linalg.norm(v, axis=-1) for v in (a, b, c))
    below = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
    angle = 2 * np.arctan2((a * np.cross(b, c)).sum(-1), below).sum(axis=1)  # Van Oosterom & Strackee 1983
    np.testing.assert_array_equal(region.at(points), np.abs(angle) > 2 * np.pi)


def test_a_grid_is_linear_between_its_middles():
    values = np.random.default_rng(5).random((5, 2, 3)).astype(np.float32)
    region, points = Region((1.0, 2.0, 0.5), values), np.random.default_rng(6).random((2000, 3)) * (1.0, 2.0, 0.5)
    at = (points / region.edge * values.shape - 0.5).T
    np.testing.assert_allclose(region.at(points), ndimage.map_coordinates(values, at, float, order=1, mode="nearest"), atol=1e-14)


def test_a_needle_of_a_grid_is_refused():
    needle = np.zeros((30, 30, 30), np.float32)
    needle[3, 4, 5] = 1
    with pytest.raises(realise.NoRoom, match="fills 3.7e-05 of its box"):
        place(Region((1.0, 1.0, 1.0), needle), 10)


# ---- classes


POPULATIONS = {
    "narrow": Population((Part(Lognormal(5.0, 1.3), 1.0),)),
    "three decades": Population((Part(Lognormal(1.0, 3.0), 1.0, 0.03, 30.0),)),
    "gamma": Population((Part(Gamma(10.0, 0.2), 1.0),)),
    "table": Population((Part(Table((0.5, 1.0, 4.0), (1.0, 3.0, 0.0)), 1.0),)),
    "bimodal": Population((Part(Lognormal(10.0, 1.4), 0.995, 1.0, 250.0), Part(Lognormal(80.0, 1.3), 0.005, 1.0, 250.0))),
    "two sizes": Population((Part(Single(1.0), 0.25), Part(Single(7.3), 0.75))),
    "one size among many": Population((Part(Lognormal(5.0, 1.3), 0.5), Part(Single(6.0), 0.5))),
    "one size": Population((Part(Single(0.1), 1.0),)),
}


@pytest.mark.parametrize("name", POPULATIONS)
def test_classes_keep_number_and_area(name):
    population = POPULATIONS[name]
    made = classes.classes(population)
    assert 1 <= len(made.radius) <= classes.MOST and len(made.edge) == len(made.radius) + 1
    assert (made.radius.astype(np.float32) == made.radius).all()
    assert (np.diff(made.radius) > 0).all() and (made.edge[:-1] <= made.radius).all() and (made.radius <= made.edge[1:]).all()
    assert made.share.sum() == pytest.approx(1, abs=1e-14)
    assert made.share @ made.radius**2 == pytest.approx(population.moment(2), rel=1e-6)
    assert made.share @ [of.moment(4) for of in made.sizes] == pytest.approx(population.moment(4), rel=1e-9)


def test_as_many_classes_as_are_asked_for():
    assert len(classes.classes(POPULATIONS["narrow"], exactly=3).radius) == 3
    assert classes.classes(POPULATIONS["two sizes"]).radius.tolist() == [1.0, float(np.float32(7.3))]
    assert len(classes.classes(POPULATIONS["two sizes"], exactly=1).radius) == 1
    assert classes.classes(POPULATIONS["one size"]).edge.tolist() == [0.1, float(np.float32(0.1))]
    wide = classes.classes(POPULATIONS["three decades"])
    assert len(wide.radius) > 20
    assert wide.edge[2:-1] / wide.edge[1:-2] == pytest.approx(classes.RATIO, rel=0.05)


def test_a_class_scatters_as_its_particles_do():
    """Small spheres scatter as r^6 (Rayleigh): class means against exact moments."""
    population = Population((Part(Lognormal(0.002, 1.3), 1.0),))
    made = classes.classes(population, exactly=3)
    m = np.array([1.5 + 0.1j])
    _, (found,) = classes.optics([Component("dust", m, population)], [made], [0.5], [1.0], 0.01)
    k = 2 * math.pi / 0.5
    polarisability = (m[0] ** 2 - 1) / (m[0] ** 2 + 2)
    for i, of in enumerate(made.sizes):
        assert found.scattering[0, i] == pytest.approx(8 / 3 * math.pi * k**4 * abs(polarisability) ** 2 * of.moment(6), rel=0.01)
        absorbed = found.extinction[0, i] - found.scattering[0, i]
        assert absorbed == pytest.approx(4 * math.pi * k * polarisability.imag * of.moment(3), rel=0.01)
    spread = made.sizes[1].moment(6) / made.sizes[1].moment(3) ** 2 - 1  # of what absorbs, which is nearly all of the extinction
    assert found.spread[0, 1] == pytest.approx(spread, rel=0.02)


@pytest.mark.parametrize(("m", "radius"), [(1.31 + 1e-8j, 40.0), (1.55 + 0.003j, 4.0)])
@pytest.mark.parametrize("tolerance", [0.3, 0.21])
def test_classes_from_few_sizes_and_angles_are_as_good_as_they_say(m, radius, tolerance):
    """Against averages of the same class that begin with as many angles and sizes as others do, at 1 %."""
    of = classes.classes(Population((Part(Lognormal(radius, 1.3), 1.0),)), exactly=3)
    middle = classes.Classes(of.edge[1:3], of.radius[1:2], np.ones(1), of.sizes[1:2])
    component = Component("grains", np.array([m]), middle.sizes[0])
    theta, (coarse,) = classes.optics([component], [middle], [0.55], [1.0], tolerance)
    angles, (fine,) = averages([component], [0.55], [1.0], Aim(0.01, integrated=True))
    every = np.union1d(theta, angles)
    tables = (phase_at(theta, coarse.phase[:, 0].astype(float), every), phase_at(angles, fine.elements[:, 0], every))
    assert integrated_difference(every, *tables).max() <= coarse.error.max() + fine.error.max()
    assert coarse.error.max() <= tolerance
    assert len(theta) < 0.75 * len(classes.optics([component], [middle], [0.55], [1.0], 0.2)[0])
    extinction = np.sum((fine.scattering + fine.absorption) * fine.weight)
    assert coarse.extinction[0, 0] == pytest.approx(extinction, rel=coarse.error.max())


def test_the_forward_peak_of_the_largest_class_is_resolved_and_nothing_else_for_it():
    """Flakes of 20 um to 2 mm: cells were no narrower than ripples of the smallest, and 10,394 angles were put elsewhere."""
    population = Population((Part(Lognormal(320.0, 1.8), 1.0, 20.0, 2000.0),))
    every, component = classes.classes(population, exactly=14), Component("flakes", np.array([1.5 + 1e-5j]), population)
    theta, (found,) = classes.optics([component], [every], [0.45], [1.0], 0.21, rays=Rays("auto"))
    assert len(theta) < 1000 and found.error.max() <= 0.21


# ---- graininess


def test_the_exponential_integral_on_both_sides_of_its_seam():
    x = np.concatenate([[0.0, 1e-12, 1 - 1e-9, 1.0, 1 + 1e-9], np.geomspace(1e-6, 600, 400)])
    np.testing.assert_allclose(graininess._second(x), special.expn(2, x) * np.exp(x), rtol=1e-12)
    assert graininess._second(1e5) == pytest.approx(1e-5, rel=3e-5)


def test_paths_are_the_integrals_that_they_stand_for():
    for sigma in (0.0, 1e-9, 0.7, 30.0):
        for near, far in ((0.5, 2.0), (3.0, 3.001), (1.0, 60.0)):
            seen = integrate.quad(lambda s: math.exp(-sigma * (s - near)), near, far, epsabs=0)[0]
            square = integrate.quad(lambda s: math.exp(-sigma * (s - near)) / s**2, near, far, epsabs=0)[0]
            assert graininess.path(sigma, near, far) == pytest.approx(seen, rel=1e-7)
            assert graininess.inverse_square_path(sigma, near, far) == pytest.approx(square, rel=1e-7)
    assert graininess.inverse_square_path(2.0, 1.0, np.inf) == pytest.approx(math.exp(2) * special.expn(2, 2.0), rel=1e-12)


def test_the_variance_of_a_pixel_is_campbell_s():
    """Pixels drawn by NumPy, of particles of two kinds in a cone: mean and variance, 5000 pixels, relative errors 1.4 and 3 %."""
    random = np.random.default_rng(11)
    share, weight = np.array([0.8, 0.2]), np.array([1.0, 3.0])
    n, angle, near, far = 50.0, 0.3, 1.0, 4.0
    expected = n * angle * (far**3 - near**3) / 3
    pixels = []
    for number in random.poisson(expected, 5000):
        s = (near**3 + random.random(number) * (far**3 - near**3)) ** (1 / 3)
        pixels.append(np.sum(random.choice(weight, number, p=share) / (angle * s**2)))
    mean, square = graininess.mixture_moments(share, weight[None], np.zeros((1, 2)), np.ones((1, 2)))
    error = np.std(pixels) / math.sqrt(5000)
    assert np.mean(pixels) == pytest.approx(n * mean[0] * graininess.path(0.0, near, far), abs=SIGMAS * error)
    predicted = graininess.relative_variance(mean[0], square[0], n, 0.0, near, far, angle)
    assert np.var(pixels) / np.mean(pixels) ** 2 == pytest.approx(predicted, rel=0.13)
    assert predicted > 2 * graininess.relative_variance(mean[0], square[0], n, 0.0, 2 * near, 2 * far, angle) * 1.9
