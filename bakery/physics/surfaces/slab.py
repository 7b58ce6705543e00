"""What is solved: a plane layer of a medium, what is on it and under it, at one wavelength."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bakery.physics.surfaces.nodes import grazing, interpolation


@dataclass(frozen=True)
class Slab:
    """A plane layer.

    Attributes
    ----------
    theta, phase : (A,) rad and 1/sr, the phase function, linear in cos theta in between
    albedo : single-scattering albedo
    depth : optical depth, 0 to infinity
    index : of the medium over that of the air, 1 for no boundary; on top, and below too where there is no base
    roughness : of the boundary on top (GGX's alpha), 0 for a smooth one; above 0 the layer has a base or is infinite
    base : albedo of a Lambertian base in contact with the medium; None for air
    under : another layer in contact with this one, or a surface that is known, in place of a base
    length : um, mean free path; thickness of a layer of depth 0
    """

    theta: np.ndarray
    phase: np.ndarray
    albedo: float
    depth: float
    index: float = 1.0
    base: float | None = None
    roughness: float = 0.0
    under: Slab | Reflector | None = None
    length: float = 1.0


@dataclass(frozen=True)
class Reflector:
    """A surface whose reflectance is known as light from air sees it.

    Attributes
    ----------
    orders : (M, K, K) Fourier orders of R times the sum of both cosines at the K Gauss nodes of the root of the cosine; odd ones
        over both sines
    """

    orders: np.ndarray

    def matrix(self, mu, flux, order: int):
        """(N, N) of one order between directions, as operators of `layer` are; mu, flux : (N,) of a medium of index 1."""
        if order >= len(self.orders):
            return np.zeros((len(mu), len(mu)))
        weight = interpolation(grazing(self.orders.shape[1])[2], np.sqrt(mu))
        sines = np.sqrt((1 - mu) * (1 + mu)) if order % 2 else np.ones(len(mu))
        values = weight @ self.orders[order] @ weight.T * np.outer(sines, sines) / (mu[:, None] + mu)
        return values * np.sqrt(np.outer(flux, flux))


def reflector(reflection, nodes: int = 40, azimuths: int = 96, orders: int = 32) -> Reflector:
    """What a function reflection(mu, mu0, phi) gives, 0 where light goes on forward."""
    mu, _, _ = grazing(nodes)
    phi = np.pi * (np.arange(azimuths) + 0.5) / azimuths
    values = reflection(mu[:, None, None], mu[:, None], phi) * (mu[:, None, None] + mu[:, None])
    waves = np.cos(np.arange(orders)[:, None] * phi) / azimuths
    result, sines = np.einsum("ijk,mk->mij", values, waves), np.sqrt((1 - mu) * (1 + mu))
    result[1::2] /= np.outer(sines, sines)
    return Reflector(0.5 * (result + np.swapaxes(result, 1, 2)))
