"""Loops of paths among explicit grains: from one need of lights or surfaces of the scene to the next."""

from __future__ import annotations

import math

import numpy as np

from bakery.kernels import DIELECTRIC, DIFFUSE, at_surface, lent, surface_density, surface_frame, surface_share
from bakery.system.compiled import njit
from renderers.granular._grains import UNKNOWN, next_surface, scratch
from renderers.wavefront import roulette, to_rgb, uniform

# What a path needs next: a surface of the scene or the light beyond, the distance to that, a light sample, nothing; that other
# paths have come as far, a medium instead of the grain that it has met; there a new direction, or none.
LEAVES, TRACE, LIGHT, DEAD, WAITS, SWITCHES, TURNS, PASSES = range(8)
NOTHING = -1  # of the scene yet
GRAINS, MEDIUM, DIFFUSION = range(3)  # techniques: how a path goes on


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def crosses(aggregate, occupied, p, d, t):
    """Whether a way of length t from p along d, both ends among the voxels, passes voxels with surfaces of the scene."""
    if occupied.size == 0:
        return False
    low, edge = aggregate.low, aggregate.edge
    a, b, c = (min(max(math.floor((p[0] - low[0]) / edge[0]), 0), occupied.shape[0] - 1),
               min(max(math.floor((p[1] - low[1]) / edge[1]), 0), occupied.shape[1] - 1),
               min(max(math.floor((p[2] - low[2]) / edge[2]), 0), occupied.shape[2] - 1))
    wall_x = (low[0] + (a + (d[0] > 0)) * edge[0] - p[0]) / d[0] if d[0] != 0 else np.inf
    wall_y = (low[1] + (b + (d[1] > 0)) * edge[1] - p[1]) / d[1] if d[1] != 0 else np.inf
    wall_z = (low[2] + (c + (d[2] > 0)) * edge[2] - p[2]) / d[2] if d[2] != 0 else np.inf
    while 0 <= a < occupied.shape[0] and 0 <= b < occupied.shape[1] and 0 <= c < occupied.shape[2]:
        if occupied[a, b, c]:
            return True
        if min(wall_x, min(wall_y, wall_z)) > t:
            return False
        if wall_x <= wall_y and wall_x <= wall_z:
            wall_x, a = wall_x + edge[0] / abs(d[0]), a + (1 if d[0] > 0 else -1)
        elif wall_y <= wall_z:
            wall_y, b = wall_y + edge[1] / abs(d[1]), b + (1 if d[1] > 0 else -1)
        else:
            wall_z, c = wall_z + edge[2] / abs(d[2]), c + (1 if d[2] > 0 else -1)
    return False


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def chance_at(aggregate, chance, p):
    """Value at p (3,) of chances (X, Y, Z) in the voxels of an aggregate."""
    low, edge = aggregate.low, aggregate.edge
    a, b, c = (min(max(math.floor((p[0] - low[0]) / edge[0]), 0), chance.shape[0] - 1),
               min(max(math.floor((p[1] - low[1]) / edge[1]), 0), chance.shape[1] - 1),
               min(max(math.floor((p[2] - low[2]) / edge[2]), 0), chance.shape[2] - 1))
    return chance[a, b, c]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _absorb(grains, which, weight, i, t):
    """Takes from weights (n, L) what the inside of a type of grain absorbs on a way of length t."""
    for w in range(weight.shape[1]):
        weight[i, w] *= math.exp(-grains.absorption[which, w] * t)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _is_rough(grains, which):
    """Whether directions at a type of grain have a density."""
    return grains.exemplars.table[which, 0] == DIFFUSE or grains.exemplars.table[which, 2] > 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _local(nx, ny, nz, dx, dy, dz, out):
    """Where a ray along d comes from, and the direction out (3,), in the frame of a normal."""
    sx, sy, sz, tx, ty, tz = surface_frame(nx, ny, nz)
    return (-(dx * sx + dy * sy + dz * sz), -(dx * tx + dy * ty + dz * tz), -(dx * nx + dy * ny + dz * nz),
            out[0] * sx + out[1] * sy + out[2] * sz, out[0] * tx + out[1] * ty + out[2] * tz,
            out[0] * nx + out[1] * ny + out[2] * nz)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _turn(grains, which, n, d, weight, states, i, chance):
    """Turns d (3,) at a surface with outward normal n (3,), and changes the weights.

    Returns the density (1/sr) of the new direction over the chance of a light sample, and whether light samples cannot take it:
    those of smooth surfaces, and those into a grain.
    """
    matter, index, roughness, _ = grains.exemplars.table[which]
    kind = int(matter)
    sx, sy, sz, tx, ty, tz = surface_frame(n[0], n[1], n[2])
    x, y = -(d[0] * sx + d[1] * sy + d[2] * sz), -(d[0] * tx + d[1] * ty + d[2] * tz)
    z = -(d[0] * n[0] + d[1] * n[1] + d[2] * n[2])
    ox, oy, oz, share, cosine = at_surface(kind, index, roughness, x, y, z, uniform(states, i), uniform(states, i),
                                           uniform(states, i))
    for w in range(weight.shape[1]):
        weight[i, w] *= share * surface_share(kind, grains.channels[which], w, cosine)
    over = 1.0 / math.sqrt(ox * ox + oy * oy + oz * oz)  # keeps rounding from growing over many reflections
    ox, oy, oz = ox * over, oy * over, oz * over
    d[0], d[1], d[2] = ox * sx + oy * tx + oz * n[0], ox * sy + oy * ty + oz * n[1], ox * sz + oy * tz + oz * n[2]
    density = 0.0
    if oz > 0.0 and _is_rough(grains, which):
        density, _, _ = surface_density(kind, index, roughness, x, y, z, ox, oy, oz)
    return density / chance, density == 0.0


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def at_grain(grains, which, t, p, d, n, weight, states, i, bounces, single, density, normal, kind, alive):
    """What path i needs at p (3,) on a grain of a type, with normal n (3,), after a way of length t: LIGHT, DEAD, or NOTHING.

    It is absorbed on its way in the grain, and turned unless it needs light; the arrays are those of `advance`.
    """
    if d[0] * n[0] + d[1] * n[1] + d[2] * n[2] > 0.0:
        if grains.exemplars.table[which, 0] != DIELECTRIC:  # a camera, a lamp or rounding took light into what is opaque
            return DEAD
        _absorb(grains, which, weight, i, t)
    chance = 1.0
    if _is_rough(grains, which):
        chance = chance_at(grains.aggregate, grains.chance, p)
        if uniform(states, i) < chance:
            kind[i] = which
            for k in range(3):
                normal[i, k] = n[k]
            return LIGHT
    density[i], single[i] = _turn(grains, which, n, d, weight, states, i, chance)
    roulette(weight, states, bounces, alive, i, i + 1)
    return NOTHING if alive[i] else DEAD


@njit(cache=True, nogil=True, error_model="numpy")
def advance(grains, occupied, origin, direction, weight, states, met, place, far, order, bounces, single, density, last,
            stage, switching, normal, kind, status, alive, begin, end):
    """Takes paths begin to end on, through all surfaces that only reflect and refract, until they need something of the scene.

    Parameters
    ----------
    occupied : (X, Y, Z) uint8, voxels of the aggregate with surfaces of the scene; empty where there are none
    origin, direction : (n, 3) m, unit;  weight : (n, L);  states : (n,);  all changed
    met, place : (n, 4), (n,) sphere and triangle that each starts on (`next_surface`); changed
    far : (n,) m, to the first surface of the scene, nan where it is not known; changed.  Known where met is UNKNOWN
    order : (n,) grains met;  bounces : (n,);  single : (n,) whether light sampling cannot take the direction; changed
    density : (n,) 1/sr, with which the direction was drawn over the chance of a light sample there; changed
    last : (n, 3) m, where each met the last grain; changed
    stage, switching : (n,) grains after which each WAITS, and whether it SWITCHES, before the next one
    normal, kind : (n, 3), (n,) become normal and type of grain where a path needs LIGHT
    status : (n,) becomes what it needs;  alive : (n,) bool, for own use
    """
    grains = lent(grains)
    room, p, d, n = scratch(), np.empty(3), np.empty(3), np.empty(3)
    now, at = np.empty(4, np.int64), np.empty(2, np.int64)
    unit = grains.unit
    for i in range(begin, end):
        for k in range(3):
            p[k], d[k] = origin[i, k] / unit, direction[i, k]
        while True:
            for k in range(4):
                now[k] = met[i, k]
            at[0] = place[i]
            known = not math.isnan(far[i])
            t = next_surface(grains, p, d, far[i] / unit if known else np.inf, now, at, n, room)
            if t == np.inf:
                status[i] = LEAVES
                if known and at[0] >= 0 and d[0] * n[0] + d[1] * n[1] + d[2] * n[2] > 0.0:  # a surface of the scene in a grain
                    _absorb(grains, at[1], weight, i, far[i] / unit)
                break
            if not known and crosses(grains.aggregate, occupied, p, d, t):
                status[i] = TRACE
                break
            which = at[1]
            new = met[i, 0] < 0 or met[i, 0] != now[0] or met[i, 1] != now[1] or met[i, 2] != now[2] or met[i, 3] != now[3]
            if new and order[i] >= stage[i] and not switching[i]:
                status[i] = WAITS
                break
            for k in range(3):
                p[k] += t * d[k]
            if new and switching[i]:
                status[i] = SWITCHES
                break
            if new:
                order[i] += 1
                for k in range(3):
                    last[i, k] = p[k] * unit
            bounces[i] += 1
            far[i], place[i] = np.nan, at[0]
            for k in range(4):
                met[i, k] = now[k]
            needs = at_grain(grains, which, t, p, d, n, weight, states, i, bounces, single, density, normal, kind, alive)
            if needs != NOTHING:
                status[i] = needs
                break
        for k in range(3):
            origin[i, k], direction[i, k] = p[k] * unit, d[k]


@njit(cache=True, nogil=True, error_model="numpy")
def light(grains, colours, origin, direction, weight, met, place, normal, kind, lit, distance, radiance, density, single, added,
          begin, end):
    """What sampled lights send by way of rough and matt grains: added (n, 3) linear sRGB.

    lit, distance, radiance, density, single : of the samples, (n, 3), (n,) m, (n, 3), (n,) 1/sr, (n,)
    """
    grains = lent(grains)
    room, p, d, n, values = scratch(), np.empty(3), np.empty(3), np.empty(3), np.empty(weight.shape[1])
    now, at = np.empty(4, np.int64), np.empty(2, np.int64)
    for i in range(begin, end):
        added[i] = 0.0
        nx, ny, nz = normal[i, 0], normal[i, 1], normal[i, 2]
        for k in range(3):
            p[k], d[k] = origin[i, k] / grains.unit, lit[i, k]
        # light that goes into a grain meets its other side
        if d[0] * nx + d[1] * ny + d[2] * nz <= 0.0 or not (radiance[i, 0] > 0 or radiance[i, 1] > 0 or radiance[i, 2] > 0):
            continue
        which = kind[i]
        matter, index, roughness, _ = grains.exemplars.table[which]
        x, y, z, ox, oy, oz = _local(nx, ny, nz, direction[i, 0], direction[i, 1], direction[i, 2], d)
        likely, share, cosine = surface_density(int(matter), index, roughness, x, y, z, ox, oy, oz)
        if likely == 0.0:
            continue
        for k in range(4):
            now[k] = met[i, k]
        at[0] = place[i]
        if next_surface(grains, p, d, distance[i] / grains.unit, now, at, n, room) < np.inf:
            continue
        chance = chance_at(grains.aggregate, grains.chance, p)
        balance = 1.0 if single[i] else density[i] / (density[i] + likely / chance)
        share *= likely * balance / chance
        for w in range(len(values)):
            values[w] = weight[i, w] * share * surface_share(int(matter), grains.channels[which], w, cosine)
        to_rgb(colours, values, radiance[i], added[i])


@njit(cache=True, nogil=True, error_model="numpy")
def scatter(grains, origin, direction, weight, states, bounces, normal, kind, density, single, alive, begin, end):
    """New directions of paths at rough and matt grains, their densities (as `advance`), and whether they go on."""
    grains = lent(grains)
    p, d, n = np.empty(3), np.empty(3), np.empty(3)
    for i in range(begin, end):
        for k in range(3):
            p[k], d[k], n[k] = origin[i, k] / grains.unit, direction[i, k], normal[i, k]
        density[i], single[i] = _turn(grains, kind[i], n, d, weight, states, i, chance_at(grains.aggregate, grains.chance, p))
        for k in range(3):
            direction[i, k] = d[k]
        roulette(weight, states, bounces, alive, i, i + 1)


@njit(cache=True, nogil=True, error_model="numpy")
def open_share(grains, point, lit, distance, share, begin, end):
    """Share (n, L), 0 or 1, of light that gets from points (n, 3) m along lit (n, 3) to `distance` (n,) m."""
    grains = lent(grains)
    room, p, d, n = scratch(), np.empty(3), np.empty(3), np.empty(3)
    now, at = np.empty(4, np.int64), np.empty(2, np.int64)
    for i in range(begin, end):
        for k in range(3):
            p[k], d[k] = point[i, k] / grains.unit, lit[i, k]
        now[0] = UNKNOWN
        share[i] = 0.0 if next_surface(grains, p, d, distance[i] / grains.unit, now, at, n, room) < np.inf else 1.0


@njit(cache=True, nogil=True, error_model="numpy")
def first_grain(grains, point, direction, far, t, begin, end):
    """Distances t (n,) m from points (n, 3) m along directions to the first grain before far (n,) m, inf where there is none."""
    grains = lent(grains)
    room, p, d, n = scratch(), np.empty(3), np.empty(3), np.empty(3)
    now, at = np.empty(4, np.int64), np.empty(2, np.int64)
    for i in range(begin, end):
        for k in range(3):
            p[k], d[k] = point[i, k] / grains.unit, direction[i, k]
        now[0] = UNKNOWN
        t[i] = next_surface(grains, p, d, far[i] / grains.unit, now, at, n, room) * grains.unit
