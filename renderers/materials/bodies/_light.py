"""Loops of light that walks in a body and is turned back at its boundary, where that is smooth."""

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import fresnel, lent, mesh_scratch, triangle_normal
from bakery.system.compiled import njit
from renderers.materials.bodies._geometry import first
from renderers.materials.bodies._walk import DEAD, ON, step
from renderers.transport.wavefront import goes_on, uniform

# a walk goes on in the body, or outside; it has met a surface at which Mitsuba turns light; it has ended
MORE, OUTSIDE, SURFACE, OVER = range(4)
MEETINGS = 8  # with surfaces in one call


class Boundary(NamedTuple):
    """Of body `number`; index : refractive index inside over that outside, of a smooth one; 0 where Mitsuba turns light"""

    number: int
    index: float


class Ends(NamedTuple):
    """What walks leave behind.

    leaving : (n, MEETINGS, 7 + L) place and direction of light that meets a surface after events (7th: how many; 0: none) and its
        weights
    turned : (n, MEETINGS, 8 + L) place, direction and length (m) of the way of what a boundary turns back, events before (8th,
        -1: none), and its weights
    status : (n,) MORE, OUTSIDE, SURFACE or OVER
    """

    leaving: np.ndarray
    turned: np.ndarray
    status: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy")
def walk(geometry, medium, boundary, limits, paths, ends, begin, end):
    """Takes walks begin to end from surface to surface, up to `MEETINGS` of them.

    medium : `Scatterer`;  boundary : `Boundary`;  limits : `_walk.Limits`;  ends : `Ends`, whose arrays are filled
    """
    geometry, medium, limits, paths, ends = lent(geometry), lent(medium), lent(limits), lent(paths), lent(ends)
    scratch, values = mesh_scratch(), np.empty(paths.throughput.shape[1])
    for i in range(begin, end):
        for m in range(MEETINGS):
            ends.leaving[i, m, 6], ends.turned[i, m, 7] = 0.0, -1.0
        ends.status[i] = MORE
        for m in range(MEETINGS):
            status = ON
            while status == ON:
                status = step(geometry, medium, limits, paths, i, scratch, values)
            if status == DEAD:
                ends.status[i] = OVER
                break
            if paths.events[i] > 0:
                ends.leaving[i, m, 6] = paths.events[i]
                for k in range(3):
                    ends.leaving[i, m, k] = paths.origin[i, k] + paths.far[i] * paths.direction[i, k]
                _store(paths, i, ends.leaving[i, m], 7)
            if boundary.index == 0.0 or geometry.owner[paths.triangle[i]] != boundary.number:
                ends.status[i] = SURFACE
                break
            if not at_boundary(geometry, boundary.index, paths, i):
                ends.status[i] = OUTSIDE
                break
            if not goes_on(paths.throughput, paths.states, paths.bounces, i):
                ends.status[i] = OVER
                break
            paths.triangle[i], paths.far[i] = first(geometry, paths.origin, paths.direction, i, paths.start[i], scratch)
            ends.turned[i, m, 6], ends.turned[i, m, 7] = paths.far[i], paths.order[i]
            for k in range(3):
                ends.turned[i, m, k] = paths.origin[i, k]
            _store(paths, i, ends.turned[i, m], 8)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _store(paths, i, row, weights):
    """Puts direction and weights of path i into a row of `Ends`."""
    for k in range(3):
        row[3 + k] = paths.direction[i, k]
    for w in range(paths.throughput.shape[1]):
        row[weights + w] = paths.throughput[i, w]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def at_boundary(geometry, index, paths, i):
    """Puts walk i at the boundary that it meets, with a new direction, and counts that; whether it is turned back."""
    nx, ny, nz = triangle_normal(geometry.blocks, paths.triangle[i])
    dx, dy, dz = paths.direction[i, 0], paths.direction[i, 1], paths.direction[i, 2]
    cosine = max(min(nx * dx + ny * dy + nz * dz, 1.0), 0.0)
    share, beyond = fresnel(cosine, 1.0 / index)
    back = uniform(paths.states, i) < share
    along, across = (1.0, -2 * cosine) if back else (index, beyond - index * cosine)
    x, y, z = along * dx + across * nx, along * dy + across * ny, along * dz + across * nz
    norm = 1 / math.sqrt(x * x + y * y + z * z)
    for k in range(3):
        paths.origin[i, k] += paths.far[i] * paths.direction[i, k]
    paths.direction[i, 0], paths.direction[i, 1], paths.direction[i, 2] = x * norm, y * norm, z * norm
    paths.start[i], paths.events[i] = paths.triangle[i], 0
    paths.bounces[i] += 1
    return back
