"""Several plane layers of different media, one on the other, and boundaries where their indices differ, smooth or rough.

As in `solution`, light that is scattered once in any of the layers, sent back by a base that it reaches without, or by the
uppermost facets between them, is exact at every angle; the rest is smooth (`adding`).  Nothing is taken out of light from under
facets.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from bakery.physics.medium.phase import phase_at
from bakery.physics.surfaces import fresnel, rough, single
from bakery.physics.surfaces.adding import below, down, escaping, of_order
from bakery.physics.surfaces.cut import Cut, cut
from bakery.physics.surfaces.deep import ITERATED
from bakery.physics.surfaces.facets import boundaries, grids
from bakery.physics.surfaces.nodes import SPARE, Nodes, coordinate, enough, interpolation, sines, vanishing
from bakery.physics.surfaces.orders import unresolved
from bakery.physics.surfaces.shared import Directions
from bakery.physics.surfaces.slab import Slab, facets_on, free, layers, rough_within

_LEAST_NODES = 24
_NEGLIGIBLE = 1e-3  # of the tolerance: a Fourier order below that twice in a row ends their sum


@dataclass(frozen=True)
class Stacked:
    """Reflection of a stack: radiance out = (1 / pi) int R mu0 L0 dmu0 dphi; the BRDF is R / pi."""

    slab: Slab  # the uppermost layer, `under` which the others are
    nodes: Nodes
    cuts: tuple[Cut, ...]  # of all layers, from the top
    # (M, N, N) Fourier orders of what is scattered more than once, inside of the uppermost boundary, times the sum of the cosines
    # there and, of odd orders, over both sines
    reflected: np.ndarray
    albedo: np.ndarray  # (N,) share of light from the nodes' directions in air that comes back, mirrored light included
    mirrored: np.ndarray  # (N,) of it, what boundaries between the layers send back unscattered
    # (M, N, N) of what leaves below by more than one scattering, rows the directions of exitance, over `factor` and, of odd
    # orders, over both sines as above; zeros where nothing does
    transmitted: np.ndarray
    passed: np.ndarray  # (N,) share that leaves below, unscattered light included

    @property
    def cut(self) -> Cut:
        """Of the uppermost layer."""
        return self.cuts[0]

    @property
    def spherical_albedo(self) -> float:
        return self.nodes.mean(self.albedo)

    def reflection(self, mu, mu0, phi):
        """R at cosines in air above 0 and azimuths (0: forward); without mirrored light.  Arguments broadcast."""
        mu, mu0, phi = np.broadcast_arrays(*(np.asarray(value, float) for value in (mu, mu0, phi)))
        if not (((mu > 0) & (mu <= 1)).all() and ((mu0 > 0) & (mu0 <= 1)).all()):
            raise ValueError("cosines of directions lie above 0 and do not exceed 1")
        return self.boundaries(mu, mu0, -1) * self.inside(mu, mu0, phi)

    def factor(self, mu, mu0, side: int):
        """What the sum of Fourier orders counts by, in reflection (side -1) or transmission (1)."""
        n = self.nodes.index
        last = n if side < 0 else layers(self.slab)[0][-1].index
        return self.boundaries(mu, mu0, side) / (fresnel.inside(mu, last) + fresnel.inside(mu0, n))

    def boundaries(self, mu, mu0, side: int = 1):
        """Share that the uppermost boundary lets in and, of what leaves below (side 1) or above, the last one out."""
        n = self.nodes.index
        last = n if side < 0 else layers(self.slab)[0][-1].index
        return (1 - fresnel.reflected(mu, last)) * (1 - fresnel.reflected(mu0, n)) / (n * last)

    def inside(self, mu, mu0, phi):
        """The same inside of the uppermost boundary, at directions that are those in air; arrays of one shape."""
        n = self.nodes.index
        smooth = self._smooth(self.reflected, mu, mu0, phi)
        return smooth / (fresnel.inside(mu, n) + fresnel.inside(mu0, n)) + self.exact(mu, mu0, phi)

    def _smooth(self, orders, mu, mu0, phi):
        """The sum of Fourier orders."""
        n = self.nodes.index
        (out, row), (into, column) = (np.unique(cosine, return_inverse=True) for cosine in (mu, mu0))
        spans = [(span, vanishing(span, self.nodes.air, cosine)) for cosine in (out, into)
                for span in (interpolation(self.nodes.at, coordinate(cosine, n)),)]
        smooth, odd = np.zeros(mu.shape), sines(mu, mu0, n)
        row, column = row.reshape(mu.shape), column.reshape(mu.shape)
        grid = len(out) * len(into) <= mu.size  # most pairs of cosines occur: those of a table, at each of its azimuths
        for m, order in enumerate(orders):
            out, into = (span[m > 1 and m % 2 == 0] for span in spans)
            term = (out @ order @ into.T)[row, column] if grid else np.einsum("...i,...i->...", (out @ order)[row], into[column])
            smooth += (2.0 if m else 1.0) * term * np.cos(m * phi) * (odd if m % 2 else 1.0)
        return smooth

    def transmission(self, mu, mu0, phi):
        """The same of light that leaves below, at mu; unscattered light left out."""
        mu, mu0, phi = np.broadcast_arrays(*(np.asarray(value, float) for value in (mu, mu0, phi)))
        if not free(self.slab):
            return np.zeros(mu.shape)
        if not (((mu > 0) & (mu <= 1)).all() and ((mu0 > 0) & (mu0 <= 1)).all()):
            raise ValueError("cosines of directions lie above 0 and do not exceed 1")
        out, into = (fresnel.inside(self.nodes.air, index) for index in (layers(self.slab)[0][-1].index, self.nodes.index))
        result = self.boundaries(mu, mu0) * self._smooth(self.transmitted / (out[:, None] + into), mu, mu0, phi)
        for part, without, inner, inner0, weight in _once_through(self.slab, self.cuts, mu, mu0):
            turned = single.turned(inner, inner0, phi, 1)
            result += 0.25 * part.albedo / without.shrinks * 4 * math.pi * phase_at(part.theta, part.phase, turned) * weight
        return result

    def exact(self, mu, mu0, phi):
        """What is exact at every angle, inside of the uppermost boundary."""
        (parts, _), total, number = layers(self.slab), 0.0, 0
        outward, inward = _reached(parts, self.cuts, mu), _reached(parts, self.cuts, mu0)
        for (part, without, inner, share), (*_, inner0, share0) in zip(outward, inward, strict=True):
            phase = 4 * math.pi * phase_at(part.theta, part.phase, single.turned(inner, inner0, phi, -1))
            depth = part.depth * without.shrinks if part.depth else 0.0
            total = total + 0.25 * part.albedo / without.shrinks * phase * single.upward(inner, inner0, depth) * share * share0
            number += 1
        if part.depth == math.inf:
            return total
        passed = share * share0 * np.exp(-depth * (1 / inner + 1 / inner0))
        if number == len(parts):
            return total + (part.base or 0.0) * passed
        below = parts[number]
        return total + rough.reflected(inner, inner0, phi, below.index / part.index, below.roughness) * passed


def _once_through(slab: Slab, cuts: Sequence[Cut], mu, mu0) -> Iterator[tuple]:
    """Of each layer of a free stack: itself, its cut, cosines in it, and what a quarter of the phase function counts by."""
    parts, _ = layers(slab)
    n, last = slab.index, parts[-1].index
    boundaries = (1 - fresnel.reflected(mu, last)) * (1 - fresnel.reflected(mu0, n)) / (n * last)
    out = list(_reached(parts[::-1], cuts[::-1], mu))[::-1]
    for (part, without, inner, share), (*_, inner0, share0) in zip(out, _reached(parts, cuts, mu0), strict=True):
        depth = part.depth * without.shrinks if part.depth else 0.0
        yield part, without, inner, inner0, boundaries * share * share0 * single.downward(inner, inner0, depth)


def _reached(parts: Sequence[Slab], cuts: Sequence[Cut], mu) -> Iterator[tuple]:
    """Of each layer down to the first facets: itself, its cut, cosines in it, and the share of light that gets there unscattered,
    times n / n_top."""
    n = parts[0].index
    share, inner = np.ones(np.shape(mu)), fresnel.inside(mu, n)
    for k, (part, without) in enumerate(zip(parts, cuts, strict=True)):
        if k and facets_on(parts, k):
            return
        if k:
            above = parts[k - 1]
            depth = above.depth * cuts[k - 1].shrinks if above.depth else 0.0
            cosine = fresnel.inside(mu, part.index)
            share = share * np.exp(-depth / inner) * (1 - fresnel.between(above.index, inner, part.index, cosine))
            inner = cosine
        yield part, without, inner, share * (n / part.index)


# ---- solution


def stacked(slab: Slab, moments: Sequence, count: int, tolerance: float = 1e-6) -> Stacked:
    """A stack with a given number of Legendre moments.

    moments : of each medium from the top, at least count + 1 Legendre moments of the phase function
    count : that are carried
    tolerance : relative; Fourier orders that matter less are left out
    """
    parts, bottom = layers(slab)
    cuts = tuple(cut(row, part.albedo, count) for row, part in zip(moments, parts, strict=True))
    # light that passes a peak is told by as many nodes as there are moments, and facets see narrow lobes
    leaving = max(_LEAST_NODES, count + SPARE) if free(slab) or rough_within(slab) else enough(count, _LEAST_NODES)
    nets = grids(parts, bottom, leaving)
    nodes, facets = [net.directions() for net in nets], boundaries(parts, nets, count)
    # of each layer, what its nodes miss of a forward peak; 0 where they are not too few
    missed = [(leaving < count + SPARE) * unresolved(without.moments, net.mu(part.index), net.flux(part.index))
              for net, part, without in zip(nodes, parts, cuts, strict=True)]
    top = nodes[0].top(slab.index)
    exact = _Exact(nodes[0], top, parts, cuts, facets)
    orders, largest, small = [], [], 0
    for order in range(count):
        accuracy = ITERATED * tolerance * largest[0] if order else 0.0
        phases, media = of_order(nodes, parts, cuts, missed, order, accuracy)
        mirrored, scattered, downward = below(nodes, parts, media, (bottom, facets), order)
        upward = escaping(mirrored, scattered, top.reflected)[:leaving, :leaving]
        if downward is not None:
            downward = down(nodes[0], 1.0, top.index, mirrored, scattered, downward)
        if order == 0:
            shares = _shares(top, mirrored, upward, downward)
        phases = [[side + np.diag(peak) for side in pair] for pair, peak in zip(phases, missed, strict=True)]
        orders.append(exact.several_times(phases, order, upward, downward))
        largest.append(max(float(np.abs(part).max()) for part in orders[-1]))
        small = small + 1 if largest[-1] <= _NEGLIGIBLE * tolerance * largest[0] else 0
        if small == 2:
            break
    reflected, transmitted = (np.stack(part) for part in zip(*orders, strict=True))
    albedo, again, passed = shares
    return Stacked(slab, top, cuts, reflected, albedo, again, transmitted, passed)


def _shares(top: Nodes, mirrored, upward, downward):
    """Shares (N,) of the light of the nodes that come back, of them those that are only mirrored below, and that leave below."""
    keep = slice(top.leaving)
    flux, through = np.sqrt(top.flux[keep]), 1 - top.reflected[keep]
    again = through**2 * mirrored[keep] / (1 - top.reflected[keep] * mirrored[keep])
    passed = np.zeros(top.leaving)
    if downward is not None:
        direct, scattered = downward
        air = flux * top.index  # of the flux in air, but for the same factor
        passed = direct + (air @ scattered) / air
    return top.reflected[keep] + through * ((through * flux) @ upward) / flux + again, again, passed


class _Exact:
    """At the nodes that leave, what is exact at every angle, with the cut phase functions; and what is left without it."""

    def __init__(self, nodes: Directions, top: Nodes, parts, cuts, facets):
        air, self.keep = top.air, slice(top.leaving)
        self.mu, self.flux, self.air_flux = top.mu[self.keep], top.flux[self.keep], nodes.flux(1.0)
        self.sines = np.sqrt((1 - self.mu) * (1 + self.mu))
        self.upward, self.base, self.downward, self.facets = [], 0.0, [], None
        for k, (part, without, inner, share) in enumerate(_reached(parts, cuts, air)):
            depth = part.depth * without.shrinks if part.depth else 0.0
            shape = single.upward(inner[:, None], inner, depth) * np.outer(share, share)
            self.upward.append(0.25 * without.albedo * shape)
            if depth < math.inf and part.base:
                out = share * np.exp(-depth / inner)
                self.base = part.base * np.outer(out, out)
            if depth < math.inf and k + 1 < len(parts) and facets[k + 1] is not None:
                out = share * np.exp(-depth / inner) / np.sqrt(nodes.flux(part.index)[self.keep])
                self.facets = facets[k + 1].above[:, self.keep, self.keep] * np.outer(out, out)
        if free(parts[0]):
            n, last, out = parts[0].index, parts[-1].index, air[:, None]
            through = (1 - fresnel.reflected(out, last)) * (1 - fresnel.reflected(air, n)) / (n * last)
            self.factor = through / (fresnel.inside(out, last) + fresnel.inside(air, n))
            self.downward = [0.25 * without.albedo * weight for _, without, *_, weight in _once_through(parts[0], cuts, out, air)]

    def several_times(self, phases, order: int, upward, downward):
        """One Fourier order of light scattered more than once, (N, N) each as `Stacked` has it."""
        keep, sines = self.keep, np.outer(self.sines, self.sines) if order % 2 else 1.0
        once = sum(factor * (even - odd)[keep, keep] for factor, (even, odd) in zip(self.upward, phases))  # to the first facets
        if self.facets is not None:
            once = once + self.facets[order]
        smooth = upward / np.sqrt(np.outer(self.flux, self.flux)) - (once + self.base if order == 0 else once)
        reflected = 0.5 * (smooth + smooth.T) * (self.mu[:, None] + self.mu) / sines
        if downward is None:
            return reflected, np.zeros_like(reflected)
        once = sum(factor * (even + odd)[keep, keep] for factor, (even, odd) in zip(self.downward, phases, strict=True))
        flux = np.sqrt(np.outer(self.air_flux, self.air_flux))
        return reflected, (downward[1] / flux - once) / self.factor / sines
