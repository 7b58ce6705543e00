"""Loops of paths among grains that have no arrangement: flights from sphere to sphere are drawn, grains are traced."""

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
from renderers.materials.grains._grains import _AHEAD, far_side, on_grain, scratch
from renderers.materials.grains._paths import LEAVES, NOTHING, TRACE, at_grain, crosses, keep_ray, leave, ray_of
from renderers.transport.wavefront import uniform


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
    grid = aggregate.cell, aggregate.m, aggregate.start, aggregate.image, aggregate.owner
    o, d, to = np.empty(3), np.empty(3), np.empty(3)
    behind, sphere = np.zeros(4, np.int64), np.empty(4, np.int64)
    for i in range(begin, end):
        behind[0] = min(np.searchsorted(area, uniform(states, i), "right"), len(area) - 1)
        nx, ny, nz = _sphere_point(states, i)
        # the normal plus a point of the unit sphere has the cosine distribution about the normal
        dx, dy, dz = _sphere_point(states, i)
        dx, dy, dz = nx + dx, ny + dy, nz + dz
        over, radius = 1.0 / max(math.sqrt(dx * dx + dy * dy + dz * dz), 1e-12), aggregate.radii[behind[0]]
        d[0], d[1], d[2] = dx * over, dy * over, dz * over
        o[0] = aggregate.centers[behind[0], 0] + radius * nx
        o[1] = aggregate.centers[behind[0], 1] + radius * ny
        o[2] = aggregate.centers[behind[0], 2] + radius * nz
        chord[i] = flight_to_sphere(o, d, behind, grid, limit, sphere, to)


class Contact(NamedTuple):
    """Where a ray starts, and then where it meets a grain.

    sphere : (4,) of the tile, and words of the grain's hash, or UNKNOWN;  centre : (3,) of the sphere, in units
    at, normal : (2,), (3,) as in `_grains.next_surface`
    """

    sphere: np.ndarray
    centre: np.ndarray
    at: np.ndarray
    normal: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def next_surface(grains, flights, ray, far, contact, states, i, scratch):
    """As `_grains.next_surface`, where spheres along the ray are drawn from stream i, and forgotten once the ray has left them.

    ray : p (3,) and unit d (3,);  contact : `Contact`, which becomes that with the grain that is met
    """
    aggregate, radii, (p, d), (sphere, centre, at, normal) = grains.aggregate, grains.aggregate.radii, ray, contact
    begin, fresh = 0.0, sphere[0] < 0
    if not fresh:
        x, y, z = centre[0] - p[0], centre[1] - p[1], centre[2] - p[2]
        t = on_grain(grains, sphere, (centre[0], centre[1], centre[2]), (x, y, z), d, (0.0, 0.0), at, normal, scratch[0][0])
        if t < np.inf:
            return t if t < far else np.inf
        begin = max(far_side(x, y, z, d, radii[sphere[0]]), 0.0)
    at[0] = -1
    while True:
        start = within_reach(aggregate, p, d, begin)
        fresh = fresh or start > begin
        if not start < far:
            return np.inf
        sphere[0], entry, ahead, x, y, z = _sphere(flights, radii, fresh, start, d, states, i)
        if not entry < far:
            return np.inf
        begin, fresh = far_side(x, y, z, d, radii[sphere[0]]), False
        cx, cy, cz = p[0] + x, p[1] + y, p[2] + z
        share = share_at(aggregate, cx, cy, cz) if aggregate.share.values.size > 0 else 1.0
        if in_mesh(aggregate, cx, cy, cz, scratch[0]) and (share >= 1.0 or uniform(states, i) < share):
            sphere[1], sphere[2], sphere[3] = np.int64(uniform(states, i) * 2.0**53), 0, 0
            t = on_grain(grains, sphere, (cx, cy, cz), (x, y, z), d, (entry, ahead), at, normal, scratch[0][0])
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


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _start(sphere, triangle, centre, unit, i, contact):
    """Makes the contact that with which path i starts."""
    for k in range(3):
        contact.centre[k] = centre[i, k] / unit
    for k in range(4):
        contact.sphere[k] = sphere[i, k]
    contact.at[0] = triangle[i]


@njit(cache=True, nogil=True, error_model="numpy")
def advance(grains, flights, occupied, walk, centre, event, begin, end):
    """As `_paths.advance`, without switching;  centre : (n, 3) m, of the sphere that each path starts in."""
    grains, flights, walk, event = lent(grains), lent(flights), lent(walk), lent(event)
    memory, p, d, n, middle = scratch(), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    sphere, at = np.empty(4, np.int64), np.empty(2, np.int64)
    contact, unit, status = Contact(sphere, middle, at, n), grains.unit, event.status
    for i in range(begin, end):
        ray_of(walk, unit, i, p, d)
        status[i] = NOTHING
        while status[i] == NOTHING:
            _start(walk.sphere, walk.triangle, centre, unit, i, contact)
            stream, traced = walk.states[i], not math.isnan(walk.far[i])
            t = next_surface(grains, flights, (p, d), walk.far[i] / unit if traced else np.inf, contact, walk.states, i, memory)
            if t == np.inf:
                status[i] = LEAVES
                leave(grains, d, n, at, walk, i)
                break
            if not traced and crosses(grains.aggregate, occupied, p, d, t):
                walk.states[i], status[i] = stream, TRACE  # drawn again, the same, once `far` is known
                break
            if walk.sphere[i, 0] != sphere[0] or walk.sphere[i, 1] != sphere[1]:
                walk.order[i] += 1
            for k in range(3):
                p[k] += t * d[k]
                centre[i, k] = middle[k] * unit
            status[i] = at_grain(grains, sphere, at, t, (p, d, n), walk, event, i)
        keep_ray(walk, unit, i, p, d)


@njit(cache=True, nogil=True, error_model="numpy")
def first_grain(grains, flights, walk, centre, distance, begin, end):
    """Makes distances (n,) m to the first grain along paths of those before which it comes, inf of others.

    centre : (n, 3) m, of the sphere that each starts in
    """
    grains, flights, walk = lent(grains), lent(flights), lent(walk)
    memory, p, d = scratch(), np.empty(3), np.empty(3)
    contact = Contact(np.empty(4, np.int64), np.empty(3), np.empty(2, np.int64), np.empty(3))
    for i in range(begin, end):
        ray_of(walk, grains.unit, i, p, d)
        _start(walk.sphere, walk.triangle, centre, grains.unit, i, contact)
        far = distance[i] / grains.unit
        distance[i] = next_surface(grains, flights, (p, d), far, contact, walk.states, i, memory) * grains.unit
