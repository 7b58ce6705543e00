"""What beams of light send to lines of sight inside a body: second events by connecting them, later ones from the tables.

Beams and lines of sight are joined in points drawn on both, in proportion to what light gets there.  Of many beams a few are
drawn for a line of sight (`_choice`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import (
    add_look_up,
    add_segment_look_up,
    lent,
    mesh_scratch,
    no_look_ups,
    phase_value,
    sum_of_look_ups,
    triangle_normal,
)
from bakery.system.compiled import njit
from renderers.materials.bodies._choice import drawn, guess
from renderers.materials.bodies._geometry import first
from renderers.transport.wavefront import uniform

LATER, SECOND, OTHER = range(3)  # what `gather` finds
_BINS, _EVEN = 8, 0.2  # parts of an angle that are drawn by what light they bring, and the share that is drawn evenly
_NEAR = 4.0  # mfp, from the middle of a beam, within which all of it is looked up, not a point that is drawn on it
_DARK = 1e-290
DRAWS = 6  # random numbers for each beam


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


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _along(u, sigma, length):
    """A length (m) drawn in proportion to exp(-sigma t) up to a length, and the integral of that, m."""
    share = -math.expm1(-sigma * length)
    return min(-math.log1p(-u * share) / sigma, length), share / sigma


@njit(cache=True, nogil=True, error_model="numpy")
def gather(geometry, medium, table, segments, w, cosine, beams, clusters, picks, later, second, beyond, around, origin,
           direction, far, states, brought, begin, end):
    """Radiance at the origins of lines of sight against their directions from light of beams, groups begin to end.

    Parameters
    ----------
    medium : `Scatterer`;  table, segments : ready tables of points and of segments of wavelength w
    cosine : mean, of the phase function
    beams : `Beams`, neighbours one after another;  clusters : `Clusters` of them
    picks : (n,) beams drawn for each line of sight
    later : whether third and later events count, by the table, and second ones on beams of negative power
    second : whether second ones on others do
    beyond : m, how far outside a mirror lies whose light is taken away from later events; inf: there is none
    around : (G + 1,) where groups of lines of sight begin, for which beams are chosen together
    origin, direction, far : (n, 3) m, unit, (n,) m
    states : (n,) uint64, of random numbers, which stay as they are: all wavelengths draw with the same
    brought : (3, n, L) column w becomes the radiance of third and later events, of second ones, and of second ones on beams that
        began with light scattered before; W/m^2 sr
    """
    geometry, medium, table, segments, beams = lent(geometry), lent(medium), lent(table), lent(segments), lent(beams)
    clusters = lent(clusters)
    looked_up, tiles = no_look_ups(), no_look_ups()
    n = len(beams.length)
    items, total, scratch, local = np.empty(n + 1, np.int64), np.empty(n), mesh_scratch(), np.empty(1, np.uint64)
    p, d, ray = np.empty((1, 3)), np.empty((1, 3)), np.empty(3)
    normal, here, view, share_of = np.empty(3), np.empty(3), np.empty(3), np.empty(_BINS)
    sigma, albedo = medium.sigma_t[w], medium.albedo[w]
    for g in range(begin, end):
        for k in range(3):
            here[k] = view[k] = 0.0
        for i in range(around[g], around[g + 1]):
            t, share = min(1.0 / sigma, 0.5 * far[i]), 1.0 / (around[g + 1] - around[g])
            for k in range(3):
                here[k] += share * (origin[i, k] + t * direction[i, k])
                view[k] += share * direction[i, k]
        count = guess(clusters, sigma, table.k0, cosine, here, view, items, total)
        for i in range(around[g], around[g + 1]):
            for kind in range(3):
                brought[kind, i, w] = 0.0
            if beyond < np.inf:
                _facing(geometry, origin, direction, i, p, d, normal, scratch)
            local[0] = states[i]
            for pick in range(picks[i]):
                beam, chance = drawn(clusters, items, total, count, (pick + uniform(local, 0)) / picks[i])
                if not chance > 0.0:
                    break
                s, weight = _along(uniform(local, 0), sigma, beams.length[beam])
                power = beams.power[beam, w] / (chance * picks[i])
                weight *= power * sigma
                u, v = uniform(local, 0), uniform(local, 0)
                for k in range(3):
                    p[0, k] = beams.origin[beam, k] + s * beams.direction[beam, k]
                if later:
                    t, lasting = _along(u, sigma, far[i])
                    lasting *= sigma**3
                    square = 0.0
                    for k in range(3):
                        d[0, k] = sigma * (origin[i, k] + t * direction[i, k] - p[0, k])
                        ray[k] = beams.direction[beam, k]
                        square += (origin[i, k] + t * direction[i, k] - clusters.middle[k, beam]) ** 2
                    if sigma * sigma * square < _NEAR * _NEAR:
                        for k in range(3):
                            d[0, k] += sigma * s * ray[k]
                        rho, along, x, y, forward = _placed(d, ray, direction, i)
                        add_segment_look_up(looked_up, tiles, table, segments, sigma * beams.length[beam], rho, along, x, y,
                                            forward, power * lasting)
                        for k in range(3):
                            d[0, k] -= sigma * s * ray[k]
                    else:
                        rho, along, x, y, forward = _placed(d, ray, direction, i)
                        add_look_up(looked_up, table, rho, along, x, y, forward, weight * lasting)
                    if beyond < np.inf:
                        _mirror(beyond, sigma, normal, origin, i, p, d, ray, t, direction)
                        rho, along, x, y, forward = _placed(d, ray, direction, i)
                        add_look_up(looked_up, table, rho, along, x, y, forward, -weight * lasting)
                negative = beams.power[beam, w] < 0.0
                if second or negative and later:
                    kind = LATER if negative else OTHER if beams.before[beam] > 0 else SECOND
                    brought[kind, i, w] += weight * albedo * albedo * sigma * _second(
                        geometry, medium, beams, beam, w, v, uniform(local, 0), share_of, p, d, origin, direction, far, i,
                        scratch)
            if later:
                brought[LATER, i, w] += sum_of_look_ups(looked_up, table) + sum_of_look_ups(tiles, segments)


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


@njit(cache=True, nogil=True, error_model="numpy")
def _facing(geometry, origin, direction, i, p, d, normal, scratch):
    """Makes normal (3,) that of the boundary where line of sight i starts, outward."""
    for k in range(3):
        p[0, k], d[0, k] = origin[i, k] + 1e-4 * geometry.scale * direction[i, k], -direction[i, k]
    triangle, _ = first(geometry, p, d, 0, np.int64(-1), scratch)
    normal[0], normal[1], normal[2] = triangle_normal(geometry.blocks, triangle) if triangle >= 0 else (d[0, 0], d[0, 1], d[0, 2])


@njit(cache=True, nogil=True, error_model="numpy")
def _mirror(beyond, sigma, normal, origin, i, p, away, ray, t, direction):
    """Changes away (1, 3) and ray (3,) to those of the collision at p (1, 3) mirrored in the plane a length `beyond` (m) outside
    of where line of sight i starts."""
    height, rise = -beyond, 0.0
    for k in range(3):
        height += (p[0, k] - origin[i, k]) * normal[k]
        rise += ray[k] * normal[k]
    for k in range(3):
        ray[k] -= 2 * rise * normal[k]
        away[0, k] = sigma * (origin[i, k] + t * direction[i, k] - p[0, k] + 2 * height * normal[k])


@njit(cache=True, nogil=True, error_model="numpy")
def _second(geometry, medium, beams, beam, w, u, v, share, p, d, origin, direction, far, i, scratch):
    """Light of a collision at p (1, 3) that scatters a second time on line of sight i, 1/m^2 sr: phase functions, attenuation,
    and the line's element.

    The place is drawn evenly in the angle at p that the line subtends, which is as the inverse square of the distance, within one
    of `_BINS` parts of it; these by the product of phase functions and attenuation in their middles (Novak et al. 2012).

    u, v : uniform numbers;  share : (_BINS,) room
    """
    along, square = 0.0, 0.0
    for k in range(3):
        along += (p[0, k] - origin[i, k]) * direction[i, k]
    for k in range(3):
        away = origin[i, k] + along * direction[i, k] - p[0, k]
        square += away * away
    h = math.sqrt(square)
    if not h > 0.0:
        return 0.0
    low, high = math.atan2(-along, h), math.atan2(far[i] - along, h)
    step, whole = (high - low) / _BINS, 0.0
    for m in range(_BINS):
        share[m] = _product(medium, beams, beam, w, low + (m + 0.5) * step, along, h, p, d, origin, direction, i)[0]
        whole += share[m]
    # numbers smaller than these have fewer digits, or none in an eighth of them: what is 700 mean free paths away is dark
    if not whole > _DARK:
        return 0.0
    least, chosen, m = _EVEN * whole / _BINS, u * (1 + _EVEN) * whole, 0
    chosen -= share[0] + least
    while chosen >= 0.0 and m < _BINS - 1:
        m += 1
        chosen -= share[m] + least
    value, distance = _product(medium, beams, beam, w, low + (m + v) * step, along, h, p, d, origin, direction, i)
    if beams.real[beam]:
        _, wall = first(geometry, p, d, 0, np.int64(-1), scratch)
        if wall < distance * (1 - 1e-6):
            return 0.0
    return value * step / h * (1 + _EVEN) * whole / (share[m] + least)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _product(medium, beams, beam, w, turn, along, h, p, d, origin, direction, i):
    """Phase functions times attenuation of the way from p (1, 3) to line of sight i, seen from there at an angle from the nearest
    point, and its length; d (1, 3) becomes its direction."""
    t, distance = along + h * math.tan(turn), h / math.cos(turn)
    cosine, last = 0.0, 0.0
    for k in range(3):
        d[0, k] = (origin[i, k] + t * direction[i, k] - p[0, k]) / distance
        cosine += d[0, k] * beams.direction[beam, k]
        last -= d[0, k] * direction[i, k]
    value = phase_value(medium.v, medium.steps, medium.phase[w], max(1 - cosine, 0.0)) \
        * phase_value(medium.v, medium.steps, medium.phase[w], max(1 - last, 0.0))
    return value * math.exp(-medium.sigma_t[w] * (distance + t)), distance
