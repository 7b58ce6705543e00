"""How far from where it went in light comes out of plane layers on each other, by walks; and the profile of programs that have
diffusion only.

Christensen and Burley's normalised profile sends exp(-r/d) + exp(-r/(3 d)) over 8 pi d r of the light to a distance r: 1 in all.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bakery import rng
from bakery.physics.medium.kernels import phase_layout
from bakery.physics.medium.phase import normalised, phase_at
from bakery.physics.multiple.legendre import moments
from bakery.physics.surfaces._spread import CLASSES, follow
from bakery.physics.surfaces.cut import without_peak
from bakery.physics.surfaces.slab import Reflector, Slab, layers

BINS = 48  # of distance; the first begins at 0
AUREOLE = 0.3  # rad; what scatters light by less counts as even in angle
BLOCKS = 16  # random streams, and samples of each mean
# ends of the first and of the last bin: in the shorter of transport path and thickness, and in the former
NEAREST, FARTHEST = 0.02, 1e3
WALKS, MOST_WALKS = 1 << 7, 1 << 11  # of each class and block, first and last
_MORE = 1.2  # walks over those that the error asks for
TOLERANCE, COARSEST = 0.02, 0.08  # relative standard error of the mean square of the distance, which the last walks may miss


@dataclass(frozen=True)
class Spread:
    """Of light on a layer, C classes of directions of equal flux, from the normal to grazing; lengths in um."""

    edges: np.ndarray  # (B + 1,) distances
    # light, light_error: (C, C, B) share that comes out in a class o at a distance between two edges; what is mirrored left out
    light: np.ndarray
    light_error: np.ndarray
    # square, square_error: (C, C) mean squared distance of the light that comes out, within the last edge
    square: np.ndarray
    square_error: np.ndarray
    # mean_square, mean_square_error: of light from all sides to all sides
    mean_square: float
    mean_square_error: float
    beyond: float  # share of the light from all sides that comes out further away, or has been as deep

    def scaled(self, unit: float) -> Spread:
        """With lengths in another unit."""
        squares = {name: getattr(self, name) * unit**2
                   for name in ("square", "square_error", "mean_square", "mean_square_error")}
        return replace(self, edges=self.edges * unit, **squares)


def edges_of(transport, thickness):
    """(BINS + 1,) distances between bins: 0, and from near to far by equal factors.

    transport, thickness : (J,) transport mean free paths and thicknesses of layers from the top, either may be infinite
    """
    finite = [part[np.isfinite(part)] for part in (transport, thickness)]
    far = max(finite[0] if len(finite[0]) else finite[1])
    # the depth of one transport mean free path, or of all layers that have one
    ahead, near = 1.0, 0.0
    for path, width in zip(transport, thickness, strict=True):
        if ahead > 0 and min(path, width) < math.inf:
            near += min(ahead * path, width)
            ahead = max(ahead - width / path, 0.0)
    return np.concatenate([[0.0], np.geomspace(NEAREST * near, FARTHEST * far, BINS)])


def spread(slab: Slab, seed: int, *stream: int, tolerance: float = TOLERANCE) -> Spread:
    """Of a layer, and of all that lie under it.

    seed, stream : of the random numbers, `surface.spread`

    Raises ValueError : what lies under it is known as light from air sees it only
    """
    parts, bottom = layers(slab)
    if isinstance(bottom, Reflector):
        raise ValueError("how far light spreads among grains is not known")
    # numbers near 1; layers that take no room let light out where it went in
    unit = max((part.length for part in parts if part.length > 0), default=1.0)
    lengths = np.array([part.length for part in parts]) / unit
    scale, lengths = (unit, lengths) if lengths.any() else (0.0, lengths + 1.0)
    table, shares = _phases(parts)
    media = np.array([_medium(part, share, length) for part, share, length in zip(parts, shares, lengths, strict=True)])
    transport, thickness = media[:, 3], media[:, 2]
    if np.isinf([transport, thickness]).all():
        return _nothing()
    edges = edges_of(transport, thickness)
    index = np.array([1.0, *(part.index for part in parts), 1.0])
    faces = np.stack([index[1:] / index[:-1], [*(part.roughness for part in parts), 0.0]], axis=1)
    base = -1.0 if bottom is None else float(bottom)
    sums = [np.zeros((BLOCKS, CLASSES, CLASSES, BINS)), np.zeros((BLOCKS, CLASSES, CLASSES)), np.zeros((BLOCKS, CLASSES))]
    streams = [rng.generator(seed, "surface.spread", *stream, block) for block in range(BLOCKS)]
    walks, total = WALKS, 0
    while True:
        for block, generator in enumerate(streams):
            follow(generator, walks, (media, faces, base), table, edges, *(part[block] for part in sums))
        total += walks
        result = _of(edges, total, *sums)
        if total >= MOST_WALKS or result.mean_square_error <= tolerance * result.mean_square:
            return result.scaled(scale)
        missing = _MORE * (result.mean_square_error / (tolerance * result.mean_square)) ** 2 - 1
        walks = min(total * math.ceil(4 * min(missing, 1.0)) // 4, MOST_WALKS - total)


def _medium(part: Slab, share: float, length: float) -> tuple[float, ...]:
    """A layer as `follow` takes it; share : of its scattered light, that goes straight on;  length : the walks' `Slab.length`."""
    if part.depth == 0:
        return 0.0, 0.0, length, math.inf, 0.0
    without, (_, g, second), lost = without_peak(part.albedo, share), moments(part.theta, part.phase, 2), 1 - part.albedo
    transport = length / (1 - part.albedo * g) if part.albedo > 0 else math.inf
    # the second term of the decay of diffuse light, by the equations of three orders of Legendre
    decay = math.sqrt(3 * lost / (transport * length)) * (1 - 0.4 * lost / (1 - part.albedo * second))
    return without.shrinks / length, without.albedo, part.depth * length, transport, decay


def _phases(parts: Sequence[Slab]):
    """Tables (J, A) of phase functions, as `without_aureole` makes them, at angles that all share; and (J,) its shares."""
    theta = parts[0].theta
    if len(parts) > 1:
        theta = np.unique(np.concatenate([[AUREOLE * (1 - 1e-9), AUREOLE], *(part.theta for part in parts)]))
    tables, shares = zip(*(without_aureole(theta, phase_at(part.theta, part.phase, theta)) for part in parts), strict=True)
    v, steps, *_ = tables[0]
    return (v, steps, *(np.stack([table[k] for table in tables]) for k in (2, 3))), shares


def without_aureole(theta, phase):
    """Table of a phase function (`phase_layout`) whose forward peak is even within `AUREOLE`, and the share of light taken out.

    That share counts as light that goes straight on; g, of all light, stays.  Where there is no peak nothing changes.
    """
    theta = np.asarray(theta, float)
    angles = np.unique(np.concatenate([theta[theta < AUREOLE], [AUREOLE * (1 - 1e-9), AUREOLE], theta[theta > AUREOLE]]))
    values = phase_at(theta, phase, angles)
    v, inner = 2 * np.sin(angles / 2) ** 2, angles < AUREOLE
    low, high, step = values[inner][:-1], values[inner][1:], np.diff(v[inner])
    light = float(np.sum(0.5 * (low + high) * step))
    turned = float(np.sum(step * (v[inner][:-1] * 0.5 * (low + high) + step * (low / 6 + high / 3))))
    even = turned / (0.5 * v[inner][-1] ** 2)
    share = 2 * math.pi * (light - even * v[inner][-1])
    if not share > 0:
        return phase_layout(theta, phase), 0.0
    values = np.where(inner, even, values)
    return phase_layout(angles, normalised(angles, values)[0]), share


def _of(edges, walks: int, light, square, beyond) -> Spread:
    """From sums (BLOCKS, ...) over walks of each class and block."""
    # weights of returns from the deep are 1 only on average: what is above 1 in a class is noise
    surplus = np.maximum((light.sum(axis=(2, 3)) + beyond).mean(axis=0) / walks, 1.0)
    light, beyond, square = light / surplus[:, None, None], beyond / surplus, square / surplus[:, None]
    shares = light / walks
    returned = light.sum(axis=3)
    squares, square_error = _ratio(square, returned)
    whole = square.sum(axis=(1, 2)), returned.sum(axis=(1, 2))
    mean, error = _ratio(*whole)
    return Spread(edges, shares.mean(axis=0), _error(shares), squares, square_error, float(mean), float(error),
                  float(beyond.mean() / walks))


def _error(values):
    return values.std(axis=0, ddof=1) / math.sqrt(len(values))


def _ratio(above, below):
    """Mean of blocks over mean of blocks, and its standard error."""
    mean = np.divide(above.sum(axis=0), below.sum(axis=0), out=np.zeros(above.shape[1:]), where=below.sum(axis=0) > 0)
    scale = below.mean(axis=0)
    return mean, np.divide(_error(above - mean * below), scale, out=np.zeros(above.shape[1:]), where=scale > 0)


def _nothing() -> Spread:
    """Of a medium without end that nothing comes out of."""
    none = np.zeros((CLASSES, CLASSES))
    return Spread(np.concatenate([[0.0], np.geomspace(NEAREST, FARTHEST, BINS)]), np.zeros((CLASSES, CLASSES, BINS)),
                  np.zeros((CLASSES, CLASSES, BINS)), none, none, 0.0, 0.0, 0.0)


# ---- the profile


def profile_within(radius, width):
    """Share of the profile's light within a distance: 1 - exp(-r/d) / 4 - 3 exp(-r/(3 d)) / 4."""
    x = np.asarray(radius, float) / width
    return -0.25 * np.expm1(-x) - 0.75 * np.expm1(-x / 3)


def profile(edges, light, beyond: float) -> tuple[float, float]:
    """The width d of the profile that light is nearest to, and the largest difference of the shares within a distance.

    edges : (B + 1,);  light : (B,) share of the light between two edges
    beyond : share further away
    """
    total = light.sum() + beyond
    if not (light.sum() > 0 and edges[-1] > 0):
        return 0.0, 0.0
    within = np.cumsum(light) / total

    def worst(width):
        return float(np.abs(profile_within(edges[1:], width) - within).max())

    low, high = math.log(edges[1]), math.log(edges[-1])
    for _ in range(4):
        widths = np.linspace(low, high, 65)
        best = int(np.argmin([worst(math.exp(width)) for width in widths]))
        low, high = widths[max(best - 1, 0)], widths[min(best + 1, 64)]
    width = math.exp(widths[best])
    return width, worst(width)
