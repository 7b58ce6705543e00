"""Photons counted so that one run serves every position and direction around a point source.

In an infinite medium only the distance r of an event from the source matters, and two directions in the frame whose axis points
from the source to it: u, that of the photon after its first event, and d, that in which it arrives.  The first and the last
scattering are left out of the walk and done exactly, for any angle Theta between beam and position and any direction (o, phi):

    T = albedo^3 / r^2  sum over m of (2 - [m = 0]) cos(m phi)
        sum over arrivals of w delta(r - r_k) cos(m D_k) p_m(Theta, u_k) p_m(d_k, o)

w is 1 after the second event, D the azimuth between u and d, p_m(a, b) the mean over phi of cos(m phi) p between directions at
a and b from the axis.  Arrivals are summed in boxes of r, in bins of the angles u and d, and as cosines of m D: `Sums`.  `lobes`
makes lobes of them.

What is added at an arrival belongs to every Theta, so that places behind a source are as well known as those ahead.  Flights
that come close to the source arrive twice, at their end and at a point drawn uniformly in the angle seen from the source,
weighted by the balance heuristic (Veach & Guibas 1995).  Weights follow exp(-k0 r) (1 + r)^2, by roulette and splitting: near and
far boxes get about as many arrivals.  What gets twice as far as the rim, well outside, diffuses back with (rim / r)
exp(-k0 (r - rim)).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from bakery import rng
from bakery.physics.medium import phase as tables
from bakery.physics.medium.kernels import phase_layout
from bakery.physics.multiple import _tally, legendre
from bakery.physics.multiple._tally import BOXES
from bakery.physics.multiple.fourier import decay
from bakery.physics.multiple.frame import CORE
from bakery.physics.multiple.kinds import POINT

BLOCKS = 32  # random streams of a batch; even ones make one half of the sums, odd ones the other
_MORE = 3  # boxes beyond the extent
_BINS = 56  # of an angle
_NARROW, RESOLUTION = 0.05, 0.1  # rad: a peak that has halved before is spread over a cone so wide, at the ends of paths
_PART = 0.02  # rad, of a bin that is averaged over
_MOMENTS, _SMALL, _MOST = 96, 1e-3, 40  # azimuthal orders: until p_l^2 is small, at most
_MILNE = 0.7104  # lengths of diffusion from where light would vanish to the surface that it enters


@dataclass(frozen=True)
class Medium:
    """What photons fly through, and what they are sorted into."""

    # albedo, k0: 1, 1/mfp
    albedo: float
    k0: float
    # theta, phase: (A,) rad, 1/sr
    theta: np.ndarray
    phase: np.ndarray
    extent: float  # mfp, of the boxes
    edges: np.ndarray  # (B + 1,) rad, of the bins of angles, 0 to pi
    orders: int  # of the azimuth
    capped: bool  # whether the phase function has more of them
    resolution: float  # rad, of the cones that narrow peaks are spread over for the first and the last scattering; or 0
    outer: tuple[np.ndarray, np.ndarray]  # angles and values of the phase function that is used there

    @property
    def g(self) -> float:
        return float(tables.mean_cosine(self.theta, self.phase))


@dataclass(frozen=True)
class Sums:
    """Arrivals, times exp(k0 r) r^2 over the volume of their box, so that they hardly depend on the box."""

    # photons, flights: followed
    photons: int
    flights: int
    halves: np.ndarray  # (2, boxes, B, B, M) of u, d and the azimuth; two independent estimates of the same
    blocks: np.ndarray  # (BLOCKS, boxes, B) of u alone

    def __add__(self, other: Sums) -> Sums:
        a, b = self.photons / (self.photons + other.photons), other.photons / (self.photons + other.photons)
        return Sums(self.photons + other.photons, self.flights + other.flights, a * self.halves + b * other.halves,
                    a * self.blocks + b * other.blocks)


def medium(albedo, theta, phase, extent=None) -> Medium:
    """Bins and orders that a phase table (A,) needs; extent None: 1e-4 of the light is beyond it, at most 200 mfp."""
    theta, phase = np.asarray(theta, float), np.asarray(phase, float)
    moments = legendre.moments(theta, phase, _MOMENTS)
    k0 = decay(albedo, moments) if albedo > 0 else 1.0
    if extent is None:
        extent = float(np.clip(11.8 / max(k0, 1e-9), 1.0, 200.0))  # (1 + x) exp(-x) = 1e-4
    narrow = min(_width(theta, phase), _width(math.pi - theta[::-1], phase[::-1])) < _NARROW
    outer = broadened(theta, phase, RESOLUTION) if narrow else (theta, phase)
    moments = legendre.moments(*outer, _MOMENTS)
    needed = int(np.flatnonzero(moments**2 > _SMALL)[-1]) + 1
    if needed == 1 and np.abs(moments[1:]).max() < 1e-9:
        edges = np.array([0.0, math.pi])  # isotropic: no direction matters
    else:
        edges = _edges(_width(*outer), _width(math.pi - outer[0][::-1], outer[1][::-1]))
    return Medium(float(albedo), float(k0), theta, phase, float(extent), edges, min(needed, _MOST), needed > _MOST,
                  RESOLUTION if narrow else 0.0, outer)


def _width(theta, phase):
    """Angle from 0 at which the phase function has halved, at most 0.5 rad: the scale of what lies there."""
    below = np.flatnonzero(phase < phase[0] / 2)
    return float(np.clip(theta[below[0]] if len(below) else 0.5, 1e-3, 0.5))


def _edges(ahead, behind):
    """Bins as dense as 1/(distance from the end + its scale) at both ends."""
    angle = np.linspace(0, 1, 20001)
    angle = np.concatenate([angle[:-1] ** 3, 2 - angle[::-1] ** 3]) * math.pi / 2
    count = np.arcsinh(angle / ahead) - np.arcsinh((math.pi - angle) / behind)
    return np.interp(np.linspace(count[0], count[-1], _BINS + 1), count, angle)


def follow(medium: Medium, photons, seed, batch) -> Sums:
    """Follows photons (rounded up to a multiple of `BLOCKS`) with the random numbers of this batch."""
    bins, per_block = len(medium.edges) - 1, -(-int(photons) // BLOCKS)
    table = phase_layout(medium.theta, medium.phase)
    halves = np.zeros((2, BOXES + _MORE, bins, bins, medium.orders))
    blocks = np.zeros((BLOCKS, BOXES + _MORE, bins))
    free = 1 / max(1 - medium.g, 1e-3)  # length of diffusion
    rim = far(medium, BOXES + _MORE) + 2 * free
    flights = 0
    for block in range(BLOCKS):
        stream = rng.generator(seed, "multiple.tally", batch, block)
        boxes = _tally.Boxes(2 * np.sin(medium.edges / 2) ** 2, medium.extent, medium.k0, halves[block % 2], blocks[block])
        flights += _tally.follow(stream, per_block, medium.albedo, table, boxes, rim, rim - _MILNE * free)
    return Sums(per_block * BLOCKS, flights, halves / (per_block * BLOCKS / 2), blocks / per_block)


def far(medium: Medium, box):
    """Distance of the middle of a box, mfp; box may be broken."""
    return CORE[POINT] * np.sinh(np.asarray(box) / BOXES * math.asinh(medium.extent / CORE[POINT]))


# ---- from sums to lobes


def coarser(medium: Medium, sums: Sums) -> tuple[Medium, Sums]:
    """The same arrivals in half as many bins, and half as many orders where those were capped: what resolution changes."""
    bins = len(medium.edges) - 1
    orders = -(-medium.orders // 2) if medium.capped else medium.orders
    if bins > 1:
        halves = sums.halves[..., :orders]
        shape = (*halves.shape[:2], bins // 2, 2, bins // 2, 2, orders)
        sums = Sums(sums.photons, sums.flights, halves.reshape(shape).sum(axis=(3, 5)),
                    sums.blocks.reshape(*sums.blocks.shape[:2], bins // 2, 2).sum(axis=3))
    return replace(medium, edges=medium.edges[::2].copy() if bins > 1 else medium.edges, orders=orders), sums


def at_boxes(sums, boxes):
    """Values in the middle of single boxes, from means over boxes (boxes, ...): what is curved is taken out."""
    boxes = np.asarray(boxes)
    return (13 * sums[boxes] - 0.5 * (sums[boxes - 1] + sums[boxes + 1])) / 12


def at_even(sums):
    """Values in the middles of boxes 0, 2, .. `BOXES`, from means over boxes and their neighbours, (BOXES/2 + 1, ...)."""
    middle = np.arange(2, BOXES + 2, 2)
    smooth = (sums[middle - 1] + 2 * sums[middle] + sums[middle + 1]) / 4
    # at u = 0 half a box and its neighbour: their mean lies at 0.75 boxes, the first of `smooth` at 2
    first = (0.5 * sums[0] + sums[1]) / 1.5
    first = np.maximum(1.6 * first - 0.6 * smooth[0], 0.5 * first) if first.ndim < 2 else 1.6 * first - 0.6 * smooth[0]
    # the mean over the three has the second moment 7/12 boxes squared
    beyond = 2 * smooth[-1] - smooth[-2]
    padded = np.concatenate([first[None], smooth, beyond[None]])
    return np.concatenate([first[None], padded[1:-1] - 7 / 96 * (padded[2:] - 2 * padded[1:-1] + padded[:-2])])


def lobes(medium: Medium, arrivals, first, last, azimuth):
    """T r exp(k0 r) from arrivals.

    arrivals : (I, B, B, M)
    first, last : (M, J, B), (M, A, B), `means` of the angles Theta of the positions from +z, and polar of the directions
    azimuth : (C,) rad, of the directions in the frame at the position

    Returns (I, J, A, C)
    """
    m = np.arange(medium.orders)
    turns = np.where(m == 0, 1.0, 2.0)[:, None] * np.cos(m[:, None] * np.asarray(azimuth))
    if medium.capped:  # Lanczos: no ringing
        turns = turns * np.sinc(m / medium.orders)[:, None]
    out = np.zeros((len(arrivals), first.shape[1], last.shape[1], len(azimuth)))
    for i in range(len(arrivals)):
        _tally.fold(np.ascontiguousarray(np.moveaxis(arrivals[i], -1, 0)), first, last, turns, out[i])
    return medium.albedo**3 * out


def integrals(medium: Medium, arrivals, first):
    """The same integrated over directions, (..., I, J), from arrivals (..., I, B) summed over d."""
    return medium.albedo**3 * (arrivals[..., None, :] * first[0]).sum(axis=-1)


def means(medium: Medium, angles):
    """p_m(angle, bin), (M, J, B): means over bins of cos(m phi) p."""
    angles = np.atleast_1d(np.asarray(angles, float))
    if len(medium.edges) == 2:
        return np.full((1, len(angles), 1), 1 / (4 * math.pi))
    theta, phase = medium.outer
    out = np.empty((medium.orders, len(angles), len(medium.edges) - 1))
    v, turns = 2 * np.sin(theta / 2) ** 2, max(64, 4 * medium.orders)
    _tally.means(v, tables.steps(theta), phase, angles, medium.edges, turns, _PART, out)
    return out


def broadened(theta, phase, width):
    """A phase table whose light within `width` of forward, and of backward, is spread evenly over that cone."""
    v, steps = 2 * np.sin(theta / 2) ** 2, tables.steps(theta)
    light = np.concatenate([[0.0], np.cumsum(math.pi * (phase[1:] + phase[:-1]) * steps)])
    cone = 2 * math.pi * 2 * math.sin(width / 2) ** 2

    def at(angle):
        """Value there and light below."""
        i = min(int(np.searchsorted(theta, angle, side="right")) - 1, len(theta) - 2)
        rise = 2 * math.sin((angle + theta[i]) / 2) * math.sin((angle - theta[i]) / 2)
        value = phase[i] + (phase[i + 1] - phase[i]) / (v[i + 1] - v[i]) * rise
        return value, light[i] + math.pi * rise * (phase[i] + value)

    (ahead, below), (behind, most) = at(width), at(math.pi - width)
    between = (theta > width * (1 + 2e-6)) & (theta < (math.pi - width) * (1 - 2e-6))
    grid = np.concatenate([[0, width, width * (1 + 1e-6)], theta[between],
                           [(math.pi - width) * (1 - 1e-6), math.pi - width, math.pi]])
    values = np.concatenate([[below / cone] * 2, [ahead], phase[between], [behind], [(light[-1] - most) / cone] * 2])
    return grid, tables.normalised(grid, values)[0]
