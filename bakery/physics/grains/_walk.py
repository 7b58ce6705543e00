"""The loop of `walk`: many rays on their way through a grain.

Many rays are under way at once and go on in steps, each step for all of them: leaps through the grid, tests of the triangles of a
cell, meetings with the surface.  So the memory that one waits for is fetched while others are computed, and leaps are made in
vector instructions.  What happens to a path depends on its own numbers only, never on its neighbours.
"""

import math
from typing import NamedTuple

import numpy as np

from bakery.physics.grains import _rays
from bakery.physics.grains._rays import confirm, leap, passed, those
from bakery.physics.grains.lanes import fetch
from bakery.physics.grains.sampling import (
    ABSORBED,
    AHEAD,
    CONTRADICTED,
    CUT,
    FAINT,
    LEFT,
    MISSED,
    philox,
    surface_frame,
    uniform_chord,
    uniform_number,
)
from bakery.physics.grains.surface import CONDUCTOR, DIELECTRIC, at_surface, surface_share
from bakery.physics.lent import lent
from bakery.physics.vectors import lowest
from bakery.system.compiled import njit

_SLOTS, _LEAPS = 128, 2  # rays under way at once; leaps between tests of cells
_EDGE = np.float32(2e-3)  # cells; a hit nearer to the wall of its cell than this is not yet known to be the first
# What is kept of a ray: axes in the order of the shear, start in that order and shear, for the exact test
(_KX, _KY, _KZ, _TRIANGLE, _SKIP, _WITHIN, _COUNT, _PATH, _STATE, _DRAWN, _FOUR), _WHOLE = range(11), 16
(_X, _Y, _Z, _DX, _DY, _DZ, _PX, _PY, _PZ, _SX, _SY, _SZ, _BEST, _INNER, _FACTOR, _HALF), _REAL = range(16), 16


class Rays(NamedTuple):
    """The rays under way, one a slot: its numbers, its state for `leap` (float32 and int32, the same memory), four uniform
    numbers drawn ahead, and what it carries in each channel."""

    real: np.ndarray
    whole: np.ndarray
    state: np.ndarray
    ints: np.ndarray
    pool: np.ndarray
    carried: np.ndarray


class Lists(NamedTuple):
    """Slots of rays that ended, hit a triangle, are to be aimed anew;  blocks of triangles to test with a ray, as `_blocks_of`
    and `_passed` write them."""

    ended: np.ndarray
    hit: np.ndarray
    aimed: np.ndarray
    tests: np.ndarray
    candidates: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy")
def followed(grid, coat, events_max, uniform, stream, paths):
    """Fill `walk.Paths` for the rays `uniform` (n, 4) through a `grid.Grid`."""
    state, number = np.zeros((_rays.FIELDS, _SLOTS), np.float32), paths.weight.shape[1]
    rays = Rays(np.zeros((_SLOTS, _REAL)), np.zeros((_SLOTS, _WHOLE), np.int64), state, state.view(np.int32),
                np.empty((_SLOTS, 4)), np.ones((_SLOTS, number)))
    lists = Lists(np.arange(_SLOTS), np.empty(_SLOTS, np.int64), np.empty(_SLOTS, np.int64), np.empty(_SLOTS, np.int64),
                  np.empty(_SLOTS * grid.longest, np.int64))
    rays.ints[_rays.STATE] = _rays.IDLE
    rays.whole[:, _PATH] = -1
    _follow(grid, coat, events_max, uniform, stream, paths, rays, lists)


@njit(cache=True, nogil=True, error_model="numpy")
def _follow(grid, coat, events_max, uniform, stream, paths, rays, lists):
    """`followed` with the memory that it needs."""
    # uncounted: counting the arrays in and out of the steps would take longer than some of them
    grid, coat, stream, paths, rays, lists = lent(grid), lent(coat), lent(stream), lent(paths), lent(rays), lent(lists)
    total, least = len(uniform), np.min(coat.mu)
    nx, ny, nz = grid.count
    alive = ended = min(_SLOTS, total)
    started = aims = 0
    while True:
        for k in range(ended):  # write down what ended, begin new paths in its place
            i = lists.ended[k]
            if i < 0:  # never: says that indices need no wrapping
                break
            _record(i, rays, coat.mu, paths)
            if started == total:
                rays.ints[_rays.STATE, i] = _rays.IDLE
                continue
            _begin(i, started, uniform, rays, paths)
            started += 1
            lists.aimed[aims] = i
            aims += 1
        for k in range(aims):
            i = lists.aimed[k]
            if i < 0:  # never, as above
                break
            _aim(i, rays, grid)
        if started == total and ended:
            alive = _closed_up(rays, alive)
        if alive == 0:
            break
        for _ in range(_LEAPS):
            for c in range(0, alive, _rays.RAYS):
                leap(rays.state, _SLOTS, c, grid.leaps, nx, ny, nz)
        ended, hits, tests = _blocks_of(rays, grid, alive, lists)
        _nearest(rays, grid, _passed(rays, grid, tests, lists), lists)
        for c in range(0, alive, _rays.RAYS):
            confirm(rays.state, _SLOTS, c, _EDGE)
        aims = 0
        for k in range(hits):
            i = lists.hit[k]
            if i < 0:  # never, as above
                break
            if _meet(i, rays, grid.corners, coat, stream, events_max, least):
                lists.aimed[aims] = i
                aims += 1
            else:
                lists.ended[ended] = i
                ended += 1


@njit(nogil=True, error_model="numpy", forceinline=True)
def _record(i, rays, mu, paths):
    """Write down the path of a ray that ended, if it has one."""
    real, whole = rays.real, rays.whole
    path = whole[i, _PATH]
    if path < 0:
        return
    ox, oy, oz, dx, dy, dz = real[i, _X], real[i, _Y], real[i, _Z], real[i, _DX], real[i, _DY], real[i, _DZ]
    status, path_inside = whole[i, _STATE], real[i, _INNER]
    if status == MISSED and whole[i, _COUNT]:
        status = CONTRADICTED if whole[i, _WITHIN] else LEFT
    paths.status[path], paths.events[path], paths.inside[path] = status, whole[i, _COUNT], path_inside
    paths.outgoing[path, 0], paths.outgoing[path, 1], paths.outgoing[path, 2] = dx, dy, dz
    leave = paths.leave
    if status == MISSED:
        for c in range(3):
            leave[path, c] = paths.start[path, c] + 2.0 * real[i, _HALF] * paths.incoming[path, c]
    else:
        along = ox * dx + oy * dy + oz * dz
        t = math.sqrt(along * along + max(1.0 - (ox * ox + oy * oy + oz * oz), 0.0)) - along
        leave[path, 0], leave[path, 1], leave[path, 2] = ox + t * dx, oy + t * dy, oz + t * dz
    for c in range(len(mu)):
        if status in (ABSORBED, CONTRADICTED):
            paths.weight[path, c] = 0.0
        elif status == MISSED:
            paths.weight[path, c] = 1.0
        else:
            paths.weight[path, c] = real[i, _FACTOR] * rays.carried[i, c] * math.exp(-mu[c] * path_inside)


@njit(nogil=True, error_model="numpy", forceinline=True)
def _begin(i, path, uniform, rays, paths):
    """Path number `path` where it enters the bounding sphere, in slot i."""
    real, whole = rays.real, rays.whole
    half, dx, dy, dz, x, y, z = uniform_chord(uniform[path, 0], uniform[path, 1], uniform[path, 2], uniform[path, 3])
    paths.start[path, 0], paths.start[path, 1], paths.start[path, 2] = x, y, z
    paths.incoming[path, 0], paths.incoming[path, 1], paths.incoming[path, 2] = dx, dy, dz
    real[i, _X], real[i, _Y], real[i, _Z] = x - AHEAD * dx, y - AHEAD * dy, z - AHEAD * dz
    real[i, _DX], real[i, _DY], real[i, _DZ] = dx, dy, dz
    real[i, _INNER], real[i, _FACTOR], real[i, _HALF] = 0.0, 1.0, half
    whole[i, _SKIP], whole[i, _WITHIN], whole[i, _COUNT], whole[i, _STATE] = -1, 0, 0, MISSED
    whole[i, _PATH], whole[i, _DRAWN], whole[i, _FOUR] = path, 0, -1
    for c in range(rays.carried.shape[1]):
        rays.carried[i, c] = 1.0


@njit(nogil=True, error_model="numpy", forceinline=True)
def _aim(i, rays, grid):
    """What leaps and tests need of a ray that starts: its shear, and where it enters the grid."""
    real, whole, state, ints = rays.real, rays.whole, rays.state, rays.ints
    ox, oy, oz, dx, dy, dz = real[i, _X], real[i, _Y], real[i, _Z], real[i, _DX], real[i, _DY], real[i, _DZ]
    if abs(dx) >= abs(dy) and abs(dx) >= abs(dz):
        kx, ky, kz, px, py, pz, sx, sy, sz = 1, 2, 0, oy, oz, ox, dy / dx, dz / dx, 1.0 / dx
    elif abs(dy) >= abs(dz):
        kx, ky, kz, px, py, pz, sx, sy, sz = 2, 0, 1, oz, ox, oy, dz / dy, dx / dy, 1.0 / dy
    else:
        kx, ky, kz, px, py, pz, sx, sy, sz = 0, 1, 2, ox, oy, oz, dx / dz, dy / dz, 1.0 / dz
    real[i, _PX], real[i, _PY], real[i, _PZ], real[i, _SX], real[i, _SY], real[i, _SZ] = px, py, pz, sx, sy, sz
    real[i, _BEST], whole[i, _TRIANGLE] = np.inf, -1
    whole[i, _KX], whole[i, _KY], whole[i, _KZ] = kx, ky, kz
    ints[_rays.AXES, i], ints[_rays.AXES + 1, i], ints[_rays.AXES + 2, i] = kx, ky, kz
    state[_rays.SHEAR, i], state[_rays.SHEAR + 1, i], state[_rays.NEAREST, i] = sx, sy, np.inf
    ints[_rays.SKIP, i] = whole[i, _SKIP]
    _enter_grid(i, rays, grid)


@njit(nogil=True, error_model="numpy", forceinline=True)
def _enter_grid(i, rays, grid):
    """The ray in cells, in single precision, and the first cell that it comes through."""
    real, state, ints, low, scale = rays.real, rays.state, rays.ints, grid.low, grid.scale
    nx, ny, nz = grid.count
    ox, oy, oz, dx, dy, dz = real[i, _X], real[i, _Y], real[i, _Z], real[i, _DX], real[i, _DY], real[i, _DZ]
    x, y, z = np.float32((ox - low[0]) * scale), np.float32((oy - low[1]) * scale), np.float32((oz - low[2]) * scale)
    # 1e-18 moves a ray by nothing, and no product is 0 * inf
    rx = np.float32(1.0 / math.copysign(max(abs(dx), 1e-18), dx))
    ry = np.float32(1.0 / math.copysign(max(abs(dy), 1e-18), dy))
    rz = np.float32(1.0 / math.copysign(max(abs(dz), 1e-18), dz))
    dx, dy, dz = np.float32(dx), np.float32(dy), np.float32(dz)
    zero, half, mx, my, mz = np.float32(0.0), np.float32(0.5), np.float32(nx), np.float32(ny), np.float32(nz)
    ux, uy, uz = rx > 0, ry > 0, rz > 0
    begin = max(max(((zero if ux else mx) - x) * rx, ((zero if uy else my) - y) * ry),
                max(((zero if uz else mz) - z) * rz, zero))
    # as leaps compute it, so that none ends beyond the grid
    end = min(min(((mx if ux else zero) - x) * rx, ((my if uy else zero) - y) * ry), ((mz if uz else zero) - z) * rz)
    a = min(max(int(x + begin * dx), 0), nx - 1)
    b = min(max(int(y + begin * dy), 0), ny - 1)
    c = min(max(int(z + begin * dz), 0), nz - 1)
    at, octant = (c * ny + b) * nx + a, (int(ux) + 2 * int(uy) + 4 * int(uz)) * (nx * ny * nz)
    state[_rays.ORIGIN, i], state[_rays.ORIGIN + 1, i], state[_rays.ORIGIN + 2, i] = x, y, z
    state[_rays.DIRECTION, i], state[_rays.DIRECTION + 1, i], state[_rays.DIRECTION + 2, i] = dx, dy, dz
    state[_rays.INVERSE, i], state[_rays.INVERSE + 1, i], state[_rays.INVERSE + 2, i] = rx, ry, rz
    state[_rays.LIMIT, i] = end
    state[_rays.SEEN, i] = x - (np.float32(a) + half)
    state[_rays.SEEN + 1, i] = y - (np.float32(b) + half)
    state[_rays.SEEN + 2, i] = z - (np.float32(c) + half)
    ints[_rays.CELL, i], ints[_rays.CELL + 1, i], ints[_rays.CELL + 2, i] = a, b, c
    ints[_rays.INDEX, i], ints[_rays.OCTANT, i] = at, octant
    entry = int(grid.leaps[octant + at])
    ints[_rays.LEAP, i] = entry & (_rays.FULL - 1)
    inside = _rays.AT if entry >= _rays.FULL else _rays.MOVES
    ints[_rays.STATE, i] = _rays.OUT if begin >= end else inside


@njit(nogil=True, error_model="numpy", forceinline=True)
def _closed_up(rays, alive):
    """No more paths begin: rays under way move to the first slots; how many they are."""
    real, whole, _, ints, pool, carried = rays
    live = 0
    for i in range(alive):
        if ints[_rays.STATE, i] != _rays.IDLE:
            if live < i:
                # not rows at once: numba compiles two seconds of checks of shapes for that
                for k in range(real.shape[1]):
                    real[live, k] = real[i, k]
                for k in range(whole.shape[1]):
                    whole[live, k] = whole[i, k]
                for k in range(pool.shape[1]):
                    pool[live, k] = pool[i, k]
                for k in range(carried.shape[1]):
                    carried[live, k] = carried[i, k]
                for k in range(ints.shape[0]):
                    ints[k, live] = ints[k, i]
                ints[_rays.STATE, i] = _rays.IDLE
            live += 1
    return live


@njit(nogil=True, error_model="numpy", forceinline=True)
def _blocks_of(rays, grid, alive, lists):
    """The first block of triangles of each ray in a cell that has some (block and slot), rays that hit one and rays that ended:
    how many ended and hit, how many blocks are to be tested."""
    ended = hits = tests = 0
    for c in range(0, alive, _rays.RAYS):
        bits = those(rays.state, _SLOTS, c, _rays.AT)
        while bits:
            i = c + lowest(bits)
            bits &= bits - 1
            block = np.int64(grid.first[rays.ints[_rays.INDEX, i]])
            fetch(grid.blocks, block * _rays.BLOCK, 2)
            lists.tests[tests] = block << 32 | i
            tests += 1
        bits = those(rays.state, _SLOTS, c, _rays.OUT)
        while bits:
            i = c + lowest(bits)
            bits &= bits - 1
            triangle = rays.whole[i, _TRIANGLE]
            if triangle >= 0:
                fetch(grid.corners, 9 * triangle, 2)
                lists.hit[hits] = i
                hits += 1
            else:
                lists.ended[ended] = i
                ended += 1
    return ended, hits, tests


@njit(nogil=True, error_model="numpy", forceinline=True)
def _passed(rays, grid, tests, lists):
    """Blocks of which a ray passes triangles near enough for the exact test: block, slot, which triangles; how many."""
    blocks, candidates = grid.blocks, 0
    names = blocks.view(np.int32)
    for k in range(tests):
        block, i = lists.tests[k] >> 32, lists.tests[k] & 0xFFFFFFFF
        while True:
            bits = passed(rays.state, _SLOTS, i, blocks, block)
            lists.candidates[candidates] = block << 32 | i << 8 | bits
            candidates += bits != 0
            fetch(grid.corners, 9 * np.int64(names[block * _rays.BLOCK // 4 + _rays.NAMES // 4 + lowest(bits | 1)]), 2)
            if names[block * _rays.BLOCK // 4 + _rays.MORE // 4] == 0:
                break
            block += 1
    return candidates


@njit(nogil=True, error_model="numpy", forceinline=True)
def _nearest(rays, grid, candidates, lists):
    """The nearest hit of each ray among the triangles that it passes: watertight, as `lanes.triangles_hit`."""
    real, whole, state, corners = rays.real, rays.whole, rays.state, grid.corners
    names = grid.blocks.view(np.int32)
    for k in range(candidates):
        block, i, bits = lists.candidates[k] >> 32, lists.candidates[k] >> 8 & 0xFFFFFF, lists.candidates[k] & 0xFF
        kx, ky, kz = whole[i, _KX], whole[i, _KY], whole[i, _KZ]
        px, py, pz, sx, sy, sz = real[i, _PX], real[i, _PY], real[i, _PZ], real[i, _SX], real[i, _SY], real[i, _SZ]
        while bits:
            triangle = np.int64(names[block * _rays.BLOCK // 4 + _rays.NAMES // 4 + lowest(bits)])
            bits &= bits - 1
            a, b, c = 9 * triangle, 9 * triangle + 3, 9 * triangle + 6
            az, bz, cz = corners[a + kz] - pz, corners[b + kz] - pz, corners[c + kz] - pz
            ax, bx, cx = (corners[a + kx] - px) - sx * az, (corners[b + kx] - px) - sx * bz, (corners[c + kx] - px) - sx * cz
            ay, by, cy = (corners[a + ky] - py) - sy * az, (corners[b + ky] - py) - sy * bz, (corners[c + ky] - py) - sy * cz
            u, v, w = cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax
            if min(u, min(v, w)) >= 0.0 or max(u, max(v, w)) <= 0.0:
                t = sz * (u * az + v * bz + w * cz) / (u + v + w)  # 0/0 of a triangle without area compares as false
                if 0.0 < t < real[i, _BEST]:
                    real[i, _BEST], whole[i, _TRIANGLE], state[_rays.NEAREST, i] = t, triangle, t * grid.scale


@njit(nogil=True, error_model="numpy", forceinline=True)
def _normal(corners, triangle):
    """Unit normal of a triangle, outward."""
    a = 9 * triangle
    ux, uy, uz = corners[a + 3] - corners[a], corners[a + 4] - corners[a + 1], corners[a + 5] - corners[a + 2]
    vx, vy, vz = corners[a + 6] - corners[a], corners[a + 7] - corners[a + 1], corners[a + 8] - corners[a + 2]
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    over = 1.0 / math.sqrt(x * x + y * y + z * z)
    return x * over, y * over, z * over


@njit(nogil=True, error_model="numpy", forceinline=True)
def _meet(i, rays, corners, coat, stream, events_max, least):
    """A meeting with the surface; whether the ray goes on."""
    real, whole = rays.real, rays.whole
    triangle, t = whole[i, _TRIANGLE], real[i, _BEST]
    dx, dy, dz = real[i, _DX], real[i, _DY], real[i, _DZ]
    real[i, _X], real[i, _Y], real[i, _Z] = real[i, _X] + t * dx, real[i, _Y] + t * dy, real[i, _Z] + t * dz
    nx, ny, nz = _normal(corners, triangle)
    z = -(dx * nx + dy * ny + dz * nz)
    whole[i, _SKIP] = triangle
    if (z < 0.0) != (whole[i, _WITHIN] != 0) or z == 0.0:
        whole[i, _COUNT] += 1
        whole[i, _STATE] = CONTRADICTED
        return False
    if z < 0.0:
        real[i, _INNER] += t
    if whole[i, _COUNT] == events_max:
        whole[i, _STATE] = CUT
        return False
    whole[i, _COUNT] += 1
    sx, sy, sz, tx, ty, tz = surface_frame(nx, ny, nz)
    x, y = -(dx * sx + dy * sy + dz * sz), -(dx * tx + dy * ty + dz * tz)
    count, u, v, w = _drawn(i, rays, coat, stream)
    x, y, z, through, cosine = at_surface(coat.kind, coat.index, coat.roughness, x, y, z, u, v, w)
    if coat.kind == DIELECTRIC:
        whole[i, _WITHIN] = z < 0.0
    else:
        for c in range(rays.carried.shape[1]):
            rays.carried[i, c] *= surface_share(coat.kind, coat.channels, c, cosine)
    dx, dy, dz = x * sx + y * tx + z * nx, x * sy + y * ty + z * ny, x * sz + y * tz + z * nz
    over = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)  # keeps rounding from growing over many reflections
    real[i, _DX], real[i, _DY], real[i, _DZ] = dx * over, dy * over, dz * over
    return _goes_on(i, rays, coat.kind, stream, least, real[i, _FACTOR] * through, count)


@njit(nogil=True, error_model="numpy", forceinline=True)
def _drawn(i, rays, coat, stream):
    """How many numbers the path has drawn when the surface has had its own, and those three."""
    kind, roughness, pool, whole = coat.kind, coat.roughness, rays.pool, rays.whole
    first, replicate, key0, key1 = stream
    path = np.uint64(first + whole[i, _PATH])
    count, u, v, w = whole[i, _DRAWN], 0.0, 0.0, 0.0
    if kind == DIELECTRIC and roughness == 0.0:  # one a meeting: four at a time
        if count >> 2 != whole[i, _FOUR]:
            whole[i, _FOUR] = count >> 2
            p, q, r, s = philox(path & np.uint64(0xFFFFFFFF), path >> np.uint64(32), replicate, np.uint64(count >> 2), key0, key1)
            pool[i, 0], pool[i, 1] = (p + 0.5) * 2.0**-32, (q + 0.5) * 2.0**-32
            pool[i, 2], pool[i, 3] = (r + 0.5) * 2.0**-32, (s + 0.5) * 2.0**-32
        u = pool[i, count & 3]
        count += 1
    elif kind != CONDUCTOR or roughness > 0.0:
        u = uniform_number(key0, key1, path, replicate, count)
        v = uniform_number(key0, key1, path, replicate, count + 1)
        count += 2
        if kind == DIELECTRIC:
            w = uniform_number(key0, key1, path, replicate, count)
            count += 1
    return count, u, v, w


@njit(nogil=True, error_model="numpy", forceinline=True)
def _goes_on(i, rays, kind, stream, least, factor, count):
    """Whether a path that carries `factor` goes on: a faint one by chance.  least : of mu;  count : numbers drawn so far."""
    real, whole = rays.real, rays.whole
    first, replicate, key0, key1 = stream
    strongest = factor
    if kind != DIELECTRIC:
        most = 0.0
        for c in range(rays.carried.shape[1]):
            most = max(most, rays.carried[i, c])
        strongest *= most
    if least > 0.0:
        strongest *= math.exp(-least * real[i, _INNER])
    if strongest < FAINT:
        if uniform_number(key0, key1, np.uint64(first + whole[i, _PATH]), replicate, count) * FAINT >= strongest:
            whole[i, _STATE] = ABSORBED
            return False
        count += 1
        factor *= FAINT / strongest
    real[i, _FACTOR], whole[i, _DRAWN] = factor, count
    return True
