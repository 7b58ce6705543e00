"""Loops that join beams of light with lines of sight that pass close by, in a grid of cells that know their beams."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import lent, phase_value
from bakery.system.compiled import njit

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


class Cells(NamedTuple):
    """Which beams come near which cells of a grid.

    low, edge, shape : (3,) m, m, (3,)
    begin : (cells + 1,) where the beams of each begin in `names`
    """

    low: np.ndarray
    edge: float
    shape: np.ndarray
    begin: np.ndarray
    names: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy")
def entered(ray, length, radius, low, edge, shape, begin, names):
    """Counts beams that come within a radius (m) of each cell, in begin (cells + 1,); or, where there are names, enters them
    there, beginning at `begin`, which is moved on.

    ray (N, 6), length (N,) : of `Lit`, none of infinite length;  low, edge, shape : of `Cells`
    """
    least, most = np.empty(3, np.int64), np.empty(3, np.int64)
    for b in range(len(length)):
        axis = 0
        for k in range(3):
            if abs(ray[b, 3 + k]) > abs(ray[b, 3 + axis]):
                axis = k
        start, d = ray[b, axis], ray[b, 3 + axis]
        ends = min(start, start + d * length[b]) - radius, max(start, start + d * length[b]) + radius
        first = max(math.floor((ends[0] - low[axis]) / edge), 0)
        last = min(math.floor((ends[1] - low[axis]) / edge), shape[axis] - 1)
        for slab in range(first, last + 1):
            # the part of the beam that comes within the radius of this layer of cells
            near = (low[axis] + slab * edge - radius - start) / d
            far_end = (low[axis] + (slab + 1) * edge + radius - start) / d
            near, far_end = max(min(near, far_end), 0.0), min(max(near, far_end), length[b])
            for k in range(3):
                low_end = ray[b, k] + min(near * ray[b, 3 + k], far_end * ray[b, 3 + k]) - radius
                high_end = ray[b, k] + max(near * ray[b, 3 + k], far_end * ray[b, 3 + k]) + radius
                least[k] = max(math.floor((low_end - low[k]) / edge), 0)
                most[k] = min(math.floor((high_end - low[k]) / edge), shape[k] - 1)
            least[axis], most[axis] = slab, slab
            for x in range(least[0], most[0] + 1):
                for y in range(least[1], most[1] + 1):
                    for z in range(least[2], most[2] + 1):
                        cell = (x * shape[1] + y) * shape[2] + z
                        if len(names):
                            names[begin[cell]] = b
                        begin[cell] += 1


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _odds(medium, scale, t, cosine):
    """How likely beams are over how likely a path is that scatters at t (m) on a line of sight by an angle of that cosine.

    scale : of `rivals`
    """
    likely = 0.0
    for w in range(len(medium.sigma_t)):
        likely += medium.sigma_t[w] * math.exp(-medium.sigma_t[w] * t) * phase_value(medium.v, medium.steps, medium.phase[w],
                                                                                    1 - cosine)
    return scale * math.sqrt(1 - cosine * cosine) * len(medium.sigma_t) / likely


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


@njit(cache=True, nogil=True, error_model="numpy")
def join(medium, beams, cells, radius, scale, origin, direction, facing, far, brought, begin, end):
    """Radiance at the origins of lines of sight against their directions, of light that beams pass to them in one event.

    Each beam stands for those that are moved by up to a radius along the tangent of the boundary where it comes in, of which one
    meets the line; where it begins at an event, at right angles to beam and line, as far as that is inside of the body.

    Parameters
    ----------
    medium : `Scatterer`;  beams : `Lit`;  cells : `Cells`, of that radius (m)
    scale : as in `rivals`, for the balance heuristic against paths that find the same light
    origin, direction, far : (n, 3) m, unit, (n,) m;  facing : (n, 3) unit, outward normals of the boundary where lines begin
    brought : (3, n, L) becomes the radiance by beams of 0, 1 and more events before; W/m^2 sr
    """
    medium, beams, cells = lent(medium), lent(beams), lent(cells)
    ray, shape, sigma, waves = beams.ray, cells.shape, medium.sigma_t, len(medium.sigma_t)
    most = DEEP / np.min(sigma)
    at, step, ahead, across = np.empty(3, np.int64), np.empty(3, np.int64), np.empty(3), np.empty(3)
    for i in range(begin, end):
        longest = min(far[i], most)
        vx, vy, vz = direction[i, 0], direction[i, 1], direction[i, 2]
        for k in range(3):
            position, d = (origin[i, k] - cells.low[k]) / cells.edge, direction[i, k]
            at[k] = min(max(math.floor(position), 0), shape[k] - 1)
            step[k] = 1 if d > 0.0 else -1
            across[k] = cells.edge / abs(d) if d != 0.0 else np.inf
            ahead[k] = ((at[k] + 1 - position) if d > 0.0 else (position - at[k])) * across[k] if d != 0.0 else np.inf
        begins = 0.0
        while True:
            axis = 0 if ahead[0] <= ahead[1] and ahead[0] <= ahead[2] else 1 if ahead[1] <= ahead[2] else 2
            ends = min(ahead[axis], longest)
            cell = (at[0] * shape[1] + at[1]) * shape[2] + at[2]
            for name in range(cells.begin[cell], cells.begin[cell + 1]):
                b = cells.names[name]
                x, y, z = origin[i, 0] - ray[b, 0], origin[i, 1] - ray[b, 1], origin[i, 2] - ray[b, 2]
                bx, by, bz = ray[b, 3], ray[b, 4], ray[b, 5]
                ux, uy, uz = by * vz - bz * vy, bz * vx - bx * vz, bx * vy - by * vx
                square, apart = ux * ux + uy * uy + uz * uz, ux * x + uy * y + uz * z
                if apart * apart > radius * radius * square:
                    continue
                # the way along which the beam is moved
                nx, ny, nz = beams.normal[b, 0], beams.normal[b, 1], beams.normal[b, 2]
                up = ux * nx + uy * ny + uz * nz
                wide = square - up * up
                if wide < _GRAZING * square:
                    up, wide = 0.0, square
                wide = 1 / math.sqrt(wide)
                wx, wy, wz = (ux - up * nx) * wide, (uy - up * ny) * wide, (uz - up * nz) * wide
                volume = ux * wx + uy * wy + uz * wz
                moved = apart / volume
                if not abs(moved) <= radius:
                    continue
                cx, cy, cz = by * wz - bz * wy, bz * wx - bx * wz, bx * wy - by * wx
                t = -(x * cx + y * cy + z * cz) / (vx * cx + vy * cy + vz * cz)
                if not (begins <= t < ends):
                    continue
                s = (x + t * vx - moved * wx) * bx + (y + t * vy - moved * wy) * by + (z + t * vz - moved * wz) * bz
                if not (0.0 <= s < beams.length[b]):
                    continue
                cosine = min(max(-(bx * vx + by * vy + bz * vz), -1.0), 1.0)
                share = 1.0
                if beams.density[b] < np.inf:
                    odds = _odds(medium, scale, t, cosine) * beams.density[b]
                    share = odds / (1 + odds) if odds < np.inf else 1.0
                wide = radius
                if nx == 0.0 and ny == 0.0 and nz == 0.0:
                    # beyond the boundary there are none that could be moved here
                    up = abs(wx * facing[i, 0] + wy * facing[i, 1] + wz * facing[i, 2])
                    deep = max(-t * (vx * facing[i, 0] + vy * facing[i, 1] + vz * facing[i, 2]), 0.0)
                    wide = deep / up if deep < radius * up else radius
                share /= (radius + wide) * volume
                order = min(beams.before[b], 2)
                for w in range(waves):
                    scattered = sigma[w] * medium.albedo[w] * phase_value(medium.v, medium.steps, medium.phase[w], 1 - cosine)
                    brought[order, i, w] += share * beams.power[b, w] * scattered * math.exp(-sigma[w] * (t + s))
            if not ends < longest:
                break
            begins = ends
            at[axis] += step[axis]
            if not 0 <= at[axis] < shape[axis]:
                break
            ahead[axis] += across[axis]
