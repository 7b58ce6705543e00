"""Single scattering as a sum: every particle that the camera can see adds to its pixel what the lights send by way of it.

A camera pencil is stopped by a particle if it passes the centre, at distance D, under an angle whose sine is below rho / D: the
cone of such directions is what the particle takes of the picture.  Pencils are drawn in that cone, evenly: a particle is spread
over the pixels that its disc covers, and one smaller than a pixel needs one pencil.  Chance decides only which parts of discs
others hide, on places on lights, and on where some pencils go on.  The sum is the mean of `walk` over camera paths that scatter
once.
"""

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import (
    BOX,
    Particles,
    disc_cells,
    discs_of_cell,
    hashed,
    mesh_scratch,
    stream_key,
    turned_direction,
)
from bakery.system.compiled import njit
from renderers.materials.particles import _transport, shadow
from renderers.materials.particles._transport import Guide, Walk, Ways
from renderers.materials.particles.box import column
from renderers.mitsuba.shading import FAR, LightSample, selected
from renderers.threads import run
from renderers.transport import steps, wavefront
from renderers.transport.paths import Paths

CHUNK = 1 << 17  # particles at a time
_FOLLOWED = 0.25  # share of the pencils that also go on as their particles scatter, to find light by
_MOST = 4096  # pencils to one particle in a pass
_DENSE = 8.0  # pencils to a pixel of a disc
_TRACED, _DRAWN = 1 << 16, 1 << 22  # particles in a pass: a second or two
_TOGETHER = 100.0  # discs, as large as those that hide most, in a pixel where nobody can tell which one hides what
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_BLOCK, _BLOCKS = 8, 1 << 18  # cells along an edge of what is compared with the view; fewer where blocks would be few


class Plan(NamedTuple):
    """How single scattering is summed.

    shares : passes that make up a sum over all particles; each takes every so many a block of cells, for as many
    drawn : whether particles that cannot be told apart are hidden by chance, as often as the mean medium hides them, rather than
        by the discs of others; of the same mean and variance, and many times quicker
    """

    shares: int = 1
    drawn: bool = False


def plan(medium, camera, height, width, depth, drawn) -> Plan:
    """A plan whose passes take seconds; arguments as in `one_pass` and `Plan`."""
    solid = camera.angle(height, width) ** 2
    lo, hi = medium.discs.region.lo, medium.discs.region.hi
    farthest = np.linalg.norm(np.maximum(abs(lo - camera.origin), abs(hi - camera.origin)))
    seen = medium.density.sum() * min(float(np.sum(solid * np.minimum(depth, farthest) ** 3)) / 3, float((hi - lo).prod()))
    return Plan(max(1, math.ceil(seen / (_DRAWN if drawn else _TRACED))), drawn)


def one_pass(world, discs, camera, height, width, number, seed, *, discrete, lights):
    """A share of the particles, and one pencil, or more for large discs, to each: what `walk.one_pass` gives, of order 1 alone.

    discs : pair of `renderers.materials.particles.medium.Medium` and `Plan`;  others : as in `walk.one_pass`
    """
    plan = discs[1]
    pixels = height * width
    by_order, by_light = np.zeros((wavefront.ORDERS, pixels, 3)), np.zeros((lights, pixels, 3))
    view = View(camera, height, width)
    share = np.array([number % plan.shares, plan.shares, stream_key(seed, "render.blocks")], np.uint64)
    for serial, chunk in enumerate(_particles(discs[0].discs, view, discrete, share)):
        _add(world, discs, view, chunk, discrete, (seed, number, serial), by_order, by_light)
    by_order[1] *= plan.shares  # the others stay untouched, and take no memory
    by_light *= plan.shares
    return by_order.reshape(-1, height, width, 3), by_light.reshape(-1, height, width, 3)


class Chunk(NamedTuple):
    """Particles: place (n, 3) m, class kind (n,), identity (n,) uint64."""

    place: np.ndarray
    kind: np.ndarray
    identity: np.ndarray


class Pencils(NamedTuple):
    """Of the camera, n of them.

    direction : (n, 3) unit;  far : (n,) m, to the disc;  throughput : (n, L);  pixel : (n,), -1 where it meets none
    states : (n,) uint64, random streams
    """

    direction: np.ndarray
    far: np.ndarray
    throughput: np.ndarray
    pixel: np.ndarray
    states: np.ndarray

    of = selected


class View:
    """The camera laid out for kernels.

    origin, axis : (3,);  inverse : (3, 3), turns a direction into s (1, column, row);  area : of a pixel at unit distance
    sides : (4, 3) normals of the sides of the pyramid of view, inwards
    frame : what `_aim` takes of it
    """

    def __init__(self, camera, height, width):
        self.height, self.width = height, width
        self.origin = np.array(camera.origin, float)
        self.inverse = np.linalg.inv(np.array([camera.corner, camera.right, camera.down], float))
        across = np.cross(camera.right, camera.down)
        self.area = float(np.linalg.norm(across))
        self.axis = across / self.area * np.sign(across @ camera.corner)
        self.frame = self.origin, self.inverse, self.axis, self.area, height, width
        corners = [camera.corner + i * width * camera.right + j * height * camera.down
                   for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
        normals = np.array([np.cross(a, b) for a, b in zip(corners, [*corners[1:], corners[0]])])
        normals *= np.sign(normals @ self.axis)[:, None]
        self.sides = normals / np.linalg.norm(normals, axis=1)[:, None]


def _particles(discs, view, discrete, share):
    """Chunks of particles that may be in the picture and nearer than `discrete` somewhere, of a share of the blocks of cells.

    share : (3,) uint64, which of the shares, how many there are, and the key by which blocks belong to them, one for all passes

    Yields `Chunk`.
    """
    for level in range(len(discs.reach)):
        bounds, farthest = disc_cells(discs, level), float(discrete.max())
        edge = _BLOCK
        while edge > 1 and np.prod(bounds[3:] - bounds[:3] + 1.0) < _BLOCKS * edge**3:
            edge //= 2
        lattice = discs.step[level], discs.region.lo + discs.shift[level], discs.reach[level]
        blocks = _blocks_in_view(lattice, bounds, edge, view.origin, view.sides, farthest, share)
        state = np.zeros(3, np.int64)  # block, cell in it, particle in that
        while state[0] < len(blocks):
            points, kind, identity = np.empty((CHUNK, 3)), np.empty(CHUNK, np.int64), np.empty(CHUNK, np.uint64)
            filled = _gather(discs, level, blocks, edge, state, bounds, points, kind, identity)
            if filled:
                yield Chunk(points[:filled], kind[:filled], identity[:filled])


@njit(cache=True, nogil=True, error_model="numpy")
def _blocks_in_view(lattice, bounds, edge, origin, sides, farthest, share):
    """First cells (n, 3) of blocks of edge^3 cells that a pyramid of view, normals sides (4, 3) inwards, may touch.

    lattice : edges (3,) and corner (3,) m of the cells of a level, and how far its discs reach, m

    Of a share of them, see `_particles`, by chance: what is left out has no pattern.
    """
    counts = (bounds[3:] - bounds[:3]) // edge + 1
    step, corner, reach = lattice
    radius = 0.5 * edge * math.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2) + reach
    out = np.empty((64, 3), np.int64)
    n = 0
    for i in range(counts[0]):
        for j in range(counts[1]):
            for k in range(counts[2]):
                block = np.uint64((i * counts[1] + j) * counts[2] + k)
                if hashed(share[2] ^ block * _GOLDEN) % share[1] != share[0]:
                    continue
                a, b, c = bounds[0] + i * edge, bounds[1] + j * edge, bounds[2] + k * edge
                x = corner[0] + (a + 0.5 * edge) * step[0] - origin[0]
                y = corner[1] + (b + 0.5 * edge) * step[1] - origin[1]
                z = corner[2] + (c + 0.5 * edge) * step[2] - origin[2]
                inside = x * x + y * y + z * z < (farthest + radius) ** 2
                for s in range(4):
                    inside = inside and sides[s, 0] * x + sides[s, 1] * y + sides[s, 2] * z > -radius
                if inside:
                    if n == len(out):
                        larger = np.empty((2 * n, 3), np.int64)
                        for m in range(n):  # not at once: numba compiles two seconds of checks of shapes for that
                            larger[m, 0], larger[m, 1], larger[m, 2] = out[m, 0], out[m, 1], out[m, 2]
                        out = larger
                    out[n, 0], out[n, 1], out[n, 2] = a, b, c
                    n += 1
    return out[:n]


@njit(cache=True, nogil=True, error_model="numpy")
def _gather(discs, level, blocks, edge, state, bounds, points, kind, identity):
    """Fills place, kind and identity with the particles of blocks from `state` on, which is moved on; how many they are."""
    particles, scratch = Particles(points, kind, identity), mesh_scratch()
    filled = np.int64(0)  # a literal 0 would be compiled for as well
    while state[0] < len(blocks):
        cell = state[1]
        i = blocks[state[0], 0] + cell // (edge * edge)
        j = blocks[state[0], 1] + cell // edge % edge
        k = blocks[state[0], 2] + cell % edge
        remaining = -1
        if i <= bounds[3] and j <= bounds[4] and k <= bounds[5]:
            filled, remaining = discs_of_cell(discs, level, (i, j, k), state[2], particles, filled, scratch)
        if remaining >= 0:
            state[2] = remaining
            return filled
        state[2] = 0
        state[1] += 1
        if state[1] == edge**3:
            state[0] += 1
            state[1] = 0
    return filled


def _add(world, discs, view, chunk, discrete, streams, by_order, by_light):
    """Adds the particles of one chunk to the picture; `streams` are (seed, pass, chunk)."""
    (medium, plan), n = discs, len(chunk.kind)
    seed, number, serial = streams
    numbers = wavefront.uniforms(chunk.identity ^ stream_key(seed, "render.aims"), 6)  # the same in all passes
    states, pencils_of = wavefront.streams(stream_key(seed, "render.splat", number, serial), n), np.empty(n, np.int64)
    run(_pencils, n, medium.discs.largest, view.origin, view.area, view.axis, chunk.place, chunk.kind, pencils_of)
    who = np.repeat(np.arange(n), pencils_of)
    points, kind, numbers, m = chunk.place[who], chunk.kind[who], numbers[who], len(who)
    part = np.arange(m) - np.repeat(np.cumsum(pencils_of) - pencils_of, pencils_of)
    states = states[who]
    wavefront.branch(states, part)
    # pencils of one particle and of all passes spread over its disc evenly
    turn = (number // plan.shares * pencils_of[who] + part)[:, None]
    aims, places = (numbers[:, :2] + turn * steps.PLACES) % 1.0, (numbers[:, 4:] + turn * steps.LIGHTS) % 1.0
    pencils = Pencils(np.empty((m, 3)), np.empty(m), np.empty((m, len(medium.sigma_t))), np.empty(m, np.int64), states)
    run(_aim, m, (medium.discs.square, medium.discs.largest), view.frame, discrete.reshape(-1),
        (points, kind, pencils_of[who]), aims, pencils)
    kept = np.flatnonzero(pencils.pixel >= 0)
    if len(kept):
        far = world.trace(np.tile(view.origin, (len(kept), 1)), pencils.direction[kept], pencils.far[kept])
        kept = kept[~np.isfinite(far)]
    points, kind, places, pencils = points[kept], kind[kept], places[kept], pencils.of(kept)
    chances = _chances(medium, plan, view, pencils, numbers[kept, 2:4])
    share = (pencils.throughput > 0).astype(float)
    ways = _ways(pencils.states, np.tile(view.origin, (len(kept), 1)), pencils.direction, pencils.far, points)
    _let_through(medium, chances[0], ways, share)
    pencils.throughput[:] *= share
    seen = np.flatnonzero((pencils.throughput > 0).any(axis=1))
    _light(world, discs, view, (kind[seen], points[seen]), pencils.of(seen), chances[1][seen], places[seen], by_order, by_light)


def _ways(states, origin, direction, distance, left_out) -> Ways:
    """Ways that particles alone hide, by their discs."""
    return Ways(states, origin, direction, distance, np.full(len(distance), np.inf), left_out)


def _let_through(medium, chance, ways, share, factor=1.0):
    """Multiplies share (n, L) by what gets through along ways: what others' discs leave, and where chance (n,) is a number all
    or nothing, as it is below what the mean medium lets through times a factor (n, L)."""
    drawn, traced = np.flatnonzero(chance >= 0), np.flatnonzero(np.isnan(chance))
    if len(drawn):
        length = column(medium.discs.region, *(values[drawn] for values in (ways.origin, ways.direction, ways.distance)))[:, None]
        through = np.broadcast_to(factor, share.shape)[drawn] * np.exp(-medium.others * medium.sigma_t * length)
        share[drawn] *= np.where(chance[drawn, None] < through, np.exp(-medium.host * length), 0.0)
    passed = share[traced]
    run(_transport.transmit, len(traced), medium, Ways(*(values[traced] for values in ways)), passed)
    share[traced] = passed


def _light(world, discs, view, particles, pencils, chance, places, by_order, by_light):
    """Adds what lights send by way of particles that are seen, class (n,) and place (n, 3) m, to the sums;
    places : (n, 2) in [0, 1), choice of a light and place on it."""
    medium, m = discs[0], len(pencils.pixel)
    if not m:
        return
    samples = [(slice(None), world.lights(particles[1], places))]
    chosen = np.flatnonzero(wavefront.uniforms(pencils.states, 1)[:, 0] < _FOLLOWED) if world.extended else ()
    if len(chosen):
        samples.append((chosen, _followed(world, medium, particles, pencils, chosen)))
    for rows, sample in samples:
        seen = [values[rows] for values in particles]
        _arrives(medium, view, seen, pencils.of(rows), chance[rows], sample, by_order, by_light)


def _followed(world, medium, particles, pencils, chosen) -> LightSample:
    """What some pencils come upon that go on as their particles scatter, as places on lights: a lamp behind a particle sends
    nearly all of its light by way of a narrow peak, which places on it seldom are in."""
    n, none, whole = len(chosen), np.zeros(len(chosen), bool), np.zeros(len(chosen), np.int64)
    origin, density = particles[1][chosen], np.zeros(n)
    paths = Paths(origin, pencils.direction[chosen], pencils.throughput[chosen], pencils.states[chosen], pencils.pixel[chosen],
                  whole, whole, density, none, left_out=origin)
    guide = Guide(paths.direction.copy(), none)
    run(_transport.scatter, n, medium.scatterer, particles[0][chosen], paths.part(Walk), guide)
    pencils.states[chosen] = paths.states
    density *= _FOLLOWED
    shading = steps.met(world, paths)
    far = np.where(shading.hit, np.linalg.norm(shading.point - origin, axis=1), FAR)
    radiance = shading.emitted / np.maximum(density, 1e-30)[:, None]
    return LightSample(paths.direction.astype(np.float32), far, radiance.astype(np.float32), density.astype(np.float32),
                       ~none, shading.source)


def _arrives(medium, view, particles, pencils, chance, sample, by_order, by_light):
    """Adds what one place on a light sends by way of each particle."""
    (kind, centre), n = particles, len(chance)
    towards, distance, factor = sample.direction.astype(float), sample.distance.astype(float), 1.0
    if np.isfinite(chance).any():
        ends = view.origin + pencils.far[:, None] * pencils.direction
        factor = shadow.factors(medium, view.origin, ends, towards, distance, centre - ends)
    share = np.repeat((sample.radiance > 0).any(axis=1)[:, None], len(medium.sigma_t), axis=1).astype(float)
    _let_through(medium, chance, _ways(pencils.states, centre, towards, distance, centre), share, factor)
    added, guide = np.empty((n, 3)), Guide(pencils.direction, np.zeros(n, bool), _FOLLOWED)
    walk = Walk(centre, pencils.direction, pencils.throughput, pencils.states, centre, np.empty(n))
    run(_transport.light, n, medium.scatterer, kind, walk, guide, share, sample, added)
    wavefront.accumulate(added, np.ones(n, np.int64), sample.light, pencils.pixel, by_order, by_light)


def _chances(medium, plan, view, pencils, numbers):
    """Numbers (2, n) in [0, 1) by which pencils, and light to them, are hidden; nan where discs hide them."""
    if not plan.drawn or medium.discs.region.kind != BOX:
        return np.full((2, len(numbers)), np.nan)
    area = medium.discs.square.max(axis=1) * math.pi
    typical = float(np.sum(medium.density * area**2) / max(float(np.sum(medium.density * area)), 1e-300))
    pixel = pencils.far**2 * view.area * (pencils.direction @ view.axis) ** 3
    return np.ascontiguousarray(np.where(pixel > _TOGETHER * typical, numbers.T, np.nan))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _cone(largest, kind, x, y, z):
    """Distance of a particle from the camera, and 1 - cos of the cone that its largest disc covers; `largest` as of
    `bakery.kernels.Discs`."""
    distance = math.sqrt(x * x + y * y + z * z)
    sine = math.sqrt(largest[kind]) / distance if distance > 0 else 1.0
    if sine >= 1:
        return distance, 1.0
    return distance, sine * sine / (1 + math.sqrt(1 - sine * sine))


@njit(cache=True, nogil=True, error_model="numpy")
def _pencils(largest, origin, area, axis, points, kind, pencils, begin, end):
    """How many pencils each particle gets: by the pixels that its disc covers."""
    for i in range(begin, end):
        x, y, z = points[i, 0] - origin[0], points[i, 1] - origin[1], points[i, 2] - origin[2]
        distance, v = _cone(largest, kind[i], x, y, z)
        along = max(x * axis[0] + y * axis[1] + z * axis[2], 0.1 * distance)
        covered = 2 * math.pi * v / (area * (along / distance) ** 3) if along > 0 else 1e9
        pencils[i] = min(max(math.ceil(covered * _DENSE), 1), _MOST)


@njit(cache=True, nogil=True, error_model="numpy")
def _aim(discs, frame, discrete, particles, aims, pencils, begin, end):
    """A pencil in the cone of each particle: direction, distance, weights over the solid angle of its pixel; pixel -1: none.

    discs : `square`, `largest` of `bakery.kernels.Discs`
    particles : place (n, 3) m, class (n,), and how many pencils each of them gets (n,)
    """
    square, largest = discs
    origin, inverse, axis, area, height, width = frame
    points, kind, shares = particles
    weight, pixel = pencils.throughput, pencils.pixel
    for i in range(begin, end):
        x, y, z = points[i, 0] - origin[0], points[i, 1] - origin[1], points[i, 2] - origin[2]
        distance, v = _cone(largest, kind[i], x, y, z)
        pixel[i] = -1
        if distance == 0:
            continue
        chosen = v * aims[i, 0]
        dx, dy, dz = turned_direction(x / distance, y / distance, z / distance, chosen,
                                      2 * math.pi * aims[i, 1])
        ahead = dx * axis[0] + dy * axis[1] + dz * axis[2]
        if ahead <= 0:
            continue
        # on the plane of the picture: direction = s (corner + column right + row down)
        s = dx * inverse[0, 0] + dy * inverse[1, 0] + dz * inverse[2, 0]
        column = (dx * inverse[0, 1] + dy * inverse[1, 1] + dz * inverse[2, 1]) / s
        row = (dx * inverse[0, 2] + dy * inverse[1, 2] + dz * inverse[2, 2]) / s
        if not (0 <= column < width and 0 <= row < height):
            continue
        to = int(row) * width + int(column)
        t = distance * (1 - chosen)
        if t >= discrete[to]:
            continue
        d2 = distance * distance * chosen * (2 - chosen)
        share = 2 * math.pi * v / (area * ahead**3 * shares[i])
        open = False
        for w in range(weight.shape[1]):
            weight[i, w] = share if d2 < square[kind[i], w] else 0.0
            open = open or weight[i, w] > 0
        if open:
            pixel[i], pencils.far[i] = to, t
            pencils.direction[i, 0], pencils.direction[i, 1], pencils.direction[i, 2] = dx, dy, dz
