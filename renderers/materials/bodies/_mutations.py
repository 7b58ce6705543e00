"""Loops of Markov chains among lines of sight and beams of light in a body, joined by the tables of multiple scattering."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import lent, mesh_scratch, phase_value, point_source
from bakery.system.compiled import njit
from renderers.materials.bodies._beams import DEEP
from renderers.materials.bodies._gather import _along, _mirror
from renderers.materials.bodies._geometry import Geometry, first
from renderers.transport.scattering import Scatterer
from renderers.transport.wavefront import uniform

# of a state: line of sight, beam, place on the beam, place on the line, both by the tables; both for second events
NUMBERS = 6
LATER, SECOND, OTHER = range(3)  # what a state brings: as `_gather`
_PARALLEL, _CLOSEST = 1e-4, 1e-9  # sine, and share of the farthest that is looked at, below which lines are no nearer
_BELOW_ONE = 1 - 2.0**-53  # the largest place of a state
_LINE, _BEAM, _ON_BEAM, _ON_LINE, _CLOSE, _SEEN = range(NUMBERS)


class Sights(NamedTuple):
    """n lines of sight in a body, neighbours one after another.

    origin, direction, far : (n, 3) m, unit, (n,) m;  facing : (n, 3) outward normals where they begin, read where light is
        mirrored
    weight : (n, L) of the paths that they belong to, over the paths of a pixel;  pixel, order : (n,) and events before
    """

    origin: np.ndarray
    direction: np.ndarray
    far: np.ndarray
    facing: np.ndarray
    weight: np.ndarray
    pixel: np.ndarray
    order: np.ndarray


class Edge(NamedTuple):
    """What light does between a beam and a line of sight.

    tables : of points, ready for look-ups, of each wavelength;  beyond : (L,) m, as `_gather.Wave`
    second : whether second events on beams of positive power count
    to_rgb, to_luminance : (3, L) linear sRGB of radiances, (3,)
    """

    geometry: Geometry
    medium: Scatterer
    tables: tuple
    beyond: np.ndarray
    second: bool
    to_rgb: np.ndarray
    to_luminance: np.ndarray


class Guide(NamedTuple):
    """How states are drawn: of lines and of beams, each in so many parts of equal length, a part by its odds.

    lines : (I + 1,) odds of all parts before, up to 1;  beams : (I, B + 1) the same of beams, of each part of lines
    density : (I, B) odds of both over those of states that are drawn alike
    """

    lines: np.ndarray
    beams: np.ndarray
    density: np.ndarray


class Plan(NamedTuple):
    """How chains go, and what their states count for.

    scale : lines times beams, which states are drawn of
    steps : of a chain; each `large`-th one draws all numbers anew
    small : (NUMBERS, 2) of small steps of each number: logarithm of the least over the largest, and the largest
    drawn, moved : states that are drawn by the guide, and those of chains, as the weights count them
    typical : mean luminance of all states, by a pilot; 0: not known
    of_state : normalisation of the pass over the states of its chains
    guide : `Guide`
    """

    scale: float
    steps: int
    large: int
    small: np.ndarray
    drawn: float
    moved: float
    typical: float
    of_state: float
    guide: Guide


class Chains(NamedTuple):
    """n chains.

    states : (n, NUMBERS) where they are;  streams : (n,) uint64, of random numbers
    taken : (B, 2) sums of how likely small and large steps were taken, of blocks of chains
    """

    states: np.ndarray
    streams: np.ndarray
    taken: np.ndarray


class _Joined(NamedTuple):
    """A place on a beam that sees one on a line of sight.

    depth : m, of both along beam and line, and the way between them;  before, after : 1 - cosines of both turns
    share : 1/m^2 over the density with which the places are drawn, times m^2; 0 where something hides them
    """

    depth: float
    before: float
    after: float
    share: float


class _Scratch(NamedTuple):
    """What a loop works on, as `_gather`."""

    point: np.ndarray
    away: np.ndarray
    ray: np.ndarray
    waves: np.ndarray
    mesh: tuple


@njit(nogil=True, error_model="numpy")
def _scratch(waves):
    return _Scratch(np.empty((1, 3)), np.empty((1, 3)), np.empty(3), np.zeros((3, waves)), mesh_scratch())


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _number(u, count):
    return min(int(u * count), count - 1)


# forceinline: a call would hand over every array of the tuples
@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _brought(edge, sights, beams, scale, u, light, scratch):
    """Luminance, without its sign, of the light (3, 3) that a state u (NUMBERS,) brings, which becomes `LATER`, `SECOND` and
    `OTHER` in linear sRGB."""
    medium, waves, kinds = edge.medium, scratch.waves, 3 if edge.second else 1
    i, b = _number(u[_LINE], len(sights.far)), _number(u[_BEAM], len(beams.length))
    of_second = OTHER if beams.before[b] > 0 or sights.order[i] > 0 else SECOND
    whole = 0.0
    for w in range(len(medium.sigma_t)):
        whole += beams.power[b, w]
    negative = whole < 0.0
    joined = _joined(edge, sights, beams, i, b, u, scratch) if negative or edge.second else _Joined(0.0, 0.0, 0.0, 0.0)
    for w in range(len(medium.sigma_t)):
        for kind in range(kinds):
            waves[kind, w] = 0.0
        sigma, power = medium.sigma_t[w], scale * sights.weight[i, w] * beams.power[b, w]
        if power != 0.0:
            waves[LATER, w] = sigma * power * _by_tables(edge, sights, beams, (i, b, w), u, scratch)
        if power != 0.0 and joined.share > 0.0:
            twice = joined.share * (medium.albedo[w] * sigma) ** 2 * math.exp(-sigma * joined.depth)
            twice *= phase_value(medium.v, medium.steps, medium.phase[w], joined.before)
            twice *= phase_value(medium.v, medium.steps, medium.phase[w], joined.after)
            waves[LATER if negative else of_second, w] += power * twice
    luminance = 0.0
    for kind in range(kinds):
        for c in range(3):
            light[kind, c] = 0.0
            for w in range(len(medium.sigma_t)):
                light[kind, c] += edge.to_rgb[c, w] * waves[kind, w]
            luminance += edge.to_luminance[c] * light[kind, c]
    if not abs(luminance) < np.inf:
        light[:] = 0.0
        return 0.0
    return abs(luminance)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _by_tables(edge, sights, beams, numbers, u, scratch):
    """Later events of light of beam b on line of sight i at wavelength w, numbers (i, b, w), by places that u draws, m."""
    i, b, w = numbers
    sigma, table, origin, direction = edge.medium.sigma_t[w], edge.tables[w], sights.origin, sights.direction
    s, collides = _along(u[_ON_BEAM], sigma, beams.length[b])
    t, lasting = _along(u[_ON_LINE], sigma, sights.far[i])
    ray = beams.direction[b, 0], beams.direction[b, 1], beams.direction[b, 2]
    view = -direction[i, 0], -direction[i, 1], -direction[i, 2]
    x, y, z = (beams.origin[b, 0] + s * ray[0], beams.origin[b, 1] + s * ray[1], beams.origin[b, 2] + s * ray[2])
    away = origin[i, 0] - t * view[0] - x, origin[i, 1] - t * view[1] - y, origin[i, 2] - t * view[2] - z
    value = point_source(table, *_placed(sigma, away, ray, view))
    if edge.beyond[w] < np.inf:
        for k in range(3):
            scratch.ray[k] = ray[k]
        scratch.point[0, 0], scratch.point[0, 1], scratch.point[0, 2] = x, y, z
        _mirror(edge.beyond[w], 1.0, sights, i, t, scratch)
        away = scratch.away[0, 0], scratch.away[0, 1], scratch.away[0, 2]
        value -= point_source(table, *_placed(sigma, away, (scratch.ray[0], scratch.ray[1], scratch.ray[2]), view))
    return value * collides * lasting * sigma**3


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _placed(sigma, away, ray, view):
    """Where a place away (m) is from light along a ray, and a direction: rho, z, and components along rho, across and along z."""
    along = away[0] * ray[0] + away[1] * ray[1] + away[2] * ray[2]
    px, py, pz = away[0] - along * ray[0], away[1] - along * ray[1], away[2] - along * ray[2]
    rho = math.sqrt(px * px + py * py + pz * pz)
    forward = view[0] * ray[0] + view[1] * ray[1] + view[2] * ray[2]
    side = math.sqrt(max(1.0 - forward * forward, 0.0))
    radial = (view[0] * px + view[1] * py + view[2] * pz) / rho if rho > 0.0 else side
    return sigma * rho, sigma * along, radial, math.sqrt(max(side * side - radial * radial, 0.0)), forward


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _joined(edge, sights, beams, i, b, u, scratch):
    """A place on beam b and one on line of sight i, `_Joined`, which u draws: on the beam in proportion to the inverse distance
    from the line, on the line evenly in the angle that it subtends there.

    So the inverse square of the distance between them goes, which the tables do not have.
    """
    ray, away, origin, direction = scratch.ray, scratch.away, sights.origin, sights.direction
    cosine, ahead, across = 0.0, 0.0, 0.0
    for k in range(3):
        ray[k] = origin[i, k] - beams.origin[b, k]
        cosine += beams.direction[b, k] * direction[i, k]
        ahead += ray[k] * beams.direction[b, k]
        across += ray[k] * direction[i, k]
    sine = max(math.sqrt(max(1.0 - cosine * cosine, 0.0)), _PARALLEL)
    nearest, square = (ahead - cosine * across) / (sine * sine), 0.0
    for k in range(3):
        square += (ray[k] - nearest * beams.direction[b, k] + (nearest * cosine - across) * direction[i, k]) ** 2
    longest = DEEP / np.min(edge.medium.sigma_t)
    close, end = max(math.sqrt(square) / sine, _CLOSEST * longest), min(beams.length[b], longest)
    low, high = math.asinh(-nearest / close), math.asinh((end - nearest) / close)
    stretched = low + u[_CLOSE] * (high - low)
    s = min(max(nearest + close * math.sinh(stretched), 0.0), end)
    stretch = (high - low) * close * math.cosh(stretched)
    along, square = 0.0, 0.0
    for k in range(3):
        scratch.point[0, k] = beams.origin[b, k] + s * beams.direction[b, k]
        along += (scratch.point[0, k] - origin[i, k]) * direction[i, k]
    for k in range(3):
        square += (origin[i, k] + along * direction[i, k] - scratch.point[0, k]) ** 2
    h = math.sqrt(square)
    if not h > 0.0:
        return _Joined(0.0, 0.0, 0.0, 0.0)
    low, high = math.atan2(-along, h), math.atan2(sights.far[i] - along, h)
    angle, before, after = low + u[_SEEN] * (high - low), 0.0, 0.0
    t, distance = along + h * math.tan(angle), h / math.cos(angle)
    for k in range(3):
        away[0, k] = (origin[i, k] + t * direction[i, k] - scratch.point[0, k]) / distance
        before += away[0, k] * beams.direction[b, k]
        after -= away[0, k] * direction[i, k]
    if beams.real[b] and first(edge.geometry, scratch.point, away, 0, np.int64(-1), scratch.mesh)[1] < distance * (1 - 1e-6):
        return _Joined(0.0, 0.0, 0.0, 0.0)
    return _Joined(s + distance + t, max(1 - before, 0.0), max(1 - after, 0.0), stretch * (high - low) / h)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _bring(light, share, image, pixel):
    for kind in range(len(image)):
        for c in range(3):
            image[kind, pixel, c] += share * light[kind, c]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _of_drawn(plan, luminance, density):
    """What a state counts for that is drawn by the guide."""
    if not plan.typical > 0.0:
        return 1.0 / (plan.drawn * density) if luminance == 0.0 else 0.0
    return 1.0 / (plan.drawn * density + plan.moved * luminance / plan.typical)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _of_moved(plan, luminance, density):
    """What a state counts for that a chain is at."""
    if not luminance > 0.0:
        return 0.0
    if not plan.typical > 0.0:
        return plan.of_state / luminance
    return plan.of_state * plan.moved / (plan.typical * plan.drawn * density + plan.moved * luminance)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _density(guide, u):
    """How likely the guide draws a state, over how likely it is when drawn alike."""
    return guide.density[_number(u[_LINE], len(guide.density)), _number(u[_BEAM], guide.density.shape[1])]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _part(odds, u):
    """Number of the part that a uniform number draws by odds of all before, and the place in it, both over their count."""
    m = min(np.searchsorted(odds, u, side="right") - 1, len(odds) - 2)
    return min((m + (u - odds[m]) / (odds[m + 1] - odds[m])) / (len(odds) - 1), _BELOW_ONE), m


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _guided(guide, u):
    """Makes line and beam of a state what uniform numbers draw by the guide."""
    u[_LINE], m = _part(guide.lines, u[_LINE])
    u[_BEAM], _ = _part(guide.beams[m], u[_BEAM])


@njit(cache=True, nogil=True, error_model="numpy")
def candidates(edge, sights, beams, plan, states, luminance, images, begin, end):
    """Luminance (n,) of states, over their density, and adds what they bring to images, as `move`.

    states : (n, NUMBERS) uniform numbers, which become states that the guide draws
    """
    edge, sights, beams, plan = lent(edge), lent(sights), lent(beams), lent(plan)
    guide = plan.guide
    scratch, light, n = _scratch(len(edge.beyond)), np.zeros((3, 3)), len(states)
    for g in range(begin, end):
        for c in range(g * n // len(images), (g + 1) * n // len(images)):
            u = states[c]
            _guided(guide, u)
            value, density = _brought(edge, sights, beams, plan.scale, u, light, scratch), _density(guide, u)
            luminance[c] = value / density
            _bring(light, _of_drawn(plan, value, density), images[g], sights.pixel[_number(u[_LINE], len(sights.far))])


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _proposed(guide, plan, state, streams, c, large, u):
    """Makes u (NUMBERS,) where chain c may go from a state."""
    if large:
        for k in range(NUMBERS):
            u[k] = uniform(streams, c)
        _guided(guide, u)
        return
    # the side of the line, that of the beam, or both
    side = uniform(streams, c) * 3
    for k in range(NUMBERS):
        u[k] = state[k]
        of_beam = k in (_BEAM, _ON_BEAM)
        if (side < 1 and of_beam) or (side >= 2 and not of_beam):
            continue
        size = 2 * uniform(streams, c) - 1
        step = plan.small[k, 1] * math.exp(abs(size) * plan.small[k, 0])
        u[k] += step if size > 0.0 else -step
        u[k] -= math.floor(u[k])
        if not u[k] < 1.0:
            u[k] = 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def move(edge, sights, beams, plan, chains, images, begin, end):
    """Moves chains of blocks begin to end and adds what they bring to images (B, kinds, pixels, 3) of these."""
    edge, sights, beams, plan = lent(edge), lent(sights), lent(beams), lent(plan)
    chains, guide = lent(chains), plan.guide
    scratch, n, lines = _scratch(len(edge.beyond)), len(chains.states), len(sights.far)
    u, current, proposed = np.empty(NUMBERS), np.zeros((3, 3)), np.zeros((3, 3))
    for g in range(begin, end):
        for c in range(g * n // len(images), (g + 1) * n // len(images)):
            state, image = chains.states[c], images[g]
            luminance, held = _brought(edge, sights, beams, plan.scale, state, current, scratch), 0.0
            density = _density(guide, state)
            for step in range(1, plan.steps + 1):
                large = step % plan.large == 0
                _proposed(guide, plan, state, chains.streams, c, large, u)
                new_luminance, new_density = _brought(edge, sights, beams, plan.scale, u, proposed, scratch), _density(guide, u)
                pixel = sights.pixel[_number(u[_LINE], lines)]
                ahead = new_luminance * density / new_density if large else new_luminance
                share = min(ahead / luminance, 1.0)
                chains.taken[g, 1 if large else 0] += share
                if large:
                    _bring(proposed, _of_drawn(plan, new_luminance, new_density), image, pixel)
                held += 1.0 - share
                if uniform(chains.streams, c) < share:
                    here = sights.pixel[_number(state[_LINE], lines)]
                    _bring(current, held * _of_moved(plan, luminance, density), image, here)
                    state[:], current[:], luminance, density, held = u, proposed, new_luminance, new_density, share
                elif share > 0.0:
                    _bring(proposed, share * _of_moved(plan, new_luminance, new_density), image, pixel)
            _bring(current, held * _of_moved(plan, luminance, density), image, sights.pixel[_number(state[_LINE], lines)])
