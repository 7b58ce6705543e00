"""Loops that join points, events of light, with lines of sight that pass close by (photon points; Jarosz et al. 2011)."""

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import lent, phase_value
from bakery.system.compiled import njit
from renderers.materials.bodies._beams import CHANGED, DEEP, SHARPER, likely
from renderers.materials.bodies._cells import cell_ahead, enter, onward, reach, start, steps_of_lines


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
    lines : `_walk.Walk`;  facing : (n, 3) unit, outward normals of the boundary where lines begin
    brought : (4, n, L) radiance by points of 0, 1 and more events before, and what half the radius would change; W/m^2 sr
    """
    medium, points, cells, lines = lent(medium), lent(points), lent(cells), lent(lines)
    longest, steps = DEEP / np.min(medium.sigma_t), steps_of_lines()
    for i in range(begin, end):
        length = min(lines.far[i], longest)
        start(cells, lines, i, steps)
        begins = 0.0
        while True:
            cell, axis = cell_ahead(cells, steps)
            ends = min(steps.ahead[axis], length)
            for name in range(cells.begin[cell], cells.begin[cell + 1]):
                _add(medium, points, cells.names[name], disc, lines, i, facing, (begins, ends), brought)
            if not ends < length or not onward(cells, steps, axis):
                break
            begins = ends


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _add(medium, points, p, disc, lines, i, facing, within, brought):
    """Adds what point p passes to line of sight i, where that passes it within a part (from, to)."""
    vx, vy, vz = lines.direction[i, 0], lines.direction[i, 1], lines.direction[i, 2]
    ray = points.ray
    x, y, z = ray[p, 0] - lines.origin[i, 0], ray[p, 1] - lines.origin[i, 1], ray[p, 2] - lines.origin[i, 2]
    t, radius = x * vx + y * vy + z * vz, disc.radius
    square, half = x * x + y * y + z * z - t * t, SHARPER * radius
    if not (within[0] <= t < within[1]) or square > radius * radius:
        return
    cosine = min(max(-(ray[p, 3] * vx + ray[p, 4] * vy + ray[p, 5] * vz), -1.0), 1.0)
    odds = disc.scale * likely(medium, points.flown[p])
    beside = math.sqrt(1 - cosine * cosine)
    share = odds / (odds + beside) if odds < np.inf else 1.0
    sharper = share / _inside(t, half, lines.direction, facing, i) if square <= half * half else 0.0
    share /= _inside(t, radius, lines.direction, facing, i)
    order, sigma = min(points.before[p], 2), medium.sigma_t
    for w in range(len(sigma)):
        scattered = medium.albedo[w] * phase_value(medium.v, medium.steps, medium.phase[w], 1 - cosine)
        lasting = math.exp(-sigma[w] * t)
        brought[order, i, w] += share * points.power[p, w] * scattered * lasting
        brought[CHANGED, i, w] += (sharper - share) * points.power[p, w] * scattered * lasting


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _inside(t, radius, direction, facing, i):
    """Area (m^2) of a disc at right angles to line i, t (m) on it, that is inside of the plane where that begins."""
    cosine = direction[i, 0] * facing[i, 0] + direction[i, 1] * facing[i, 1] + direction[i, 2] * facing[i, 2]
    up, deep = math.sqrt(max(1 - cosine * cosine, 0.0)), max(-t * cosine, 0.0)
    if not deep < radius * up:
        return math.pi * radius * radius
    chord = deep / (radius * up)
    return radius * radius * (math.pi - math.acos(chord) + chord * math.sqrt(1 - chord * chord))
