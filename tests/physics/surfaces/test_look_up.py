"""Tables of layers in compiled loops: within their error of the solutions, reciprocal, and right at the limits."""

import math

import numpy as np
import pytest

from bakery.kernels import surface_reflectance, surface_transmittance
from bakery.physics.surfaces import fresnel, table
from bakery.physics.surfaces.corrected import Corrected, Factors
from tests.physics.surfaces.layers import LAYERS, solutions
from tests.physics.surfaces.layers import table as table_of


@pytest.mark.parametrize("name", LAYERS)
def test_tables_keep_the_error_that_they_state(name):
    looked_up, errors = table_of(name)
    assert errors.largest < 3e-3 and errors.mean_square < 6e-4
    # at other directions than those by which the grid was chosen
    rng = np.random.default_rng(5)
    mu, mu0 = rng.uniform(0.002, 1, (2, 300))
    phi = rng.uniform(0, math.pi, 300)
    for wave, solution in enumerate(solutions(name)):
        for function, exact in ((surface_reflectance, solution.reflection(mu, mu0, phi)),
                                (surface_transmittance, solution.transmission(mu, mu0, phi))):
            values = np.array([function(looked_up, wave, *at) for at in zip(mu, mu0, np.cos(phi), strict=True)])
            np.testing.assert_allclose(values, exact, rtol=3e-3, atol=1e-9)


@pytest.mark.parametrize("name", ["tinted", "sheet", "matt"])
def test_light_goes_both_ways_alike(name):
    looked_up, _ = table_of(name)
    rng = np.random.default_rng(6)
    for mu, mu0, cos_phi in rng.uniform([0.01, 0.01, -1], 1, (100, 3)):
        for function in (surface_reflectance, surface_transmittance):
            assert function(looked_up, 0, mu, mu0, cos_phi) == pytest.approx(function(looked_up, 0, mu0, mu, cos_phi), rel=1e-12)


@pytest.mark.parametrize("mu0", [1.0, 0.6, 0.05])
@pytest.mark.parametrize("name", ["half space", "white", "sheet"])
def test_tables_lose_no_light(name, mu0):
    looked_up, _ = table_of(name)
    x, weight = np.polynomial.legendre.leggauss(48)
    x, weight = 0.5 * (1 + x), 0.5 * weight
    sums = [sum(surface(looked_up, 0, mu * mu, mu0, math.cos(math.pi * turn)) * 4 * mu**3 * w * v
                for mu, w in zip(x, weight, strict=True) for turn, v in zip(x, weight, strict=True))
            for surface in (surface_reflectance, surface_transmittance)]
    solution = solutions(name)[0]
    inner = fresnel.inside(mu0, looked_up.index)
    front, passes = fresnel.reflected(mu0, looked_up.index), math.exp(-solution.slab.depth * solution.cut.shrinks / inner)
    down = (1 - front) ** 2 * passes / (1 - (front * passes) ** 2)
    assert sum(sums) + front + down * (1 + front * passes) == pytest.approx(1, abs=6e-4)


def test_means_of_infinite_layers_are_means_of_values():
    looked_up, _ = table_of("tinted")
    mean = looked_up.combined([[0.2, 0.3, 0.5]])
    values = [surface_reflectance(looked_up, wave, 0.3, 0.8, 0.4) for wave in range(3)]
    assert surface_reflectance(mean, 0, 0.3, 0.8, 0.4) == pytest.approx(np.dot([0.2, 0.3, 0.5], values), rel=1e-6)
    with pytest.raises(ValueError, match="infinite"):
        table_of("sheet")[0].combined([[1.0]])


def test_a_coarse_grid_is_noticed():
    rough = table._sampled(solutions("tinted"), 6, 5)
    assert table.errors_of(rough, table.probed(solutions("tinted"))).largest > 0.02


def test_nothing_enters_beyond_the_critical_angle():
    looked_up, _ = table_of("lighter")
    assert surface_reflectance(looked_up, 0, 0.5, 0.9, 0.0) == 0  # cos 0.6 is critical
    assert surface_reflectance(looked_up, 0, 0.7, 0.9, 0.0) > 0


@pytest.mark.slow
def test_light_counted_among_grains_is_looked_up():
    """Factors of a made-up packing, with a peak straight back: what the compiled loops say against what the asset says."""
    rng = np.random.default_rng(7)
    back = 1 + 2 * np.exp(-np.arange(48) / 3.0)[:, None, None] * np.ones((48, 8, 8))
    factors = Factors((back, *(1 + 0.1 * rng.random((2, 12, 8, 8)))), np.linspace(1.1, 0.9, 36).reshape(3, 12), 0.01)
    counted = [Corrected(solution, factors) for solution in solutions("tinted")[:1]]
    looked_up, errors = table.surface_table(counted)
    assert errors.mean_square < 0.002 and errors.largest < 0.03
    mu, mu0 = rng.uniform(0.05, 1, (2, 300))
    phi = rng.uniform(0, math.pi, 300)
    for wave, solution in enumerate(counted):
        values = [surface_reflectance(looked_up, wave, *at) for at in zip(mu, mu0, np.cos(phi), strict=True)]
        exact = solution.reflection(mu, mu0, phi)
        assert np.abs(values / exact - 1).max() < 0.03 and np.sqrt(np.mean((values / exact - 1) ** 2)) < 0.002
        assert np.abs(exact / solution.solution.reflection(mu, mu0, phi) - 1).max() > 0.2  # the medium would not do


@pytest.mark.parametrize("other, rms, largest", [((0, 80), 1e-3, 6e-3), ((89, 89.9), 8e-3, 0.12)])
def test_light_counted_among_grains_is_looked_up_at_grazing_angles(other, rms, largest):
    """To 89.9 degrees, from others and from grazing ones; by a grid without crowded nodes 2.3 % and 24 % there."""
    (looked_up, _), (counted,) = table_of("grains"), solutions("grains")
    rng = np.random.default_rng(8)
    mu, mu0 = np.cos(np.radians([rng.uniform(89, 89.9, 1000), rng.uniform(*other, 1000)]))
    phi = rng.uniform(0, math.pi, 1000)
    values = np.array([surface_reflectance(looked_up, 0, *at) for at in zip(mu, mu0, np.cos(phi), strict=True)])
    off = values / counted.reflection(mu, mu0, phi) - 1
    assert np.sqrt(np.mean(off**2)) < rms and np.abs(off).max() < largest
