"""Tables made of photons: against the solver where both reach, their own error bars, and media that the solver refuses."""

import math
from dataclasses import replace

import numpy as np
import pytest

from bakery.physics.medium import analytic
from bakery.physics.medium import phase as phases
from bakery.physics.multiple import along, build, counted, frame, legendre, lookup, solution, tally, uniform
from bakery.physics.multiple.kinds import POINT, SEGMENT
from tests.conftest import slow


def henyey_greenstein(g):
    theta, values, _, _ = analytic.tabulated("hg", 1e-4, 1, g=[g])
    return theta, values[0]


@pytest.fixture(scope="module", params=[slow((0.9, 0.5)), (0.9, 0.0)], ids=["g 0.5", "g 0"])
def both(request):
    """Tables of photons and the solution of the same medium."""
    albedo, g = request.param
    theta, phase = henyey_greenstein(g)
    made = counted.build(albedo, theta, phase, (POINT, SEGMENT), extent=12.0, tolerance=0.05, photons=100_000, seed=3)
    return made, solution.solve(albedo, legendre.moments(theta, phase, 140))


@pytest.mark.slow
@pytest.mark.parametrize("kind", [POINT, SEGMENT])
def test_the_stated_error_covers_the_true_one(both, kind):
    made, solved = both
    found = made.tables[kind]
    rho, z = build.places(kind, found.length, found.extent, np.random.default_rng(77))
    true = np.sqrt(np.mean(build.errors(found, solved.medium, rho, z) ** 2))
    # photons are fixed, and so are the places
    assert true < found.error_with_solver < 5 * true
    assert found.error < found.error_with_solver < 0.1


@pytest.mark.parametrize("kind", [POINT, SEGMENT])
def test_standard_errors_are_those_of_the_noise(both, kind):
    made, solved = both
    exact = build.table(solved, kind, extent=12.0, tolerance=0.01)
    apart = counted.agreement(made.tables[kind], made.offset_error[kind], exact)
    # corners share photons: about 40 of the 1300 are independent, whose mean square is below 2.5 with odds of 1e-6 against
    assert 0.3 < np.mean(apart**2) < 2.5
    # with a defect of 5 % the test fails
    wrong = replace(exact, offset=exact.offset + np.float32(0.05))
    assert np.mean(counted.agreement(made.tables[kind], made.offset_error[kind], wrong) ** 2) > 3


def test_beams_are_summed_as_finely_as_lobes_turn():
    """Along a beam against a rule of many points, for lobes of g = 0.8; pieces that leave the turn out miss 5 % or more."""
    solved = solution.solve(0.95, legendre.moments(*henyey_greenstein(0.8), 140), most=48)
    points = lookup.ready(build.table(solved, POINT, extent=12.0, tolerance=0.05))
    rho, z, length, polar, azimuth = 0.205, 0.13, 2.0, np.linspace(0.05, 3.0, 20), np.array([0.3, 1.5, 2.8])
    found = along.lobes(points, length, np.array([rho]), np.array([z]), polar, azimuth)[0]
    # the same directions from +z and the azimuth of the position
    axis = math.atan2(rho, z)
    ahead, side = np.cos(polar)[:, None], np.sin(polar)[:, None] * np.cos(azimuth)
    theta = np.arccos(ahead * math.cos(axis) + side * math.sin(axis))
    phi = np.arctan2(np.sin(polar)[:, None] * np.sin(azimuth), ahead * math.sin(axis) - side * math.cos(axis))
    first, last = math.asinh(-z / rho), math.asinh((length - z) / rho)
    exact = np.zeros_like(theta)
    for x, weight in zip(*np.polynomial.legendre.leggauss(200), strict=True):
        t = (first + last + (last - first) * x) / 2
        s = z + rho * math.sinh(t)
        exact += weight * (last - first) / 2 * rho * math.cosh(t) * math.exp(-s) * lookup.point(points, rho, z - s, theta, phi)
    # pieces: 0.05 % at worst; the rule of 200 points far less
    assert np.abs(found - exact).max() < 2e-3 * exact.max()
    alone = lookup.segment(points, points._replace(length=2 * length), rho, z, theta, phi, length)  # shorter than a tile
    assert np.abs(alone - exact).max() < 2e-3 * exact.max()
    coarse = along.lobes(points._replace(turn=0.0), length, np.array([rho]), np.array([z]), polar, azimuth)[0]
    assert np.abs(coarse - exact).max() > 0.05 * exact.max()


@pytest.mark.slow
def test_more_photons_are_followed_until_the_tolerance_is_reached(monkeypatch):
    medium = 0.8, *henyey_greenstein(-0.3)
    monkeypatch.setattr(counted, "_FIRST", 1e5)
    rough, fine = (counted.build(*medium, extent=10.0, tolerance=tolerance, photons=60_000) for tolerance in (0.3, 1e-3))
    assert rough.photons < 20_000 and rough.tables[POINT].error_with_solver <= 0.3
    assert 59_000 < fine.photons <= 60_032 and fine.tables[POINT].error_with_solver > 1e-3  # and it says so
    assert fine.tables[POINT].error_with_solver < 0.7 * rough.tables[POINT].error_with_solver


def test_the_same_photons_give_the_same_bytes_and_batches_add_up():
    medium = tally.medium(0.7, *henyey_greenstein(0.4), 8.0)
    one, again = (tally.follow(medium, 640, 5, 1) for _ in range(2))
    assert one.halves.tobytes() == again.halves.tobytes() and one.blocks.tobytes() == again.blocks.tobytes()
    other = tally.follow(medium, 1280, 5, 2)
    both = one + other
    np.testing.assert_allclose(both.halves, (one.halves + 2 * other.halves) / 3, rtol=1e-12)
    # the sums over d and without azimuth are those of the blocks
    np.testing.assert_allclose(both.halves.mean(axis=0)[..., 0].sum(axis=-1), both.blocks.mean(axis=0), rtol=1e-12, atol=1e-14)


@pytest.mark.slow
def test_light_is_kept():
    """albedo^3/(1 - albedo), from the arrivals alone; and without absorption the far light is that of diffusion."""
    albedo = 0.6
    medium = tally.medium(albedo, *henyey_greenstein(0.6), 40.0)
    sums = tally.follow(medium, 64_000, 1, 0)
    r = tally.far(medium, np.arange(tally.BOXES + 3))
    width = math.asinh(40.0 / frame.CORE[POINT]) / tally.BOXES
    shells = np.sqrt(r**2 + frame.CORE[POINT] ** 2) * width * r * np.exp(-medium.k0 * r)
    light = albedo**3 * (sums.blocks.sum(axis=2) * shells).sum(axis=1)
    # boxes are summed by their middles: 0.5 %; five standard errors of 32 blocks: odds 2e-5 twice over, at a fixed seed
    assert light.mean() == pytest.approx(albedo**3 / (1 - albedo), abs=5 * light.std(ddof=1) / math.sqrt(32) + 0.003)
    # phi = 3 (1 - g) / (4 pi r), and the source is albedo = 1 times it
    clear = tally.medium(1.0, *henyey_greenstein(0.3), 12.0)
    sums = tally.follow(clear, 16_000, 1, 0)
    far = tally.integrals(clear, sums.blocks, tally.means(clear, np.array([1.2])))[:, 60, 0]
    exact = 3 * (1 - 0.3) / (4 * math.pi)
    assert far.mean() == pytest.approx(exact, abs=5 * far.std(ddof=1) / math.sqrt(32) + 0.05 * exact)


@pytest.mark.slow
def test_peaks_that_no_table_resolves_are_broadened_and_keep_their_light(monkeypatch):
    monkeypatch.setattr(uniform, "_ORDERS", (2e-3, 12))  # a coarse table is enough here
    monkeypatch.setattr(tally, "_BINS", 24)
    theta, phase = henyey_greenstein(-0.999)
    wide, broad = tally.broadened(theta, phase, 0.1)
    assert phases.phase_integral(wide, broad) == pytest.approx(1, rel=1e-12)
    assert broad.max() == pytest.approx(1 / (math.pi * 0.01), rel=0.01)
    assert phases.mean_cosine(wide, broad) == pytest.approx(-0.999, abs=0.003)
    made = counted.build(0.8, theta, phase, (POINT,), extent=5.0, tolerance=0.3, photons=3200)
    assert made.resolution == tally.RESOLUTION
    values = lookup.point(lookup.ready(made.tables[POINT]), [0.0, 0.5, 3.0], [0.3, -0.5, 1.0], 0.4, 0.2)
    assert np.isfinite(values).all() and (values > 0).all() and made.tables[POINT].error_with_solver > 0.1


def test_nothing_that_scatters():
    made = counted.build(0.0, *henyey_greenstein(0.5), (POINT, SEGMENT), extent=10.0)
    assert made.tables[POINT].empty and made.tables[SEGMENT].empty and made.photons == 0
    ready = [lookup.ready(made.tables[kind]) for kind in (POINT, SEGMENT)]
    assert lookup.segment(*ready, 1.0, 1.0, 0.2, 0.1) == 0
