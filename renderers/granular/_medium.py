"""Loops of paths in the medium that stands for grains, inside of their mesh: from one need of the scene to the next."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import (
    Aggregate,
    aggregate_scratch,
    clear_in_mesh,
    deep_in_mesh,
    diffuse_share,
    lent,
    mesh_boundary,
)
from bakery.system.compiled import njit
from renderers.granular._grains import NOWHERE
from renderers.granular._paths import DEAD, DIFFUSION, LEAVES, LIGHT, PASSES, TRACE, TURNS, chance_at, crosses
from renderers.granular._varied import collision, grain_at, thinned
from renderers.scattering import flight, flown, mean_phase, scattered
from renderers.wavefront import ORDERS, roulette, to_rgb, uniform

DIFFUSE = -1  # in place of the component that scatters: a point whose fluence counts, the same in all directions
_UNIFORM = 1 / (4 * math.pi)  # 1/sr


class Medium(NamedTuple):
    """A medium of C components in a mesh, homogeneous or not.  Lengths are in `unit`, m.

    aggregate : of the mesh
    sigma_t : (L,) 1/unit, the most where it varies;  albedo : (C L,), by components
    v, steps (A,), (A - 1,), phase, cdf (C L, A) : as `bakery.kernels.phase_layout` has them
    chance : (X, Y, Z) float32, with which a scattering in each voxel samples a light
    often : with which a point samples one where light diffuses
    turned : (C L,) share of the light that meets a grain which the medium scatters or absorbs; the rest, in the forward peak that
        it is without, goes on as it came.  Empty: all of it
    """

    aggregate: Aggregate
    unit: float
    sigma_t: np.ndarray
    albedo: np.ndarray
    v: np.ndarray
    steps: np.ndarray
    phase: np.ndarray
    cdf: np.ndarray
    chance: np.ndarray
    often: float = 1.0
    turned: np.ndarray = np.zeros(0)


@njit(cache=True, nogil=True, error_model="numpy")
def _any_direction(d, states, i):
    """Makes d (3,) any direction."""
    z, turn = 2.0 * uniform(states, i) - 1.0, 2 * math.pi * uniform(states, i)
    sine = math.sqrt(max(1.0 - z * z, 0.0))
    d[0], d[1], d[2] = sine * math.cos(turn), sine * math.sin(turn), z


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _turned(medium, kind, d, weight, states, i, values):
    """Turns d (3,) where a path stands at a `kind` of point, and changes the weights; the density (1/sr) of d."""
    if kind == DIFFUSE:
        _any_direction(d, states, i)
        return _UNIFORM
    d[0], d[1], d[2], density = scattered(medium, kind * len(values), d[0], d[1], d[2], weight, states, i, values)
    return density


@njit(cache=True, nogil=True, error_model="numpy")
def _diffused(medium, diffuse, p, d, q, weight, states, i, bounces, alive, room):
    """Whether light diffuses at a scattering at p (3,) of a path along d (3,): then both change, to a point near the mesh.

    There fluence over 4 pi counts, the albedo of the scattering included.  alive : becomes whether the path goes on
    """
    enough = max(diffuse.near, abs(diffuse.ahead))
    if enough == np.inf or clear_in_mesh(medium.aggregate, diffuse, p, enough, room) < enough:
        return False
    for k in range(3):
        q[k] = p[k] + diffuse.ahead * d[k]
    radius = clear_in_mesh(medium.aggregate, diffuse, q, diffuse.near, room)
    if radius < diffuse.near:
        return False
    for w in range(weight.shape[1]):
        weight[i, w] *= medium.albedo[w]
    while True:
        radius -= diffuse.skin
        _any_direction(d, states, i)
        for k in range(3):
            q[k] += radius * d[k]
        for w in range(weight.shape[1]):
            weight[i, w] *= diffuse_share(diffuse.sigma_tr[w] * radius)
        bounces[i] += 1
        roulette(weight, states, bounces, alive, i, i + 1)
        radius = clear_in_mesh(medium.aggregate, diffuse, q, diffuse.near, room)
        if not alive[i] or radius < diffuse.near:
            for k in range(3):
                p[k] = q[k]
            return True


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _chance(medium, kind, p):
    """Of a light sample at p (3,), a `kind` of point."""
    return medium.often if kind == DIFFUSE else chance_at(medium.aggregate, medium.chance, p)


@njit(cache=True, nogil=True, error_model="numpy")
def advance(medium, varied, diffuse, occupied, origin, direction, weight, states, met, place, far, density, order, bounces,
            single, technique, kind, status, alive, begin, end):
    """Takes paths begin to end on until they need something of the scene; parameters as those of `_paths.advance`.

    varied : `bakery.kernels.Varied`, how much there is of the components, where that varies
    diffuse : `bakery.kernels.Diffuse` of the medium
    met : (n, 4), of which only UNKNOWN counts;  place : (n,) triangle of the mesh that each starts on, or -1
    density : (n,) 1/sr, with which the direction was drawn over the chance of a light sample there
    technique : (n,) becomes DIFFUSION where light diffuses
    kind : (n,) becomes the component that scatters, or DIFFUSE, where a path needs LIGHT; `scatter` takes it on from there
    """
    medium, varied, diffuse = lent(medium), lent(varied), lent(diffuse)
    room, p, q, d = aggregate_scratch(), np.empty(3), np.empty(3), np.empty(3)
    values, before, sigma = np.empty(weight.shape[1]), np.empty(weight.shape[1]), np.empty(varied.hits.shape)
    unit = medium.unit
    for i in range(begin, end):
        for k in range(3):
            p[k], d[k] = origin[i, k] / unit, direction[i, k]
        status[i] = -1
        while status[i] < 0:
            # the way of one direction; where it has to be asked for surfaces of the scene first, it is drawn again, the same
            stream, known = states[i], not math.isnan(far[i])
            limit = far[i] / unit if known else np.inf
            for w in range(len(before)):
                before[w] = weight[i, w]
            t, component = _way(medium, varied, occupied, p, d, q, weight, states, i, place[i], limit, known, sigma, room)
            if t < 0.0:
                states[i], status[i] = stream, TRACE
                for w in range(len(before)):
                    weight[i, w] = before[w]
            elif component < 0:
                status[i] = LEAVES
            else:
                for k in range(3):
                    p[k] += t * d[k]
                order[i] += 1
                bounces[i] += 1
                met[i, 0], place[i], far[i], single[i], kind[i] = NOWHERE, -1, np.nan, False, component
                # what was scattered once or twice is left to itself, for its layers
                if order[i] >= ORDERS - 1 and _diffused(medium, diffuse, p, d, q, weight, states, i, bounces, alive, room):
                    kind[i], technique[i] = DIFFUSE, DIFFUSION
                    if not alive[i]:
                        status[i] = DEAD
                        break
                chance = _chance(medium, kind[i], p)
                if uniform(states, i) < chance:
                    status[i] = LIGHT
                else:
                    density[i] = _turned(medium, kind[i], d, weight, states, i, values) / chance
                    roulette(weight, states, bounces, alive, i, i + 1)
                    if not alive[i]:
                        status[i] = DEAD
        for k in range(3):
            origin[i, k], direction[i, k] = p[k] * unit, d[k]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _way(medium, varied, occupied, p, d, q, weight, states, i, place, limit, known, sigma, room):
    """Distance along d to the next scattering before `limit`, and its component, -1 where there is none; below 0: surfaces may
    come first.  sigma : (C, L) for own use"""
    gone, most = 0.0, varied.most
    while True:
        for k in range(3):
            q[k] = p[k] + gone * d[k]
        s = -math.log1p(-uniform(states, i)) / most if most > 0.0 else flight(medium, weight, states, i)
        end, at, inside = np.inf, -1, True
        if not deep_in_mesh(medium.aggregate, q, d, min(s, limit - gone)):
            end, at, inside = mesh_boundary(medium.aggregate, q, d, place, room)
        if not inside and (end == np.inf or gone + end >= limit):
            return gone, -1
        if not known and crosses(medium.aggregate, occupied, q, d, min(s, end) if inside else end):
            return -1.0, -1
        if inside and s < min(end, limit - gone):
            if most == 0.0:
                flown(medium, weight, i, s, True)
                return gone + s, 0
            gone, place = gone + s, -1
            component = collision(varied, p[0] + gone * d[0], p[1] + gone * d[1], p[2] + gone * d[2], weight, states, i, sigma)
            if component >= 0:
                return gone, component
            continue
        if inside:
            if most == 0.0:
                flown(medium, weight, i, min(end, limit - gone), False)
            if limit - gone <= end:
                return limit, -1
        gone, place = gone + end, at


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _passed(medium, varied, p, d, far, q, passed, states, i, sigma, room):
    """Share (L,) of light that gets from p along d to `far`; where the medium varies, an estimate.  sigma : (C, L) for own use"""
    gone, inside_for, place = 0.0, 0.0, -1
    for w in range(len(passed)):
        passed[w] = 1.0
    while gone < far:
        for k in range(3):
            q[k] = p[k] + gone * d[k]
        t, place, outward = mesh_boundary(medium.aggregate, q, d, place, room)
        if place < 0:
            break
        if outward and varied.most > 0.0:
            if not thinned(varied, q, d, min(t, far - gone), passed, states, i, sigma):
                return
        elif outward:
            inside_for += min(t, far - gone)
        gone += t
    if varied.most == 0.0:
        for w in range(len(passed)):
            passed[w] = math.exp(-medium.sigma_t[w] * inside_for)


@njit(cache=True, nogil=True, error_model="numpy")
def _towards(medium, kind, weight, i, v, values):
    """Density (1/sr) with which `_turned` draws a direction; values (L,) become what the weights take towards it."""
    if kind == DIFFUSE:
        for w in range(len(values)):
            values[w] = _UNIFORM
        return _UNIFORM
    first = kind * len(values)
    mean = mean_phase(medium, first, weight, i, v, values)
    for w in range(len(values)):
        values[w] *= medium.albedo[first + w]
    return mean


@njit(cache=True, nogil=True, error_model="numpy")
def light(medium, varied, colours, origin, direction, weight, states, kind, lit, distance, radiance, density, single, added,
          begin, end):
    """What sampled lights send by way of scatterings: added (n, 3) linear sRGB; parameters as those of `_paths.light`.

    kind : (n,) as `advance` found it
    """
    medium, varied = lent(medium), lent(varied)
    room, p, d, q = aggregate_scratch(), np.empty(3), np.empty(3), np.empty(3)
    values, passed, sigma = np.empty(weight.shape[1]), np.empty(weight.shape[1]), np.empty(varied.hits.shape)
    for i in range(begin, end):
        added[i] = 0.0
        if not (radiance[i, 0] > 0 or radiance[i, 1] > 0 or radiance[i, 2] > 0):
            continue
        square = 0.0
        for k in range(3):
            p[k], d[k] = origin[i, k] / medium.unit, lit[i, k]
            square += (d[k] - direction[i, k]) ** 2
        chance = _chance(medium, kind[i], p)
        ahead = _towards(medium, kind[i], weight, i, min(0.5 * square, 2.0), values)
        balance = 1.0 if single[i] else density[i] / (density[i] + ahead / chance)
        _passed(medium, varied, p, d, distance[i] / medium.unit, q, passed, states, i, sigma, room)
        for w in range(len(values)):
            values[w] *= weight[i, w] * passed[w] * balance / chance
        to_rgb(colours, values, radiance[i], added[i])


@njit(cache=True, nogil=True, error_model="numpy")
def scatter(medium, origin, direction, weight, states, bounces, kind, density, alive, begin, end):
    """New directions of paths where `advance` found a `kind` (n,), their densities, and whether they go on."""
    medium = lent(medium)
    p, d, values = np.empty(3), np.empty(3), np.empty(weight.shape[1])
    for i in range(begin, end):
        for k in range(3):
            p[k], d[k] = origin[i, k] / medium.unit, direction[i, k]
        density[i] = _turned(medium, kind[i], d, weight, states, i, values) / _chance(medium, kind[i], p)
        for k in range(3):
            direction[i, k] = d[k]
        roulette(weight, states, bounces, alive, i, i + 1)


@njit(cache=True, nogil=True, error_model="numpy")
def open_share(medium, varied, states, point, lit, distance, share, begin, end):
    """Share (n, L) of light that gets from points (n, 3) m along lit (n, 3) to `distance` (n,) m.

    states : (n,) random streams, of which the share is an estimate where the medium varies
    """
    medium, varied = lent(medium), lent(varied)
    room, p, d, q = aggregate_scratch(), np.empty(3), np.empty(3), np.empty(3)
    sigma = np.empty(varied.hits.shape)
    for i in range(begin, end):
        for k in range(3):
            p[k], d[k] = point[i, k] / medium.unit, lit[i, k]
        _passed(medium, varied, p, d, distance[i] / medium.unit, q, share[i], states, i, sigma, room)


@njit(cache=True, nogil=True, error_model="numpy")
def _passes(medium, kind, weight, states, i):
    """Whether light that has met a grain goes on as it came; weights change by their own share over the mean of all."""
    first, total, turned = kind * weight.shape[1], 0.0, 0.0
    for w in range(weight.shape[1]):
        total += weight[i, w]
        turned += weight[i, w] * medium.turned[first + w]
    if not total > 0.0:
        return False
    passes = uniform(states, i) * total >= turned
    for w in range(weight.shape[1]):
        if passes:
            weight[i, w] *= (1.0 - medium.turned[first + w]) * total / (total - turned)
        else:
            weight[i, w] *= medium.turned[first + w] * total / turned
    return passes


@njit(cache=True, nogil=True, error_model="numpy")
def arrive(medium, met_by, origin, weight, states, met, place, far, order, bounces, single, kind, status, begin, end):
    """Makes scatterings of the grains that paths have met at their origins.

    met_by : `bakery.kernels.Varied` of all light that grains meet, with what the medium lets pass
    kind : (n,) becomes the component;  status : (n,) becomes LIGHT, TURNS, or PASSES where the light is in the forward peak
    """
    medium, met_by = lent(medium), lent(met_by)
    p, sigma = np.empty(3), np.empty(met_by.hits.shape)
    for i in range(begin, end):
        for k in range(3):
            p[k] = origin[i, k] / medium.unit
        bounces[i] += 1
        met[i, 0], place[i], far[i] = NOWHERE, -1, np.nan
        kind[i] = grain_at(met_by, p, states, i, sigma) if len(sigma) > 1 else 0
        if medium.turned.size > 0 and _passes(medium, kind[i], weight, states, i):
            status[i], single[i] = PASSES, True  # light samples end at grains
        else:
            order[i] += 1
            single[i] = False
            status[i] = LIGHT if uniform(states, i) < chance_at(medium.aggregate, medium.chance, p) else TURNS


@njit(cache=True, nogil=True, error_model="numpy")
def entry(medium, origin, direction, far, inside, t, begin, end):
    """Distances t (n,) m along directions to where rays come into the mesh, before far (n,) m, inf where they do not.

    inside : whether those that start inside of the mesh are in it already
    """
    medium = lent(medium)
    room, p, d = aggregate_scratch(), np.empty(3), np.empty(3)
    for i in range(begin, end):
        gone, place, first = 0.0, -1, True
        t[i] = np.inf
        while gone < far[i] / medium.unit:
            for k in range(3):
                d[k] = direction[i, k]
                p[k] = origin[i, k] / medium.unit + gone * d[k]
            way, place, outward = mesh_boundary(medium.aggregate, p, d, place, room)
            if place < 0:
                break
            if outward and first and inside:
                t[i] = 0.0
                break
            first = False
            gone += way
            if not outward:
                if gone * medium.unit < far[i]:
                    t[i] = gone * medium.unit
                break
