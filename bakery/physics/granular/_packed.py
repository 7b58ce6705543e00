"""Loops of `packed`: one meeting with a grain, whole walks."""

import math
from typing import NamedTuple

import numpy as np

from bakery.physics.grains.bvh import mesh_scratch, nearest_triangle, triangle_normal
from bakery.physics.grains.sampling import next_uniform, surface_frame, uniforms_of_meeting
from bakery.physics.grains.surface import at_surface
from bakery.physics.granular.flights import flight_to_sphere
from bakery.physics.lent import lent
from bakery.physics.packing.instances import kind, rotation, rotation_matrix, uniforms
from bakery.system.compiled import njit

MISSED, LEFT, LOST, CONTRADICTED, CUT = range(5)
AHEAD = 1.0 / 128  # how far outside of the bounding sphere a ray starts: a grain may touch the sphere
RETRIES = 1000  # meetings with a grain, besides ten times the depth, after which no hit is drawn again and the walk is given up
FAR = 1 << 30  # walks start in copies of the tile with numbers up to this

# What a walk adds up; mean square displacements over 1, 2, 4, ... hits follow.
(HITS, ENTRIES, VOIDS, VOID, VOID2, FLIGHT, FLIGHT2, NEXT, ALONG, ACROSS, SQUARE, COSINE, EVENTS, WALKS, GIVEN_UP, DRAWN, LOSSES,
 CONTRADICTIONS, CUTS) = range(19)
SUMS = 19


class Tile(NamedTuple):
    """A periodic tile of spheres: centers (N, 3), radii (N,), cumulated shares of the surface (N,), the grid of
    `flight_to_sphere`, longest flight between two spheres."""

    centers: np.ndarray
    radii: np.ndarray
    area: np.ndarray
    grid: tuple
    limit: float


class Grains(NamedTuple):
    """Types of grain as `exemplars.Exemplars` has them, their cumulated shares (T,), seed of their hash (uint64), meetings with a
    surface after which a hit is drawn again."""

    shares: np.ndarray
    table: np.ndarray
    offset: np.ndarray
    nodes: np.ndarray
    children: np.ndarray
    blocks: np.ndarray
    seed: np.uint64
    depth: int


class Kind(NamedTuple):
    """A type of grain: its surface, and its radius if it is a ball (else 0)."""

    matter: int
    index: float
    roughness: float
    radius: float


class Draws(NamedTuple):
    """Random numbers of a walk, `sampling.next_uniform`'s arguments."""

    stream: np.ndarray
    pool: np.ndarray


class Walk(NamedTuple):
    """Where a walk is: the sphere (number, copy of the tile) and the one before, entry into it (on the unit sphere) and
    direction, vector to its centre, origin of the flight, way since the last hit, `meet`'s ray, sums, places after hits."""

    sphere: np.ndarray
    left_behind: np.ndarray
    entry: np.ndarray
    d: np.ndarray
    to: np.ndarray
    o: np.ndarray
    since_hit: np.ndarray
    ray: np.ndarray
    row: np.ndarray
    position: np.ndarray


@njit(nogil=True, error_model="numpy", forceinline=True)
def turned(grain, d, n, draws):
    """Direction after a meeting with the surface, its part along the outward normal n, the share of the light that leaves, and
    the cosine at the facet."""
    (dx, dy, dz), (nx, ny, nz) = d, n
    sx, sy, sz, tx, ty, tz = surface_frame(nx, ny, nz)
    x, y, z = -(dx * sx + dy * sy + dz * sz), -(dx * tx + dy * ty + dz * tz), -(dx * nx + dy * ny + dz * nz)
    u, v, w = uniforms_of_meeting(grain.matter, grain.roughness, draws.stream, draws.pool)
    x, y, z, share, cosine = at_surface(grain.matter, grain.index, grain.roughness, x, y, z, u, v, w)
    dx, dy, dz = x * sx + y * tx + z * nx, x * sy + y * ty + z * ny, x * sz + y * tz + z * nz
    over = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)  # keeps rounding from growing over many reflections
    return dx * over, dy * over, dz * over, z, share, cosine


@njit(cache=True, nogil=True, error_model="numpy")
def ball(grain, ray, depth, draws):
    """Follow `ray` (6,) (place on the unit sphere, direction) through a smooth or rough ball; what became of it, and meetings."""
    draws, radius = lent(draws), grain.radius
    ox, oy, oz, dx, dy, dz = ray[0], ray[1], ray[2], ray[3], ray[4], ray[5]
    along = -(ox * dx + oy * dy + oz * dz)
    px, py, pz = ox + along * dx, oy + along * dy, oz + along * dz
    inside = radius * radius - (px * px + py * py + pz * pz)
    if radius == 1.0:
        t = 0.0
    elif inside > 0.0:
        t = along - math.sqrt(inside)
    else:
        leave(ray, px, py, pz, dx, dy, dz)
        return MISSED, 0
    nx, ny, nz = (ox + t * dx) / radius, (oy + t * dy) / radius, (oz + t * dz) / radius
    count = 0
    while True:
        if count == depth:
            return CUT, count
        count += 1
        dx, dy, dz, z, share, _ = turned(grain, (dx, dy, dz), (nx, ny, nz), draws)
        if share < 1.0 and next_uniform(draws.stream, draws.pool) >= share:
            return LOST, count
        if z > 0.0:
            break
        t = -2.0 * (dx * nx + dy * ny + dz * nz)
        nx, ny, nz = nx + t * dx, ny + t * dy, nz + t * dz
        over = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
        nx, ny, nz = nx * over, ny * over, nz * over
    leave(ray, radius * nx, radius * ny, radius * nz, dx, dy, dz)
    return LEFT, count


@njit(nogil=True, error_model="numpy", forceinline=True)
def leave(ray, ox, oy, oz, dx, dy, dz):
    """Write where a ray from inside of the unit sphere leaves it."""
    along = ox * dx + oy * dy + oz * dz
    t = math.sqrt(along * along + max(1.0 - (ox * ox + oy * oy + oz * oz), 0.0)) - along
    ox, oy, oz = ox + t * dx, oy + t * dy, oz + t * dz
    over = 1.0 / math.sqrt(ox * ox + oy * oy + oz * oz)
    ray[0], ray[1], ray[2], ray[3], ray[4], ray[5] = ox * over, oy * over, oz * over, dx, dy, dz


@njit(cache=True, nogil=True, error_model="numpy")
def mesh(tree, grain, ray, depth, draws, scratch):
    """Follow `ray` (6,) (place on the unit sphere, direction) through a mesh; what became of it, and meetings."""
    draws, scratch, (nodes, children, blocks) = lent(draws), lent(scratch), lent(tree)
    dx, dy, dz = ray[3], ray[4], ray[5]
    ox, oy, oz = ray[0] - AHEAD * dx, ray[1] - AHEAD * dy, ray[2] - AHEAD * dz
    within, triangle, count = False, np.int64(-1), 0
    while True:
        triangle, t = nearest_triangle(nodes, children, blocks, ox, oy, oz, dx, dy, dz, triangle, scratch)
        if triangle < 0:
            if within:
                return CONTRADICTED, count
            if count == 0:  # the chord: from its middle, where rounding is least
                t = -(ox * dx + oy * dy + oz * dz)
                ox, oy, oz = ox + t * dx, oy + t * dy, oz + t * dz
            leave(ray, ox, oy, oz, dx, dy, dz)
            return (LEFT if count else MISSED), count
        ox, oy, oz = ox + t * dx, oy + t * dy, oz + t * dz
        nx, ny, nz = triangle_normal(blocks, triangle)
        z = -(dx * nx + dy * ny + dz * nz)
        if (z < 0.0) != within or z == 0.0:
            return CONTRADICTED, count
        if count == depth:
            return CUT, count
        count += 1
        dx, dy, dz, z, share, _ = turned(grain, (dx, dy, dz), (nx, ny, nz), draws)
        if share < 1.0 and next_uniform(draws.stream, draws.pool) >= share:
            return LOST, count
        within = z < 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def meet(sphere, entry, d, grains, draws, scratch, ray, row):
    """Follow a ray that enters the sphere `met` until it leaves, again from the same entry where its light is lost.

    entry, d : (3,) place on the unit sphere and direction;  ray : (6,) becomes those with which it leaves
    Returns what became of it and how often it met the surface.
    """
    grains, draws = lent(grains), lent(draws)
    table, offset, depth = grains.table, grains.offset, grains.depth
    which, b, c, e = 0, 0.0, 0.0, 0.0
    if len(grains.shares) > 1 or table[0, 3] == 0.0:
        a, b, c, e = uniforms(grains.seed, sphere[1], sphere[2], sphere[3], sphere[0])
        which = kind(a, grains.shares)
    grain = Kind(int(table[which, 0]), table[which, 1], table[which, 2], table[which, 3])
    state, count, spent = LOST, 0, 0
    if grain.radius > 0.0:  # a ball: nobody sees how it is turned
        while state > LEFT and spent < 10 * depth + RETRIES:
            for k in range(3):
                ray[k], ray[3 + k] = entry[k], d[k]
            state, count = ball(grain, ray, depth, draws)
            if state > LEFT:
                row[LOSSES + state - LOST] += 1
            spent += count + 1
        return state, count
    qx, qy, qz, qw = rotation(b, c, e)
    xx, xy, xz, yx, yy, yz, zx, zy, zz = rotation_matrix(qx, qy, qz, qw)
    low, high = offset[which, 0], offset[which + 1, 0]
    tree = grains.nodes[low:high], grains.children[low:high], grains.blocks[offset[which, 1] : offset[which + 1, 1]]
    while state > LEFT and spent < 10 * depth + RETRIES:
        ray[0] = xx * entry[0] + yx * entry[1] + zx * entry[2]
        ray[1] = xy * entry[0] + yy * entry[1] + zy * entry[2]
        ray[2] = xz * entry[0] + yz * entry[1] + zz * entry[2]
        ray[3] = xx * d[0] + yx * d[1] + zx * d[2]
        ray[4] = xy * d[0] + yy * d[1] + zy * d[2]
        ray[5] = xz * d[0] + yz * d[1] + zz * d[2]
        over = 1.0 / math.sqrt(ray[3] * ray[3] + ray[4] * ray[4] + ray[5] * ray[5])
        ray[3], ray[4], ray[5] = ray[3] * over, ray[4] * over, ray[5] * over
        state, count = mesh(tree, grain, ray, depth, draws, scratch)
        if state > LEFT:
            row[LOSSES + state - LOST] += 1
        spent += count + 1
    for k in (0, 3):
        x, y, z = ray[k], ray[k + 1], ray[k + 2]
        ray[k], ray[k + 1], ray[k + 2] = xx * x + xy * y + xz * z, yx * x + yy * y + yz * z, zx * x + zy * y + zz * z
        over = 1.0 / math.sqrt(ray[k] ** 2 + ray[k + 1] ** 2 + ray[k + 2] ** 2)
        ray[k], ray[k + 1], ray[k + 2] = ray[k] * over, ray[k + 1] * over, ray[k + 2] * over
    return state, count


@njit(cache=True, nogil=True, error_model="numpy")
def _isotropic(v, draws):
    """A uniform direction."""
    v[2] = 2.0 * next_uniform(draws.stream, draws.pool) - 1.0
    across, phi = math.sqrt(max(1.0 - v[2] * v[2], 0.0)), 2.0 * math.pi * next_uniform(draws.stream, draws.pool)
    v[0], v[1] = across * math.cos(phi), across * math.sin(phi)


@njit(cache=True, nogil=True, error_model="numpy")
def _enter(area, sphere, entry, d, draws):
    """A ray of uniform isotropic radiance where it enters a sphere: number, copy, place on the unit sphere, direction."""
    sphere[0] = min(np.searchsorted(area, next_uniform(draws.stream, draws.pool), "right"), len(area) - 1)
    for k in range(1, 4):
        sphere[k] = int((2.0 * next_uniform(draws.stream, draws.pool) - 1.0) * FAR)
    length = 0.0
    while length < 1e-12:  # the normal plus a point of the unit sphere has the cosine distribution about the normal
        _isotropic(entry, draws)
        _isotropic(d, draws)
        length = 0.0
        for k in range(3):
            d[k] -= entry[k]
            length += d[k] * d[k]
        length = math.sqrt(length)
    for k in range(3):
        d[k] /= length


@njit(cache=True, nogil=True, error_model="numpy")
def walks(tile, grains, key, replicate, first, count, length, warm):
    """Sums over walks first ... first + count - 1 of a replicate, each of `length` hits after the first `warm` ones.

    key : two words of 32 bits, uint64
    Returns (SUMS + W,), W = 1 + the logarithm of length/4 to base 2: the rows above, then for windows of 1, 2, 4, ... hits the
    mean square displacement over all windows of a walk, added up over the walks.
    """
    windows = 1
    while 1 << (windows + 1) < length:
        windows += 1
    out, draws = np.zeros(SUMS + windows), Draws(np.zeros(5, np.uint64), np.empty(4))
    draws.stream[0], draws.stream[1], draws.stream[3] = key[0], key[1], replicate
    walk = Walk(np.empty(4, np.int64), np.empty(4, np.int64), np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3),
                np.empty(6), np.zeros(SUMS), np.zeros((length + 1, 3)))
    scratch = mesh_scratch()
    for walker in range(count):
        draws.stream[2], draws.stream[4] = np.uint64(first + walker), np.uint64(0)
        walk.row[:] = 0.0
        if _walk(tile, grains, walk, draws, scratch, length, warm):
            _add_displacements(out, walk.position, windows)
        else:
            walk.row[: EVENTS + 1] = 0.0
            walk.row[GIVEN_UP] = 1
        walk.row[WALKS] = 1
        for k in range(SUMS):
            out[k] += walk.row[k]
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _walk(tile, grains, walk, draws, scratch, length, warm):
    """One walk; whether it came to its end."""
    tile, grains, walk, draws, scratch = lent(tile), lent(grains), lent(walk), lent(draws), lent(scratch)
    row, hits, state, events = walk.row, -1, MISSED, 0
    while state == MISSED:
        _enter(tile.area, walk.sphere, walk.entry, walk.d, draws)
        state, events = meet(walk.sphere, walk.entry, walk.d, grains, draws, scratch, walk.ray, row)
        row[DRAWN] += 1
    free, last = 0.0, 0.0
    walk.since_hit[:] = 0.0
    while state <= LEFT:
        radius = tile.radii[walk.sphere[0]]
        if state == LEFT:  # a hit is over: the step that ends here began where the hit before it ended
            hits += 1
            if hits > warm:
                _add_step(walk, radius, hits - warm, free, last, events)
                last = free
                if hits - warm == length:
                    break
            free = 0.0
            walk.since_hit[:] = 0.0
        else:
            free += _pass(walk, radius)
        z = _next_sphere(tile, walk, radius)
        if z >= tile.limit:
            break
        free += z
        if hits >= warm:
            row[VOIDS] += 1
            row[VOID] += z
            row[VOID2] += z * z
            row[ENTRIES] += 1
        state, events = meet(walk.sphere, walk.entry, walk.d, grains, draws, scratch, walk.ray, row)
    return hits == warm + length


@njit(nogil=True, error_model="numpy", forceinline=True)
def _add_step(walk, radius, hit, free, last, events):
    """Add the step that ends with a hit to the sums.  free, last : paths between hits, of this step and the one before."""
    row, along, across, square, cosine = walk.row, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        displacement = radius * (walk.ray[k] - walk.entry[k])
        along += displacement * walk.d[k]
        across += displacement * walk.ray[3 + k]
        square += displacement * displacement
        cosine += walk.d[k] * walk.ray[3 + k]
        walk.position[hit, k] = walk.position[hit - 1, k] + walk.since_hit[k] + displacement
    row[HITS] += 1
    row[FLIGHT] += free
    row[FLIGHT2] += free * free
    row[NEXT] += free * last  # of the step before: 0 at first, counted below
    row[ALONG] += along
    row[ACROSS] += across
    row[SQUARE] += square
    row[COSINE] += cosine
    row[EVENTS] += events


@njit(nogil=True, error_model="numpy", forceinline=True)
def _pass(walk, radius):
    """Path through a sphere whose grain was missed, added to the way."""
    chord = 0.0
    for k in range(3):
        displacement = radius * (walk.ray[k] - walk.entry[k])
        walk.since_hit[k] += displacement
        chord += displacement * walk.d[k]
    return chord


@njit(nogil=True, error_model="numpy", forceinline=True)
def begin_beyond(walk, centers, radius):
    """The next flight begins where light left the sphere, which it does not meet again."""
    for k in range(4):
        walk.left_behind[k] = walk.sphere[k]
    for k in range(3):
        walk.d[k] = walk.ray[3 + k]
        walk.o[k] = centers[walk.sphere[0], k] + radius * walk.ray[k]


@njit(nogil=True, error_model="numpy", forceinline=True)
def _next_sphere(tile, walk, radius):
    """Flight from a sphere to the next one, which is entered; the limit where none comes."""
    begin_beyond(walk, tile.centers, radius)
    z = flight_to_sphere(walk.o, walk.d, walk.left_behind, tile.grid, tile.limit, walk.sphere, walk.to)
    if z >= tile.limit:
        return z
    length2 = 0.0
    for k in range(3):
        walk.since_hit[k] += z * walk.d[k]
        walk.entry[k] = z * walk.d[k] - walk.to[k]
        length2 += walk.entry[k] * walk.entry[k]
    over = 1.0 / math.sqrt(length2)
    for k in range(3):
        walk.entry[k] *= over
    return z


@njit(cache=True, nogil=True, error_model="numpy")
def _add_displacements(out, position, windows):
    """Add a walk's mean square displacements over 1, 2, 4, ... hits."""
    for j in range(windows):
        n = 1 << j
        step, total, number = max(n // 8, 1), 0.0, 0  # windows that overlap by more than 7/8 tell nothing new
        for t in range(0, len(position) - n, step):
            end, begin = position[t + n], position[t]
            x, y, z = end[0] - begin[0], end[1] - begin[1], end[2] - begin[2]
            total += x * x + y * y + z * z
            number += 1
        out[SUMS + j] += total / number
