"""Loops of paths among grains that have no arrangement: flights from sphere to sphere are drawn, grains are traced."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import (
    DIELECTRIC,
    flight_to_sphere,
    in_mesh,
    lent,
    share_at,
    surface_frame,
    within_reach,
)
from bakery.system.compiled import njit
from renderers.granular._grains import _AHEAD, far_side, on_grain, scratch
from renderers.granular._paths import LEAVES, NOTHING, TRACE, _absorb, at_grain, crosses
from renderers.wavefront import uniform


class Flights(NamedTuple):
    """How far light flies between spheres, and which spheres it enters.

    void : (K,) units, ascending: chords between spheres, one as likely as the other
    longer : (K,) cumulated shares of their length
    area, volume : (N,) cumulated shares of the tile's spheres in cross section and volume
    fraction : of the volume in spheres
    """

    void: np.ndarray
    longer: np.ndarray
    area: np.ndarray
    volume: np.ndarray
    fraction: float


@njit(cache=True, nogil=True, error_model="numpy")
def _sphere_point(states, i):
    """A point of the unit sphere."""
    z, turn = 2.0 * uniform(states, i) - 1.0, 2.0 * math.pi * uniform(states, i)
    across = math.sqrt(1.0 - z * z)
    return across * math.cos(turn), across * math.sin(turn), z


@njit(cache=True, nogil=True, error_model="numpy")
def chords(aggregate, area, limit, states, chord, begin, end):
    """Chords (n,) between spheres of the repeated tile along isotropic uniform lines; longer ones are cut at `limit`.

    area : (N,) cumulated shares in cross section;  states : (n,) random streams
    """
    aggregate = lent(aggregate)
    o, d, to = np.empty(3), np.empty(3), np.empty(3)
    left, met = np.zeros(4, np.int64), np.empty(4, np.int64)
    for i in range(begin, end):
        left[0] = min(np.searchsorted(area, uniform(states, i), "right"), len(area) - 1)
        nx, ny, nz = _sphere_point(states, i)
        # the normal plus a point of the unit sphere has the cosine distribution about the normal
        dx, dy, dz = _sphere_point(states, i)
        dx, dy, dz = nx + dx, ny + dy, nz + dz
        over, radius = 1.0 / max(math.sqrt(dx * dx + dy * dy + dz * dz), 1e-12), aggregate.radii[left[0]]
        d[0], d[1], d[2] = dx * over, dy * over, dz * over
        o[0] = aggregate.centers[left[0], 0] + radius * nx
        o[1] = aggregate.centers[left[0], 1] + radius * ny
        o[2] = aggregate.centers[left[0], 2] + radius * nz
        chord[i] = flight_to_sphere(o, d, left, aggregate.cell, aggregate.m, aggregate.start, aggregate.image, aggregate.owner,
                                    limit, met, to)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def next_surface(grains, flights, p, d, far, met, centre, states, i, at, normal, room):
    """As `_grains.next_surface`, where spheres along the ray are drawn from stream i, and forgotten once the ray has left them.

    met : (4,) sphere of the tile and words of the grain's hash, or UNKNOWN;  centre : (3,) of the sphere, in units
    Both become those of the sphere of the grain that is met.
    """
    aggregate, radii = grains.aggregate, grains.aggregate.radii
    begin, fresh = 0.0, met[0] < 0
    if not fresh:
        x, y, z = centre[0] - p[0], centre[1] - p[1], centre[2] - p[2]
        t = on_grain(grains, met, (centre[0], centre[1], centre[2]), x, y, z, d, 0.0, 0.0, at, normal, room[0][0])
        if t < np.inf:
            return t if t < far else np.inf
        begin = max(far_side(x, y, z, d, radii[met[0]]), 0.0)
    at[0] = -1
    while True:
        start = within_reach(aggregate, p, d, begin)
        fresh = fresh or start > begin
        if not start < far:
            return np.inf
        met[0], entry, ahead, x, y, z = _sphere(flights, radii, fresh, start, d, states, i)
        if not entry < far:
            return np.inf
        begin, fresh = far_side(x, y, z, d, radii[met[0]]), False
        cx, cy, cz = p[0] + x, p[1] + y, p[2] + z
        share = share_at(aggregate, cx, cy, cz) if aggregate.share.values.size > 0 else 1.0
        if in_mesh(aggregate, cx, cy, cz, room[0]) and (share >= 1.0 or uniform(states, i) < share):
            met[1], met[2], met[3] = np.int64(uniform(states, i) * 2.0**53), 0, 0
            t = on_grain(grains, met, (cx, cy, cz), x, y, z, d, entry, ahead, at, normal, room[0][0])
            if t < np.inf:
                leaves = d[0] * normal[0] + d[1] * normal[1] + d[2] * normal[2] > 0.0
                if leaves and grains.exemplars.table[at[1], 0] != DIELECTRIC:  # light does not begin inside of what is opaque
                    begin, fresh, at[0] = start, True, -1
                    continue
                centre[0], centre[1], centre[2] = cx, cy, cz
                return t if t < far else np.inf


@njit(cache=True, nogil=True, error_model="numpy")
def _sphere(flights, radii, fresh, start, d, states, i):
    """The sphere that a ray along d (3,) meets from `start` on, where it leaves another one or, if fresh, is anywhere.

    Returns its number, the distance at which the ray is first in it, how many radii before that the grain is looked for, and the
    way to its centre from where `start` is counted.
    """
    if fresh and uniform(states, i) < flights.fraction:  # anywhere in a sphere
        s = min(np.searchsorted(flights.volume, uniform(states, i), "right"), len(radii) - 1)
        x, y, z = _sphere_point(states, i)
        radius = radii[s] * uniform(states, i) ** (1 / 3)
        return s, start, 0.0, start * d[0] + radius * x, start * d[1] + radius * y, start * d[2] + radius * z
    entry = start + _flown(flights, fresh, states, i)
    s = min(np.searchsorted(flights.area, uniform(states, i), "right"), len(radii) - 1)
    square, turn = uniform(states, i), 2.0 * math.pi * uniform(states, i)
    u, v = radii[s] * math.sqrt(square) * math.cos(turn), radii[s] * math.sqrt(square) * math.sin(turn)
    along = entry + radii[s] * math.sqrt(1.0 - square)
    sx, sy, sz, tx, ty, tz = surface_frame(d[0], d[1], d[2])
    return (s, entry, _AHEAD, along * d[0] + u * sx + v * tx, along * d[1] + u * sy + v * ty, along * d[2] + u * sz + v * tz)


@njit(cache=True, nogil=True, error_model="numpy")
def _flown(flights, fresh, states, i):
    """Way to the next sphere from another one, or, if fresh, from anywhere between spheres."""
    u = uniform(states, i)
    if not fresh:
        return flights.void[int(u * len(flights.void))]
    # a point lies on a chord as often as that is long, and anywhere on it
    k = min(np.searchsorted(flights.longer, u, "right"), len(flights.void) - 1)
    return flights.void[k] * uniform(states, i)


@njit(cache=True, nogil=True, error_model="numpy")
def advance(grains, flights, occupied, origin, direction, weight, states, met, centre, place, far, order, bounces, single,
            density, normal, kind, status, alive, begin, end):
    """As `_paths.advance`;  centre : (n, 3) m, of the sphere that each path starts in."""
    grains, flights = lent(grains), lent(flights)
    room, p, d, n, middle = scratch(), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    now, at = np.empty(4, np.int64), np.empty(2, np.int64)
    unit = grains.unit
    for i in range(begin, end):
        for k in range(3):
            p[k], d[k] = origin[i, k] / unit, direction[i, k]
        while True:
            for k in range(3):
                middle[k] = centre[i, k] / unit
            for k in range(4):
                now[k] = met[i, k]
            at[0] = place[i]
            stream, known = states[i], not math.isnan(far[i])
            t = next_surface(grains, flights, p, d, far[i] / unit if known else np.inf, now, middle, states, i, at, n, room)
            if t == np.inf:
                status[i] = LEAVES
                if known and at[0] >= 0 and d[0] * n[0] + d[1] * n[1] + d[2] * n[2] > 0.0:  # a surface of the scene in a grain
                    _absorb(grains, at[1], weight, i, far[i] / unit)
                break
            if not known and crosses(grains.aggregate, occupied, p, d, t):
                states[i], status[i] = stream, TRACE  # drawn again, the same, once `far` is known
                break
            which = at[1]
            if met[i, 0] != now[0] or met[i, 1] != now[1]:
                order[i] += 1
            bounces[i] += 1
            far[i], place[i] = np.nan, at[0]
            for k in range(3):
                p[k] += t * d[k]
                centre[i, k] = middle[k] * unit
            for k in range(4):
                met[i, k] = now[k]
            needs = at_grain(grains, which, t, p, d, n, weight, states, i, bounces, single, density, normal, kind, alive)
            if needs != NOTHING:
                status[i] = needs
                break
        for k in range(3):
            origin[i, k], direction[i, k] = p[k] * unit, d[k]


@njit(cache=True, nogil=True, error_model="numpy")
def clear(grains, flights, origin, met, centre, place, towards, distance, states, found, begin, end):
    """Whether no grain is on the ways from origin (n, 3) m along towards (n, 3) to `distance` (n,) m: found (n,) bool.

    met, centre, place : (n, 4), (n, 3) m, (n,) sphere and triangle that each starts on, as in `next_surface`
    """
    grains, flights = lent(grains), lent(flights)
    room, p, d, n, middle = scratch(), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    now, at = np.empty(4, np.int64), np.empty(2, np.int64)
    for i in range(begin, end):
        for k in range(3):
            p[k], d[k], middle[k] = origin[i, k] / grains.unit, towards[i, k], centre[i, k] / grains.unit
        for k in range(4):
            now[k] = met[i, k]
        at[0] = place[i]
        found[i] = next_surface(grains, flights, p, d, distance[i] / grains.unit, now, middle, states, i, at, n, room) == np.inf
