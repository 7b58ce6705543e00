"""Loops of light that walks in a body and is turned back at its boundary, where that is smooth."""

from __future__ import annotations

import math

import numpy as np

from bakery.kernels import fresnel, lent, mesh_scratch, triangle_normal
from bakery.system.compiled import njit
from renderers.materials.bodies._geometry import clearance, first
from renderers.transport.scattering import flight, flown, scattered
from renderers.transport.wavefront import roulette, uniform

# a walk goes on in the body, or outside; it has met a surface at which Mitsuba turns light; it has ended
MORE, OUTSIDE, SURFACE, OVER = range(4)
MEETINGS = 8  # with surfaces in one call


@njit(cache=True, nogil=True, error_model="numpy")
def walk(geometry, medium, number, index, origin, direction, weight, states, far, triangle, start, events, order, bounces,
         leaving, turned, status, alive, begin, end):
    """Takes walks begin to end from surface to surface, up to `MEETINGS` of them.

    Parameters
    ----------
    medium : `Scatterer` of body `number`
    index : refractive index inside over that outside, of a smooth boundary; 0 where Mitsuba turns light
    origin, direction, weight, states, far, triangle, start, events, order, bounces : as in `_walk.advance`
    leaving : (n, MEETINGS, 7 + L) place and direction of light that meets a surface after `events` (7th, 0: none) and its weights
    turned : (n, MEETINGS, 8 + L) place, direction and length (m) of the way of what a boundary turns back, events before (8th,
        -1: none), and its weights
    status : (n,) becomes MORE, OUTSIDE, SURFACE or OVER;  alive : (n,) bool, room
    """
    geometry, medium = lent(geometry), lent(medium)
    scratch, values, waves = mesh_scratch(), np.empty(weight.shape[1]), weight.shape[1]
    for i in range(begin, end):
        for m in range(MEETINGS):
            leaving[i, m, 6], turned[i, m, 7] = 0.0, -1.0
        status[i] = MORE
        for m in range(MEETINGS):
            _to_surface(geometry, medium, origin, direction, weight, states, i, far, triangle, start, events, order, bounces,
                        alive, values, scratch)
            if not alive[i]:
                status[i] = OVER
                break
            if events[i] > 0:
                leaving[i, m, 6] = events[i]
                for k in range(3):
                    leaving[i, m, k], leaving[i, m, 3 + k] = origin[i, k] + far[i] * direction[i, k], direction[i, k]
                for w in range(waves):
                    leaving[i, m, 7 + w] = weight[i, w]
            if index == 0.0 or geometry.owner[triangle[i]] != number:
                status[i] = SURFACE
                break
            back = _at_boundary(geometry, index, origin, direction, states, i, far, triangle)
            start[i], events[i] = triangle[i], 0
            bounces[i] += 1
            if not back:
                status[i] = OUTSIDE
                break
            roulette(weight, states, bounces, alive, i, i + 1)
            if not alive[i]:
                status[i] = OVER
                break
            triangle[i], far[i] = first(geometry, origin, direction, i, start[i], scratch)
            turned[i, m, 6], turned[i, m, 7] = far[i], order[i]
            for k in range(3):
                turned[i, m, k], turned[i, m, 3 + k] = origin[i, k], direction[i, k]
            for w in range(waves):
                turned[i, m, 8 + w] = weight[i, w]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _to_surface(geometry, medium, origin, direction, weight, states, i, far, triangle, start, events, order, bounces, alive,
                values, scratch):
    """Takes walk i to the next surface; alive (n,) becomes whether it gets there."""
    alive[i] = True
    while True:
        t = flight(medium, weight, states, i)
        # flights that end sooner than any triangle may be need no search among them
        if math.isnan(far[i]) and not t < clearance(geometry, origin, i):
            triangle[i], far[i] = first(geometry, origin, direction, i, start[i], scratch)
        if not math.isnan(far[i]) and not t < far[i]:
            flown(medium, weight, i, far[i], False)
            alive[i] = far[i] < np.inf
            return
        flown(medium, weight, i, t, True)
        for k in range(3):
            origin[i, k] += t * direction[i, k]
        events[i] += 1
        order[i] += 1
        bounces[i] += 1
        start[i], far[i] = -1, np.nan
        direction[i, 0], direction[i, 1], direction[i, 2], _ = scattered(
            medium, 0, direction[i, 0], direction[i, 1], direction[i, 2], weight, states, i, values)
        roulette(weight, states, bounces, alive, i, i + 1)
        if not alive[i]:
            return


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _at_boundary(geometry, index, origin, direction, states, i, far, triangle):
    """Puts walk i at the boundary that it meets, with a new direction; whether it is turned back."""
    nx, ny, nz = triangle_normal(geometry.blocks, triangle[i])
    cosine = max(min(nx * direction[i, 0] + ny * direction[i, 1] + nz * direction[i, 2], 1.0), 0.0)
    share, beyond = fresnel(cosine, 1.0 / index)
    back = uniform(states, i) < share
    along, across = (1.0, -2 * cosine) if back else (index, beyond - index * cosine)
    x, y = along * direction[i, 0] + across * nx, along * direction[i, 1] + across * ny
    z = along * direction[i, 2] + across * nz
    norm = 1 / math.sqrt(x * x + y * y + z * z)
    for k in range(3):
        origin[i, k] += far[i] * direction[i, k]
    direction[i, 0], direction[i, 1], direction[i, 2] = x * norm, y * norm, z * norm
    return back
