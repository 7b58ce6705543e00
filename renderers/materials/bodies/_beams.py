"""Loops that join beams of light with lines of sight that pass close by, in a grid of cells that know their beams."""

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import lent, phase_value
from bakery.system.compiled import njit
from renderers.materials.bodies._cells import cell_ahead, enter, onward, reach, start, steps_of_lines

SHARPER = 0.5  # radius over which beams and points are spread a second time, over the first: what that changes tells its error
CHANGED = 3  # of what lines of sight are brought: what that changes, in all orders
DEEP = 30.0  # mean free paths, beyond which light is 1e-13 and left out
_GRAZING = 0.36  # square of a sine, below which beams are not spread along the boundary but at right angles


class Lit(NamedTuple):
    """N straight beams of light in a body.

    ray : (N, 6) m, unit, where each begins and its direction
    normal : (N, 3) unit, outward, of the boundary where it comes in; 0 of those that begin at events
    length : (N,) m;  power : (N, L) W
    density : (N,) 1/sr, with which the light sample was drawn; inf where paths find no such light
    before : (N,) scattering events before
    """

    ray: np.ndarray
    normal: np.ndarray
    length: np.ndarray
    power: np.ndarray
    density: np.ndarray
    before: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy")
def entered(ray, length, radius, cells, latest):
    """Enters beams in the cells that they come within a radius (m) of; ray (N, 6), length (N,) of `Lit`, none infinite."""
    cells = lent(cells)
    low, edge = cells.low, cells.edge
    least, most = np.empty(3, np.int64), np.empty(3, np.int64)
    for b in range(len(length)):
        axis = 0
        for k in range(3):
            if abs(ray[b, 3 + k]) > abs(ray[b, 3 + axis]):
                axis = k
        start, d = ray[b, axis], ray[b, 3 + axis]
        ends = min(start, start + d * length[b]) - radius, max(start, start + d * length[b]) + radius
        first, last = reach(cells, axis, ends[0], ends[1])
        for slab in range(first, last + 1):
            # the part of the beam that comes within the radius of this layer of cells
            near = (low[axis] + slab * edge - radius - start) / d
            far_end = (low[axis] + (slab + 1) * edge + radius - start) / d
            near, far_end = max(min(near, far_end), 0.0), min(max(near, far_end), length[b])
            for k in range(3):
                low_end = ray[b, k] + min(near * ray[b, 3 + k], far_end * ray[b, 3 + k]) - radius
                high_end = ray[b, k] + max(near * ray[b, 3 + k], far_end * ray[b, 3 + k]) + radius
                least[k], most[k] = reach(cells, k, low_end, high_end)
            least[axis], most[axis] = slab, slab
            enter(cells, least, most, b, latest)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _odds(medium, scale, t, cosine):
    """How likely beams are over how likely a path is that scatters at t (m) on a line of sight by an angle of that cosine.

    scale : of `rivals`
    """
    density = 0.0
    for w in range(len(medium.sigma_t)):
        density += medium.sigma_t[w] * math.exp(-medium.sigma_t[w] * t) * phase_value(medium.v, medium.steps, medium.phase[w],
                                                                                    1 - cosine)
    return scale * math.sqrt(1 - cosine * cosine) * len(medium.sigma_t) / density


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def likely(medium, s):
    """How likely a flight ends at s (m), 1/m, mean of the wavelengths."""
    total = 0.0
    for w in range(len(medium.sigma_t)):
        total += medium.sigma_t[w] * math.exp(-medium.sigma_t[w] * s)
    return total / len(medium.sigma_t)


@njit(cache=True, nogil=True, error_model="numpy")
def rivals(medium, scale, t, before, after, rival, begin, end):
    """How likely beams are to bring light that paths begin to end may find, over their own likelihood and over the density of the
    light sample: rival (n,) sr.

    scale : m sr, beams a m^2 of the boundary, times the square of the index, times the width over which they are spread
    t : (n,) m, where paths have scattered on their lines of sight;  before, after : (n, 3) directions
    """
    medium = lent(medium)
    for i in range(begin, end):
        cosine = 0.0
        for k in range(3):
            cosine += before[i, k] * after[i, k]
        rival[i] = _odds(medium, scale, t[i], min(max(cosine, -1.0), 1.0))


class Spread(NamedTuple):
    """radius : m, by which beams are moved to both sides;  scale : as in `rivals`, against paths that find the same light
    points : m, against points that bring the same light: points a beam, times the area over which they are spread, over the width
        of beams; 0 where there are none
    """

    radius: float
    scale: float
    points: float


class _Crossing(NamedTuple):
    """Where a beam that is moved along a unit vector x, y, z meets a line of sight: m along the line and along the beam.

    moved : m;  volume : of the box of the unit vectors of beam, line and move
    """

    t: float
    s: float
    moved: float
    x: float
    y: float
    z: float
    volume: float


@njit(cache=True, nogil=True, error_model="numpy")
def join(medium, beams, cells, spread, lines, facing, brought, begin, end):
    """Radiance at the origins of lines of sight against their directions, of light that beams pass to them in one event.

    Each beam stands for those that are moved by up to a radius along the tangent of the boundary where it comes in, of which one
    meets the line; where it begins at an event, at right angles to beam and line, as far as that is inside of the body.

    Parameters
    ----------
    medium : `Scatterer`;  beams : `Lit`;  cells : `Cells`, of the radius of the `Spread`
    lines : `_walk.Walk`;  facing : (n, 3) unit, outward normals of the boundary where lines begin
    brought : (4, n, L) adds the radiance by beams of 0, 1 and more events before, and what half the radius would change; W/m^2 sr
    """
    medium, beams, cells, lines = lent(medium), lent(beams), lent(cells), lent(lines)
    longest, steps = DEEP / np.min(medium.sigma_t), steps_of_lines()
    for i in range(begin, end):
        length = min(lines.far[i], longest)
        start(cells, lines, i, steps)
        begins = 0.0
        while True:
            cell, axis = cell_ahead(cells, steps)
            ends = min(steps.ahead[axis], length)
            for name in range(cells.begin[cell], cells.begin[cell + 1]):
                b = cells.names[name]
                crossing = _crossing(beams, b, lines, i, spread.radius, (begins, ends))
                if crossing.volume > 0.0:
                    _add(medium, beams, b, spread, lines, i, facing, crossing, brought)
            if not ends < length or not onward(cells, steps, axis):
                break
            begins = ends


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _crossing(beams, b, lines, i, radius, within):
    """Where beam b meets line of sight i, within a part of it (from, to); of no volume where it does not."""
    ray = beams.ray
    vx, vy, vz = lines.direction[i, 0], lines.direction[i, 1], lines.direction[i, 2]
    x, y, z = lines.origin[i, 0] - ray[b, 0], lines.origin[i, 1] - ray[b, 1], lines.origin[i, 2] - ray[b, 2]
    bx, by, bz = ray[b, 3], ray[b, 4], ray[b, 5]
    ux, uy, uz = by * vz - bz * vy, bz * vx - bx * vz, bx * vy - by * vx
    square, apart = ux * ux + uy * uy + uz * uz, ux * x + uy * y + uz * z
    if apart * apart > radius * radius * square:
        return _Crossing(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    # the way along which the beam is moved
    nx, ny, nz = beams.normal[b, 0], beams.normal[b, 1], beams.normal[b, 2]
    up = ux * nx + uy * ny + uz * nz
    level = square - up * up
    if level < _GRAZING * square:
        up, level = 0.0, square
    scale = 1 / math.sqrt(level)
    wx, wy, wz = (ux - up * nx) * scale, (uy - up * ny) * scale, (uz - up * nz) * scale
    volume = ux * wx + uy * wy + uz * wz
    moved = apart / volume
    if not abs(moved) <= radius:
        return _Crossing(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    cx, cy, cz = by * wz - bz * wy, bz * wx - bx * wz, bx * wy - by * wx
    t = -(x * cx + y * cy + z * cz) / (vx * cx + vy * cy + vz * cz)
    if not (within[0] <= t < within[1]):
        return _Crossing(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    s = (x + t * vx - moved * wx) * bx + (y + t * vy - moved * wy) * by + (z + t * vz - moved * wz) * bz
    if not (0.0 <= s < beams.length[b]):
        return _Crossing(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return _Crossing(t, s, abs(moved), wx, wy, wz, volume)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _add(medium, beams, b, spread, lines, i, facing, crossing, brought):
    """Adds what beam b passes to line of sight i where they meet."""
    vx, vy, vz = lines.direction[i, 0], lines.direction[i, 1], lines.direction[i, 2]
    bx, by, bz = beams.ray[b, 3], beams.ray[b, 4], beams.ray[b, 5]
    t, radius, sigma = crossing.t, spread.radius, medium.sigma_t
    cosine = min(max(-(bx * vx + by * vy + bz * vz), -1.0), 1.0)
    share = 1.0
    if beams.density[b] < np.inf:
        odds = _odds(medium, spread.scale, t, cosine) * beams.density[b]
        share = odds / (1 + odds) if odds < np.inf else 1.0
    if spread.points > 0.0:
        beside = math.sqrt(1 - cosine * cosine)
        share *= beside / (beside + spread.points * likely(medium, crossing.s))
    inward, half = radius, SHARPER * radius
    inward_half = half
    if beams.normal[b, 0] == 0.0 and beams.normal[b, 1] == 0.0 and beams.normal[b, 2] == 0.0:
        # beyond the boundary there are none that could be moved here
        up = abs(crossing.x * facing[i, 0] + crossing.y * facing[i, 1] + crossing.z * facing[i, 2])
        deep = max(-t * (vx * facing[i, 0] + vy * facing[i, 1] + vz * facing[i, 2]), 0.0)
        inward = deep / up if deep < radius * up else radius
        inward_half = min(inward, half)
    sharper = share / ((half + inward_half) * crossing.volume) if crossing.moved <= half else 0.0
    share /= (radius + inward) * crossing.volume
    order = min(beams.before[b], 2)
    for w in range(len(sigma)):
        scattered = sigma[w] * medium.albedo[w] * phase_value(medium.v, medium.steps, medium.phase[w], 1 - cosine)
        lasting = math.exp(-sigma[w] * (t + crossing.s))
        brought[order, i, w] += share * beams.power[b, w] * scattered * lasting
        brought[CHANGED, i, w] += (sharper - share) * beams.power[b, w] * scattered * lasting
