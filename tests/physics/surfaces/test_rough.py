"""Rough boundaries: energy, reciprocity, the smooth limit, facets counted one by one."""

import math

import numpy as np
import pytest

from bakery.physics.surfaces import fresnel, nodes, rough
from bakery.physics.surfaces.slab import Slab
from bakery.physics.surfaces.solution import solve
from tests.physics.surfaces.test_layers import EVERYWHERE, SPHERE, henyey_greenstein

G8 = 0.8 ** np.arange(25.0)


@pytest.mark.parametrize(("index", "roughness"), [(1.33, 0.1), (1.5, 0.5), (1.5, 1.0), (0.8, 0.2)])
@pytest.mark.parametrize("depth", [0.0, 1.0, math.inf])
def test_white_furnace(index, roughness, depth):
    solution = solve(Slab(*henyey_greenstein(0.8), 1.0, depth, index, 1.0, roughness), G8, 24, 0.1)
    np.testing.assert_allclose(solution.albedo, 1, atol=1e-9)


def test_reciprocity():
    mu, mu0, phi = EVERYWHERE
    solution = solve(Slab(*henyey_greenstein(0.8), 0.9, 2.0, 1.4, 0.3, 0.2), G8, 24, 1e-2)
    np.testing.assert_allclose(solution.reflection(mu, mu0, phi), solution.reflection(mu0, mu, phi), rtol=1e-10)


def test_nearly_smooth():
    """Facets of a roughness of 0.05 do what a smooth boundary does, but for shadows."""
    smooth, facets = (solve(Slab(*SPHERE, 0.95, math.inf, 1.33, None, roughness), np.eye(25)[0], 24, 0.1)
                      for roughness in (0.0, 0.05))
    assert facets.spherical_albedo == pytest.approx(smooth.spherical_albedo, abs=2e-3)
    at = np.array([0.5, 0.8, 1.0])
    albedos = [nodes.interpolation(each.nodes.at, s) @ each.albedo for each, s in ((smooth, at), (facets, np.sqrt(at)))]
    np.testing.assert_allclose(albedos[1], albedos[0], atol=6e-3)


def refracted(mu, inner, phi, index, roughness):
    """Walter et al. 2007, eq. 21, times pi over the square of the index."""
    i = np.stack(np.broadcast_arrays(np.sqrt(1 - mu * mu), 0.0, mu))[..., None, None]
    sine = np.sqrt(1 - inner * inner)
    o = np.stack(np.broadcast_arrays(-sine * np.cos(phi), -sine * np.sin(phi), -inner))
    half = (i + index * o) * (1 if index < 1 else -1)
    square = np.sum(half**2, axis=0)
    half = half / np.sqrt(square)
    into, on = np.sum(i * half, axis=0), -np.sum(o * half, axis=0)
    visible = [2 / (1 + np.sqrt(1 + roughness**2 * (1 / cosine**2 - 1))) for cosine in (mu, inner)]
    density = roughness**2 / (math.pi * ((roughness**2 - 1) * half[2] ** 2 + 1) ** 2)
    passes = 1 - fresnel.reflected(np.clip(into, 0, 1), index)
    value = math.pi * into * on * passes * visible[0] * visible[1] * density / (mu * inner * square)
    return np.where((half[2] > 0) & (into > 0) & (on > 0), value, 0.0)


@pytest.mark.parametrize(("index", "roughness"), [(1.5, 0.3), (1.33, 0.15), (0.8, 0.4)])
def test_shares_of_facets(index, roughness):
    """What facets reflect and refract once, and what is missing, by integrals of the published densities over directions."""
    x, weight = np.polynomial.legendre.leggauss(600)
    out, flux = 0.5 * (1 + x), 0.5 * (1 + x) * weight
    phi = math.pi * (np.arange(800) + 0.5) / 800
    directions = nodes.nodes(40)
    root = np.sqrt(directions.flux)
    facets = rough.facets(directions, directions, index, roughness, 1)
    lost = []
    for mu in (0.4, 0.9):
        at = nodes.interpolation(directions.at, math.sqrt(mu))
        mirrored = flux @ rough.reflected(out[:, None], mu, phi, index, roughness).mean(axis=1)
        lost.append(1 - mirrored - index**2 * flux @ refracted(mu, out[:, None], phi, index, roughness).mean(axis=1))
        assert at @ facets.mirrored - at @ (facets.again @ root / root) == pytest.approx(mirrored, abs=2e-4)
    # what is sent on is in proportion to what is missing
    again = [nodes.interpolation(directions.at, math.sqrt(mu)) @ (facets.again @ root / root) for mu in (0.4, 0.9)]
    assert again[1] / again[0] == pytest.approx(lost[1] / lost[0], rel=0.02)


def test_free_layers_are_refused():
    with pytest.raises(ValueError, match="base or is infinite"):
        solve(Slab(*SPHERE, 0.5, 1.0, 1.3, None, 0.2), np.eye(33)[0], 32)
