"""Directions at which a layer is solved: Gauss nodes over the cosine, dense at grazing angles, on both sides of a boundary.

Radiance has terms in mu ln mu at grazing angles, which Gauss nodes over mu resolve poorly: in s = sqrt(mu) they are s^2 ln s, and
a polynomial in s through n nodes is within n^-4 of them.  Under a boundary of an index above 1 the kernel jumps at the critical
angle, so that directions that leave (images of the nodes in air) and those that are totally reflected have nodes of their own.
What leaves is then smooth in the cosine in air itself, and nodes over that keep their digits: weights of grazing nodes over s are
some 1e-12, and light scattered into them would drown in the rounding of what is not.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from bakery.physics.surfaces import fresnel

SPARE = 8  # nodes beyond as many as there are moments
_RESOLVED = 68  # nodes: as many as there are moments up to about so many
POWER = 2  # mu = s^POWER; 3 would converge faster, but its smallest cosines cost the digits that rounding leaves


@dataclass(frozen=True)
class Nodes:
    """Directions of a hemisphere."""

    mu: np.ndarray  # (N + C,) cosines in the medium; the first N are those that leave it
    flux: np.ndarray  # (N + C,) shares of the flux of isotropic light, 2 mu times weight, that add up to 1
    air: np.ndarray  # (N,) cosines in air of those that leave
    reflected: np.ndarray  # (N + C,) share of the light that the boundary sends back into the medium, 1 where it is total
    at: np.ndarray  # (N,) `coordinate` of the directions that leave: between them what leaves is a polynomial
    index: float  # of the medium, over that of the air

    @property
    def leaving(self) -> int:
        return len(self.air)

    def mean(self, values) -> float:
        """Of values (N,) at the directions that leave, over light from all sides; 1 where an index below 1 reflects all of it."""
        flux, enters = self.flux[:self.leaving], min(self.index, 1.0)**2
        return float(enters * (flux @ values) / flux.sum() + 1 - enters)

    def spans(self, mu):
        """Of cosines in air (Q,), as `shared.Directions.spans`: between the nodes that leave is a single polynomial."""
        yield np.arange(len(mu)), slice(self.leaving), self.at, coordinate(mu, self.index)


def grazing(count: int, top: float = 1.0):
    """`count` cosines from 0 to `top`, weights of an integral over them, and coordinates s from 0 to 1."""
    x, weight = np.polynomial.legendre.leggauss(count)
    s = 0.5 * (1 + x)
    return top * s**POWER, top * POWER * s ** (POWER - 1) * 0.5 * weight, s


def enough(count: int, least: int) -> int:
    """Directions that leave, for as many Legendre moments; where they are too few for a peak, see `orders.unresolved`."""
    return max(least, min(count + SPARE, _RESOLVED + count // 16))


@lru_cache(maxsize=16)
def nodes(count: int, index: float = 1.0) -> Nodes:
    """The directions of a medium under a smooth boundary.

    count : of the directions that leave
    index : 1 for no boundary
    """
    if index <= 1:
        mu, weight, s = grazing(count)
        air = fresnel.outside(mu, index)
        return Nodes(mu, 2 * mu * weight, air, fresnel.reflected(air, index), s, index)
    x, weight = np.polynomial.legendre.leggauss(count)
    mu, weight, limit = 0.5 * (1 + x), 0.5 * weight, fresnel.critical(index)
    trapped, trapped_weight, _ = grazing(max(8, math.ceil(count * limit)), limit)
    return Nodes(np.concatenate([fresnel.inside(mu, index), trapped]),
                 # mu dmu is n^2 times smaller inside
                 np.concatenate([2 * mu * weight / index**2, 2 * trapped * trapped_weight]),
                 mu, np.concatenate([fresnel.reflected(mu, index), np.ones(len(trapped))]), mu, index)


def coordinate(mu, index: float):
    """Where directions in air of cosine mu lie between the nodes, like mu: 0 to 1."""
    return mu if index > 1 else np.sqrt(fresnel.inside(mu, index))


@lru_cache(maxsize=16)
def _barycentric(count: int):
    x, gauss = np.polynomial.legendre.leggauss(count)
    return np.where(np.arange(count) % 2, -1.0, 1.0) * np.sqrt((1 - x * x) * gauss)


def interpolation(s, at):
    """(..., N) weights of values at the nodes s (N,), Gauss's of (0, 1), that give their polynomial at any coordinates (...,)."""
    result = np.asarray(at, float)[..., None] - s
    # next to this, 1 / 1e-200, nothing else counts at a node itself
    np.copyto(result, 1e-200, where=result == 0)
    np.divide(_barycentric(len(s)), result, out=result)
    result /= result.sum(axis=-1, keepdims=True)
    return result


def sines(mu, mu0, index: float):
    """Product of the sines in the medium of two directions, from their cosines in air: odd orders are over it."""
    return np.sqrt((1 - mu * mu) * (1 - mu0 * mu0)) / index**2


def vanishing(weights, air, mu):
    """Weights (K, N) of `interpolation` for even orders from 2 on, which fall as the squared sine at normal incidence.

    air : (N,) cosines in air of the nodes;  mu : (K,) those of the coordinates
    """
    return weights * ((1 - mu) * (1 + mu))[:, None] / ((1 - air) * (1 + air))
