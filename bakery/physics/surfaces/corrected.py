"""A half space or a layer of a medium, corrected by what walks among the grains say that it stands for: orders kept apart.

The reflectance of an order is its share in the medium's plane layer, times a factor of the pair of directions, a table over
cells of `pairs`, times a factor of each of both directions' cosines, the same function.  The medium brings the shape within
cells, where the walks' noise would be; the factors make its light in each cell, and its albedo at each angle, that of the walks.
Light that leaves below has factors of its own, with the direction opposite to that in which it leaves as the second of a pair.
Both factors know no order of the directions, so reciprocity holds exactly.  `fit` makes them of counts.
"""

import math
from dataclasses import dataclass

import numpy as np

from bakery.physics.medium.phase import phase_at
from bakery.physics.surfaces import pairs, single
from bakery.physics.surfaces.nodes import grazing
from bakery.physics.surfaces.solution import Solution

ORDERS = ("first", "second", "higher")
DEGREE = 6  # of the polynomial in the root of the cosine through albedos
_ACROSS, _AROUND = 24, 48  # directions out along the root of the cosine and over half of the azimuth


@dataclass(frozen=True)
class Factors:
    """What light of each order is times that of the medium."""

    cells: tuple[np.ndarray, ...]  # by order, tables (A, U, V) over the coordinates of `pairs`, values at the middles of cells
    scale: np.ndarray  # (3, B) of either direction, at the middles of B equal steps of the root of its cosine from `least` to 1
    least: float  # root of the smallest cosine

    def at(self, order: int, mu, mu0, phi):
        """Factor (K,) of an order at pairs (K,)."""
        table = self.cells[order]
        index, weight = pairs.interpolation(mu, mu0, phi, table.shape)
        return (table.ravel()[index] * weight).sum(axis=1) * self.along(order, mu) * self.along(order, mu0)

    def along(self, order: int, mu):
        """Factor of one direction."""
        return np.interp(np.sqrt(mu), middles(self.scale.shape[1], self.least), self.scale[order])


def middles(bins: int, least: float):
    """Roots of the cosine in the middles of bins."""
    return least + (1 - least) * (np.arange(bins) + 0.5) / bins


@dataclass(frozen=True)
class Corrected:
    """The reflectance of grains, and of a layer over air the transmittance."""

    solution: Solution  # of the medium's half space or layer without a boundary
    factors: Factors  # of the orders
    below: Factors | None = None  # of light that leaves below; None where none does
    straight: np.ndarray | None = None  # (B,) share of the light of the bins of `factors` that leaves below undeflected

    def reflection(self, mu, mu0, phi):
        """R at cosines above 0 and azimuths (0: forward); the BRDF is R / pi.  Arguments broadcast."""
        return self._value(mu, mu0, phi, -1)

    def transmission(self, mu, mu0, phi):
        """The same of light that leaves below, undeflected light left out: 0 where none does."""
        return np.zeros(np.broadcast(mu, mu0, phi).shape) if self.below is None else self._value(mu, mu0, phi, 1)

    def _value(self, mu, mu0, phi, side: int):
        mu, mu0, phi = np.broadcast_arrays(*(np.asarray(value, float) for value in (mu, mu0, phi)))
        return sum(self.orders(mu.ravel(), mu0.ravel(), phi.ravel(), side)).reshape(mu.shape)

    def orders(self, mu, mu0, phi, side: int = -1) -> list:
        """Reflection (side -1) or transmission (1) by order, at pairs (K,): first, second, higher."""
        factors, shapes = self.factors if side < 0 else self.below, shares(self.solution, mu, mu0, phi, side)
        return [shape * factors.at(k, mu, mu0, phi if side < 0 else math.pi - phi) for k, shape in enumerate(shapes)]

    def unscattered(self, mu):
        """Share (K,) of light that leaves below undeflected, at cosines (K,)."""
        bins = self.straight
        # beyond the middle of the last bin it goes on as before
        at, values = np.append(middles(len(bins), self.factors.least), 1.0), np.append(bins, 1.5 * bins[-1] - 0.5 * bins[-2])
        return np.clip(np.interp(np.sqrt(mu), at, values), 0, 1)

    def albedos(self, mu0):
        """Share (3, K) of the light of directions (K,) that comes back, by order."""
        mu, phi, weight = hemisphere()
        at = [np.broadcast_to(a, (len(mu0), len(mu))).ravel() for a in (mu, np.asarray(mu0)[:, None], phi)]
        return np.stack([order.reshape(len(mu0), -1) @ weight for order in self.orders(*at)])


def shares(solution: Solution, mu, mu0, phi, side: int = -1):
    """The medium's light at pairs (K,), sent back (side -1) or let through (1): scattered once, by it or its base, several times,
    and again that, from which higher orders are made."""
    slab = solution.slab
    phase = 4 * math.pi * phase_at(slab.theta, slab.phase, single.turned(mu, mu0, phi, side))
    once = 0.25 * slab.albedo * phase * (single.upward if side < 0 else single.downward)(mu, mu0, slab.depth)
    if side < 0 and slab.base:
        once = once + slab.base * np.exp(-slab.depth * (1 / mu + 1 / mu0))
    whole = (solution.reflection if side < 0 else solution.transmission)(mu, mu0, phi)
    several = np.maximum(whole - once, 0.0)
    return once, several, several


def hemisphere():
    """Directions out, mu and phi (P,), and weights of an integral of R that is an albedo."""
    mu, weight, _ = grazing(_ACROSS)
    phi = math.pi * (np.arange(_AROUND) + 0.5) / _AROUND
    return np.repeat(mu, _AROUND), np.tile(phi, _ACROSS), np.repeat(2 * mu * weight, _AROUND) / _AROUND
