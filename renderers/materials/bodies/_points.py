"""Loops that join points, events of light, with lines of sight that pass close by (photon points; Jarosz et al. 2011)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import lent, phase_value
from bakery.system.compiled import njit
from renderers.materials.bodies._beams import DEEP, likely
from renderers.materials.bodies._cells import enter, reach


class Points(NamedTuple):
    """N events in a body, each at the end of a flight that began at an event, before light is turned there.

    ray : (N, 6) m, unit, where each is and the direction in which light arrives
    flown : (N,) m, length of the flight;  power : (N, L) W;  before : (N,) scattering events before
    """

    ray: np.ndarray
    flown: np.ndarray
    power: np.ndarray
    before: np.ndarray


class Disc(NamedTuple):
    """radius : m, over which points are spread at right angles to lines of sight
    scale : m, against beams that bring the same light, as in `_beams.Spread.points`
    """

    radius: float
    scale: float


@njit(cache=True, nogil=True, error_model="numpy")
def entered(ray, radius, cells, latest):
    """Enters points in the cells that come within a radius (m); ray (N, 6) of `Points`."""
    cells = lent(cells)
    least, most = np.empty(3, np.int64), np.empty(3, np.int64)
    for p in range(len(ray)):
        for k in range(3):
            least[k], most[k] = reach(cells, k, ray[p, k] - radius, ray[p, k] + radius)
        enter(cells, least, most, p, latest)


@njit(cache=True, nogil=True, error_model="numpy")
def join(medium, points, cells, disc, lines, facing, brought, begin, end):
    """Adds to `brought` the radiance at the origins of lines of sight against their directions, of light that scatters at points.

    Each point stands for a disc at right angles to the line, as far as that is inside of the body.

    Parameters
    ----------
    medium : `Scatterer`;  points : `Points`;  cells : `Cells`, of the radius of the `Disc`
    lines : `Paths`;  facing : (n, 3) unit, outward normals of the boundary where lines begin
    brought : (3, n, L) radiance by points of 0, 1 and more events before; W/m^2 sr
    """
    medium, points, cells, lines = lent(medium), lent(points), lent(cells), lent(lines)
    shape, longest = cells.shape, DEEP / np.min(medium.sigma_t)
    at, step, ahead, across = np.empty(3, np.int64), np.empty(3, np.int64), np.empty(3), np.empty(3)
    for i in range(begin, end):
        length = min(lines.far[i], longest)
        for k in range(3):
            position, d = (lines.origin[i, k] - cells.low[k]) / cells.edge, lines.direction[i, k]
            at[k] = min(max(math.floor(position), 0), shape[k] - 1)
            step[k] = 1 if d > 0.0 else -1
            across[k] = cells.edge / abs(d) if d != 0.0 else np.inf
            ahead[k] = ((at[k] + 1 - position) if d > 0.0 else (position - at[k])) * across[k] if d != 0.0 else np.inf
        begins = 0.0
        while True:
            axis = 0 if ahead[0] <= ahead[1] and ahead[0] <= ahead[2] else 1 if ahead[1] <= ahead[2] else 2
            ends = min(ahead[axis], length)
            cell = (at[0] * shape[1] + at[1]) * shape[2] + at[2]
            for name in range(cells.begin[cell], cells.begin[cell + 1]):
                _add(medium, points, cells.names[name], disc, lines, i, facing, (begins, ends), brought)
            if not ends < length:
                break
            begins = ends
            at[axis] += step[axis]
            if not 0 <= at[axis] < shape[axis]:
                break
            ahead[axis] += across[axis]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _add(medium, points, p, disc, lines, i, facing, within, brought):
    """Adds what point p passes to line of sight i, where that passes it within a part (from, to)."""
    vx, vy, vz = lines.direction[i, 0], lines.direction[i, 1], lines.direction[i, 2]
    ray = points.ray
    x, y, z = ray[p, 0] - lines.origin[i, 0], ray[p, 1] - lines.origin[i, 1], ray[p, 2] - lines.origin[i, 2]
    t, radius = x * vx + y * vy + z * vz, disc.radius
    if not (within[0] <= t < within[1]) or x * x + y * y + z * z - t * t > radius * radius:
        return
    cosine = min(max(-(ray[p, 3] * vx + ray[p, 4] * vy + ray[p, 5] * vz), -1.0), 1.0)
    odds = disc.scale * likely(medium, points.flown[p])
    beside = math.sqrt(1 - cosine * cosine)
    share = (odds / (odds + beside) if odds < np.inf else 1.0) / _inside(t, radius, lines.direction, facing, i)
    order, sigma = min(points.before[p], 2), medium.sigma_t
    for w in range(len(sigma)):
        scattered = medium.albedo[w] * phase_value(medium.v, medium.steps, medium.phase[w], 1 - cosine)
        brought[order, i, w] += share * points.power[p, w] * scattered * math.exp(-sigma[w] * t)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _inside(t, radius, direction, facing, i):
    """Area (m^2) of a disc at right angles to line i, t (m) on it, that is inside of the plane where that begins."""
    cosine = direction[i, 0] * facing[i, 0] + direction[i, 1] * facing[i, 1] + direction[i, 2] * facing[i, 2]
    up, deep = math.sqrt(max(1 - cosine * cosine, 0.0)), max(-t * cosine, 0.0)
    if not deep < radius * up:
        return math.pi * radius * radius
    chord = deep / (radius * up)
    return radius * radius * (math.pi - math.acos(chord) + chord * math.sqrt(1 - chord * chord))
