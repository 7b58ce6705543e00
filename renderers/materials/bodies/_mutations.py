"""Loops over states among lines of sight and beams of light in a body, joined by the tables of multiple scattering."""

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

# of a state: line of sight, beam, place on the beam, place on the line, both by the tables; both for second events
NUMBERS = 6
PLACES = 2  # on the beam and on the line each, that a candidate has: what all pairs of them bring is guessed
LATER, SECOND, OTHER = range(3)  # what a state brings: as `_gather`
_PARALLEL, _CLOSEST = 1e-4, 1e-9  # sine, and share of the farthest that is looked at, below which lines are no nearer
_BELOW_ONE = 1 - 2.0**-53  # the largest place of a state
BINS = 24, 8, 8, 4  # of `Guess`
FINEST = 0.3  # mfp, below which distances are told apart evenly, beyond by their logarithm
IN_BIN = 8  # places of a bin whose mean it is
_LINE, _BEAM, _ON_BEAM, _ON_LINE, _CLOSE, _SEEN = range(NUMBERS)
_AHEAD, _COLLIDES, _TAKES, _WEIGHTS = 3, 6, 7, 8  # columns of `ends_of`
_BEFORE = 0.75  # of the places on a beam that comes towards the camera, before it passes where the line begins
_FARTHEST = 6.0  # longest mfp between the beginnings of beam and line, beyond which no second event is guessed


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
    to_rgb : (3, L) linear sRGB of radiances
    """

    geometry: Geometry
    medium: Scatterer
    tables: tuple
    beyond: np.ndarray
    second: bool
    to_rgb: np.ndarray


class Guide(NamedTuple):
    """How candidates are drawn: of lines and of beams, each in so many parts of equal length, a part by its odds.

    lines : (I + 1,) odds of all parts before, up to 1;  beams : (I, B + 1) the same of beams, of each part of lines
    density : (I, B) odds of both over those of states that are drawn alike
    """

    lines: np.ndarray
    beams: np.ndarray
    density: np.ndarray


class Guess(NamedTuple):
    """Roughly what states bring: the tables of each wavelength, averaged over bins.

    share : (L,) what a wavelength weighs, luminance without signs
    scale : inverse of ln(1 + m / `FINEST`) of the farthest distance m that is told apart, longest mean free paths
    values : (R, A, A, T, L) mfp^-3 sr^-1, of bins in distance, in both turns and in the angle between the planes of these
    lines, beams : `ends_of` those of a pass
    """

    share: np.ndarray
    scale: float
    values: np.ndarray
    lines: np.ndarray
    beams: np.ndarray


class _Joined(NamedTuple):
    """A place on a beam and one on a line of sight.

    distance : m, between them;  depth : m, with both along beam and line;  before, after : 1 - cosines of both turns
    share : 1/m^2 over the density with which the places are drawn, times m^2
    """

    distance: float
    depth: float
    before: float
    after: float
    share: float


class _Scratch(NamedTuple):
    """What a loop works on, as `_gather`; guessed : (`PLACES`, `PLACES`) of a candidate."""

    point: np.ndarray
    away: np.ndarray
    ray: np.ndarray
    waves: np.ndarray
    guessed: np.ndarray
    mesh: tuple


@njit(nogil=True, error_model="numpy")
def _scratch(waves):
    return _Scratch(np.empty((1, 3)), np.empty((1, 3)), np.empty(3), np.zeros((3, waves)), np.empty((PLACES, PLACES)),
                    mesh_scratch())


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _number(u, count):
    return min(int(u * count), count - 1)


# forceinline: a call would hand over every array of the tuples
@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _brought(edge, sights, beams, scale, u, light, scratch):
    """Makes light (3, 3) what a state u (NUMBERS,) brings, times scale: `LATER`, `SECOND` and `OTHER` in linear sRGB."""
    medium, waves, kinds = edge.medium, scratch.waves, 3 if edge.second else 1
    i, b = _number(u[_LINE], len(sights.far)), _number(u[_BEAM], len(beams.length))
    of_second = OTHER if beams.before[b] > 0 or sights.order[i] > 0 else SECOND
    negative = _takes(beams, b)
    joined = _joined(edge, sights, beams, (i, b), (u[_CLOSE], u[_SEEN]), scratch) if negative or edge.second \
        else _Joined(0.0, 0.0, 0.0, 0.0, 0.0)
    seen = joined.share > 0.0 and not _hidden(edge, beams, b, joined, scratch)
    lengths = _lengths(edge, sights, beams, i, b, u)
    for w in range(len(medium.sigma_t)):
        for kind in range(kinds):
            waves[kind, w] = 0.0
        power = scale * sights.weight[i, w] * beams.power[b, w]
        if power != 0.0:
            waves[LATER, w] = medium.sigma_t[w] * power * _by_tables(edge, sights, beams, (i, b, w), lengths, scratch)
        if power != 0.0 and seen:
            waves[LATER if negative else of_second, w] += power * _twice(medium, w, joined)
    for kind in range(kinds):
        for c in range(3):
            for w in range(len(medium.sigma_t)):
                light[kind, c] += edge.to_rgb[c, w] * waves[kind, w]
            if not abs(light[kind, c]) < np.inf:
                light[kind, c] = 0.0


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _takes(beams, b):
    """Whether a beam takes light away."""
    whole = 0.0
    for w in range(beams.power.shape[1]):
        whole += beams.power[b, w]
    return whole < 0.0


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _twice(medium, w, joined):
    """Light at wavelength w that scatters at both places, over the density of these."""
    sigma = medium.sigma_t[w]
    return joined.share * (medium.albedo[w] * sigma) ** 2 * math.exp(-sigma * joined.depth) \
        * phase_value(medium.v, medium.steps, medium.phase[w], joined.before) \
        * phase_value(medium.v, medium.steps, medium.phase[w], joined.after)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _hidden(edge, beams, b, joined, scratch):
    """Whether a surface lies between both places, which were joined last."""
    return beams.real[b] and first(edge.geometry, scratch.point, scratch.away, 0, np.int64(-1), scratch.mesh)[1] \
        < joined.distance * (1 - 1e-6)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _lengths(edge, sights, beams, i, b, u):
    """A place on beam b and one on line of sight i that u draws, as far along as the longest mean free path has collisions: m
    along both, and what that leaves out of the density, m^2.

    All wavelengths have the same places, so that what is guessed of them is nearly the same, too.
    """
    sigma = np.min(edge.medium.sigma_t)
    s, collides = _along(u[_ON_BEAM], sigma, beams.length[b])
    t, lasting = _along(u[_ON_LINE], sigma, sights.far[i])
    return s, t, collides * lasting * math.exp(sigma * (s + t))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _by_tables(edge, sights, beams, numbers, lengths, scratch):
    """Later events of light of beam b on line of sight i at wavelength w, numbers (i, b, w), at `_lengths` along both, m."""
    (i, b, w), (s, t, share) = numbers, lengths
    sigma, table, origin, direction = edge.medium.sigma_t[w], edge.tables[w], sights.origin, sights.direction
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
    return value * share * math.exp(-sigma * (s + t)) * sigma**3


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
def _joined(edge, sights, beams, numbers, places, scratch):
    """A place on beam b and one on line of sight i, numbers (i, b), `_Joined`, which two uniform numbers draw: on the beam in
    proportion to the inverse distance from the line, on the line evenly in the angle that it subtends there, or, of a beam that
    comes towards the camera, as the inverse root of the angle from the line's beginning.  Three in four places on such a beam lie
    before it passes that beginning, from where light scatters forward twice.

    So the inverse square of the distance between them goes, which the tables do not have.
    """
    (i, b), (on_beam, seen) = numbers, places
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
    low, high, odds = math.asinh(-nearest / close), math.asinh((end - nearest) / close), 1.0
    if cosine < 0.0 and 0.0 < ahead < end:
        passing, before_it = math.asinh((ahead - nearest) / close), on_beam < _BEFORE
        on_beam = on_beam / _BEFORE if before_it else (on_beam - _BEFORE) / (1 - _BEFORE)
        low, high, odds = (low, passing, _BEFORE) if before_it else (passing, high, 1 - _BEFORE)
    stretched = low + on_beam * (high - low)
    s = min(max(nearest + close * math.sinh(stretched), 0.0), end)
    stretch = (high - low) * close * math.cosh(stretched) / odds
    along, square = 0.0, 0.0
    for k in range(3):
        scratch.point[0, k] = beams.origin[b, k] + s * beams.direction[b, k]
        along += (scratch.point[0, k] - origin[i, k]) * direction[i, k]
    for k in range(3):
        square += (origin[i, k] + along * direction[i, k] - scratch.point[0, k]) ** 2
    h = math.sqrt(square)
    if not h > 0.0:
        return _Joined(0.0, 0.0, 0.0, 0.0, 0.0)
    low, high = math.atan2(-along, h), math.atan2(sights.far[i] - along, h)
    before, after = 0.0, 0.0
    if cosine < 0.0:
        # light that goes on to the camera's side scatters forward twice, which is bright where few angles are
        stretch, seen = stretch * 2 * seen, seen * seen
    angle = low + seen * (high - low)
    t, distance = along + h * math.tan(angle), h / math.cos(angle)
    for k in range(3):
        away[0, k] = (origin[i, k] + t * direction[i, k] - scratch.point[0, k]) / distance
        before += away[0, k] * beams.direction[b, k]
        after -= away[0, k] * direction[i, k]
    return _Joined(distance, s + distance + t, max(1 - before, 0.0), max(1 - after, 0.0), stretch * (high - low) / h)


@njit(cache=True, nogil=True, error_model="numpy")
def averaged(table, thicker, scale, shifts, values):
    """Makes values (R, A, A, T) means of a table over the bins of a `Guess`.

    thicker : longest mean free path over that of the table;  shifts : (n, 4) places in a bin, 0 to 1
    """
    for r, a, b, c in np.ndindex(values.shape):
        total = 0.0
        for n in range(len(shifts)):
            distance = thicker * FINEST * math.expm1((r + shifts[n, 0]) / (len(values) * scale))
            half_a, half_b = (a + shifts[n, 1]) / values.shape[1], (b + shifts[n, 2]) / values.shape[2]
            ahead, back = 1 - 2 * half_a * half_a, 1 - 2 * half_b * half_b
            aside, up = math.sqrt(1 - ahead * ahead), math.sqrt(1 - back * back)
            cosine = 1 - 2 * (c + shifts[n, 3]) / values.shape[3]
            total += point_source(table, distance * aside, distance * ahead, back * aside - up * cosine * ahead,
                                  up * math.sqrt(1 - cosine * cosine), back * ahead + up * cosine * aside)
        values[r, a, b, c] = total / len(shifts)


def ends_of(sigma, origin, direction, length, weight):
    """Lines of sight or beams (n, 8 + L) as a guess reads them, in single precision and one row each, as most are not in the
    processor's cache: origin in longest mean free paths, direction, share that collides, 1 where it takes light away, |weight|.

    sigma : 1/m, smallest extinction;  others as in `Sights` and `Beams`
    """
    collides, takes = -np.expm1(-sigma * length), weight.sum(axis=1) < 0
    return np.column_stack([sigma * origin, direction, collides, takes, np.abs(weight)]).astype(np.float32)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _guessed(edge, guess, sights, beams, u, scratch):
    """Roughly what luminance a candidate u (NUMBERS,) brings, without signs, over the density of those drawn alike: the mean of
    its places, which are `scratch.guessed`."""
    i, b, total = _number(u[_LINE], len(sights.far)), _number(u[_BEAM], len(beams.length)), 0.0
    square, along, against, forward, lines, ends = 0.0, 0.0, 0.0, 0.0, guess.lines, guess.beams
    for k in range(_AHEAD):
        apart = lines[i, k] - ends[b, k]
        square += apart * apart
        along += apart * ends[b, _AHEAD + k]
        against -= apart * lines[i, _AHEAD + k]
        forward -= ends[b, _AHEAD + k] * lines[i, _AHEAD + k]
    sigma, power, weight = np.min(edge.medium.sigma_t), scratch.waves[0], scratch.waves[1]
    # close to a line of sight second events are brighter than all later ones
    near = (edge.second or ends[b, _TAKES] > 0) and square < _FARTHEST**2
    # the same places as `_lengths` has, but for rounding
    collides, lasting = ends[b, _COLLIDES], lines[i, _COLLIDES]
    for w in range(len(power)):
        weight[w] = guess.share[w] * lines[i, _WEIGHTS + w] * ends[b, _WEIGHTS + w]
        power[w] = weight[w] * edge.medium.sigma_t[w] ** 4 / sigma**2 * collides * lasting
    for m in range(PLACES):
        s = -math.log(1 - (m + u[_ON_BEAM]) / PLACES * collides)
        for n in range(PLACES):
            t = -math.log(1 - (n + u[_ON_LINE]) / PLACES * lasting)
            z, y, value = along - t * forward - s, against - t - s * forward, 0.0
            if near:
                joined = _joined(edge, sights, beams, (i, b), ((m + u[_CLOSE]) / PLACES, (n + u[_SEEN]) / PLACES), scratch)
                for w in range(len(power) if joined.share > 0.0 else 0):
                    value += weight[w] * _twice(edge.medium, w, joined)
            inverse = 1 / math.sqrt(max(square + t * t + s * s + 2 * (s * t * forward - t * against - s * along), _CLOSEST))
            ahead, back = min(max(z * inverse, -1.0), 1.0), min(max(y * inverse, -1.0), 1.0)
            both = math.sqrt(max((1 - ahead * ahead) * (1 - back * back), _CLOSEST))
            values = guess.values[
                _number(math.log(1 + 1 / (inverse * FINEST)) * guess.scale, guess.values.shape[0]),
                _number(math.sqrt(0.5 - 0.5 * ahead), guess.values.shape[1]),
                _number(math.sqrt(0.5 - 0.5 * back), guess.values.shape[2]),
                _number(min(max(0.5 - 0.5 * (forward - ahead * back) / both, 0.0), 1.0), guess.values.shape[3])]
            for w in range(len(power)):
                # nearly exp(-x), but quicker
                less = 1 / (1 + (edge.medium.sigma_t[w] / sigma - 1) * (s + t) / 16)
                less *= less
                less *= less
                less *= less
                value += power[w] * values[w] * less * less
            scratch.guessed[m, n] = value
            total += value
    return total / PLACES**2


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
def candidates(edge, guess, sights, beams, guide, states, worth, begin, end):
    """Makes uniform numbers, states (n, NUMBERS), states that the guide draws, and worth (n,) what is guessed of them over their
    density."""
    edge, guess, sights, beams, guide = lent(edge), lent(guess), lent(sights), lent(beams), lent(guide)
    scratch = _scratch(len(edge.beyond))
    for c in range(begin, end):
        _guided(guide, states[c])
        value = _guessed(edge, guess, sights, beams, states[c], scratch) / _density(guide, states[c])
        worth[c] = value if value < np.inf else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def settle(edge, guess, sights, beams, numbers, states, odds, begin, end):
    """Makes candidates (n, NUMBERS) states at one of their places each, which uniform numbers (n,) draw by the guess, and odds
    (n,) how likely that place is, over how likely it would be if all were alike."""
    edge, guess, sights, beams = lent(edge), lent(guess), lent(sights), lent(beams)
    scratch = _scratch(len(edge.beyond))
    for c in range(begin, end):
        mean, pair = _guessed(edge, guess, sights, beams, states[c], scratch), 0
        guessed = scratch.guessed.ravel()
        ahead = numbers[c] * mean * PLACES**2 - guessed[0]
        while ahead >= 0.0 and pair < PLACES**2 - 1:
            pair += 1
            ahead -= guessed[pair]
        for on_beam, on_line in ((_ON_BEAM, _ON_LINE), (_CLOSE, _SEEN)):
            states[c, on_beam] = (pair // PLACES + states[c, on_beam]) / PLACES
            states[c, on_line] = (pair % PLACES + states[c, on_line]) / PLACES
        odds[c] = guessed[pair] / mean


@njit(cache=True, nogil=True, error_model="numpy")
def bring(edge, sights, beams, guide, states, counts, light, begin, end):
    """Makes light (n, 3, 3) what states bring, `LATER`, `SECOND` and `OTHER` in linear sRGB, over their density, times what they
    count (n,)."""
    edge, sights, beams, guide = lent(edge), lent(sights), lent(beams), lent(guide)
    scratch, scale = _scratch(len(edge.beyond)), float(len(sights.far)) * len(beams.length)
    for c in range(begin, end):
        light[c] = 0.0
        _brought(edge, sights, beams, scale * counts[c] / _density(guide, states[c]), states[c], light[c], scratch)


@njit(cache=True, nogil=True, error_model="numpy")
def add(sights, states, light, image):
    """Adds light (n, 3, 3) of states to the pixels of an image (3, pixels, 3), one after the other."""
    for c in range(len(states)):
        pixel = sights.pixel[_number(states[c, _LINE], len(sights.far))]
        for kind in range(3):
            for k in range(3):
                image[kind, pixel, k] += light[c, kind, k]
