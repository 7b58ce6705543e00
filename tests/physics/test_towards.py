"""Densities of directions at rough surfaces are those with which directions are drawn.

Fixed seeds; a comparison is within 5.5 standard errors, 4e-8 each, some 2e-5 for the file.
"""

import numpy as np
import pytest

from bakery.physics.grains.surface import CONDUCTOR, DIELECTRIC, DIFFUSE, at_surface, surface_density
from bakery.system.compiled import njit

BINS = 12, 16  # of the cosine, of the azimuth


@njit
def drawn(kind, index, alpha, wi, uniform, out, share, density, again):
    for n in range(len(uniform)):
        x, y, z, share[n], _ = at_surface(kind, index, alpha, wi[0], wi[1], wi[2], uniform[n, 0], uniform[n, 1], uniform[n, 2])
        out[n, 0], out[n, 1], out[n, 2] = x, y, z
        density[n], again[n], _ = surface_density(kind, index, alpha, wi[0], wi[1], wi[2], x, y, z)


@njit
def valued(kind, index, alpha, wi, wo, density):
    for n in range(len(wo)):
        density[n], _, _ = surface_density(kind, index, alpha, wi[0], wi[1], wi[2], wo[n, 0], wo[n, 1], wo[n, 2])


@pytest.mark.parametrize("kind, index, alpha, z", [
    (DIFFUSE, 1.0, 0.0, 0.7), (CONDUCTOR, 1.0, 0.4, 0.8), (CONDUCTOR, 1.0, 0.8, 0.3), (DIELECTRIC, 1.5, 0.4, 0.8),
    (DIELECTRIC, 1.5, 0.7, 0.3), (DIELECTRIC, 1.5, 0.5, -0.9), (DIELECTRIC, 1.33, 0.6, -0.4), (DIELECTRIC, 0.7, 0.5, 0.6)])
def test_densities(kind, index, alpha, z):
    wi, random, count = np.array([np.sqrt(1 - z * z), 0.0, z]), np.random.default_rng(1), 200_000
    out, share, density, again = np.empty((count, 3)), np.empty(count), np.empty(count), np.empty(count)
    drawn(kind, index, alpha, wi, random.random((count, 3)), out, share, density, again)
    assert np.allclose(np.linalg.norm(out, axis=1), 1, atol=1e-6)
    kept = share > 0  # what leaves on the wrong side is lost in any case
    assert np.allclose(again[kept], share[kept], rtol=1e-6) and np.all(density[kept] > 0)
    where = [np.clip(((out[:, 2] + 1) / 2 * BINS[0]).astype(int), 0, BINS[0] - 1),
             ((np.arctan2(out[:, 1], out[:, 0]) / (2 * np.pi) + 0.5) * BINS[1]).astype(int) % BINS[1]]
    found = np.zeros(BINS)
    np.add.at(found, tuple(one[kept] for one in where), 1 / count)
    fine = 60
    u = (np.arange(BINS[0] * fine) + 0.5) / (BINS[0] * fine) * 2 - 1
    phi = ((np.arange(BINS[1] * fine) + 0.5) / (BINS[1] * fine) - 0.5) * 2 * np.pi
    u, phi = (one.ravel() for one in np.meshgrid(u, phi, indexing="ij"))
    sine, values = np.sqrt(1 - u * u), np.empty(u.size)
    valued(kind, index, alpha, wi, np.stack([sine * np.cos(phi), sine * np.sin(phi), u], axis=1), values)
    expected = values.reshape(BINS[0], fine, BINS[1], fine).mean(axis=(1, 3)) * 4 * np.pi / np.prod(BINS)
    assert np.all(np.abs(found - expected) < 5.5 * np.sqrt(expected / count) + 2e-3 * expected + 2e-6)
    assert found.sum() == pytest.approx(kept.mean())
