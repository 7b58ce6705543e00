"""What beams of light send to lines of sight inside a body: second events by connecting them, later ones from the tables.

Beams and lines of sight are joined in points drawn on both, in proportion to what light gets there.  Of many beams a few are
drawn for a line of sight (`_choice`).
"""

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import add_look_up, add_segment_look_up, lent, mesh_scratch, no_look_ups, phase_value, sum_of_look_ups
from bakery.system.compiled import njit
from renderers.materials.bodies._choice import drawn, guess
from renderers.materials.bodies._geometry import first
from renderers.transport.wavefront import uniform

LATER, SECOND, OTHER = range(3)  # what `gather` finds
_BINS, _EVEN = 8, 0.2  # parts of an angle that are drawn by what light they bring, and the share that is drawn evenly
_NEAR = 4.0  # mfp, from the middle of a beam, within which all of it is looked up, not a point that is drawn on it
_DARK = 1e-290


class Beams(NamedTuple):
    """N straight beams of light in a body.

    origin, direction : (N, 3) m, unit;  length : (N,) m, inf of beams that end nowhere
    power : (N, L) W, negative where light is taken away
    before : (N,) scattering events before;  begun : (N,) bool, the last of them begins the beam, not a surface
    real : (N,) bool, the way from a beam to the eye must not cross surfaces; others are in an infinite medium
    """

    origin: np.ndarray
    direction: np.ndarray
    length: np.ndarray
    power: np.ndarray
    before: np.ndarray
    begun: np.ndarray
    real: np.ndarray


class Lines(NamedTuple):
    """n lines of sight in a body, and what they gather.

    origin, direction, far : (n, 3) m, unit, (n,) m;  facing : (n, 3) outward normals where they begin, read where light is
        mirrored
    states : (n,) uint64, of random numbers, which stay as they are: all wavelengths draw with the same
    picks : (n,) beams drawn for each;  around : (G + 1,) where groups begin, for which beams are chosen together
    brought : (3, n, L) radiance of third and later events, of second ones, and of second ones on beams that began with light
        scattered before, at the origins against the directions; W/m^2 sr
    """

    origin: np.ndarray
    direction: np.ndarray
    far: np.ndarray
    facing: np.ndarray
    states: np.ndarray
    picks: np.ndarray
    around: np.ndarray
    brought: np.ndarray


class Wave(NamedTuple):
    """What is gathered at a wavelength.

    w : its number;  cosine : mean, of the phase function;  points, segments : tables that are ready for look-ups
    later : whether third and later events count, by the tables, and second ones on beams of negative power
    second : whether second ones on others do
    beyond : m, how far outside a mirror lies whose light is taken away from later events; inf: there is none
    """

    w: int
    cosine: float
    points: tuple
    segments: tuple
    later: bool
    second: bool
    beyond: float


class _Pick(NamedTuple):
    """A place on a beam: number of the beam, m along it, power (W) over how likely it was drawn, and that times the share of the
    beam's light which collides in place of its density."""

    beam: int
    s: float
    power: float
    weight: float


class _Scratch(NamedTuple):
    """What a loop works on: point (1, 3) on a beam, a way from there (1, 3), a direction of light (3,), shares of parts of an
    angle, sums of look-ups of points and of segments, and of the tree of triangles."""

    point: np.ndarray
    away: np.ndarray
    ray: np.ndarray
    share: np.ndarray
    of_points: tuple
    of_segments: tuple
    mesh: tuple


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _along(u, sigma, length):
    """A length (m) drawn in proportion to exp(-sigma t) up to a length, and the integral of that, m."""
    share = -math.expm1(-sigma * length)
    return min(-math.log1p(-u * share) / sigma, length), share / sigma


@njit(cache=True, nogil=True, error_model="numpy")
def gather(geometry, medium, wave, beams, clusters, lines, begin, end):
    """Makes `brought` of groups begin to end of lines of sight, at one wavelength, from light of beams.

    medium : `Scatterer`;  wave : `Wave`
    beams : `Beams`, neighbours one after another;  clusters : `Clusters` of them
    """
    geometry, medium, wave, beams = lent(geometry), lent(medium), lent(wave), lent(beams)
    clusters, lines = lent(clusters), lent(lines)
    n, w, sigma = len(beams.length), wave.w, medium.sigma_t[wave.w]
    items, total, stream = np.empty(n + 1, np.int64), np.empty(n), np.empty(1, np.uint64)
    here, view = np.empty(3), np.empty(3)
    scratch = _Scratch(np.empty((1, 3)), np.empty((1, 3)), np.empty(3), np.empty(_BINS), no_look_ups(), no_look_ups(),
                       mesh_scratch())
    for g in range(begin, end):
        _middle(lines, g, sigma, here, view)
        count = guess(clusters, (sigma, wave.points.k0, wave.cosine), here, view, items, total)
        for i in range(lines.around[g], lines.around[g + 1]):
            for kind in range(3):
                lines.brought[kind, i, w] = 0.0
            stream[0] = lines.states[i]
            for number in range(lines.picks[i]):
                beam, chance = drawn(clusters, items, total, count, (number + uniform(stream, 0)) / lines.picks[i])
                if not chance > 0.0:
                    break
                s, weight = _along(uniform(stream, 0), sigma, beams.length[beam])
                power = beams.power[beam, w] / (chance * lines.picks[i])
                weight *= power * sigma
                u, part = uniform(stream, 0), uniform(stream, 0)
                for k in range(3):
                    scratch.point[0, k] = beams.origin[beam, k] + s * beams.direction[beam, k]
                if wave.later:
                    _add_later(wave, sigma, beams, clusters, lines, i, _Pick(beam, s, power, weight), u, scratch)
                negative = beams.power[beam, w] < 0.0
                if wave.second or negative and wave.later:
                    kind = LATER if negative else OTHER if beams.before[beam] > 0 else SECOND
                    lines.brought[kind, i, w] += weight * medium.albedo[w] * medium.albedo[w] * sigma * _second(
                        geometry, medium, w, beams, beam, lines, i, (part, uniform(stream, 0)), scratch)
            if wave.later:
                lines.brought[LATER, i, w] += sum_of_look_ups(scratch.of_points, wave.points) \
                    + sum_of_look_ups(scratch.of_segments, wave.segments)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _middle(lines, g, sigma, here, view):
    """Makes here and view (3,) place and direction in the middle of a group of lines of sight, a mean free path ahead."""
    for k in range(3):
        here[k] = view[k] = 0.0
    for i in range(lines.around[g], lines.around[g + 1]):
        t, share = min(1.0 / sigma, 0.5 * lines.far[i]), 1.0 / (lines.around[g + 1] - lines.around[g])
        for k in range(3):
            here[k] += share * (lines.origin[i, k] + t * lines.direction[i, k])
            view[k] += share * lines.direction[i, k]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _add_later(wave, sigma, beams, clusters, lines, i, pick, u, scratch):
    """Adds look-ups of third and later events at a place of line of sight i, which is drawn with the number u."""
    away, ray, beam = scratch.away, scratch.ray, pick.beam
    t, lasting = _along(u, sigma, lines.far[i])
    lasting *= sigma**3
    square = 0.0
    for k in range(3):
        away[0, k] = sigma * (lines.origin[i, k] + t * lines.direction[i, k] - scratch.point[0, k])
        ray[k] = beams.direction[beam, k]
        square += (lines.origin[i, k] + t * lines.direction[i, k] - clusters.middle[k, beam]) ** 2
    if sigma * sigma * square < _NEAR * _NEAR:
        for k in range(3):
            away[0, k] += sigma * pick.s * ray[k]
        rho, along, x, y, forward = _placed(away, ray, lines.direction, i)
        add_segment_look_up(scratch.of_points, scratch.of_segments, wave.points, wave.segments, sigma * beams.length[beam], rho,
                            along, x, y, forward, pick.power * lasting)
    else:
        rho, along, x, y, forward = _placed(away, ray, lines.direction, i)
        add_look_up(scratch.of_points, wave.points, rho, along, x, y, forward, pick.weight * lasting)
    if wave.beyond < np.inf:
        _mirror(wave.beyond, sigma, lines, i, t, scratch)
        rho, along, x, y, forward = _placed(away, ray, lines.direction, i)
        add_look_up(scratch.of_points, wave.points, rho, along, x, y, forward, -pick.weight * lasting)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _placed(away, ray, direction, i):
    """Where a place away (1, 3) is from light along ray (3,), and the direction against line of sight i: rho, z, and components
    along rho, across and along z."""
    x, y, z = away[0, 0], away[0, 1], away[0, 2]
    bx, by, bz = ray[0], ray[1], ray[2]
    ox, oy, oz = -direction[i, 0], -direction[i, 1], -direction[i, 2]
    along = x * bx + y * by + z * bz
    px, py, pz = x - along * bx, y - along * by, z - along * bz
    rho = math.sqrt(px * px + py * py + pz * pz)
    forward = ox * bx + oy * by + oz * bz
    if rho > 0.0:
        radial = (ox * px + oy * py + oz * pz) / rho
        across = math.sqrt(max(1.0 - forward * forward - radial * radial, 0.0))
    else:
        radial, across = math.sqrt(max(1.0 - forward * forward, 0.0)), 0.0
    return rho, along, radial, across, forward


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _mirror(beyond, sigma, lines, i, t, scratch):
    """Changes the way from a place on a beam to length t of line of sight i, and the beam's direction, to those of both mirrored
    in the plane a length `beyond` (m) outside of where the line starts."""
    height, rise, ray, normal = -beyond, 0.0, scratch.ray, lines.facing
    for k in range(3):
        height += (scratch.point[0, k] - lines.origin[i, k]) * normal[i, k]
        rise += ray[k] * normal[i, k]
    for k in range(3):
        ray[k] -= 2 * rise * normal[i, k]
        scratch.away[0, k] = sigma * (lines.origin[i, k] + t * lines.direction[i, k] - scratch.point[0, k]
                                      + 2 * height * normal[i, k])


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _second(geometry, medium, w, beams, beam, lines, i, numbers, scratch):
    """Light of a collision at the place on a beam that scatters a second time on line of sight i, 1/m^2 sr: phase functions,
    attenuation, and the line's element.

    The place is drawn evenly in the angle that the line subtends there, which is as the inverse square of the distance, within
    one of `_BINS` parts of it; these by the product of phase functions and attenuation in their middles (Novak et al. 2012).

    numbers : two uniform ones, of the part and of the place in it
    """
    u, v = numbers
    along, square, share = 0.0, 0.0, scratch.share
    for k in range(3):
        along += (scratch.point[0, k] - lines.origin[i, k]) * lines.direction[i, k]
    for k in range(3):
        away = lines.origin[i, k] + along * lines.direction[i, k] - scratch.point[0, k]
        square += away * away
    h = math.sqrt(square)
    if not h > 0.0:
        return 0.0
    low, high = math.atan2(-along, h), math.atan2(lines.far[i] - along, h)
    step, whole = (high - low) / _BINS, 0.0
    for m in range(_BINS):
        share[m] = _product(medium, w, beams, beam, lines, i, (low + (m + 0.5) * step, along, h), scratch)[0]
        whole += share[m]
    # numbers smaller than these have fewer digits, or none in an eighth of them: what is 700 mean free paths away is dark
    if not whole > _DARK:
        return 0.0
    least, chosen, m = _EVEN * whole / _BINS, u * (1 + _EVEN) * whole, 0
    chosen -= share[0] + least
    while chosen >= 0.0 and m < _BINS - 1:
        m += 1
        chosen -= share[m] + least
    value, distance = _product(medium, w, beams, beam, lines, i, (low + (m + v) * step, along, h), scratch)
    if beams.real[beam]:
        _, wall = first(geometry, scratch.point, scratch.away, 0, np.int64(-1), scratch.mesh)
        if wall < distance * (1 - 1e-6):
            return 0.0
    return value * step / h * (1 + _EVEN) * whole / (share[m] + least)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _product(medium, w, beams, beam, lines, i, seen, scratch):
    """Phase functions times attenuation of the way from the place on a beam to line of sight i, and its length; `away` becomes
    its direction.

    seen : angle from the nearest point of the line, as seen from the place; how far along the line that point is, and how far off
    """
    turn, along, h = seen
    t, distance, d = along + h * math.tan(turn), h / math.cos(turn), scratch.away
    cosine, last = 0.0, 0.0
    for k in range(3):
        d[0, k] = (lines.origin[i, k] + t * lines.direction[i, k] - scratch.point[0, k]) / distance
        cosine += d[0, k] * beams.direction[beam, k]
        last -= d[0, k] * lines.direction[i, k]
    value = phase_value(medium.v, medium.steps, medium.phase[w], max(1 - cosine, 0.0)) \
        * phase_value(medium.v, medium.steps, medium.phase[w], max(1 - last, 0.0))
    return value * math.exp(-medium.sigma_t[w] * (distance + t)), distance
