"""Loops of `goniometer`: light that falls on a half space or a layer of packed grains, grain by grain, until it is out again."""

import math
from typing import NamedTuple

import numpy as np

from bakery.physics.grains.bvh import mesh_scratch, nearest_triangle, triangle_normal
from bakery.physics.grains.sampling import AHEAD, FAINT, next_uniform
from bakery.physics.grains.surface import CONDUCTOR, DIELECTRIC, DIFFUSE, fresnel_conductor
from bakery.physics.granular._aimed import aimed
from bakery.physics.granular._clear import refracted
from bakery.physics.granular._packed import FAR, Draws, Kind, begin_beyond, leave, turned
from bakery.physics.granular.flights import flight_in_slab
from bakery.physics.lent import lent
from bakery.physics.packing.instances import kind, rotation, rotation_matrix, uniforms
from bakery.physics.surfaces.pairs import cell_of
from bakery.system.compiled import njit

MISSED, LEFT, DROPPED, CUT = range(4)
FIRST, SECOND, HIGHER, ORDERS = range(4)  # orders that are kept apart, and how many these are
FOLLOWED = 16  # of walks whose light is late, one goes on, which tells how much of it leaves
STEEPEST = 1e-4  # least cosine at which light enters: 89.994 degrees
_STRAIGHT = 5e-13  # 1 - cosine up to which light counts as not deflected
# What is counted beside light: hits, walks, those given up (no sphere ahead), contradicted and cut in a grain
HITS, WALKS, GIVEN_UP, CONTRADICTED, CUTS = range(5)
SUMS = 5


class Matter(NamedTuple):
    """What takes light away: mu (T, C) of the interiors, 1/R of the grain's own sphere per unit of the tile; channels (T, 2, C)
    of the surfaces as `surface.Surface` has them."""

    mu: np.ndarray
    channels: np.ndarray


class Rules(NamedTuple):
    """Order after which walks end (0: none), hits after which light is late and with which a walk ends, meetings with one grain's
    surface after which a path is cut, cells along the coordinates of pairs (3,), bins of the root of the cosine, decay (C,) per
    unit of depth of light that is still inside, thickness of the layer (inf: none), sides at which light leaves (2: also below),
    albedo (C,) of a matt plane under the lowest grains where there is no second side, whether light of the third order that
    leaves by the grain of the first is told by walks to the second order, which are many."""

    last: int
    late: int
    most: int
    depth: int
    cells: np.ndarray
    bins: int
    decay: np.ndarray
    thickness: float
    sides: int
    base: np.ndarray
    returns: bool


class Counted(NamedTuple):
    """What walks bring, by channel and first of all by side where light leaves.

    cells, entered : by order and cell, and by order and bin of entry, of light that is not late
    walks : by bin of entry, by the weights of aimed directions
    deep : light that becomes late, by bin of entry;  followed : of it, that of walks that go on
    late, inside : of that, what leaves, and what is left at the end of walks
    straight : light that passed undeflected, by bin of entry;  sums : `SUMS` numbers
    """

    cells: np.ndarray
    entered: np.ndarray
    walks: np.ndarray
    deep: np.ndarray
    followed: np.ndarray
    late: np.ndarray
    inside: np.ndarray
    straight: np.ndarray
    sums: np.ndarray


class Path(NamedTuple):
    """Where light is: the sphere (number, copy of the tile) and the one before, origin and direction of the flight, vector to the
    next centre, ray through the unit sphere (6,), what each channel carries, and the optical path inside of grains."""

    sphere: np.ndarray
    left_behind: np.ndarray
    o: np.ndarray
    d: np.ndarray
    to: np.ndarray
    ray: np.ndarray
    carried: np.ndarray
    optical: np.ndarray


@njit(nogil=True, error_model="numpy", forceinline=True)
def _turned(grain, channels, d, n, draws, carried, fresh):
    """Direction after a meeting with the surface, its part along the outward normal, share of all light that is left.

    fresh : light that nothing has turned yet
    """
    dx, dy, dz, z, share, cosine = turned(grain, d, n, draws)
    if grain.matter == DIFFUSE:
        if fresh:
            (dx, dy, dz), z, share = aimed(d, n, (dx, dy, dz), draws)
        for c in range(len(carried)):
            carried[c] *= channels[0, c]
    elif grain.matter == CONDUCTOR:
        for c in range(len(carried)):
            carried[c] *= fresnel_conductor(cosine, channels[0, c], channels[1, c])
    return dx, dy, dz, z, share


@njit(cache=True, nogil=True, error_model="numpy")
def _ball(grain, channels, ray, limits, draws, carried):
    """Follow `ray` (6,) through a ball: what became of it, share of all light left, path inside in radii of the sphere.

    limits : meetings after which it is cut, whether nothing has turned it yet, whether what clear balls reflect is wanted
    """
    (depth, fresh, wanted) = limits
    draws, radius = lent(draws), grain.radius
    ox, oy, oz, dx, dy, dz = ray[0], ray[1], ray[2], ray[3], ray[4], ray[5]
    along = -(ox * dx + oy * dy + oz * dz)
    px, py, pz = ox + along * dx, oy + along * dy, oz + along * dz
    beside = radius * radius - (px * px + py * py + pz * pz)
    t = 0.0
    if radius < 1.0:
        if beside <= 0.0:
            leave(ray, px, py, pz, dx, dy, dz)
            return MISSED, 1.0, 0.0
        t = along - math.sqrt(beside)
    nx, ny, nz = (ox + t * dx) / radius, (oy + t * dy) / radius, (oz + t * dz) / radius
    if grain.matter == DIELECTRIC and grain.roughness == 0.0:
        (dx, dy, dz), (nx, ny, nz), factor, path = refracted(grain.index, (dx, dy, dz), (nx, ny, nz), draws, (depth, wanted))
        over = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
        leave(ray, radius * nx, radius * ny, radius * nz, dx * over, dy * over, dz * over)
        return LEFT if factor >= 0.0 else CUT, max(factor, 0.0), radius * path
    count, factor, path = 0, 1.0, 0.0
    while factor > 0.0:
        if count == depth:
            return CUT, 0.0, path
        count += 1
        dx, dy, dz, z, share = _turned(grain, channels, (dx, dy, dz), (nx, ny, nz), draws, carried, fresh and count == 1)
        factor *= share
        if z > 0.0:
            break
        t = -2.0 * (dx * nx + dy * ny + dz * nz)
        path += radius * t
        nx, ny, nz = nx + t * dx, ny + t * dy, nz + t * dz
        over = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
        nx, ny, nz = nx * over, ny * over, nz * over
    leave(ray, radius * nx, radius * ny, radius * nz, dx, dy, dz)
    return LEFT, factor, path


@njit(cache=True, nogil=True, error_model="numpy")
def _mesh(tree, grain, channels, ray, limits, draws, carried, scratch):
    """The same through a mesh."""
    draws, scratch, (nodes, children, blocks), (depth, fresh) = lent(draws), lent(scratch), lent(tree), limits
    dx, dy, dz = ray[3], ray[4], ray[5]
    ox, oy, oz = ray[0] - AHEAD * dx, ray[1] - AHEAD * dy, ray[2] - AHEAD * dz
    within, triangle, count, factor, path = False, np.int64(-1), 0, 1.0, 0.0
    while factor > 0.0:
        triangle, t = nearest_triangle(nodes, children, blocks, ox, oy, oz, dx, dy, dz, triangle, scratch)
        if triangle < 0:
            if within:
                return DROPPED, 0.0, path
            if count == 0:  # the chord: from its middle, where rounding is least
                t = -(ox * dx + oy * dy + oz * dz)
                ox, oy, oz = ox + t * dx, oy + t * dy, oz + t * dz
            leave(ray, ox, oy, oz, dx, dy, dz)
            return (LEFT if count else MISSED), factor, path
        if within:
            path += t
        ox, oy, oz = ox + t * dx, oy + t * dy, oz + t * dz
        nx, ny, nz = triangle_normal(blocks, triangle)
        z = -(dx * nx + dy * ny + dz * nz)
        if (z < 0.0) != within or z == 0.0:
            return DROPPED, 0.0, path
        if count == depth:
            return CUT, 0.0, path
        count += 1
        dx, dy, dz, z, share = _turned(grain, channels, (dx, dy, dz), (nx, ny, nz), draws, carried, fresh and count == 1)
        factor *= share
        within = z < 0.0
    return LEFT, 0.0, path


@njit(cache=True, nogil=True, error_model="numpy")
def _meet(path, radius, grains, matter, limits, draws, scratch):
    """Follow the path's ray through the grain of its sphere: what became of it, share of all light left, and what of that is the
    weight of an aimed direction.  limits : as of `_ball`."""
    depth, fresh, _ = limits
    path, grains, matter = lent(path), lent(grains), lent(matter)
    table, offset, sphere, ray = grains.table, grains.offset, path.sphere, path.ray
    which, b, c, e = 0, 0.0, 0.0, 0.0
    if len(grains.shares) > 1 or table[0, 3] == 0.0:
        a, b, c, e = uniforms(grains.seed, sphere[1], sphere[2], sphere[3], sphere[0])
        which = kind(a, grains.shares)
    grain = Kind(int(table[which, 0]), table[which, 1], table[which, 2], table[which, 3])
    if grain.radius > 0.0:
        state, factor, inside = _ball(grain, matter.channels[which], ray, limits, draws, path.carried)
    else:
        turn = rotation_matrix(*rotation(b, c, e))
        low, high = offset[which, 0], offset[which + 1, 0]
        tree = grains.nodes[low:high], grains.children[low:high], grains.blocks[offset[which, 1] : offset[which + 1, 1]]
        _rotated(ray, (turn[0], turn[3], turn[6], turn[1], turn[4], turn[7], turn[2], turn[5], turn[8]))
        state, factor, inside = _mesh(tree, grain, matter.channels[which], ray, (depth, fresh), draws, path.carried, scratch)
        _rotated(ray, turn)
    if grain.matter == DIELECTRIC:
        for k in range(len(path.optical)):
            path.optical[k] += matter.mu[which, k] * radius * inside
    return state, factor, factor if fresh and grain.matter == DIFFUSE and state == LEFT else 1.0


@njit(nogil=True, error_model="numpy", forceinline=True)
def _rotated(ray, matrix):
    """Place and direction by the rows of a rotation, kept at length 1."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = matrix
    for k in (0, 3):
        x, y, z = ray[k], ray[k + 1], ray[k + 2]
        x, y, z = xx * x + xy * y + xz * z, yx * x + yy * y + yz * z, zx * x + zy * y + zz * z
        over = 1.0 / math.sqrt(x * x + y * y + z * z)
        ray[k], ray[k + 1], ray[k + 2] = x * over, y * over, z * over


@njit(cache=True, nogil=True, error_model="numpy")
def counted(tile, grains, matter, key, replicate, first, count, surface, rules):
    """Walks first ... first + count - 1 of a replicate: `Counted` as one array (`pack` of the module above says how).

    surface : lowest and highest level in the tile at which it may be cut; centres below are there
    """
    channels, number = matter.mu.shape[1], rules.cells[0] * rules.cells[1] * rules.cells[2]
    out = Counted(np.zeros((rules.sides, ORDERS, channels, number)), np.zeros((rules.sides, ORDERS, channels, rules.bins)),
                  np.zeros(rules.bins), np.zeros((channels, rules.bins)), np.zeros(channels), np.zeros((rules.sides, channels)),
                  np.zeros(channels), np.zeros((channels, rules.bins)), np.zeros(SUMS))
    draws = Draws(np.zeros(5, np.uint64), np.empty(4))
    draws.stream[0], draws.stream[1], draws.stream[3] = key[0], key[1], replicate
    path = Path(np.empty(4, np.int64), np.empty(4, np.int64), np.empty(3), np.empty(3), np.empty(3), np.empty(6),
                np.ones(channels), np.zeros(channels))
    scratch, widest = mesh_scratch(), np.max(tile.radii)
    for walk in range(count):
        draws.stream[2], draws.stream[4] = np.uint64(first + walk), np.uint64(0)
        goes_on = (first + walk) % FOLLOWED == 0
        _walk(tile, grains, matter, path, draws, scratch, (surface[0], surface[1], widest, goes_on), rules, out)
    return np.concatenate((out.cells.ravel(), out.entered.ravel(), out.walks, out.deep.ravel(), out.followed, out.late.ravel(),
                           out.inside, out.straight.ravel(), out.sums))


@njit(cache=True, nogil=True, error_model="numpy")
def _walk(tile, grains, matter, path, draws, scratch, levels, rules, out):
    """One walk, from above the grains until it is out or at its end.

    levels : the lowest and the highest at which the tile may be cut, how far the largest sphere reaches beyond its centre, and
        whether the walk goes on when its light is late
    """
    tile, grains, matter, path, draws = lent(tile), lent(grains), lent(matter), lent(path), lent(draws)
    scratch, rules, out = lent(scratch), lent(rules), lent(out)
    cell = tile.grid[0]
    bin0, mu0, ex, ey, top = _begin(path, cell, levels, rules.bins, draws)
    base, bottom = path.left_behind[3], top - rules.thickness
    above, below = top + levels[2], bottom - levels[2]
    order, hits, factor, late, returned = 0, 0, 1.0, False, False
    first = _numbers(path.left_behind)  # sphere of the first hit
    out.walks[bin0] += 1.0
    out.sums[WALKS] += 1.0
    while True:
        shift = (path.left_behind[3] - base) * cell[2]  # the frame's origin, seen from that of the first copy
        limit, rises = _limit(path, tile.limit, above - shift, below - shift), path.d[2] > 0.0
        z = flight_in_slab(path.o, path.d, path.left_behind, tile.grid, limit, path.sphere, path.to, (base, top, bottom))
        if z < limit:
            radius = tile.radii[path.sphere[0]]
            _enter(path, z)
            state, kept, weight = _meet(path, radius, grains, matter, (rules.depth, hits == 0, rules.last > 0), draws, scratch)
            if state > LEFT:
                out.sums[CONTRADICTED if state == DROPPED else CUTS] += 1.0
                return
            if state == LEFT:
                hits += 1
                out.sums[HITS] += 1.0
                out.walks[bin0] += weight - 1.0  # as much light as is followed: no more of it leaves than came in
                factor *= kept
                if hits == 1:
                    first = _numbers(path.sphere)
                if _is_deflected(path):
                    order += 1
                    returned = rules.returns and order == HIGHER + 1 and first == _numbers(path.sphere)
            begin_beyond(path, tile.centers, radius)
        elif not rises and (path.d[2] == 0.0 or below == -np.inf):
            out.sums[GIVEN_UP] += 1.0
            return
        elif rises or rules.sides == 2:
            cosine = ex * path.d[0] + ey * path.d[1] - mu0 * path.d[2]
            _count_out(path, (order, late, returned), factor, mu0, cosine, bin0, rules, out)
            return
        else:
            _reflect(path, limit, rules.base, draws)
            state, hits, order, returned = LEFT, hits + 1, order + 1, False
        if hits >= rules.most:
            _count_inside(path, late, factor, above - (path.left_behind[3] - base) * cell[2], above - below, rules, out)
            return
        if state == LEFT:
            factor = _goes_on(path, factor, draws) if hits > 1 else factor
            if factor == 0.0 or _is_past(path, order, returned, rules):
                return
            if hits > rules.late and order > HIGHER and not late:
                late = True
                _count_deep(path, factor, levels[3], bin0, out)
                if not levels[3]:
                    return


@njit(nogil=True, error_model="numpy", forceinline=True)
def _numbers(sphere):
    """Of a sphere and its copy, that can be compared."""
    return sphere[0], sphere[1], sphere[2], sphere[3]


@njit(nogil=True, error_model="numpy", forceinline=True)
def _is_past(path, order, returned, rules):
    """Whether nothing that a walk does is counted any more: it is beyond the last order that is asked for.

    Down in a half space light meets one more sphere, which may be that of the first hit.
    """
    ahead = path.d[2] <= 0.0 and rules.sides == 1 and not rules.returns
    return rules.last > 0 and order + ahead > rules.last and not returned


@njit(nogil=True, error_model="numpy", forceinline=True)
def _limit(path, longest, above, below):
    """How far a walk flies until it is out of the grains, above or below them; at most `longest` where it goes along them."""
    if path.d[2] > 0.0:
        return max((above - path.o[2]) / path.d[2], 0.0)
    if path.d[2] < 0.0 and below > -np.inf:
        return max((below - path.o[2]) / path.d[2], 0.0)
    return longest


@njit(nogil=True, error_model="numpy", forceinline=True)
def _is_deflected(path):
    """Whether a grain has sent light on in another direction than the one it came in."""
    return 1.0 - (path.d[0] * path.ray[3] + path.d[1] * path.ray[4] + path.d[2] * path.ray[5]) > _STRAIGHT


@njit(nogil=True, error_model="numpy", forceinline=True)
def _begin(path, cell, levels, bins, draws):
    """Light above the grains: bin and cosine of its incidence, horizontal part of its direction, the plane that cuts the tile."""
    least = math.sqrt(STEEPEST)
    share = next_uniform(draws.stream, draws.pool)
    bin0, s = min(int(share * bins), bins - 1), least + (1.0 - least) * share
    mu0, azimuth = s * s, 2.0 * math.pi * next_uniform(draws.stream, draws.pool)
    across = math.sqrt(max(1.0 - mu0 * mu0, 0.0))
    ex, ey = across * math.cos(azimuth), across * math.sin(azimuth)
    path.d[0], path.d[1], path.d[2] = ex, ey, -mu0
    top = levels[0] + (levels[1] - levels[0]) * next_uniform(draws.stream, draws.pool)
    path.o[0], path.o[1] = cell[0] * next_uniform(draws.stream, draws.pool), cell[1] * next_uniform(draws.stream, draws.pool)
    path.o[2], path.left_behind[0] = top + levels[2], -1
    for k in range(1, 4):
        path.left_behind[k] = int((2.0 * next_uniform(draws.stream, draws.pool) - 1.0) * FAR)
    path.carried[:] = 1.0
    path.optical[:] = 0.0
    return bin0, mu0, ex, ey, top


@njit(nogil=True, error_model="numpy", forceinline=True)
def _reflect(path, distance, albedo, draws):
    """The path after a matt plane under the grains sent it up again."""
    share, azimuth = next_uniform(draws.stream, draws.pool), 2.0 * math.pi * next_uniform(draws.stream, draws.pool)
    for k in range(3):
        path.o[k] += distance * path.d[k]
    across = math.sqrt(1.0 - share)
    path.d[0], path.d[1], path.d[2] = across * math.cos(azimuth), across * math.sin(azimuth), math.sqrt(share)
    path.left_behind[0] = -1
    for c in range(len(path.carried)):
        path.carried[c] *= albedo[c]


@njit(nogil=True, error_model="numpy", forceinline=True)
def _enter(path, z):
    """The ray where it enters the next sphere."""
    length2 = 0.0
    for k in range(3):
        path.ray[k] = z * path.d[k] - path.to[k]
        path.ray[3 + k] = path.d[k]
        length2 += path.ray[k] * path.ray[k]
    over = 1.0 / math.sqrt(length2)
    for k in range(3):
        path.ray[k] *= over


@njit(nogil=True, error_model="numpy", forceinline=True)
def _goes_on(path, factor, draws):
    """The share of all light of a path that goes on, 0 where it does not: faint ones go on by chance.

    Not asked after the first hit: those that are aimed are faint, and wanted once.
    """
    strongest = 0.0
    for c in range(len(path.carried)):
        if factor * path.carried[c] * (1.0 - path.optical[c]) >= FAINT:  # 1 - x: no more than exp(-x)
            return factor
        strongest = max(strongest, factor * path.carried[c] * math.exp(-path.optical[c]))
    if strongest >= FAINT or strongest > 0.0 and next_uniform(draws.stream, draws.pool) * FAINT < strongest:
        return factor * max(FAINT / strongest, 1.0)
    return 0.0


@njit(nogil=True, error_model="numpy", forceinline=True)
def _count_deep(path, factor, goes_on, bin0, out):
    """Light that has become late."""
    for c in range(len(path.carried)):
        light = factor * path.carried[c] * math.exp(-path.optical[c])
        out.deep[c, bin0] += light
        if goes_on:
            out.followed[c] += light


@njit(nogil=True, error_model="numpy", forceinline=True)
def _count_inside(path, late, factor, above, deepest, rules, out):
    """Light that is late at the end of its walk; above : height of the upper face in the walk's frame, the lower one is as much
    deeper as deepest says."""
    if not late:  # hardly any grain deflects light
        out.sums[GIVEN_UP] += 1.0
        return
    depth = max(above - path.o[2], 0.0)
    if rules.sides == 2:
        depth = min(depth, max(deepest - depth, 0.0))
    for c in range(len(path.carried)):
        out.inside[c] += factor * path.carried[c] * math.exp(-path.optical[c] - rules.decay[c] * depth)


@njit(nogil=True, error_model="numpy", forceinline=True)
def _count_out(path, kind, factor, mu0, cosine, bin0, rules, out):
    """Light that left.  kind : its order, whether it is late, whether it is as `Rules.returns` says;  cosine : of the scattering
    angle;  undeflected light leaves below alone.

    Below, the pair is that of the light's origin and of the direction opposite to that in which it leaves.
    """
    order, late, returned = kind
    at, side = min(order - 1, HIGHER), 0 if path.d[2] > 0.0 else 1
    if rules.last and order > rules.last and not returned:
        return
    cell = cell_of(max(abs(path.d[2]), 1e-12), mu0, cosine if side else -cosine, rules.cells)
    for c in range(len(path.carried)):
        light = factor * path.carried[c] * math.exp(-path.optical[c])
        if at < 0:
            out.straight[c, bin0] += light
        elif late:
            out.late[side, c] += light
        else:
            if rules.last or not returned:
                out.cells[side, at, c, cell] += light
            if not (rules.last and returned):
                out.entered[side, at, c, bin0] += light
