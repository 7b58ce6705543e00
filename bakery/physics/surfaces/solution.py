"""A plane layer of a medium over a base, solved at nodes, and looked up at any angles.

The part that is scattered once is exact: at the nodes that of the cut phase function is taken out, and where it is looked up that
of the full one is put in, with optical depths without the peak (TMS, Nakajima and Tanaka 1988).  What is left is smooth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from bakery.physics.medium.phase import phase_at
from bakery.physics.surfaces import fresnel, single
from bakery.physics.surfaces.cut import Cut, cut
from bakery.physics.surfaces.layer import between, homogeneous
from bakery.physics.surfaces.nodes import Nodes, coordinate, interpolation, nodes
from bakery.physics.surfaces.orders import phase_matrices

_LEAST_NODES, _SPARE_NODES = 24, 8
_NEGLIGIBLE = 0.01  # of the tolerance: a Fourier order below that twice in a row ends their sum


@dataclass(frozen=True)
class Slab:
    """What is solved: one wavelength of a layer.

    Attributes
    ----------
    theta, phase : (A,) rad and 1/sr, the phase function, linear in cos theta in between
    albedo : single-scattering albedo
    depth : optical depth, 0 to infinity
    index : of the medium over that of the air, 1 for no boundary; smooth, on top, and below too where there is no base
    base : albedo of a Lambertian base in contact with the medium; None for air
    """

    theta: np.ndarray
    phase: np.ndarray
    albedo: float
    depth: float
    index: float = 1.0
    base: float | None = None


@dataclass(frozen=True)
class Solution:
    """Reflection and transmission of a slab: radiance out = (1 / pi) int R mu0 L0 dmu0 dphi; the BRDF is R / pi.

    Attributes
    ----------
    reflected, transmitted : (M, N, N) Fourier orders of what is scattered more than once, inside of the boundary, times the sum
        of the cosines inside
    albedo : (N,) share of light from the nodes' directions in air that comes back, mirrored light included
    passed : (N,) share that leaves below, unscattered light included; 0 over a base
    """

    slab: Slab
    nodes: Nodes
    cut: Cut
    reflected: np.ndarray
    transmitted: np.ndarray
    albedo: np.ndarray
    passed: np.ndarray

    @property
    def spherical_albedo(self) -> float:
        """Of light from all sides; that which an index below 1 reflects totally is left out."""
        flux = self.nodes.flux[:self.nodes.leaving]
        return float(flux @ self.albedo / flux.sum())

    def reflection(self, mu, mu0, phi):
        """R at cosines in air above 0 and azimuths (0: forward); without mirrored light.  Arguments broadcast."""
        return self._value(self.reflected, mu, mu0, phi, -1)

    def transmission(self, mu, mu0, phi):
        """The same of light that leaves below; unscattered light left out.

        Notes
        -----
        Within the peak that is cut off (`cut.share` of the light) it counts light that the peak deflects several times as if
        once.
        """
        return self._value(self.transmitted, mu, mu0, phi, 1)

    def _value(self, orders, mu, mu0, phi, side: int):
        mu, mu0, phi = np.broadcast_arrays(*(np.asarray(value, float) for value in (mu, mu0, phi)))
        if not (((mu > 0) & (mu <= 1)).all() and ((mu0 > 0) & (mu0 <= 1)).all()):
            raise ValueError("cosines of directions lie above 0 and do not exceed 1")
        slab, n = self.slab, self.slab.index
        through = (1 - fresnel.reflected(mu, n)) * (1 - fresnel.reflected(mu0, n)) / n**2
        lit = through > 0
        result = np.zeros(mu.shape)
        if not lit.any():
            return result
        mu, mu0, phi, through = mu[lit], mu0[lit], phi[lit], through[lit]
        out, into = (interpolation(self.nodes.at, coordinate(cosine, n)) for cosine in (mu, mu0))
        terms = np.einsum("...i,mij,...j->m...", out, orders, into, optimize=True)
        factors = np.where(np.arange(len(orders)) == 0, 1.0, 2.0)[:, None]
        smooth = np.sum(factors * terms * np.cos(np.arange(len(orders))[:, None] * phi), axis=0)
        inner, inner0 = fresnel.inside(mu, n), fresnel.inside(mu0, n)
        depth = slab.depth * self.cut.shrinks
        shape = single.upward if side < 0 else single.downward
        phase = 4 * math.pi * phase_at(slab.theta, slab.phase, single.turned(inner, inner0, phi, side))
        once = 0.25 * slab.albedo / self.cut.shrinks * phase * shape(inner, inner0, depth)
        if side < 0 and slab.base and depth < math.inf:
            once = once + slab.base * np.exp(-depth * (1 / inner + 1 / inner0))
        result[lit] = through * (smooth / (inner + inner0) + once)
        return result


def solve(slab: Slab, moments, count: int, tolerance: float = 1e-6) -> Solution:
    """The slab with a given number of Legendre moments.

    Parameters
    ----------
    moments : at least count + 1 Legendre moments of the phase function
    count : that are carried
    tolerance : relative; Fourier orders that matter less are left out
    """
    without = cut(moments, slab.albedo, count)
    directions = nodes(max(_LEAST_NODES, count + _SPARE_NODES), slab.index)
    depth = slab.depth * without.shrinks if slab.depth else 0.0
    orders, small = [], 0
    for order in range(count):
        even, odd = phase_matrices(without.moments, directions.mu, order)
        layer = homogeneous(even, odd, directions.mu, directions.flux, without.albedo, depth)
        upward, downward = between(layer, _below(slab, directions, order), directions.reflected)
        if order == 0:
            albedo, passed = _shares(slab, directions, upward, downward)
        direct = np.exp(-depth / directions.mu)
        orders.append(_several_times(slab, without, directions, order, depth, direct, (upward, downward), (even, odd)))
        largest = [max(np.abs(part).max() for part in both) for both in orders]
        small = small + 1 if largest[-1] <= _NEGLIGIBLE * tolerance * largest[0] else 0
        if small == 2:
            break
    reflected, transmitted = (np.stack(parts) for parts in zip(*orders, strict=True))
    return Solution(slab, directions, without, reflected, transmitted, albedo, passed)


def _below(slab: Slab, directions: Nodes, order: int):
    """What lies under the layer, as a reflection (N, N); None for nothing."""
    if slab.base is None:
        return np.diag(directions.reflected) if slab.index != 1 else None
    flux = np.sqrt(directions.flux)
    return slab.base * flux[:, None] * flux if order == 0 else None


def _shares(slab: Slab, directions: Nodes, upward, downward):
    """Shares (N,) of the light of the nodes that come back and that pass."""
    leaving = directions.leaving
    inward = 1 - directions.reflected[:leaving]
    flux = np.sqrt(directions.flux[:leaving])
    back, through = (inward * ((inward * flux) @ part[:leaving, :leaving]) / flux for part in (upward, downward))
    return directions.reflected[:leaving] + back, through if slab.base is None else np.zeros(leaving)


def _several_times(slab: Slab, without: Cut, directions: Nodes, order: int, depth: float, direct, light, phase):
    """Upward and downward light of one order without what is mirrored or scattered once, each (N, N).

    light : upward and downward;  phase : even and odd part
    """
    (upward, downward), (even, odd) = light, phase
    keep = slice(directions.leaving)
    mu, flux, direct = directions.mu[keep], directions.flux[keep], direct[keep]
    mirror = directions.reflected[keep] if slab.base is None else np.zeros(len(mu))
    mirrored = direct / (1 - (mirror * direct) ** 2)
    weight = np.sqrt(flux)[:, None] * np.sqrt(flux)
    up = (upward[keep, keep] - np.diag(mirrored * mirror * direct)) / weight
    down = (downward[keep, keep] - np.diag(mirrored)) / weight if slab.base is None else np.zeros_like(up)
    out, into, quarter = mu[:, None], mu[None, :], 0.25 * without.albedo
    up -= quarter * (even - odd)[keep, keep] * single.upward(out, into, depth)
    if slab.base is None:
        down -= quarter * (even + odd)[keep, keep] * single.downward(out, into, depth)
    elif order == 0:
        up -= slab.base * direct[:, None] * direct
    return tuple(0.5 * (part + part.T) * (out + into) for part in (up, down))
