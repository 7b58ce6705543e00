"""Plane layers against closed forms, published figures and laws of conservation."""

import math

import mpmath
import numpy as np
import pytest

from bakery.physics.medium.phase import normalised, phase_at
from bakery.physics.multiple import legendre
from bakery.physics.surfaces import deep, fresnel, layer, nodes, orders, single
from bakery.physics.surfaces.refine import compact, converged, refined
from bakery.physics.surfaces.slab import Slab
from bakery.physics.surfaces.solution import solve
from tests.conftest import slow

GRAZING = math.cos(math.radians(89.9))
COSINES = np.array([GRAZING, 0.05, 0.2, 0.5, 0.7106756, 0.9, 1.0])
SPHERE = np.array([0.0, math.pi]), np.array([1.0, 1.0]) / (4 * math.pi)
EVERYWHERE = np.meshgrid(COSINES, COSINES, np.linspace(0, math.pi, 7), indexing="ij")


def chandrasekhar(albedo: float, mu):
    """H(mu) by its closed integral (Chandrasekhar 1960, V 40), to 20 digits: no iteration, no quadrature of the layer's."""
    with mpmath.workdps(20):
        def of(cosine):
            def integrand(angle):
                square = mpmath.cos(angle) ** 2 + cosine**2 * mpmath.sin(angle) ** 2
                cot = 1 - angle**2 / 3 - angle**4 / 45 if angle < 1e-4 else angle * mpmath.cot(angle)
                # 1 - angle cot(angle) loses its digits there
                lost = angle**2 / 3 + angle**4 / 45 if angle < 1e-4 else 1 - cot
                return mpmath.log((1 - albedo) * cot + lost) / square
            return mpmath.exp(-cosine / mpmath.pi * mpmath.quad(integrand, [0, 0.01, 0.1, 0.5, 1, 1.4, mpmath.pi / 2]))
        return np.array([float(of(mpmath.mpf(float(value)))) for value in mu])


def henyey_greenstein(g: float, angles: int = 2000):
    """Angles and values of a table as assets hold them."""
    theta = np.concatenate([[0.0], np.geomspace(1e-4, math.pi, angles)])
    theta[-1] = math.pi
    phase = (1 - g * g) / (1 + g * g - 2 * g * np.cos(theta)) ** 1.5 / (4 * math.pi)
    return theta, normalised(theta, phase)[0]


@pytest.mark.parametrize("albedo", [0.1, 0.5, 0.9, 0.99, 1.0])
def test_isotropic_half_space_is_chandrasekhars(albedo):
    solution = solve(Slab(*SPHERE, albedo, math.inf), np.eye(33)[0], 32)
    mu = COSINES
    H = chandrasekhar(albedo, mu)
    exact = albedo / 4 * H[:, None] * H / (mu[:, None] + mu)
    np.testing.assert_allclose(solution.reflection(mu[:, None], mu, 1.0), exact, rtol=1e-6)
    if albedo == 1:  # Chandrasekhar's table XI: H(1), H(0.5)
        np.testing.assert_allclose(chandrasekhar(1.0, [1.0, 0.5]), [2.9078, 2.0128], atol=1e-4)


@pytest.mark.parametrize(("albedo", "g", "spherical", "plane"),
                         [(0.9, -0.3, 0.5224, 0.5100), (0.9, 0.6, 0.3230, 0.3008), slow(0.99, 0.8, 0.6027, 0.5860),
                          slow(0.999, 0.9, 0.79543, 0.78643)])
def test_half_spaces_of_one_lobe(albedo, g, spherical, plane):
    """Four digits from an independent doubling and counted photons, five of the last from PythonicDISORT."""
    solution = solve(Slab(*henyey_greenstein(g), albedo, math.inf), g ** np.arange(65.0), 64)
    assert solution.spherical_albedo == pytest.approx(spherical, abs=6e-5)
    at = nodes.interpolation(solution.nodes.at, nodes.coordinate(0.7106756, 1.0))
    assert at @ solution.albedo == pytest.approx(plane, abs=6e-5)


@pytest.mark.parametrize("depth", [1e-12, 0.3, 10.0, 1e6, math.inf])
@pytest.mark.parametrize("index", [0.8, 1.0, 1.33, 1.5])
def test_white_furnace(depth, index):
    slab = Slab(*henyey_greenstein(0.8), 1.0, depth, index, None if math.isinf(depth) else 1.0)
    solution = solve(slab, 0.8 ** np.arange(33.0), 32, 0.1)
    np.testing.assert_allclose(solution.albedo, 1, atol=1e-6)


@pytest.mark.parametrize("index", [0.8, 1.0, 1.5])
@pytest.mark.parametrize("depth", [0.0, 1e-12, 0.01, 3.0, 1e6])
def test_free_layers_lose_nothing(depth, index):
    solution = solve(Slab(*henyey_greenstein(0.8), 1.0, depth, index), 0.8 ** np.arange(33.0), 32, 0.1)
    np.testing.assert_allclose(solution.albedo + solution.passed, 1, atol=1e-6)


@pytest.mark.parametrize("slab", [Slab(*henyey_greenstein(0.9), 0.95, 2.0, 1.4),
                                  Slab(*henyey_greenstein(0.5), 0.5, 1.0, 0.9, 0.3)])
def test_reciprocity(slab):
    solution = solve(slab, (0.9 if slab.albedo > 0.9 else 0.5) ** np.arange(33.0), 32, 1e-3)
    mu, mu0, phi = EVERYWHERE
    for side in (solution.reflection, solution.transmission):
        np.testing.assert_allclose(side(mu, mu0, phi), side(mu0, mu, phi), rtol=1e-9, atol=1e-12)


def test_thin_layers_scatter_once():
    theta, phase = henyey_greenstein(0.7)
    depth = 1e-9
    solution = solve(Slab(theta, phase, 0.8, depth), 0.7 ** np.arange(33.0), 32)
    mu, mu0, phi = (part[1:, 1:] for part in EVERYWHERE)
    lobe = 4 * math.pi * phase_at(theta, phase, single.turned(mu, mu0, phi, -1))
    np.testing.assert_allclose(solution.reflection(mu, mu0, phi), 0.8 * lobe * depth / (4 * mu * mu0), rtol=1e-7)


def test_faint_media_scatter_once():
    """An albedo of 1e-6: what is scattered twice is a part of it, and rounding none; under a boundary too."""
    for index in (1.0, 1.33):
        faint, fainter = (solve(Slab(*SPHERE, albedo, math.inf, index), np.eye(65)[0], 64) for albedo in (1e-6, 1e-9))
        values = [solution.reflection(*EVERYWHERE) / solution.slab.albedo for solution in (faint, fainter)]
        np.testing.assert_allclose(values[0], values[1], rtol=3e-6)


@pytest.mark.parametrize("index", [1.0, 1.4])
@pytest.mark.parametrize("albedo", [0.3, 1.0])
def test_seam_between_thin_and_thick(albedo, index, monkeypatch):
    """Layers that are doubled and those by singular values are the same."""
    slab = Slab(*henyey_greenstein(0.8), albedo, 0.1, index)
    solutions = []
    for seam in (0.01, 1.0):
        monkeypatch.setattr(layer, "_THIN", seam)
        solutions.append(solve(slab, 0.8 ** np.arange(33.0), 32, 0.01))
    for name in ("reflection", "transmission"):
        np.testing.assert_allclose(*(getattr(solution, name)(*EVERYWHERE) for solution in solutions), rtol=2e-7)


@pytest.mark.slow
def test_peaked_and_backward_phase_functions():
    """Energy of what needs many moments, of a backward lobe, and of two lobes that no number of moments can carry."""
    theta, narrow = henyey_greenstein(0.99)
    phase = 0.5 * narrow + 0.5 * narrow[::-1]
    for moments in (0.99 ** np.arange(41.0), (-0.9) ** np.arange(41.0), 0.99 ** np.arange(41.0) * (np.arange(41) % 2 == 0)):
        for depth in (0.01, 1e5):
            solution = solve(Slab(theta, phase, 1.0, depth, 1.33), moments, 40, 100.0)
            np.testing.assert_allclose(solution.albedo + solution.passed, 1, atol=1e-6)


@pytest.mark.parametrize(("albedo", "g", "depth"), [(0.9, 0.75, 1.0), (0.999, 0.85, 20.0)])
def test_fluxes_of_pythonicdisort(albedo, g, depth):
    """An independent program of discrete ordinates, where it is installed."""
    pydisort = pytest.importorskip("PythonicDISORT").pydisort
    moments = g ** np.arange(65.0)
    solution = solve(Slab(*henyey_greenstein(g), albedo, depth), moments, 64, 1.0)
    for mu in (0.2, 0.7106756):
        _, upward, downward = pydisort(np.array([depth]), np.array([albedo]), 64, moments[None, :64], mu, 1.0, 0.0, NFourier=1,
                                       only_flux=True, f_arr=moments[64:])[:3]
        at = nodes.interpolation(solution.nodes.at, nodes.coordinate(mu, 1.0))
        assert at @ solution.albedo == pytest.approx(float(upward(0.0)) / mu, rel=1e-6)
        assert at @ solution.passed == pytest.approx(float(sum(downward(depth))) / mu, rel=1e-6)


def test_nothing_scatters():
    """Albedo 0, and thickness 0: the base alone, seen through what absorbs."""
    mu, mu0, phi = EVERYWHERE
    black = solve(Slab(*SPHERE, 0.0, math.inf), np.eye(33)[0], 32)
    assert not black.reflection(mu, mu0, phi).any() and not black.albedo.any()
    bare = solve(Slab(*SPHERE, 0.7, 0.0, 1.0, 0.4), np.eye(33)[0], 32)
    np.testing.assert_allclose(bare.reflection(mu, mu0, phi), 0.4, rtol=1e-12)
    covered = solve(Slab(*SPHERE, 0.0, 0.5, 1.0, 0.4), np.eye(33)[0], 32)
    np.testing.assert_allclose(covered.reflection(mu, mu0, phi), 0.4 * np.exp(-0.5 * (1 / mu + 1 / mu0)), rtol=1e-9)


def test_half_a_layer_on_the_other():
    directions = nodes.nodes(40, 1.3)
    even, odd = orders.phase_matrices(0.8 ** np.arange(24.0), directions.mu, 1)
    half, whole = (layer.homogeneous(even, odd, directions.mu, directions.flux, 0.97, depth) for depth in (1.5, 3.0))
    bare = np.zeros(len(directions.mu))
    (reflection, scattered), through = half.scattered(bare), np.diag(half.direct)
    passed = scattered + through
    arriving = np.linalg.solve(np.eye(len(bare)) - reflection @ reflection, passed)
    upward, downward = whole.scattered(bare)
    np.testing.assert_allclose(reflection + passed @ reflection @ arriving, upward, atol=1e-11)
    np.testing.assert_allclose(passed @ arriving - through**2, downward, atol=1e-11)


def test_boundary():
    """Snell's and Fresnel's laws: normal incidence, Brewster's angle, total reflection."""
    assert fresnel.reflected(1.0, 1.5) == pytest.approx(0.04)
    polariser = math.cos(math.atan(1.5))
    assert fresnel.reflected(polariser, 1.5) == pytest.approx(0.5 * ((1.5**2 - 1) / (1.5**2 + 1)) ** 2)
    assert fresnel.reflected(0.3, 0.8) == 1
    assert fresnel.outside(fresnel.inside(0.4, 1.33), 1.33) == pytest.approx(0.4)


@pytest.mark.parametrize(("slab", "tolerance"), [
    (Slab(*henyey_greenstein(0.75), 0.99, math.inf), 0.01), (Slab(*henyey_greenstein(0.8), 0.9, 4.0, 1.33, 0.2), 0.01),
    (Slab(*henyey_greenstein(0.7), 1.0, 0.5), 0.01),
    pytest.param(Slab(*henyey_greenstein(0.95), 0.99, math.inf), 0.05, marks=pytest.mark.slow)])
def test_refined_until_it_no_longer_changes(slab, tolerance):
    """The stated error bounds the true one, by a solution of more moments."""
    mu, mu0, phi = EVERYWHERE
    solution, error = refined(slab, tolerance)
    count = 2 * len(solution.cut.moments)
    exact = solve(slab, legendre.moments(slab.theta, slab.phase, count), count, 1e-4)
    assert 0 < error <= tolerance
    np.testing.assert_allclose(solution.reflection(mu, mu0, phi), exact.reflection(mu, mu0, phi), rtol=error)


def test_what_is_out_of_reach_is_said():
    assert refined(Slab(*henyey_greenstein(0.95), 0.99, math.inf), 1e-5, most=32)[1] > 1e-5


def test_directions_outside_the_hemisphere():
    with pytest.raises(ValueError, match="above 0"):
        solve(Slab(*SPHERE, 0.5, 1.0), np.eye(33)[0], 32).reflection(-0.1, 0.5, 0.0)


def test_whole_milk_is_as_white_as_published():
    """Diffuse reflectance of light that enters (Jensen et al. 2001, table 1, index 1.3): theirs is diffusion's."""
    sigma_s, sigma_a = np.array([8.50, 10.70, 12.57]), np.array([0.0011, 0.0024, 0.0140])
    for albedo, published in zip(sigma_s / (sigma_s + sigma_a), (0.91, 0.88, 0.76), strict=True):
        solution = solve(Slab(*henyey_greenstein(0.7), albedo, math.inf, 1.3), 0.7 ** np.arange(49.0), 48, 1e-4)
        mirrored = float(fresnel.reflected(1.0, 1.3))
        back = np.interp(1.0, solution.nodes.air, solution.albedo) - mirrored
        assert back / (1 - mirrored) == pytest.approx(published, rel=0.02)


@pytest.mark.parametrize(("index", "depth", "base"), [(1.0, math.inf, None), slow(1.0, 60.0, 0.5), (1.4, 60.0, None)])
def test_orders_that_are_iterated(monkeypatch, index, depth, base):
    """High orders of a deep layer by Ambarzumian's invariance are those by modes, where nodes miss a part of the peak too."""
    slab, wanted = Slab(*henyey_greenstein(0.93), 0.999, depth, index, base), 0.93 ** np.arange(82.0)
    iterated = solve(slab, wanted, 81, 1e-4)
    monkeypatch.setattr(deep, "FAINT", 0.0)
    exact = solve(slab, wanted, 81, 1e-4)
    count = min(len(exact.reflected), len(iterated.reflected))
    assert count > 12
    np.testing.assert_allclose(iterated.reflected[:count:2], exact.reflected[:count:2], atol=1e-7)
    np.testing.assert_allclose(iterated.reflection(*EVERYWHERE), exact.reflection(*EVERYWHERE), rtol=1e-5)


@pytest.mark.parametrize(("g", "steps"), [(-0.8, 40), (0.8, 40), (0.8, 3)])
def test_orders_that_iteration_does_not_reach_go_by_modes(monkeypatch, g, steps):
    """Moments of both signs; with too few steps for the lower orders."""
    slab, wanted = Slab(*henyey_greenstein(g), 1.0, math.inf), g ** np.arange(33.0)
    monkeypatch.setattr(deep, "_STEPS", steps)
    iterated = solve(slab, wanted, 32, 1e-3)
    monkeypatch.setattr(deep, "FAINT", 0.0)
    np.testing.assert_allclose(iterated.reflection(*EVERYWHERE), solve(slab, wanted, 32, 1e-3).reflection(*EVERYWHERE), rtol=1e-5)


@pytest.mark.parametrize("slab", [Slab(*henyey_greenstein(0.85), 0.99, math.inf), Slab(*henyey_greenstein(0.8), 1.0, 2.0, 1.33)])
def test_orders_are_rounded_within_the_tolerance(slab):
    """Reciprocity and energy (order 0) stay; most numbers become 0, or have few digits; the error that is stated holds."""
    solution, before = converged(slab, 0.02)
    result, error = compact(solution, before, 0.02)
    assert before <= error <= 0.02
    for name in ("reflected", "transmitted")[:1 if slab.depth == math.inf else 2]:
        orders, exact = getattr(result, name), getattr(solution, name)
        np.testing.assert_array_equal(orders[0], exact[0])
        np.testing.assert_array_equal(orders, np.swapaxes(orders, 1, 2))
        assert np.count_nonzero(orders) < 0.6 * np.count_nonzero(exact)
    mu, mu0, phi = EVERYWHERE
    np.testing.assert_allclose(result.reflection(mu, mu0, phi), solution.reflection(mu, mu0, phi), rtol=error)


@pytest.mark.parametrize(("index", "depth"), [(1.0, math.inf), (1.5, 2.0), (0.8, 2.0)])
def test_many_pairs_are_those_of_few(index, depth):
    """Many pairs take a finer grid, few the polynomials themselves."""
    solution = solve(Slab(*henyey_greenstein(0.7), 0.99, depth, index), 0.7 ** np.arange(33.0), 32, 1e-3)
    (mu, mu0), phi = np.random.default_rng(1).uniform(GRAZING, 1, (2, 4000)), np.linspace(0, math.pi, 4000)
    assert len(mu) > 64 * solution.nodes.leaving
    for light in (solution.reflection, solution.transmission):
        few = np.concatenate([light(*(part[at:at + 500] for part in (mu, mu0, phi))) for at in range(0, 4000, 500)])
        np.testing.assert_allclose(light(mu, mu0, phi), few, rtol=1e-5, atol=1e-7)
