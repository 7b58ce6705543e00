"""The loop of `walk`: many rays on their way through a grain.

Many rays are under way at once and go on in steps, each step for all of them: leaps through the grid, tests of the triangles of a
cell, meetings with the surface.  So the memory that one waits for is fetched while others are computed, and leaps are made in
vector instructions.  What happens to a path depends on its own numbers only, never on its neighbours.
"""

from __future__ import annotations

import math

import numpy as np

from bakery.physics.grains import _rays
from bakery.physics.grains._rays import confirm, leap, passed, those
from bakery.physics.grains.lanes import fetch, lowest
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
from bakery.system.compiled import njit

_SLOTS, _LEAPS = 128, 2  # rays under way at once; leaps between tests of cells
_EDGE = np.float32(2e-3)  # cells; a hit nearer to the wall of its cell than this is not yet known to be the first
# What is kept of a ray: axes in the order of the shear, start in that order and shear, for the exact test
(_KX, _KY, _KZ, _PLACE, _SKIP, _WITHIN, _COUNT, _PATH, _STATE, _DRAWN, _FOUR), _WHOLE = range(11), 16
(_X, _Y, _Z, _DX, _DY, _DZ, _PX, _PY, _PZ, _SX, _SY, _SZ, _BEST, _INNER, _FACTOR, _HALF), _REAL = range(16), 16


@njit(cache=True, nogil=True, error_model="numpy")
def followed(grid, coat, events_max, uniform, stream, paths):
    """Fill `walk.Paths` for the rays `uniform` (n, 4) through a `grid.Grid`."""
    low, scale, (nx, ny, nz), leaps, first, blocks, corners, longest = grid
    names = blocks.view(np.int32)
    kind, index, roughness, channels, mu = coat
    first_path, replicate, key0, key1 = stream
    status, start, leave, incoming, outgoing, inside, weight, events = paths
    number, total, least = weight.shape[1], len(uniform), np.min(mu)
    real, whole = np.zeros((_SLOTS, _REAL)), np.zeros((_SLOTS, _WHOLE), np.int64)
    state = np.zeros((_rays.FIELDS, _SLOTS), np.float32)
    ints = state.view(np.int32)
    pool, carried = np.empty((_SLOTS, 4)), np.ones((_SLOTS, number))
    finished, met, tests = np.empty(_SLOTS, np.int64), np.empty(_SLOTS, np.int64), np.empty(_SLOTS, np.int64)
    aimed, aims = np.empty(_SLOTS, np.int64), 0
    candidates = np.empty(_SLOTS * longest, np.int64)
    alive, begun = min(_SLOTS, total), 0
    ints[_rays.STATE] = _rays.IDLE
    whole[:, _PATH] = -1
    ended = alive
    finished[:alive] = np.arange(alive)
    while True:
        for k in range(ended):  # write down what ended, begin new paths in its place
            i = finished[k]
            if i < 0:  # never: says that indices need no wrapping
                break
            path = whole[i, _PATH]
            ox, oy, oz, dx, dy, dz = real[i, _X], real[i, _Y], real[i, _Z], real[i, _DX], real[i, _DY], real[i, _DZ]
            if path >= 0:
                what, path_inside = whole[i, _STATE], real[i, _INNER]
                if what == MISSED and whole[i, _COUNT]:
                    what = CONTRADICTED if whole[i, _WITHIN] else LEFT
                status[path], events[path], inside[path] = what, whole[i, _COUNT], path_inside
                outgoing[path, 0], outgoing[path, 1], outgoing[path, 2] = dx, dy, dz
                if what == MISSED:
                    for c in range(3):
                        leave[path, c] = start[path, c] + 2.0 * real[i, _HALF] * incoming[path, c]
                else:
                    along = ox * dx + oy * dy + oz * dz
                    t = math.sqrt(along * along + max(1.0 - (ox * ox + oy * oy + oz * oz), 0.0)) - along
                    leave[path, 0], leave[path, 1], leave[path, 2] = ox + t * dx, oy + t * dy, oz + t * dz
                for c in range(number):
                    if what in (ABSORBED, CONTRADICTED):
                        weight[path, c] = 0.0
                    elif what == MISSED:
                        weight[path, c] = 1.0
                    else:
                        weight[path, c] = real[i, _FACTOR] * carried[i, c] * math.exp(-mu[c] * path_inside)
            if begun == total:
                ints[_rays.STATE, i] = _rays.IDLE
                continue
            half, dx, dy, dz, x, y, z = uniform_chord(uniform[begun, 0], uniform[begun, 1], uniform[begun, 2], uniform[begun, 3])
            start[begun, 0], start[begun, 1], start[begun, 2] = x, y, z
            incoming[begun, 0], incoming[begun, 1], incoming[begun, 2] = dx, dy, dz
            real[i, _X], real[i, _Y], real[i, _Z] = x - AHEAD * dx, y - AHEAD * dy, z - AHEAD * dz
            real[i, _DX], real[i, _DY], real[i, _DZ] = dx, dy, dz
            real[i, _INNER], real[i, _FACTOR], real[i, _HALF] = 0.0, 1.0, half
            whole[i, _SKIP], whole[i, _WITHIN], whole[i, _COUNT], whole[i, _STATE] = -1, 0, 0, MISSED
            whole[i, _PATH], whole[i, _DRAWN], whole[i, _FOUR] = begun, 0, -1
            for c in range(number):
                carried[i, c] = 1.0
            begun += 1
            aimed[aims] = i
            aims += 1
        for k in range(aims):  # what leaps and tests need of a new ray
            i = aimed[k]
            if i < 0:  # never: says that indices need no wrapping
                break
            ox, oy, oz, dx, dy, dz = real[i, _X], real[i, _Y], real[i, _Z], real[i, _DX], real[i, _DY], real[i, _DZ]
            if abs(dx) >= abs(dy) and abs(dx) >= abs(dz):
                kx, ky, kz, px, py, pz, sx, sy, sz = 1, 2, 0, oy, oz, ox, dy / dx, dz / dx, 1.0 / dx
            elif abs(dy) >= abs(dz):
                kx, ky, kz, px, py, pz, sx, sy, sz = 2, 0, 1, oz, ox, oy, dz / dy, dx / dy, 1.0 / dy
            else:
                kx, ky, kz, px, py, pz, sx, sy, sz = 0, 1, 2, ox, oy, oz, dx / dz, dy / dz, 1.0 / dz
            real[i, _PX], real[i, _PY], real[i, _PZ], real[i, _SX], real[i, _SY], real[i, _SZ] = px, py, pz, sx, sy, sz
            real[i, _BEST], whole[i, _PLACE] = np.inf, -1
            whole[i, _KX], whole[i, _KY], whole[i, _KZ] = kx, ky, kz
            ints[_rays.AXES, i], ints[_rays.AXES + 1, i], ints[_rays.AXES + 2, i] = kx, ky, kz
            state[_rays.SHEAR, i], state[_rays.SHEAR + 1, i], state[_rays.NEAREST, i] = sx, sy, np.inf
            ints[_rays.SKIP, i] = whole[i, _SKIP]
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
            entry = int(leaps[octant + at])
            ints[_rays.LEAP, i] = entry & (_rays.FULL - 1)
            here = _rays.AT if entry >= _rays.FULL else _rays.MOVES
            ints[_rays.STATE, i] = _rays.OUT if begin >= end else here
        if begun == total and ended:  # no more to begin: the rays left close up
            live = 0
            for i in range(alive):
                if ints[_rays.STATE, i] != _rays.IDLE:
                    if live < i:
                        real[live], whole[live], pool[live], carried[live] = real[i], whole[i], pool[i], carried[i]
                        ints[:, live] = ints[:, i]
                        ints[_rays.STATE, i] = _rays.IDLE
                    live += 1
            alive = live
        if alive == 0:
            break
        for _ in range(_LEAPS):
            for c in range(0, alive, _rays.RAYS):
                leap(state, _SLOTS, c, leaps, nx, ny, nz)
        aims = ended = hits = number_tests = 0
        for c in range(0, alive, _rays.RAYS):
            bits = those(state, _SLOTS, c, _rays.AT)
            while bits:
                i = c + lowest(bits)
                bits &= bits - 1
                block = np.int64(first[ints[_rays.INDEX, i]])
                fetch(blocks, block * _rays.BLOCK, 2)
                tests[number_tests] = block << 32 | i
                number_tests += 1
            bits = those(state, _SLOTS, c, _rays.OUT)
            while bits:
                i = c + lowest(bits)
                bits &= bits - 1
                place = whole[i, _PLACE]
                if place >= 0:
                    fetch(corners, 9 * place, 2)
                    met[hits] = i
                    hits += 1
                else:
                    finished[ended] = i
                    ended += 1
        some = 0
        for k in range(number_tests):
            block, i = tests[k] >> 32, tests[k] & 0xFFFFFFFF
            while True:
                bits = passed(state, _SLOTS, i, blocks, block)
                candidates[some] = block << 32 | i << 8 | bits
                some += bits != 0
                fetch(corners, 9 * np.int64(names[block * _rays.BLOCK // 4 + _rays.NAMES // 4 + lowest(bits | 1)]), 2)
                if names[block * _rays.BLOCK // 4 + _rays.MORE // 4] == 0:
                    break
                block += 1
        for k in range(some):  # as `lanes.triangles_hit`: watertight
            block, i, bits = candidates[k] >> 32, candidates[k] >> 8 & 0xFFFFFF, candidates[k] & 0xFF
            kx, ky, kz = whole[i, _KX], whole[i, _KY], whole[i, _KZ]
            px, py, pz, sx, sy, sz = real[i, _PX], real[i, _PY], real[i, _PZ], real[i, _SX], real[i, _SY], real[i, _SZ]
            while bits:
                place = np.int64(names[block * _rays.BLOCK // 4 + _rays.NAMES // 4 + lowest(bits)])
                bits &= bits - 1
                a, b, c = 9 * place, 9 * place + 3, 9 * place + 6
                az, bz, cz = corners[a + kz] - pz, corners[b + kz] - pz, corners[c + kz] - pz
                ax, bx, cx = (corners[a + kx] - px) - sx * az, (corners[b + kx] - px) - sx * bz, (corners[c + kx] - px) - sx * cz
                ay, by, cy = (corners[a + ky] - py) - sy * az, (corners[b + ky] - py) - sy * bz, (corners[c + ky] - py) - sy * cz
                u, v, w = cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax
                if min(u, min(v, w)) >= 0.0 or max(u, max(v, w)) <= 0.0:
                    t = sz * (u * az + v * bz + w * cz) / (u + v + w)  # 0/0 of a triangle without area compares as false
                    if 0.0 < t < real[i, _BEST]:
                        real[i, _BEST], whole[i, _PLACE], state[_rays.NEAREST, i] = t, place, t * scale
        for c in range(0, alive, _rays.RAYS):
            confirm(state, _SLOTS, c, _EDGE)
        for k in range(hits):
            i = met[k]
            if i < 0:  # never: says that indices need no wrapping
                break
            place, t = whole[i, _PLACE], real[i, _BEST]
            dx, dy, dz = real[i, _DX], real[i, _DY], real[i, _DZ]
            real[i, _X], real[i, _Y], real[i, _Z] = real[i, _X] + t * dx, real[i, _Y] + t * dy, real[i, _Z] + t * dz
            a = 9 * place
            ux, uy, uz = corners[a + 3] - corners[a], corners[a + 4] - corners[a + 1], corners[a + 5] - corners[a + 2]
            vx, vy, vz = corners[a + 6] - corners[a], corners[a + 7] - corners[a + 1], corners[a + 8] - corners[a + 2]
            nx_, ny_, nz_ = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            over = 1.0 / math.sqrt(nx_ * nx_ + ny_ * ny_ + nz_ * nz_)
            nx_, ny_, nz_ = nx_ * over, ny_ * over, nz_ * over
            z = -(dx * nx_ + dy * ny_ + dz * nz_)
            whole[i, _SKIP] = place
            if (z < 0.0) != (whole[i, _WITHIN] != 0) or z == 0.0:
                whole[i, _COUNT] += 1
                whole[i, _STATE], finished[ended] = CONTRADICTED, i
                ended += 1
                continue
            if z < 0.0:
                real[i, _INNER] += t
            if whole[i, _COUNT] == events_max:
                whole[i, _STATE], finished[ended] = CUT, i
                ended += 1
                continue
            whole[i, _COUNT] += 1
            sx, sy, sz, tx, ty, tz = surface_frame(nx_, ny_, nz_)
            x, y = -(dx * sx + dy * sy + dz * sz), -(dx * tx + dy * ty + dz * tz)
            path, factor = np.uint64(first_path + whole[i, _PATH]), real[i, _FACTOR]
            count, u, v, w = whole[i, _DRAWN], 0.0, 0.0, 0.0
            if kind == DIELECTRIC and roughness == 0.0:  # one a meeting: four at a time
                if count >> 2 != whole[i, _FOUR]:
                    whole[i, _FOUR] = count >> 2
                    p, q, r, s = philox(path & np.uint64(0xFFFFFFFF), path >> np.uint64(32), replicate, np.uint64(count >> 2),
                                        key0, key1)
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
            x, y, z, through, cosine = at_surface(kind, index, roughness, x, y, z, u, v, w)
            factor *= through
            if kind == DIELECTRIC:
                whole[i, _WITHIN] = z < 0.0
            else:
                for c in range(number):
                    carried[i, c] *= surface_share(kind, channels, c, cosine)
            dx, dy, dz = x * sx + y * tx + z * nx_, x * sy + y * ty + z * ny_, x * sz + y * tz + z * nz_
            over = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)  # keeps rounding from growing over many reflections
            real[i, _DX], real[i, _DY], real[i, _DZ] = dx * over, dy * over, dz * over
            strongest = factor
            if kind != DIELECTRIC:
                most = 0.0
                for c in range(number):
                    most = max(most, carried[i, c])
                strongest *= most
            if least > 0.0:
                strongest *= math.exp(-least * real[i, _INNER])
            if strongest < FAINT:
                if uniform_number(key0, key1, path, replicate, count) * FAINT >= strongest:
                    whole[i, _STATE], finished[ended] = ABSORBED, i
                    ended += 1
                    continue
                count += 1
                factor *= FAINT / strongest
            real[i, _FACTOR], whole[i, _DRAWN] = factor, count
            aimed[aims] = i
            aims += 1
