"""What is solved: a plane layer of a medium, what is on it and under it, at one wavelength."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bakery.physics.surfaces.nodes import grazing, interpolation


@dataclass(frozen=True)
class Slab:
    """A plane layer."""

    # theta, phase: (A,) rad and 1/sr, the phase function, linear in cos theta in between
    theta: np.ndarray
    phase: np.ndarray
    albedo: float  # single-scattering albedo
    depth: float  # optical depth, 0 to infinity
    index: float = 1.0  # of the medium over that of the air, 1 for no boundary; on top, and below too where there is no base
    base: float | None = None  # albedo of a Lambertian base in contact with the medium; None for air
    # of the boundary on top (GGX's alpha), 0 for a smooth one; above 0 the layer has a base or is infinite
    roughness: float = 0.0
    # another layer in contact with this one, or a surface that is known, in place of a base
    under: Slab | Reflector | None = None
    length: float = 1.0  # um, mean free path; thickness of a layer of depth 0


@dataclass(frozen=True)
class Reflector:
    """A surface whose reflectance is known as light from air sees it."""

    # (M, K, K) Fourier orders of R times the sum of both cosines at the K Gauss nodes of the root of the cosine; odd ones over
    # both sines
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


# ---- stacks


def layers(slab: Slab) -> tuple[list[Slab], Reflector | float | None]:
    """Media of a stack from the top, and what is under them: a reflector, the albedo of a matt base, None: nothing, or air.

    Raises ValueError : an index below 1; facets over air
    """
    parts = [slab]
    while isinstance(parts[-1].under, Slab):
        parts.append(parts[-1].under)
    last = parts[-1]
    if len(parts) > 1 and any(part.index < 1 for part in parts):
        raise ValueError("media of a stack have an index of 1 or more")
    if free(slab) and any(facets_on(parts, k) for k in range(len(parts))):
        raise ValueError("a layer under a rough boundary has a base or is infinite")
    if last.depth == math.inf:
        return parts, None
    return parts, last.base if last.under is None else last.under


def free(slab: Slab) -> bool:
    """Whether air is below a layer, or below a stack."""
    while isinstance(slab.under, Slab):
        slab = slab.under
    return slab.depth < math.inf and slab.base is None and slab.under is None


def upside_down(slab: Slab) -> Slab:
    """A layer, or a stack, over air as light from below sees it; its boundaries are smooth."""
    parts, under = layers(slab)[0], None
    for part in parts:
        under = replace(part, under=under)
    return under


def facets_on(parts: Sequence[Slab], k: int) -> bool:
    """Whether layer number k has a rough boundary on top."""
    return parts[k].roughness > 0 and parts[k].index != (parts[k - 1].index if k else 1.0)


def rough_within(slab: Slab) -> bool:
    """Whether any boundary of a stack is rough."""
    parts, _ = layers(slab)
    return any(facets_on(parts, k) for k in range(len(parts)))
