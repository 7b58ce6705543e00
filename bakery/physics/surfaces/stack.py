"""Several plane layers of different media, one on the other, and smooth boundaries where their indices differ.

Nodes go by n sin(theta), which refraction keeps: all media share them, and those of light that a medium is too thin for (total
reflection) come last.  Between two indices nodes are dense at the larger one, where its medium grazes.  In radiance over n^2 the
operators of `layer` are the same on both sides of a boundary, and symmetric for any stack: from the bottom up, each order is what
is only mirrored, D, a number a node, and what is scattered, S.  Neither is a difference of larger numbers.

As in `solution`, light that is scattered once in any of the layers, or sent back by a base that it reaches without, is exact at
every angle; the rest is smooth.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from bakery.physics.medium.phase import phase_at
from bakery.physics.surfaces import fresnel, single
from bakery.physics.surfaces.cut import Cut, cut
from bakery.physics.surfaces.deep import ITERATED, Deep, layer_of_order
from bakery.physics.surfaces.layer import Layer
from bakery.physics.surfaces.nodes import SPARE, Nodes, coordinate, enough, grazing, interpolation, vanishing
from bakery.physics.surfaces.orders import phase_matrices, unresolved
from bakery.physics.surfaces.slab import Reflector, Slab

_LEAST_NODES, _FEWEST = 24, 8
_NEGLIGIBLE = 1e-3  # of the tolerance: a Fourier order below that twice in a row ends their sum


def layers(slab: Slab) -> tuple[list[Slab], Reflector | float | None]:
    """Media of a stack from the top, and what is under them: a reflector, the albedo of a matt base, None: nothing is reached.

    Raises
    ------
    ValueError : a free stack; an index below 1; facets between media
    """
    parts = [slab]
    while isinstance(parts[-1].under, Slab):
        parts.append(parts[-1].under)
    last = parts[-1]
    if any(part.index < 1 for part in parts):
        raise ValueError("media of a stack have an index of 1 or more")
    if any(part.roughness > 0 and part.index != 1 for part in parts):
        raise ValueError("boundaries of a stack are smooth")
    if last.depth == math.inf:
        return parts, None
    if last.under is None and last.base is None:
        raise ValueError("a stack has a base, or its last layer is infinite")
    return parts, last.under or last.base


@dataclass(frozen=True)
class Directions:
    """Nodes that media of several indices share.

    Attributes
    ----------
    above : (K,) squared index at which the medium grazes that is next to the node
    cosine : (K,) times that index, its cosine there
    etendue : (K,) d(n^2 sin^2), share of a hemisphere of air
    top : the first medium's own
    """

    above: np.ndarray
    cosine: np.ndarray
    etendue: np.ndarray
    top: Nodes

    def mu(self, index: float):
        """Cosines in a medium, of those nodes that it has."""
        keep = self.above <= index * index
        return np.sqrt(index * index - self.above[keep] + self.cosine[keep] ** 2) / index

    def flux(self, index: float):
        """Shares of the flux of isotropic light in a medium."""
        return self.etendue[self.above <= index * index] / index**2


def directions(count: int, indices: Sequence[float]) -> Directions:
    """Nodes of a stack, `count` of them leave.

    Parameters
    ----------
    indices : of the media from the top, 1 or more
    """
    ends = sorted({1.0, *indices})
    if indices[0] == 1:
        air, weight, at = grazing(count)
    else:
        x, weight = np.polynomial.legendre.leggauss(count)
        air = at = 0.5 * (1 + x)
        weight = 0.5 * weight
    parts = [(np.ones(count), air, 2 * air * weight)]
    for low, high in zip(ends, ends[1:]):
        limit = math.sqrt((1 - low / high) * (1 + low / high))
        mu, weight, _ = grazing(max(_FEWEST, math.ceil(count * limit)), limit)
        parts.append((np.full(len(mu), high * high), high * mu, 2 * mu * weight * high * high))
    above, cosine, etendue = (np.concatenate(column) for column in zip(*parts, strict=True))
    index = indices[0]
    keep = above <= index * index
    mirrored = np.concatenate([fresnel.reflected(air, index), np.ones(int(keep.sum()) - count)])
    inner = np.sqrt(index * index - above[keep] + cosine[keep] ** 2) / index
    return Directions(above, cosine, etendue, Nodes(inner, etendue[keep] / index**2, air, mirrored, at, index))


@dataclass(frozen=True)
class Stacked:
    """Reflection of a stack: radiance out = (1 / pi) int R mu0 L0 dmu0 dphi; the BRDF is R / pi.

    Attributes
    ----------
    slab : the uppermost layer, `under` which the others are
    cuts : of all layers, from the top
    reflected : (M, N, N) Fourier orders of what is scattered more than once, inside of the uppermost boundary, times the sum of
        the cosines there and, of odd orders, over both sines
    albedo : (N,) share of light from the nodes' directions in air that comes back, mirrored light included
    mirrored : (N,) of it, what boundaries between the layers send back unscattered
    """

    slab: Slab
    nodes: Nodes
    cuts: tuple[Cut, ...]
    reflected: np.ndarray
    albedo: np.ndarray
    mirrored: np.ndarray

    @property
    def cut(self) -> Cut:
        """Of the uppermost layer."""
        return self.cuts[0]

    @property
    def passed(self) -> np.ndarray:
        return np.zeros_like(self.albedo)

    @property
    def spherical_albedo(self) -> float:
        flux = self.nodes.flux[:self.nodes.leaving]
        return float(flux @ self.albedo / flux.sum())

    def reflection(self, mu, mu0, phi):
        """R at cosines in air above 0 and azimuths (0: forward); without mirrored light.  Arguments broadcast."""
        mu, mu0, phi = np.broadcast_arrays(*(np.asarray(value, float) for value in (mu, mu0, phi)))
        if not (((mu > 0) & (mu <= 1)).all() and ((mu0 > 0) & (mu0 <= 1)).all()):
            raise ValueError("cosines of directions lie above 0 and do not exceed 1")
        n = self.nodes.index
        return (1 - fresnel.reflected(mu, n)) * (1 - fresnel.reflected(mu0, n)) / n**2 * self.inside(mu, mu0, phi)

    def factor(self, mu, mu0, side: int):
        """What the sum of Fourier orders counts by."""
        n = self.nodes.index
        through = (1 - fresnel.reflected(mu, n)) * (1 - fresnel.reflected(mu0, n)) / n**2
        return through / (fresnel.inside(mu, n) + fresnel.inside(mu0, n))

    def inside(self, mu, mu0, phi):
        """The same inside of the uppermost boundary, at directions that are those in air; arrays of one shape."""
        n = self.nodes.index
        (out, row), (into, column) = (np.unique(cosine, return_inverse=True) for cosine in (mu, mu0))
        spans = [(span, vanishing(span, self.nodes.air, cosine)) for cosine in (out, into)
                for span in (interpolation(self.nodes.at, coordinate(cosine, n)),)]
        smooth, sines = np.zeros(mu.shape), np.sqrt((1 - mu * mu) * (1 - mu0 * mu0)) / n**2
        for m, order in enumerate(self.reflected):
            out, into = (span[m > 1 and m % 2 == 0] for span in spans)
            term = np.einsum("...i,...i->...", (out @ order)[row.reshape(mu.shape)], into[column.reshape(mu.shape)])
            smooth += (2.0 if m else 1.0) * term * np.cos(m * phi) * (sines if m % 2 else 1.0)
        return smooth / (fresnel.inside(mu, n) + fresnel.inside(mu0, n)) + self.exact(mu, mu0, phi)

    def transmission(self, mu, mu0, phi):
        """0: what is under a stack is infinite, or sends back."""
        return np.zeros(np.broadcast_shapes(*map(np.shape, (mu, mu0, phi))))

    def exact(self, mu, mu0, phi):
        """What is exact at every angle, inside of the uppermost boundary."""
        total, there, below = 0.0, _reached(self.slab, self.cuts, mu), None
        for (part, without, inner, share), (*_, inner0, share0) in zip(there, _reached(self.slab, self.cuts, mu0)):
            phase = 4 * math.pi * phase_at(part.theta, part.phase, single.turned(inner, inner0, phi, -1))
            depth = part.depth * without.shrinks if part.depth else 0.0
            total = total + 0.25 * part.albedo / without.shrinks * phase * single.upward(inner, inner0, depth) * share * share0
            below = part, share * share0 * np.exp(-depth * (1 / inner + 1 / inner0)) if depth < math.inf else 0.0
        return total + (below[0].base or 0.0) * below[1]


def _reached(slab: Slab, cuts: Sequence[Cut], mu) -> Iterator[tuple]:
    """Of each layer: itself, its cut, cosines in it, and the share of light that gets there unscattered, times n / n_top."""
    (parts, _), n = layers(slab), slab.index
    share, inner = np.ones(np.shape(mu)), fresnel.inside(mu, n)
    for k, (part, without) in enumerate(zip(parts, cuts, strict=True)):
        if k:
            above = parts[k - 1]
            depth = above.depth * cuts[k - 1].shrinks if above.depth else 0.0
            cosine = fresnel.inside(mu, part.index)
            share = share * np.exp(-depth / inner) * (1 - _mirrored(above.index, inner, part.index, cosine))
            inner = cosine
        yield part, without, inner, share * (n / part.index)


def _mirrored(index, mu, index_below, mu_below):
    """Share that a boundary reflects, from the cosines on both sides."""
    if index == index_below:
        return np.zeros_like(mu)
    across = (index * mu - index_below * mu_below) / (index * mu + index_below * mu_below)
    along = (index_below * mu - index * mu_below) / (index_below * mu + index * mu_below)
    return 0.5 * (across**2 + along**2)


# ---- solution


def stacked(slab: Slab, moments: Sequence, count: int, tolerance: float = 1e-6) -> Stacked:
    """A stack with a given number of Legendre moments.

    Parameters
    ----------
    moments : of each medium from the top, at least count + 1 Legendre moments of the phase function
    count : that are carried
    tolerance : relative; Fourier orders that matter less are left out
    """
    parts, bottom = layers(slab)
    cuts = tuple(cut(row, part.albedo, count) for row, part in zip(moments, parts, strict=True))
    nodes = directions(enough(count, _LEAST_NODES), [part.index for part in parts])
    top, exact = nodes.top, _Exact(nodes, parts, cuts)
    keep = slice(top.leaving)
    mu, flux, through = top.mu[keep], np.sqrt(top.flux[keep]), 1 - top.reflected[keep]
    missed = _missed(nodes, parts, cuts, top.leaving < count + SPARE)
    sums, sines, orders, largest, small = mu[:, None] + mu, np.sqrt((1 - mu) * (1 + mu)), [], [], 0
    for order in range(count):
        phases = [phase_matrices(without.moments, nodes.mu(part.index), order)
                  for part, without in zip(parts, cuts, strict=True)]
        accuracy = ITERATED * tolerance * largest[0] if order else 0.0
        media = [_of_order(nodes, *medium, order, accuracy) for medium in zip(parts, cuts, phases, missed, strict=True)]
        mirrored, scattered = _below(nodes, parts, media, bottom, order)
        upward = _escaping(mirrored, scattered, top.reflected)[keep, keep]
        if order == 0:
            again = through**2 * mirrored[keep] / (1 - top.reflected[keep] * mirrored[keep])
            albedo = top.reflected[keep] + through * ((through * flux) @ upward) / flux + again
        phases = [[side + np.diag(peak) for side in pair] for pair, peak in zip(phases, missed, strict=True)]
        rest = upward / np.outer(flux, flux) - exact.of(phases, order)
        orders.append(0.5 * (rest + rest.T) * sums / (np.outer(sines, sines) if order % 2 else 1.0))
        largest.append(float(np.abs(orders[-1]).max()))
        small = small + 1 if largest[-1] <= _NEGLIGIBLE * tolerance * largest[0] else 0
        if small == 2:
            break
    return Stacked(slab, top, cuts, np.stack(orders), albedo, again)


def _missed(nodes: Directions, parts, cuts, few: bool) -> list:
    """Of each layer, what its nodes miss of a forward peak (`orders.unresolved`); 0 where they are not too few."""
    return [few * unresolved(without.moments, nodes.mu(part.index), nodes.flux(part.index))
            for part, without in zip(parts, cuts, strict=True)]


def _of_order(nodes: Directions, part: Slab, without: Cut, phases, missed, order: int, accuracy: float) -> Layer | Deep:
    """One layer."""
    depth = part.depth * without.shrinks if part.depth else 0.0
    return layer_of_order(without, order, phases, missed, (nodes.mu(part.index), nodes.flux(part.index)), depth, accuracy)


def _below(nodes: Directions, parts, media, bottom, order: int):
    """What is under the uppermost boundary, inside of it: D (N,) and S (N, N)."""
    if isinstance(bottom, Reflector):
        index, scattered = 1.0, bottom.matrix(nodes.mu(1.0), nodes.flux(1.0), order)
    else:
        index, root = parts[-1].index, np.sqrt(nodes.flux(parts[-1].index))
        scattered = (bottom or 0.0) * np.outer(root, root) * (order == 0)
    mirrored = np.zeros(len(scattered))
    for part, layer in zip(parts[::-1], media[::-1], strict=True):
        if part.index != index:
            mirrored, scattered = _across(nodes, part.index, index, mirrored, scattered)
            index = part.index
        mu = nodes.mu(index)
        reflection, down = layer.scattered(np.zeros(len(mu)))
        if part.depth == math.inf:
            mirrored, scattered = np.zeros(len(mu)), reflection
            continue
        whole = scattered + np.diag(mirrored)
        again = whole @ reflection @ np.linalg.solve(np.eye(len(mu)) - whole @ reflection, whole)
        # all that comes up to the layer's lower face, and what of it is scattered
        returned, direct = whole + again, layer.direct
        returned_scattered = scattered + again
        scattered = reflection + down.T @ returned @ (down + np.diag(direct)) + direct[:, None] * (returned @ down) \
            + direct[:, None] * returned_scattered * direct
        mirrored = direct**2 * mirrored
    return mirrored, scattered


def _across(nodes: Directions, above: float, below: float, mirrored, scattered):
    """D and S of what is under a boundary, seen from above it; indices of the media above and below."""
    mu, mu_below = nodes.mu(above), nodes.mu(below)
    shared = min(len(mu), len(mu_below))
    share = _mirrored(above, mu[:shared], below, mu_below[:shared])
    inside, outside = np.ones(len(mu_below)), np.ones(len(mu))
    inside[:shared] = outside[:shared] = share
    through = 1 - share
    result = np.zeros((len(mu), len(mu)))
    result[:shared, :shared] = np.outer(through, through) * _escaping(mirrored, scattered, inside)[:shared, :shared]
    outside[:shared] += through**2 * mirrored[:shared] / (1 - share * mirrored[:shared])
    return outside, result


def _escaping(mirrored, scattered, boundary):
    """Scattered light that comes up to a boundary in all, of light that entered through it: what it sends back comes again.

    With W = D + S and the boundary's r that is W / (1 - r W) without D / (1 - r D), and no difference of the two.
    """
    # between two boundaries that reflect totally nothing is lost, and nothing scattered gets there
    boundary = np.where(boundary * mirrored < 1, boundary, 0.0)
    whole = scattered + np.diag(mirrored)
    result = np.linalg.solve((np.eye(len(whole)) - boundary[:, None] * whole).T, scattered.T).T
    return result / (1 - mirrored * boundary)[:, None]


class _Exact:
    """At the nodes that leave, what `Stacked.exact` is with the cut phase functions."""

    def __init__(self, nodes: Directions, parts, cuts):
        air, keep = nodes.top.air, slice(nodes.top.leaving)
        self.keep, self.factors, self.base = keep, [], 0.0
        for part, without, inner, share in _reached(parts[0], cuts, air):
            depth = part.depth * without.shrinks if part.depth else 0.0
            shape = single.upward(inner[:, None], inner, depth) * np.outer(share, share)
            self.factors.append(0.25 * without.albedo * shape)
            if depth < math.inf and part.base:
                out = share * np.exp(-depth / inner)
                self.base = part.base * np.outer(out, out)

    def of(self, phases, order: int):
        """(N, N) of one Fourier order."""
        once = sum(factor * (even - odd)[self.keep, self.keep] for factor, (even, odd) in zip(self.factors, phases, strict=True))
        return once + self.base if order == 0 else once
