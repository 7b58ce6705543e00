"""Legendre moments and expansion coefficients: closed forms, another rule, output published with Mishchenko's program."""

import math

import numpy as np
import pytest

from bakery import mie
from bakery.physics import moments
from bakery.physics.medium import phase
from tests.physics.test_phase import random_table

NAMES = ("alpha1", "alpha2", "alpha3", "alpha4", "beta1", "beta2")

# What Mishchenko's spher.f (Lorenz-Mie, www.giss.nasa.gov/staff/mmishchenko) prints of its own setting: radii as r^-3 from
# 0.245830 to 1.19417 um (effective radius 0.6 um, effective variance 0.2), at 0.63 um, 1.53 + 0.008 i
SPHER = {0: (1.00000, .00000, .00000, .89795, .00000, .00000), 1: (2.11107, .00000, .00000, 2.17321, .00000, .00000),
         2: (2.80371, 3.94496, 3.70286, 2.68232, -.11397, .04016), 3: (2.75088, 3.26632, 3.32478, 2.86830, -.04919, -.13012),
         4: (2.78642, 3.29211, 3.08787, 2.67642, -.11611, -.09967), 7: (2.12491, 2.19572, 2.22264, 2.21115, .03711, -.22087),
         12: (1.18264, 1.32442, 1.23019, 1.14003, -.06023, -.16558), 18: (.33469, .38531, .31822, .29493, -.02181, -.11245),
         23: (.02026, .02103, .02698, .03304, -.00277, -.00397), 27: (-.00088, -.00088, -.00001, .00051, -.00092, .00187),
         29: (.00002, .00003, .00006, .00005, .00013, -.00006)}


def henyey_greenstein(theta, g):
    return (1 - g * g) / (4 * math.pi) / ((1 - g) ** 2 + 4 * g * np.sin(theta / 2) ** 2) ** 1.5


def test_moments_of_henyey_and_greenstein_are_powers_of_g():
    theta = np.concatenate([[0.0], np.geomspace(1e-4, math.pi, 8000)])
    table, _ = phase.normalised(theta, np.stack([henyey_greenstein(theta, g) for g in (0.0, 0.5, 0.8, 0.95)]))
    expected = np.array([0.0, 0.5, 0.8, 0.95])[:, None] ** np.arange(201)
    assert np.abs(moments.legendre_moments(theta, table, 200) - expected).max() < 1e-6  # interpolation: 5e-7 of these angles


def test_moments_are_exact_for_the_interpolant():
    """Peaks down to 1e-8 rad: against Gauss's rule in theta, and against the sums that the table itself has."""
    theta, f = random_table(3)
    computed = moments.legendre_moments(theta, f, 40)
    at, weight, cell, share = moments._quadrature(theta, 160)
    values = 2 * math.pi * weight * (f[:, cell] * (1 - share) + f[:, cell + 1] * share)
    other = np.stack([np.sum(values * polynomial, axis=-1) for _, polynomial in moments.wigner(at, 0, 0, 40)], axis=-1)
    assert np.abs(computed - other).max() < 1e-12
    assert np.abs(computed[:, 0] - 1).max() < 1e-13
    assert np.abs(computed[:, 1] - phase.mean_cosine(theta, f)).max() < 1e-13


def test_rayleigh_has_its_closed_form():
    """alpha1 = (1, 0, 1/2), alpha2 = (0, 0, 3), alpha4 = (0, 3/2), beta1 = (0, 0, sqrt(3/2)): de Haan et al. 1987, eq. 141."""
    theta = np.linspace(0, math.pi, 4001)
    mu, scale = np.cos(theta), 3 / (16 * math.pi)
    got = moments.expansion_coefficients(theta, scale * (1 + mu**2), scale * (mu**2 - 1), scale * 2 * mu, 0 * mu, 4)
    expected = np.zeros((6, 5))
    expected[0, [0, 2]] = 1, 0.5
    expected[1, 2], expected[3, 1], expected[4, 2] = 3, 1.5, math.sqrt(1.5)
    assert np.abs(np.stack([getattr(got, name) for name in NAMES]) - expected).max() < 1e-6  # 4001 angles, linear between


@pytest.fixture(scope="module")
def spheres():
    """The matrix of the population that spher.f is set to, by our series: theta, (s11, s12, s33, s34), cross sections."""
    node, weight = np.polynomial.legendre.leggauss(200)
    low, high, k = 0.245830, 1.19417, 2 * math.pi / 0.63
    r = (low + high) / 2 + (high - low) / 2 * node
    share = weight * r**-3.0 / np.sum(weight * r**-3.0)
    ext, sca = (np.sum(share * math.pi * r**2 * q) for q in mie.efficiencies(1.53 + 0.008j, k * r)[:2])
    theta = np.linspace(0, math.pi, 6001)
    s1, s2 = mie.amplitudes(1.53 + 0.008j, k * r, theta)
    product = s2 * s1.conj()
    elements = [share @ element / k**2 / sca for element in ((abs(s1) ** 2 + abs(s2) ** 2) / 2, (abs(s2) ** 2 - abs(s1) ** 2) / 2,
                                                              product.real, product.imag)]
    return theta, elements, ext, sca


def test_expansion_is_that_published_with_spher_f(spheres):
    theta, elements, ext, sca = spheres
    assert (ext, sca) == (pytest.approx(1.92604, abs=6e-6), pytest.approx(1.78033, abs=6e-6))
    got = moments.expansion_coefficients(theta, *elements, orders=31)
    for l, published in SPHER.items():
        # half a unit of the last printed digit, and as much again for the digits of the printed radii
        assert [getattr(got, name)[l] for name in NAMES] == pytest.approx(published, abs=1.5e-5), l


def test_series_gives_the_matrix_back(spheres):
    """Summed up again, every element comes out as it went in: the other four functions have no closed form to be held to."""
    theta, (s11, s12, s33, s34), *_ = spheres
    e = moments.expansion_coefficients(theta, s11, s12, s33, s34, 40)

    def summed(coefficients, m, n):
        return sum(coefficients[l] * function for l, function in moments.wigner(theta, m, n, 40)) / (4 * math.pi)

    assert np.abs(summed(e.alpha1, 0, 0) - s11).max() < 1e-5
    assert np.abs(summed(e.alpha4, 0, 0) - s33).max() < 1e-5
    assert np.abs(summed(e.alpha2 + e.alpha3, 2, 2) - (s11 + s33)).max() < 1e-5
    assert np.abs(summed(e.alpha2 - e.alpha3, 2, -2) - (s11 - s33)).max() < 1e-5
    assert np.abs(-summed(e.beta1, 0, 2) - s12).max() < 1e-5
    assert np.abs(-summed(e.beta2, 0, 2) - s34).max() < 1e-5


@pytest.mark.parametrize("g", [0.5, 0.9])
@pytest.mark.parametrize("tolerance", [0.1, 1e-3])
def test_what_is_cut_is_stated(g, tolerance):
    theta = np.concatenate([[0.0], np.geomspace(1e-4, math.pi, 6000)])
    table, _ = phase.normalised(theta, henyey_greenstein(theta, g))
    series = moments.legendre_series(theta, table, tolerance)
    off = np.abs(moments.phase_of(series.moments, theta) - table)
    true = 2 * math.pi * np.trapezoid(off * np.sin(theta), theta)
    assert series.cut <= tolerance and series.cut == pytest.approx(true, rel=0.05)
    last = series.moments.size - 1
    fewer = moments.legendre_series(theta, table, tolerance, most=int(0.9 * last) - 1)
    assert fewer.cut > tolerance and fewer.moments.size == int(0.9 * last)


def test_extremes():
    theta = np.array([0.0, math.pi])
    assert moments.legendre_series(theta, np.full(2, 1 / (4 * math.pi)), 1e-3).moments.tolist() == [1.0]
    assert moments.legendre_moments(theta, np.full((3, 2), 1 / (4 * math.pi)), 0).shape == (3, 1)
    with pytest.raises(ValueError, match="tolerance above 0"):
        moments.legendre_series(theta, np.ones(2), 0.0)
    with pytest.raises(ValueError, match="counted from 0"):
        moments.legendre_moments(theta, np.ones(2), -1)
    with pytest.raises(ValueError, match="ascend"):
        moments.legendre_moments(theta[::-1], np.ones(2), 2)
