"""Loops of paths among explicit grains: from one need of lights or surfaces of the scene to the next."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import (
    DIELECTRIC,
    DIFFUSE,
    at_surface,
    lent,
    passes_marked,
    surface_density,
    surface_frame,
    surface_share,
    voxel_at,
    within_reach,
)
from bakery.system.compiled import njit
from renderers.materials.grains._grains import next_surface, scratch
from renderers.transport.wavefront import roulette, to_rgb, uniform

# What a path needs next: a surface of the scene or the light beyond, the distance to that, a light sample, nothing; that other
# paths have come as far, a medium instead of the grain that it has met; there a new direction, or none.
LEAVES, TRACE, LIGHT, DEAD, WAITS, SWITCHES, TURNS, PASSES = range(8)
NOTHING = -1  # of the scene yet
GRAINS, MEDIUM, DIFFUSION = range(3)  # techniques: how a path goes on


class Walk(NamedTuple):
    """What loops change of n paths: arrays of any record of paths that has these fields.

    origin, direction : (n, 3) m, unit;  throughput : (n, L);  states : (n,) random streams
    sphere, triangle : (n, 4), (n,) of the grain that each starts on (`_grains.next_surface`)
    far : (n,) m, to the first surface of the scene, nan where it is not known; known where the sphere is UNKNOWN
    order, bounces : (n,) grains met; surfaces met
    single : (n,) whether light sampling cannot take the direction
    density : (n,) 1/sr, with which the direction was drawn, over the chance of a light sample there
    """

    origin: np.ndarray
    direction: np.ndarray
    throughput: np.ndarray
    states: np.ndarray
    sphere: np.ndarray
    triangle: np.ndarray
    far: np.ndarray
    order: np.ndarray
    bounces: np.ndarray
    single: np.ndarray
    density: np.ndarray


class Switching(NamedTuple):
    """When n paths go from grains to their medium.

    last : (n, 3) m, where each met the last grain
    stage, switching : (n,) grains after which each WAITS, and whether it SWITCHES, before the next one
    """

    last: np.ndarray
    stage: np.ndarray
    switching: np.ndarray


class Event(NamedTuple):
    """What loops have taken n paths to.

    status : (n,) what each needs
    kind : (n,) where that is LIGHT the type of grain, or the component of a medium;  normal : (n, 3) of the grain
    alive : (n,) whether roulette has left it
    """

    status: np.ndarray
    kind: np.ndarray
    normal: np.ndarray
    alive: np.ndarray

    @classmethod
    def empty(cls, n) -> Event:
        """Of n paths, to be filled."""
        return cls(np.empty(n, np.int64), np.empty(n, np.int64), np.empty((n, 3)), np.empty(n, bool))

    def of(self, chosen) -> Event:
        """Of some of the paths."""
        return Event(*(values[chosen] for values in self))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def crosses(aggregate, occupied, p, d, t):
    """Whether a ray of length t from p along d, both ends among the voxels, passes voxels with surfaces of the scene."""
    return occupied.size > 0 and passes_marked(aggregate.low, aggregate.edge, occupied, p, d, t)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def chance_at(aggregate, chance, p):
    """Value at p (3,) of chances (X, Y, Z) in the voxels of an aggregate."""
    return chance[voxel_at(aggregate.low, aggregate.edge, chance.shape, p[0], p[1], p[2])]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def ray_of(walk, unit, i, p, d):
    """Makes p (3,), in units, and d (3,) origin and direction of path i."""
    for k in range(3):
        p[k], d[k] = walk.origin[i, k] / unit, walk.direction[i, k]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def keep_ray(walk, unit, i, p, d):
    """Makes p (3,), in units, and d (3,) those of path i."""
    for k in range(3):
        walk.origin[i, k], walk.direction[i, k] = p[k] * unit, d[k]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def absorb(grains, kind, throughput, i, t):
    """Takes from throughputs (n, L) what the inside of a type of grain absorbs over a length t."""
    for w in range(throughput.shape[1]):
        throughput[i, w] *= math.exp(-grains.absorption[kind, w] * t)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _is_rough(grains, kind):
    """Whether directions at a type of grain have a density."""
    return grains.exemplars.table[kind, 0] == DIFFUSE or grains.exemplars.table[kind, 2] > 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _local(nx, ny, nz, dx, dy, dz, out):
    """Where a ray along d comes from, and the direction out (3,), in the frame of a normal."""
    sx, sy, sz, tx, ty, tz = surface_frame(nx, ny, nz)
    return (-(dx * sx + dy * sy + dz * sz), -(dx * tx + dy * ty + dz * tz), -(dx * nx + dy * ny + dz * nz),
            out[0] * sx + out[1] * sy + out[2] * sz, out[0] * tx + out[1] * ty + out[2] * tz,
            out[0] * nx + out[1] * ny + out[2] * nz)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def turn(grains, kind, n, d, throughput, states, i, chance):
    """Turns d (3,) at a surface with outward normal n (3,), and changes the throughputs.

    Returns the density (1/sr) of the new direction over the chance of a light sample, and whether light samples cannot take it:
    those of smooth surfaces, and those into a grain.
    """
    matter, index, roughness, _ = grains.exemplars.table[kind]
    surface = int(matter)
    sx, sy, sz, tx, ty, tz = surface_frame(n[0], n[1], n[2])
    x, y = -(d[0] * sx + d[1] * sy + d[2] * sz), -(d[0] * tx + d[1] * ty + d[2] * tz)
    z = -(d[0] * n[0] + d[1] * n[1] + d[2] * n[2])
    ox, oy, oz, share, cosine = at_surface(surface, index, roughness, x, y, z, uniform(states, i), uniform(states, i),
                                           uniform(states, i))
    for w in range(throughput.shape[1]):
        throughput[i, w] *= share * surface_share(surface, grains.channels[kind], w, cosine)
    over = 1.0 / math.sqrt(ox * ox + oy * oy + oz * oz)  # keeps rounding from growing over many reflections
    ox, oy, oz = ox * over, oy * over, oz * over
    d[0], d[1], d[2] = ox * sx + oy * tx + oz * n[0], ox * sy + oy * ty + oz * n[1], ox * sz + oy * tz + oz * n[2]
    density = 0.0
    if oz > 0.0 and _is_rough(grains, kind):
        density, _, _ = surface_density(surface, index, roughness, x, y, z, ox, oy, oz)
    return density / chance, density == 0.0


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def at_grain(grains, sphere, at, t, ray, walk, event, i):
    """Puts path i on a grain that it has met after a length t; what it needs: LIGHT, DEAD, or NOTHING.

    It is absorbed on its way in the grain, and turned unless it needs light.
    sphere, at : (4,), (2,) as of `_grains.next_surface`;  ray : p, d and the normal there, (3,)
    """
    (p, d, n), kind = ray, at[1]
    walk.bounces[i] += 1
    walk.far[i], walk.triangle[i] = np.nan, at[0]
    for k in range(4):
        walk.sphere[i, k] = sphere[k]
    if d[0] * n[0] + d[1] * n[1] + d[2] * n[2] > 0.0:
        if grains.exemplars.table[kind, 0] != DIELECTRIC:  # a camera, a lamp or rounding took light into what is opaque
            return DEAD
        absorb(grains, kind, walk.throughput, i, t)
    chance = 1.0
    if _is_rough(grains, kind):
        chance = chance_at(grains.aggregate, grains.chance, p)
        if uniform(walk.states, i) < chance:
            event.kind[i] = kind
            for k in range(3):
                event.normal[i, k] = n[k]
            return LIGHT
    walk.density[i], walk.single[i] = turn(grains, kind, n, d, walk.throughput, walk.states, i, chance)
    roulette(walk.throughput, walk.states, walk.bounces, event.alive, i, i + 1)
    return NOTHING if event.alive[i] else DEAD


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def leave(grains, d, n, at, walk, i):
    """Absorbs what a path that comes to a surface of the scene in a grain loses up to there."""
    if not math.isnan(walk.far[i]) and at[0] >= 0 and d[0] * n[0] + d[1] * n[1] + d[2] * n[2] > 0.0:
        absorb(grains, at[1], walk.throughput, i, walk.far[i] / grains.unit)


@njit(cache=True, nogil=True, error_model="numpy")
def advance(grains, occupied, walk, switching, event, begin, end):
    """Takes paths begin to end on, through all surfaces that only reflect and refract, until they need something of the scene.

    occupied : (X, Y, Z) uint8, voxels of the aggregate with surfaces of the scene; empty where there are none
    walk : `Walk`, changed;  switching : `Switching`, of which `last` changes;  event : `Event`, filled
    """
    grains, walk, switching, event = lent(grains), lent(walk), lent(switching), lent(event)
    memory, p, d, n = scratch(), np.empty(3), np.empty(3), np.empty(3)
    sphere, at = np.empty(4, np.int64), np.empty(2, np.int64)
    unit, status = grains.unit, event.status
    for i in range(begin, end):
        ray_of(walk, unit, i, p, d)
        status[i] = NOTHING
        while status[i] == NOTHING:
            for k in range(4):
                sphere[k] = walk.sphere[i, k]
            at[0] = walk.triangle[i]
            traced = not math.isnan(walk.far[i])
            t = next_surface(grains, p, d, walk.far[i] / unit if traced else np.inf, sphere, at, n, memory)
            if t == np.inf:
                status[i] = LEAVES
                leave(grains, d, n, at, walk, i)
                break
            if not traced and crosses(grains.aggregate, occupied, p, d, t):
                status[i] = TRACE
                break
            new = (walk.sphere[i, 0] < 0 or walk.sphere[i, 0] != sphere[0] or walk.sphere[i, 1] != sphere[1]
                   or walk.sphere[i, 2] != sphere[2] or walk.sphere[i, 3] != sphere[3])
            if new and walk.order[i] >= switching.stage[i] and not switching.switching[i]:
                status[i] = WAITS
                break
            for k in range(3):
                p[k] += t * d[k]
            if new and switching.switching[i]:
                status[i] = SWITCHES
                break
            if new:
                walk.order[i] += 1
                for k in range(3):
                    switching.last[i, k] = p[k] * unit
            status[i] = at_grain(grains, sphere, at, t, (p, d, n), walk, event, i)
        keep_ray(walk, unit, i, p, d)


@njit(cache=True, nogil=True, error_model="numpy")
def next_event(grains, colours, walk, event, sample, added, begin, end):
    """What light samples send by way of rough and matt grains: added (n, 3) linear sRGB.

    sample : `LightSample`, whose distances are those up to which grains are looked for
    """
    grains, walk, event, sample = lent(grains), lent(walk), lent(event), lent(sample)
    radiance, towards = sample.radiance, sample.direction
    memory, p, d, n, values = scratch(), np.empty(3), np.empty(3), np.empty(3), np.empty(walk.throughput.shape[1])
    sphere, at = np.empty(4, np.int64), np.empty(2, np.int64)
    for i in range(begin, end):
        added[i] = 0.0
        nx, ny, nz = event.normal[i, 0], event.normal[i, 1], event.normal[i, 2]
        for k in range(3):
            p[k], d[k] = walk.origin[i, k] / grains.unit, towards[i, k]
        # light that goes into a grain meets its other side
        if d[0] * nx + d[1] * ny + d[2] * nz <= 0.0 or not (radiance[i, 0] > 0 or radiance[i, 1] > 0 or radiance[i, 2] > 0):
            continue
        kind = event.kind[i]
        matter, index, roughness, _ = grains.exemplars.table[kind]
        x, y, z, ox, oy, oz = _local(nx, ny, nz, walk.direction[i, 0], walk.direction[i, 1], walk.direction[i, 2], d)
        likely, share, cosine = surface_density(int(matter), index, roughness, x, y, z, ox, oy, oz)
        if likely == 0.0:
            continue
        for k in range(4):
            sphere[k] = walk.sphere[i, k]
        at[0] = walk.triangle[i]
        if next_surface(grains, p, d, sample.distance[i] / grains.unit, sphere, at, n, memory) < np.inf:
            continue
        chance = chance_at(grains.aggregate, grains.chance, p)
        balance = 1.0 if sample.delta[i] else sample.density[i] / (sample.density[i] + likely / chance)
        share *= likely * balance / chance
        for w in range(len(values)):
            values[w] = walk.throughput[i, w] * share * surface_share(int(matter), grains.channels[kind], w, cosine)
        to_rgb(colours, values, radiance[i], added[i])


@njit(cache=True, nogil=True, error_model="numpy")
def scatter(grains, walk, event, begin, end):
    """New directions of paths at rough and matt grains, their densities (as `advance`), and whether they go on."""
    grains, walk, event = lent(grains), lent(walk), lent(event)
    p, d, n = np.empty(3), np.empty(3), np.empty(3)
    for i in range(begin, end):
        ray_of(walk, grains.unit, i, p, d)
        for k in range(3):
            n[k] = event.normal[i, k]
        chance = chance_at(grains.aggregate, grains.chance, p)
        walk.density[i], walk.single[i] = turn(grains, event.kind[i], n, d, walk.throughput, walk.states, i, chance)
        for k in range(3):
            walk.direction[i, k] = d[k]
        roulette(walk.throughput, walk.states, walk.bounces, event.alive, i, i + 1)


@njit(cache=True, nogil=True, error_model="numpy")
def first_surface(grains, point, direction, far, start, t, normal, begin, end):
    """Distances t (n,) m from points (n, 3) m along directions to the next surface of a grain before far (n,) m, inf where there
    is none.

    start : (n, 4), (n,) sphere and triangle of the grain that each starts on, as in `_grains.next_surface`
    normal : (n, 3), outward, of the surface that is met, before `far` or after it; 0 where there is none
    """
    grains = lent(grains)
    memory, p, d, n = scratch(), np.empty(3), np.empty(3), np.empty(3)
    (spheres, triangles), sphere, at = start, np.empty(4, np.int64), np.empty(2, np.int64)
    for i in range(begin, end):
        for k in range(3):
            p[k], d[k] = point[i, k] / grains.unit, direction[i, k]
        for k in range(4):
            sphere[k] = spheres[i, k]
        at[0] = triangles[i]
        t[i] = next_surface(grains, p, d, far[i] / grains.unit, sphere, at, n, memory) * grains.unit
        for k in range(3):
            normal[i, k] = n[k] if at[0] >= 0 else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def reached(grains, point, direction, far, comes, begin, end):
    """Whether rays from points (n, 3) m along directions come to a voxel that some grain reaches into before far (n,) m: comes
    (n,) bool."""
    grains = lent(grains)
    p, d = np.empty(3), np.empty(3)
    for i in range(begin, end):
        for k in range(3):
            p[k], d[k] = point[i, k] / grains.unit, direction[i, k]
        comes[i] = within_reach(grains.aggregate, p, d, 0.0) < far[i] / grains.unit
