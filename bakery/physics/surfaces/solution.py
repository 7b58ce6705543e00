"""A plane layer of a medium under a smooth boundary, or none, solved at nodes, and looked up at any angles.

The part that is scattered once is exact: at the nodes that of the cut phase function is taken out, and where it is looked up that
of the full one is put in, with optical depths without the peak (TMS, Nakajima and Tanaka 1988).  What is left is smooth.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from bakery.physics.medium.phase import phase_at
from bakery.physics.surfaces import fresnel, single
from bakery.physics.surfaces.covered import Covered, covered
from bakery.physics.surfaces.cut import Cut, cut
from bakery.physics.surfaces.deep import ITERATED, Deep, layer_of_order
from bakery.physics.surfaces.layer import Layer, between
from bakery.physics.surfaces.nodes import SPARE, Nodes, coordinate, enough, interpolation, nodes, sines, vanishing
from bakery.physics.surfaces.orders import phase_matrices, unresolved
from bakery.physics.surfaces.slab import Slab
from bakery.physics.surfaces.stack import Stacked, stacked

_LEAST_NODES = 24
_NEGLIGIBLE = 1e-3  # of the tolerance: a Fourier order below that twice in a row ends their sum
# pairs over nodes, from which on they take a finer grid; its points over nodes, its neighbours of a pair each way, and Fourier
# orders at once (even, for memory)
_MANY, _FINER, _NEIGHBOURS, _AT_ONCE = 64, 4, 8, 32


@dataclass(frozen=True)
class Solution:
    """Reflection and transmission of a slab: radiance out = (1 / pi) int R mu0 L0 dmu0 dphi; the BRDF is R / pi."""

    slab: Slab
    nodes: Nodes
    cut: Cut
    # reflected, transmitted: (M, N, N) Fourier orders of what is scattered more than once, inside of the boundary, times the sum
    # of the cosines inside, over `single.interacts` of both and, of odd orders, over both sines: smooth, however thin the layer
    # is, and near normal incidence too
    reflected: np.ndarray
    transmitted: np.ndarray
    albedo: np.ndarray  # (N,) share of light from the nodes' directions in air that comes back, mirrored light included
    passed: np.ndarray  # (N,) share that leaves below, unscattered light included; 0 over a base

    @property
    def spherical_albedo(self) -> float:
        """Of light from all sides."""
        return self.nodes.mean(self.albedo)

    def reflection(self, mu, mu0, phi):
        """R at cosines in air above 0 and azimuths (0: forward); without mirrored light.  Arguments broadcast."""
        return self._value(self.reflected, mu, mu0, phi, -1)

    def transmission(self, mu, mu0, phi):
        """The same of light that leaves below, 0 over a base; unscattered light left out.

        Within the peak that is cut off (`cut.share` of the light) it counts light that the peak deflects several times as if
        once.
        """
        if self.slab.base is not None or self.slab.depth == math.inf:
            return np.zeros(np.broadcast_shapes(*map(np.shape, (mu, mu0, phi))))
        return self._value(self.through, mu, mu0, phi, 1)

    @property
    def through(self):
        """`transmitted` without the sum of the cosines: light that grazes on both ways leaves no smaller share of them."""
        mu = self.nodes.mu[:self.nodes.leaving]
        return self.transmitted / (mu[:, None] + mu)

    def factor(self, mu, mu0, side: int):
        """What the sum of Fourier orders counts by, in reflection (side -1) or transmission (1); arguments as there."""
        n, depth = self.slab.index, self.slab.depth * self.cut.shrinks if self.slab.depth else 0.0
        inner, inner0 = fresnel.inside(mu, n), fresnel.inside(mu0, n)
        through = (1 - fresnel.reflected(mu, n)) * (1 - fresnel.reflected(mu0, n)) / n**2
        return through * single.interacts(inner, depth) * single.interacts(inner0, depth) / (inner + inner0)

    def _terms(self, orders, mu, mu0):
        """Fourier orders (M, K) at pairs of cosines (K,) in air, each cosine interpolated once."""
        (out, row), (into, column) = (np.unique(cosine, return_inverse=True) for cosine in (mu, mu0))
        # few cosines in many pairs: between all of them first
        crossed = len(out) * len(into) <= 2 * len(mu)
        if not crossed and len(mu) > _MANY * self.nodes.leaving:
            return self._terms_of_many(orders, mu, mu0)
        spans = [(span, vanishing(span, self.nodes.air, cosine)) for cosine in (out, into)
                for span in (interpolation(self.nodes.at, coordinate(cosine, self.slab.index)),)]
        terms = np.empty((len(orders), len(mu)))
        for which, falling in ((slice(1), 0), (slice(1, None, 2), 0), (slice(2, None, 2), 1)):
            out, into = (span[falling] for span in spans)
            if crossed:
                terms[which] = (out @ orders[which] @ into.T)[:, row, column]
            else:
                for number in range(len(orders))[which]:
                    terms[number] = np.einsum("ki,ki->k", (out @ orders[number])[row], into[column])
        terms[1::2] *= sines(mu, mu0, self.slab.index)
        return terms

    def _terms_of_many(self, orders, mu, mu0):
        """The same from a finer grid, even in the angle of cosine 1 - 2 s: in that, polynomials of s are waves, which neighbours
        tell to 1e-6."""
        count, waves = _FINER * self.nodes.leaving, np.arange(len(orders))
        fine = interpolation(self.nodes.at, np.sin(0.5 * math.pi * (np.arange(count) + 0.5) / count) ** 2)
        (out, weight_out), (into, weight_in) = (_neighbours(coordinate(cosine, self.slab.index), count) for cosine in (mu, mu0))
        weights, points = weight_out[:, :, None] * weight_in[:, None], out[:, :, None] * count + into[:, None]
        rows = np.arange(0, points.size + 1, _NEIGHBOURS**2)
        between = csr_array((weights.ravel(), points.ravel(), rows), shape=(len(mu), count**2))
        even = ((waves > 0) & (waves % 2 == 0))[:, None, None]
        falling = (1 - self.nodes.air) * (1 + self.nodes.air)
        terms, scaled = np.empty((len(orders), len(mu))), orders / np.where(even, falling * falling[:, None], 1.0)
        for start in range(0, len(orders), _AT_ONCE):
            part = fine @ scaled[start : start + _AT_ONCE] @ fine.T
            terms[start : start + _AT_ONCE] = (between @ part.reshape(len(part), -1).T).T
        terms[2::2] *= (1 - mu * mu) * (1 - mu0 * mu0)
        terms[1::2] *= sines(mu, mu0, self.slab.index)
        return terms

    def _value(self, orders, mu, mu0, phi, side: int):
        mu, mu0, phi = np.broadcast_arrays(*(np.asarray(value, float) for value in (mu, mu0, phi)))
        for cosines in (mu, mu0):
            outside = cosines[~((cosines > 0) & (cosines <= 1))]
            if outside.size:
                raise ValueError(f"cosine {outside.flat[0]:g} of a direction; above 0 and up to 1 would do")
        slab, n = self.slab, self.slab.index
        through = (1 - fresnel.reflected(mu, n)) * (1 - fresnel.reflected(mu0, n)) / n**2
        entering = through > 0
        result = np.zeros(mu.shape)
        if not entering.any():
            return result
        mu, mu0, phi, through = mu[entering], mu0[entering], phi[entering], through[entering]
        inner, inner0 = fresnel.inside(mu, n), fresnel.inside(mu0, n)
        smooth = 0.0
        if len(orders):
            factors, order = np.where(np.arange(len(orders)) == 0, 1.0, 2.0)[:, None], np.arange(len(orders))[:, None]
            smooth = np.sum(factors * self._terms(orders, mu, mu0) * np.cos(order * phi), axis=0)
        depth = slab.depth * self.cut.shrinks
        shape = single.upward if side < 0 else single.downward
        phase = 4 * math.pi * phase_at(slab.theta, slab.phase, single.turned(inner, inner0, phi, side))
        twice = single.interacts(inner, depth) * single.interacts(inner0, depth)
        once = 0.25 * slab.albedo / self.cut.shrinks * phase * shape(inner, inner0, depth)
        if side < 0 and slab.base and depth < math.inf:
            once = once + slab.base * np.exp(-depth * (1 / inner + 1 / inner0))
        result[entering] = through * (smooth * twice / (inner + inner0 if side < 0 else 1.0) + once)
        return result


def _neighbours(s, count: int):
    """Points (K, n) of an even grid of `count` in the angle of cosine 1 - 2 s next to coordinates s (K,), mirrored at its ends,
    and their weights of a polynomial through them (Lagrange)."""
    at = 2 * count / math.pi * np.arcsin(np.sqrt(np.clip(s, 0, 1))) - 0.5
    first = np.floor(at).astype(int) - _NEIGHBOURS // 2 + 1
    away = (at - first)[:, None] - np.arange(_NEIGHBOURS)
    weights = np.empty(away.shape)
    for k in range(_NEIGHBOURS):
        others = np.delete(np.arange(_NEIGHBOURS), k)
        weights[:, k] = np.prod(away[:, others] / (k - others), axis=1)
    points = first[:, None] + np.arange(_NEIGHBOURS)
    points = np.where(points < 0, -1 - points, points)
    return np.where(points >= count, 2 * count - 1 - points, points), weights


def solve(slab: Slab, moments, count: int, tolerance: float = 1e-6) -> Solution | Covered | Stacked:
    """The slab with a given number of Legendre moments.

    moments : at least count + 1 Legendre moments of the phase function; a list of them where other layers are under it
    count : that are carried
    tolerance : relative; Fourier orders that matter less are left out
    """
    if slab.roughness and slab.index != 1:
        return covered(slab, moments, count, tolerance)
    if slab.under is not None:
        return stacked(slab, moments, count, tolerance)
    without = cut(moments, slab.albedo, count)
    # light that passes a peak is told by as many nodes as there are moments
    passes = slab.base is None and slab.depth < math.inf
    directions = nodes(max(_LEAST_NODES, count + SPARE) if passes else enough(count, _LEAST_NODES), slab.index)
    missed = (directions.leaving < count + SPARE) * unresolved(without.moments, directions.mu, directions.flux)
    depth = slab.depth * without.shrinks if slab.depth else 0.0
    several, orders, largest, small = _Several(slab, without, directions), [], [], 0
    for order in range(count):
        even, odd = phase_matrices(without.moments, directions.mu, order)
        accuracy = ITERATED * tolerance * largest[0] if largest else 0.0
        layer = layer_of_order(without, order, (even, odd), missed, (directions.mu, directions.flux), depth, accuracy)
        for part in (even, odd):
            np.einsum("ii->i", part)[:] += missed
        upward, downward = _scattered(slab, directions, order, layer)
        if order == 0:
            albedo, passed = _shares(slab, directions, layer, upward, downward)
        orders.append(several.times(order, upward, downward, even, odd))
        largest.append(max(float(np.abs(part).max()) for part in orders[-1]))
        small = small + 1 if largest[-1] <= _NEGLIGIBLE * tolerance * largest[0] else 0
        if small == 2:
            break
    reflected, transmitted = (np.stack(parts) for parts in zip(*orders, strict=True))
    return Solution(slab, directions, without, reflected, transmitted, albedo, passed)


def _scattered(slab: Slab, directions: Nodes, order: int, layer: Layer | Deep):
    """Light (N, N) inside of the boundary scattered upward at the top, and downward at the bottom.

    What the base sends back of light that is scattered nowhere else is left out.
    """
    if slab.base is None or slab.depth == math.inf:
        return layer.scattered(directions.reflected)
    flux = np.sqrt(directions.flux)
    base = (slab.base if order == 0 else 0.0) * np.outer(flux, flux)
    return between(layer, base, directions.reflected), np.zeros_like(base)


def _shares(slab: Slab, directions: Nodes, layer: Layer, upward, downward):
    """Shares (N,) of the light of the nodes that come back and that pass."""
    keep = slice(directions.leaving)
    inward, flux = 1 - directions.reflected[keep], np.sqrt(directions.flux[keep])
    back, through = (inward * ((inward * flux) @ part[keep, keep]) / flux for part in (upward, downward))
    back = directions.reflected[keep] + back
    if slab.base is not None:
        on = inward * layer.direct[keep]
        return back + slab.base * on * (on @ directions.flux[keep]), through
    mirrored, direct = (inward**2 * part[keep] for part in layer.unscattered(directions.reflected))
    return back + mirrored, through + direct


class _Several:
    """Light without what is scattered once, at the nodes that leave."""

    def __init__(self, slab: Slab, without: Cut, directions: Nodes):
        self.keep, depth = slice(directions.leaving), slab.depth * without.shrinks if slab.depth else 0.0
        mu, flux = directions.mu[self.keep], np.sqrt(directions.flux[self.keep])
        out, into, quarter = mu[:, None], mu, 0.25 * without.albedo
        self.flux, self.passes = flux[:, None] * flux, slab.base is None and depth < math.inf
        self.up = quarter * single.upward(out, into, depth)
        self.down = quarter * single.downward(out, into, depth) if self.passes else None
        share = single.interacts(mu, depth)
        odd = share * np.sqrt((1 - mu) * (1 + mu))
        self.sums = [0.5 * (out + into) / (part[:, None] * part) for part in (share, odd)]

    def times(self, order: int, upward, downward, even, odd):
        """Upward and downward light of one order, each (N, N), from that of all nodes and both parts of the phase function."""
        keep = self.keep
        parts = [upward[keep, keep] / self.flux - (even - odd)[keep, keep] * self.up]
        if self.passes:
            parts.append(downward[keep, keep] / self.flux - (even + odd)[keep, keep] * self.down)
        parts = [(part + part.T) * self.sums[order % 2] for part in parts]
        return parts[0], parts[1] if self.passes else np.zeros_like(parts[0])
