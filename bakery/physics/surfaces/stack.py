"""Several plane layers of different media, one on the other, and smooth boundaries where their indices differ.

Nodes go by n sin(theta), which refraction keeps: all media share them, and those of light that a medium is too thin for (total
reflection) come last.  Between two indices nodes are dense at the larger one, where its medium grazes.  In radiance over n^2 the
operators of `layer` are the same on both sides of a boundary, and symmetric for any stack: from the bottom up, each order is what
is only mirrored, D, a number a node, and what is scattered, S.  Neither is a difference of larger numbers.  Over air, what leaves
below is kept in the same way, light that passed unscattered apart; it is not symmetric: the other way is that of the stack upside
down.

As in `solution`, light that is scattered once in any of the layers, or sent back by a base that it reaches without, is exact at
every angle; the rest is smooth.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bakery.physics.medium.phase import phase_at
from bakery.physics.surfaces import fresnel, single
from bakery.physics.surfaces.cut import Cut, cut
from bakery.physics.surfaces.deep import ITERATED, Deep, layer_of_order
from bakery.physics.surfaces.layer import Layer
from bakery.physics.surfaces.nodes import SPARE, Nodes, coordinate, enough, grazing, interpolation, sines, vanishing
from bakery.physics.surfaces.orders import phase_matrices, unresolved
from bakery.physics.surfaces.slab import Reflector, Slab

_LEAST_NODES, _FEWEST = 24, 8
_NEGLIGIBLE = 1e-3  # of the tolerance: a Fourier order below that twice in a row ends their sum


def layers(slab: Slab) -> tuple[list[Slab], Reflector | float | None]:
    """Media of a stack from the top, and what is under them: a reflector, the albedo of a matt base, None: nothing, or air.

    Raises
    ------
    ValueError : an index below 1; facets between media
    """
    parts = [slab]
    while isinstance(parts[-1].under, Slab):
        parts.append(parts[-1].under)
    last = parts[-1]
    if len(parts) > 1 and any(part.index < 1 for part in parts):
        raise ValueError("media of a stack have an index of 1 or more")
    if any(part.roughness > 0 and part.index != 1 for part in parts[1:]):
        raise ValueError("boundaries between the media of a stack are smooth")
    if last.depth == math.inf:
        return parts, None
    return parts, last.base if last.under is None else last.under


def under_facets(slab: Slab) -> Slab:
    """A stack as light inside of its uppermost medium sees it: indices are over that of this medium, which has no boundary.

    Raises
    ------
    ValueError : air below; an index below that of the uppermost medium
    """
    if free(slab):
        raise ValueError("a layer under a rough boundary has a base or is infinite")

    def relative(part: Slab) -> Slab:
        under = relative(part.under) if isinstance(part.under, Slab) else part.under
        if part.index < slab.index * (1 - 1e-9) or isinstance(under, Reflector) and slab.index != 1:
            raise ValueError("under a rough boundary no medium has a lower index than the uppermost one")
        return replace(part, index=max(part.index / slab.index, 1.0), roughness=part.roughness * (part is not slab), under=under)

    return relative(slab)


def free(slab: Slab) -> bool:
    """Whether air is below a layer, or below a stack."""
    while isinstance(slab.under, Slab):
        slab = slab.under
    return slab.depth < math.inf and slab.base is None and slab.under is None


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
    transmitted : (M, N, N) of what leaves below by more than one scattering, rows the directions of exitance, over `factor` and,
        of odd orders, over both sines as above; zeros where nothing does
    passed : (N,) share that leaves below, unscattered light included
    """

    slab: Slab
    nodes: Nodes
    cuts: tuple[Cut, ...]
    reflected: np.ndarray
    albedo: np.ndarray
    mirrored: np.ndarray
    transmitted: np.ndarray
    passed: np.ndarray

    @property
    def cut(self) -> Cut:
        """Of the uppermost layer."""
        return self.cuts[0]

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
        """What the sum of Fourier orders counts by, in reflection (side -1) or transmission (1)."""
        n = self.nodes.index
        last = n if side < 0 else layers(self.slab)[0][-1].index
        through = (1 - fresnel.reflected(mu, last)) * (1 - fresnel.reflected(mu0, n)) / (n * last)
        return through / (fresnel.inside(mu, last) + fresnel.inside(mu0, n))

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
        for m, order in enumerate(orders):
            out, into = (span[m > 1 and m % 2 == 0] for span in spans)
            term = np.einsum("...i,...i->...", (out @ order)[row.reshape(mu.shape)], into[column.reshape(mu.shape)])
            smooth += (2.0 if m else 1.0) * term * np.cos(m * phi) * (odd if m % 2 else 1.0)
        return smooth

    def transmission(self, mu, mu0, phi):
        """The same of light that leaves below, at mu; unscattered light left out."""
        mu, mu0, phi = np.broadcast_arrays(*(np.asarray(value, float) for value in (mu, mu0, phi)))
        if not free(self.slab):
            return np.zeros(mu.shape)
        if not (((mu > 0) & (mu <= 1)).all() and ((mu0 > 0) & (mu0 <= 1)).all()):
            raise ValueError("cosines of directions lie above 0 and do not exceed 1")
        result = self.factor(mu, mu0, 1) * self._smooth(self.transmitted, mu, mu0, phi)
        for part, without, inner, inner0, weight in _once_through(self.slab, self.cuts, mu, mu0):
            turned = single.turned(inner, inner0, phi, 1)
            result += 0.25 * part.albedo / without.shrinks * 4 * math.pi * phase_at(part.theta, part.phase, turned) * weight
        return result

    def exact(self, mu, mu0, phi):
        """What is exact at every angle, inside of the uppermost boundary."""
        (parts, _), total, below = layers(self.slab), 0.0, None
        outward, inward = _reached(parts, self.cuts, mu), _reached(parts, self.cuts, mu0)
        for (part, without, inner, share), (*_, inner0, share0) in zip(outward, inward, strict=True):
            phase = 4 * math.pi * phase_at(part.theta, part.phase, single.turned(inner, inner0, phi, -1))
            depth = part.depth * without.shrinks if part.depth else 0.0
            total = total + 0.25 * part.albedo / without.shrinks * phase * single.upward(inner, inner0, depth) * share * share0
            below = part, share * share0 * np.exp(-depth * (1 / inner + 1 / inner0)) if depth < math.inf else 0.0
        return total + (below[0].base or 0.0) * below[1]


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
    """Of each layer: itself, its cut, cosines in it, and the share of light that gets there unscattered, times n / n_top."""
    n = parts[0].index
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
    # light that passes a peak is told by as many nodes as there are moments
    leaving = max(_LEAST_NODES, count + SPARE) if free(slab) else enough(count, _LEAST_NODES)
    nodes = directions(leaving, [part.index for part in parts])
    top, exact, missed = nodes.top, _Exact(nodes, parts, cuts), _missed(nodes, parts, cuts, leaving < count + SPARE)
    orders, largest, small = [], [], 0
    for order in range(count):
        phases = [phase_matrices(without.moments, nodes.mu(part.index), order)
                  for part, without in zip(parts, cuts, strict=True)]
        accuracy = ITERATED * tolerance * largest[0] if order else 0.0
        media = [of_order(nodes, *medium, order, accuracy) for medium in zip(parts, cuts, phases, missed, strict=True)]
        mirrored, scattered, downward = below(nodes, parts, media, bottom, order)
        upward = _escaping(mirrored, scattered, top.reflected)[:leaving, :leaving]
        if downward is not None:
            downward = _down(nodes, 1.0, top.index, mirrored, scattered, downward)
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


def _missed(nodes: Directions, parts, cuts, few: bool) -> list:
    """Of each layer, what its nodes miss of a forward peak (`orders.unresolved`); 0 where they are not too few."""
    return [few * unresolved(without.moments, nodes.mu(part.index), nodes.flux(part.index))
            for part, without in zip(parts, cuts, strict=True)]


def of_order(nodes: Directions, part: Slab, without: Cut, phases, missed, order: int, accuracy: float) -> Layer | Deep:
    """One layer."""
    depth = part.depth * without.shrinks if part.depth else 0.0
    return layer_of_order(without, order, phases, missed, (nodes.mu(part.index), nodes.flux(part.index)), depth, accuracy)


def below(nodes: Directions, parts, media, bottom, order: int):
    """What is under the uppermost boundary, inside of it: D (N,) and S (N, N); and what of light from there leaves below.

    That is (N,) unscattered and (K, N) scattered, K directions in air; None where nothing does.
    """
    through = None
    if free(parts[0]):
        index, scattered = 1.0, np.zeros((nodes.top.leaving, nodes.top.leaving))
        through = np.ones(nodes.top.leaving), scattered
    elif isinstance(bottom, Reflector):
        index, scattered = 1.0, bottom.matrix(nodes.mu(1.0), nodes.flux(1.0), order)
    else:
        index, root = parts[-1].index, np.sqrt(nodes.flux(parts[-1].index))
        scattered = (bottom or 0.0) * np.outer(root, root) * (order == 0)
    mirrored = np.zeros(len(scattered))
    for part, layer in zip(parts[::-1], media[::-1], strict=True):
        if part.index != index:
            if through is not None:
                through = _down(nodes, part.index, index, mirrored, scattered, through)
            mirrored, scattered = _across(nodes, part.index, index, mirrored, scattered)
            index = part.index
        mu = nodes.mu(index)
        reflection, down = layer.scattered(np.zeros(len(mu)))
        if part.depth == math.inf:
            mirrored, scattered = np.zeros(len(mu)), reflection
            continue
        whole = scattered + np.diag(mirrored)
        if through is not None:
            passed, light = through
            arriving = np.linalg.solve(np.eye(len(mu)) - reflection @ whole, down + reflection @ (whole * layer.direct))
            through = passed * layer.direct, light @ (arriving + np.diag(layer.direct)) + passed[:len(light), None] \
                * arriving[:len(light)]
        again = whole @ reflection @ np.linalg.solve(np.eye(len(mu)) - whole @ reflection, whole)
        # all that comes up to the layer's lower face, and what of it is scattered
        returned, direct = whole + again, layer.direct
        returned_scattered = scattered + again
        scattered = reflection + down.T @ returned @ (down + np.diag(direct)) + direct[:, None] * (returned @ down) \
            + direct[:, None] * returned_scattered * direct
        mirrored = direct**2 * mirrored
    return mirrored, scattered, through


def _down(nodes: Directions, above: float, below: float, mirrored, scattered, through):
    """What of light from above a boundary leaves below; of what is under it D, S and the same."""
    mu, mu_below = nodes.mu(above), nodes.mu(below)
    shared, (passed, light) = min(len(mu), len(mu_below)), through
    boundary = np.ones(len(mu_below))
    boundary[:shared] = _mirrored(above, mu[:shared], below, mu_below[:shared])
    enters = 1 - boundary[:shared]
    # between two boundaries that reflect totally nothing is lost, and nothing scattered gets there
    boundary = np.where(boundary * mirrored < 1, boundary, 0.0)
    again = 1 / (1 - boundary * mirrored)
    whole = scattered + np.diag(mirrored)
    arriving = np.linalg.solve(np.eye(len(whole)) - boundary[:, None] * whole, boundary[:, None] * scattered * again)
    direct, result = np.zeros(len(mu)), np.zeros((len(light), len(mu)))
    direct[:shared] = passed[:shared] * again[:shared] * enters
    whole = light @ (arriving + np.diag(again)) + passed[:len(light), None] * arriving[:len(light)]
    result[:, :shared] = whole[:, :shared] * enters
    return direct, result


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
    """At the nodes that leave, what is exact at every angle, with the cut phase functions; and what is left without it."""

    def __init__(self, nodes: Directions, parts, cuts):
        air, self.keep = nodes.top.air, slice(nodes.top.leaving)
        self.mu, self.flux, self.air_flux = nodes.top.mu[self.keep], nodes.top.flux[self.keep], nodes.flux(1.0)
        self.sines = np.sqrt((1 - self.mu) * (1 + self.mu))
        self.upward, self.base, self.downward = [], 0.0, []
        for part, without, inner, share in _reached(parts, cuts, air):
            depth = part.depth * without.shrinks if part.depth else 0.0
            shape = single.upward(inner[:, None], inner, depth) * np.outer(share, share)
            self.upward.append(0.25 * without.albedo * shape)
            if depth < math.inf and part.base:
                out = share * np.exp(-depth / inner)
                self.base = part.base * np.outer(out, out)
        if free(parts[0]):
            n, last, out = parts[0].index, parts[-1].index, air[:, None]
            through = (1 - fresnel.reflected(out, last)) * (1 - fresnel.reflected(air, n)) / (n * last)
            self.factor = through / (fresnel.inside(out, last) + fresnel.inside(air, n))
            self.downward = [0.25 * without.albedo * weight for _, without, *_, weight in _once_through(parts[0], cuts, out, air)]

    def several_times(self, phases, order: int, upward, downward):
        """One Fourier order of light scattered more than once, (N, N) each as `Stacked` has it."""
        keep, sines = self.keep, np.outer(self.sines, self.sines) if order % 2 else 1.0
        once = sum(factor * (even - odd)[keep, keep] for factor, (even, odd) in zip(self.upward, phases, strict=True))
        smooth = upward / np.sqrt(np.outer(self.flux, self.flux)) - (once + self.base if order == 0 else once)
        reflected = 0.5 * (smooth + smooth.T) * (self.mu[:, None] + self.mu) / sines
        if downward is None:
            return reflected, np.zeros_like(reflected)
        once = sum(factor * (even + odd)[keep, keep] for factor, (even, odd) in zip(self.downward, phases, strict=True))
        flux = np.sqrt(np.outer(self.air_flux, self.air_flux))
        return reflected, (downward[1] / flux - once) / self.factor / sines
