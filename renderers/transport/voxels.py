"""Columns along rays through media whose density a grid gives: exact, voxel by voxel.

Between the middles of eight voxels a density is trilinear, and along a ray a polynomial of third degree, which Simpson's rule
integrates without error.  A flight through such a medium ends where the column, in lengths of density 1, is that of a flight
through a homogeneous one; so no collisions are drawn that do not take place, and shadow rays have no noise of their own.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import numpy as np

import renderers.mitsuba  # noqa: F401  before mitsuba: it finds LLVM

import mitsuba as mi  # isort: skip

_HALVINGS = 24  # of the piece in which a flight ends: what single precision tells apart


@dataclass
class _OnRay:
    """origin, slope : of rays, in voxels from the middle of the first one;  last : position of the last one
    first : place of the first one's density
    """

    origin: mi.Vector3f
    slope: mi.Vector3f
    last: mi.Vector3f
    first: mi.UInt32


class Voxels:
    """Densities on grids, by the numbers of their media.

    any : whether there is one
    """

    def __init__(self, grids, count, unit):
        """
        grids : `regions.Grid` by the number of its medium
        count : of media
        unit : m, length of 1 in the loop
        """
        self.any = bool(grids)
        if not self.any:
            return
        shapes, scales, shifts, firsts = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count)
        values, first = [], 0
        for number, grid in grids.items():
            density, low = np.asarray(grid.density, np.float32), np.asarray(grid.lo, float)
            shapes[number] = density.shape
            scales[number] = np.array(density.shape) * unit / (grid.hi - low)
            shifts[number] = -np.array(density.shape) * low / (grid.hi - low) - 0.5
            firsts[number], first = first, first + density.size
            values.append(density.ravel())
        self._values = mi.Float(np.concatenate(values))
        self._first = mi.UInt32(firsts.astype(np.uint32))
        self._shape, self._scale, self._shift = ([mi.Float(column.astype(np.float32)) for column in table.T]
                                                 for table in (shapes, scales, shifts))

    def has(self, medium):
        """Whether the density of a medium is on a grid."""
        return dr.gather(mi.Float, self._shape[0], medium) > 0

    def march(self, ray, start, end, medium, column, active):
        """How far rays come from `start` until they have passed a column, at most to `end`, and the columns that they passed.

        column : in lengths of density 1;  inf: all the way
        """
        grid = self._on_ray(ray, medium, active)

        def step(cell, t, passed, going, reached):
            corners = self._corners(grid, cell, going)
            walls = _walls(grid, cell)
            out = dr.min(walls)
            beyond = dr.maximum(t, dr.minimum(out, end))
            piece = _column(grid, corners, cell, t, beyond)
            reached |= going & (passed + piece >= column)
            going &= ~reached
            sign = dr.select(grid.slope > 0, mi.Int32(1), mi.Int32(-1))
            cell = mi.Vector3i(cell + dr.select(going & (walls <= out), sign, 0))
            t, passed = dr.select(going, beyond, t), dr.select(going, passed + piece, passed)
            return cell, t, passed, going & (beyond < end), reached

        first = dr.clip(grid.origin + start * grid.slope, -1, grid.last)
        state = mi.Vector3i(dr.floor(first)), mi.Float(start), dr.zeros(mi.Float, dr.width(active)), active & (end > start), \
            dr.full(mi.Bool, False, dr.width(active))
        cell, t, passed, _, reached = dr.while_loop(state, lambda cell, t, passed, going, reached: going, step, label="voxels")
        t = dr.select(reached, self._where(grid, cell, t, end, column - passed, reached), t)
        return t, dr.select(reached, column, passed)

    def _where(self, grid, cell, t, end, column, active):
        """Where in the cells that rays are in at t they have passed a column, by halving."""
        corners = self._corners(grid, cell, active)

        def step(low, high, turn):
            middle = 0.5 * (low + high)
            less = _column(grid, corners, cell, t, middle) < column
            return dr.select(less, middle, low), dr.select(less, high, middle), turn + 1

        out = dr.maximum(t, dr.minimum(dr.min(_walls(grid, cell)), end))
        state = mi.Float(t), out, dr.select(active, mi.UInt32(0), _HALVINGS)
        return dr.while_loop(state, lambda low, high, turn: turn < _HALVINGS, step, label="end of a flight")[1]

    def _on_ray(self, ray, medium, active):
        """Grids of media, and rays in them."""
        shape, scale, shift = (mi.Vector3f(*(dr.gather(mi.Float, axis, medium, active) for axis in table))
                               for table in (self._shape, self._scale, self._shift))
        slope = ray.d * scale
        return _OnRay(mi.Vector3f(ray.o * scale + shift), mi.Vector3f(dr.select(dr.abs(slope) > 1e-20, slope, 1e-20)), shape - 1,
                      dr.gather(mi.UInt32, self._first, medium, active))

    def _corners(self, grid, cell, active):
        """Densities at the eight middles of voxels around cells, z fastest; beyond the outer ones their own."""
        last = mi.Vector3i(grid.last)
        low, high = (dr.clip(cell + k, 0, last) for k in (0, 1))
        return [dr.gather(mi.Float, self._values, grid.first + mi.UInt32((x * (last.y + 1) + y) * (last.z + 1) + z), active)
                for x in (low.x, high.x) for y in (low.y, high.y) for z in (low.z, high.z)]


def _walls(grid, cell):
    """Distances at which rays leave cells, along each axis."""
    return (mi.Vector3f(cell) + dr.select(grid.slope > 0, mi.Float(1), mi.Float(0)) - grid.origin) / grid.slope


def _column(grid, corners, cell, begin, end):
    """Of a piece of a ray in a cell, by Simpson's rule."""
    def density(t):
        position = dr.clip(dr.clip(grid.origin + t * grid.slope, 0, grid.last) - mi.Vector3f(cell), 0, 1)
        values = corners
        for share in (position.z, position.y, position.x):
            values = [dr.lerp(a, b, share) for a, b in zip(values[::2], values[1::2])]
        return values[0]

    return (end - begin) / 6 * (density(begin) + 4 * density(0.5 * (begin + end)) + density(end))
