"""The loop of `walk`: rays on their way through a grain, one after another."""

from __future__ import annotations

import math

import numpy as np

from bakery.physics.grains.bvh import mesh_scratch, nearest_triangle, triangle_normal
from bakery.physics.grains.sampling import (
    ABSORBED,
    AHEAD,
    CONTRADICTED,
    CUT,
    FAINT,
    LEFT,
    MISSED,
    enter,
    next_uniform,
    surface_frame,
    uniforms_of_meeting,
)
from bakery.physics.grains.surface import DIELECTRIC, at_surface, surface_share
from bakery.system.compiled import njit


@njit(cache=True, nogil=True, error_model="numpy")
def followed(tree, coat, events_max, uniform, numbers, paths):
    """Fill `walk.Paths` for the rays `uniform` (n, 4) among the triangles of a `bvh.triangle_tree`."""
    nodes, children, blocks, _ = tree
    kind, mu = coat.kind, coat.mu
    first, replicate, key0, key1 = numbers
    scratch, pool, stream = mesh_scratch(), np.empty(4), np.zeros(5, np.uint64)
    stream[0], stream[1], stream[3] = key0, key1, replicate
    carried, least = np.empty(len(mu)), np.min(mu)
    for i in range(len(uniform)):
        stream[2], stream[4] = np.uint64(first + i), np.uint64(0)
        half = enter(uniform[i], paths.start[i], paths.incoming[i])
        dx, dy, dz = paths.incoming[i]
        x, y, z = paths.start[i]
        ox, oy, oz = x - AHEAD * dx, y - AHEAD * dy, z - AHEAD * dz
        triangle, count, within, path_inside, factor = np.int64(-1), 0, False, 0.0, 1.0
        carried[:] = 1.0
        while True:
            triangle, t = nearest_triangle(nodes, children, blocks, ox, oy, oz, dx, dy, dz, triangle, scratch)
            if triangle < 0:
                state = MISSED if count == 0 else CONTRADICTED if within else LEFT
                break
            ox, oy, oz = ox + t * dx, oy + t * dy, oz + t * dz
            nx, ny, nz = triangle_normal(blocks, triangle)
            z = -(dx * nx + dy * ny + dz * nz)
            if (z < 0.0) != within or z == 0.0:
                count += 1
                state = CONTRADICTED
                break
            if z < 0.0:
                path_inside += t
            if count == events_max:
                state = CUT
                break
            count += 1
            dx, dy, dz, within, through = _meet((dx, dy, dz), (nx, ny, nz), z, coat, stream, pool, carried)
            factor = _goes_on(factor * through, kind, carried, least * path_inside, stream, pool)
            if factor == 0.0:
                state = ABSORBED
                break
        paths.status[i], paths.events[i], paths.inside[i] = state, count, path_inside
        _record(i, state, half, (ox, oy, oz), (dx, dy, dz), paths)
        for c in range(len(mu)):
            if state in (ABSORBED, CONTRADICTED):
                paths.weight[i, c] = 0.0
            else:
                paths.weight[i, c] = 1.0 if state == MISSED else factor * carried[c] * math.exp(-mu[c] * path_inside)


@njit(nogil=True, error_model="numpy", forceinline=True)
def _meet(d, n, z, coat, stream, pool, carried):
    """New unit direction of a ray that meets a surface with normal n, whether it is inside then, share left of all light."""
    (dx, dy, dz), (nx, ny, nz) = d, n
    sx, sy, sz, tx, ty, tz = surface_frame(nx, ny, nz)
    x, y = -(dx * sx + dy * sy + dz * sz), -(dx * tx + dy * ty + dz * tz)
    u, v, w = uniforms_of_meeting(coat.kind, coat.roughness, stream, pool)
    x, y, z, through, cosine = at_surface(coat.kind, coat.index, coat.roughness, x, y, z, u, v, w)
    if coat.kind != DIELECTRIC:
        for c in range(len(carried)):
            carried[c] *= surface_share(coat.kind, coat.channels, c, cosine)
    dx, dy, dz = x * sx + y * tx + z * nx, x * sy + y * ty + z * ny, x * sz + y * tz + z * nz
    over = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)  # keeps rounding from growing over many reflections
    return dx * over, dy * over, dz * over, coat.kind == DIELECTRIC and z < 0.0, through


@njit(nogil=True, error_model="numpy", forceinline=True)
def _goes_on(factor, kind, carried, depth, stream, pool):
    """What a path carries on: a faint one goes on by chance, else 0.  depth : least absorption depth of any channel."""
    strongest = factor if kind == DIELECTRIC else factor * np.max(carried)
    if depth > 0.0:
        strongest *= math.exp(-depth)
    if strongest >= FAINT:
        return factor
    return factor * (FAINT / strongest) if next_uniform(stream, pool) * FAINT < strongest else 0.0


@njit(nogil=True, error_model="numpy", forceinline=True)
def _record(i, state, half, o, d, paths):
    """Where a ray from o along d leaves the bounding sphere, and its direction."""
    (ox, oy, oz), (dx, dy, dz) = o, d
    paths.outgoing[i, 0], paths.outgoing[i, 1], paths.outgoing[i, 2] = dx, dy, dz
    if state == MISSED:
        for c in range(3):
            paths.leave[i, c] = paths.start[i, c] + 2.0 * half * paths.incoming[i, c]
        return
    along = ox * dx + oy * dy + oz * dz
    t = math.sqrt(along * along + max(1.0 - (ox * ox + oy * oy + oz * oz), 0.0)) - along
    paths.leave[i, 0], paths.leave[i, 1], paths.leave[i, 2] = ox + t * dx, oy + t * dy, oz + t * dz
