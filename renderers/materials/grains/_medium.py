"""Loops of paths in the medium that stands for grains, inside of their mesh: from one need of the scene to the next."""

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import (
    Aggregate,
    Diffuse,
    Varied,
    aggregate_scratch,
    clear_in_mesh,
    deep_in_mesh,
    diffuse_share,
    lent,
    mesh_boundary,
)
from bakery.system.compiled import njit
from renderers.materials.grains._grains import NOWHERE
from renderers.materials.grains._paths import (
    DEAD,
    DIFFUSION,
    LEAVES,
    LIGHT,
    NOTHING,
    PASSES,
    TRACE,
    TURNS,
    chance_at,
    crosses,
    keep_ray,
    ray_of,
)
from renderers.materials.grains._varied import collision, grain_at, thinned
from renderers.transport.scattering import DIFFUSE, UNIFORM, flight, flown, scattered
from renderers.transport.wavefront import ORDERS, roulette, uniform


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


class Content(NamedTuple):
    """What fills a mesh.

    varied : how much there is of the components, where that varies;  diffuse : where light diffuses
    """

    medium: Medium
    varied: Varied
    diffuse: Diffuse


@njit(cache=True, nogil=True, error_model="numpy")
def _any_direction(d, states, i):
    """Makes d (3,) any direction."""
    z, turn = 2.0 * uniform(states, i) - 1.0, 2 * math.pi * uniform(states, i)
    sine = math.sqrt(max(1.0 - z * z, 0.0))
    d[0], d[1], d[2] = sine * math.cos(turn), sine * math.sin(turn), z


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _turned(medium, kind, d, throughput, states, i, values):
    """Turns d (3,) where a path stands at a `kind` of point, and changes the throughputs; the density (1/sr) of d."""
    if kind == DIFFUSE:
        _any_direction(d, states, i)
        return UNIFORM
    d[0], d[1], d[2], density = scattered(medium, kind * len(values), d[0], d[1], d[2], throughput, states, i, values)
    return density


@njit(cache=True, nogil=True, error_model="numpy")
def _diffused(content, ray, q, walk, event, i, scratch):
    """Whether light diffuses at a scattering of path i, p (3,) along d (3,), the ray: then both change, to a point near the mesh.

    There fluence over 4 pi counts, the albedo of the scattering included.  event.alive : becomes whether the path goes on
    """
    (medium, _, diffuse), (p, d), throughput, states = content, ray, walk.throughput, walk.states
    enough = max(diffuse.near, abs(diffuse.ahead))
    if enough == np.inf or clear_in_mesh(medium.aggregate, diffuse, p, enough, scratch) < enough:
        return False
    for k in range(3):
        q[k] = p[k] + diffuse.ahead * d[k]
    radius = clear_in_mesh(medium.aggregate, diffuse, q, diffuse.near, scratch)
    if radius < diffuse.near:
        return False
    for w in range(throughput.shape[1]):
        throughput[i, w] *= medium.albedo[w]
    while True:
        radius -= diffuse.skin
        _any_direction(d, states, i)
        for k in range(3):
            q[k] += radius * d[k]
        for w in range(throughput.shape[1]):
            throughput[i, w] *= diffuse_share(diffuse.sigma_tr[w] * radius)
        walk.bounces[i] += 1
        roulette(throughput, states, walk.bounces, event.alive, i, i + 1)
        radius = clear_in_mesh(medium.aggregate, diffuse, q, diffuse.near, scratch)
        if not event.alive[i] or radius < diffuse.near:
            for k in range(3):
                p[k] = q[k]
            return True


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _chance(medium, kind, p):
    """Of a light sample at p (3,), a `kind` of point."""
    return medium.often if kind == DIFFUSE else chance_at(medium.aggregate, medium.chance, p)


@njit(cache=True, nogil=True, error_model="numpy")
def advance(content, occupied, walk, technique, event, begin, end):
    """Takes paths begin to end on until they need something of the scene; parameters as those of `_paths.advance`.

    content : `Content`;  walk : of its spheres only UNKNOWN counts; its triangles are of the mesh
    technique : (n,) becomes DIFFUSION where light diffuses
    event : its kind becomes the component that scatters, or DIFFUSE; `scatter` takes the path on from there
    """
    content, walk, event = lent(content), lent(walk), lent(event)
    medium, varied, _ = content
    memory, p, q, d = aggregate_scratch(), np.empty(3), np.empty(3), np.empty(3)
    waves, throughput, states = walk.throughput.shape[1], walk.throughput, walk.states
    values, before, sigma = np.empty(waves), np.empty(waves), np.empty(varied.hits.shape)
    unit, status = medium.unit, event.status
    for i in range(begin, end):
        ray_of(walk, unit, i, p, d)
        status[i] = NOTHING
        while status[i] == NOTHING:
            # the flight of one direction; where it has to be asked for surfaces of the scene first, it is drawn again, the same
            stream = states[i]
            for w in range(waves):
                before[w] = throughput[i, w]
            t, component = _flight(content, occupied, (p, d), walk, i, (q, sigma, memory))
            if t < 0.0:
                states[i], status[i] = stream, TRACE
                for w in range(waves):
                    throughput[i, w] = before[w]
            elif component < 0:
                status[i] = LEAVES
            else:
                for k in range(3):
                    p[k] += t * d[k]
                walk.order[i] += 1
                walk.bounces[i] += 1
                walk.sphere[i, 0], walk.triangle[i], walk.far[i], walk.single[i] = NOWHERE, -1, np.nan, False
                event.kind[i] = component
                # what was scattered once or twice is left to itself, for its layers
                if walk.order[i] >= ORDERS - 1 and _diffused(content, (p, d), q, walk, event, i, memory):
                    event.kind[i], technique[i] = DIFFUSE, DIFFUSION
                    if not event.alive[i]:
                        status[i] = DEAD
                        break
                chance = _chance(medium, event.kind[i], p)
                if uniform(states, i) < chance:
                    status[i] = LIGHT
                else:
                    walk.density[i] = _turned(medium, event.kind[i], d, throughput, states, i, values) / chance
                    roulette(throughput, states, walk.bounces, event.alive, i, i + 1)
                    if not event.alive[i]:
                        status[i] = DEAD
        keep_ray(walk, unit, i, p, d)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _flight(content, occupied, ray, walk, i, scratch):
    """Distance of path i to the next scattering before the first surface, and its component, -1 where there is none; below 0:
    surfaces may come first.  ray : p, d (3,);  scratch : (3,), (C, L), and of meshes"""
    (medium, varied, _), (p, d), (q, sigma, memory) = content, ray, scratch
    traced, throughput, states = not math.isnan(walk.far[i]), walk.throughput, walk.states
    limit = walk.far[i] / medium.unit if traced else np.inf
    distance, triangle, most = 0.0, walk.triangle[i], varied.most
    while True:
        for k in range(3):
            q[k] = p[k] + distance * d[k]
        s = -math.log1p(-uniform(states, i)) / most if most > 0.0 else flight(medium, throughput, states, i)
        end, at, inside = np.inf, -1, True
        if not deep_in_mesh(medium.aggregate, q, d, min(s, limit - distance)):
            end, at, inside = mesh_boundary(medium.aggregate, q, d, triangle, memory)
        if not inside and (end == np.inf or distance + end >= limit):
            return distance, -1
        if not traced and crosses(medium.aggregate, occupied, q, d, min(s, end) if inside else end):
            return -1.0, -1
        if inside and s < min(end, limit - distance):
            if most == 0.0:
                flown(medium, throughput, i, s, True)
                return distance + s, 0
            distance, triangle = distance + s, -1
            component = collision(varied, p[0] + distance * d[0], p[1] + distance * d[1], p[2] + distance * d[2], throughput,
                                  states, i, sigma)
            if component >= 0:
                return distance, component
            continue
        if inside:
            if most == 0.0:
                flown(medium, throughput, i, min(end, limit - distance), False)
            if limit - distance <= end:
                return limit, -1
        distance, triangle = distance + end, at


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _transmittance(content, ray, far, passed, states, i, scratch):
    """Share (L,) of light that gets along a ray to `far`; where the medium varies, an estimate.  scratch : as of `_flight`"""
    (medium, varied, _), (p, d), (q, sigma, memory) = content, ray, scratch
    distance, inside_for, triangle = 0.0, 0.0, -1
    for w in range(len(passed)):
        passed[w] = 1.0
    while distance < far:
        for k in range(3):
            q[k] = p[k] + distance * d[k]
        t, triangle, outward = mesh_boundary(medium.aggregate, q, d, triangle, memory)
        if triangle < 0:
            break
        if outward and varied.most > 0.0:
            if not thinned(varied, q, d, min(t, far - distance), passed, states, i, sigma):
                return
        elif outward:
            inside_for += min(t, far - distance)
        distance += t
    if varied.most == 0.0:
        for w in range(len(passed)):
            passed[w] = math.exp(-medium.sigma_t[w] * inside_for)


@njit(cache=True, nogil=True, error_model="numpy")
def chances(medium, event, origin, chance, begin, end):
    """Chances (n,) of light samples at events at origins (n, 3) m."""
    medium, event = lent(medium), lent(event)
    p = np.empty(3)
    for i in range(begin, end):
        for k in range(3):
            p[k] = origin[i, k] / medium.unit
        chance[i] = _chance(medium, event.kind[i], p)


@njit(cache=True, nogil=True, error_model="numpy")
def scatter(medium, walk, event, begin, end):
    """New directions of paths at events, their densities, and whether they go on."""
    medium, walk, event = lent(medium), lent(walk), lent(event)
    p, d, values = np.empty(3), np.empty(3), np.empty(walk.throughput.shape[1])
    for i in range(begin, end):
        ray_of(walk, medium.unit, i, p, d)
        density = _turned(medium, event.kind[i], d, walk.throughput, walk.states, i, values)
        walk.density[i] = density / _chance(medium, event.kind[i], p)
        for k in range(3):
            walk.direction[i, k] = d[k]
        roulette(walk.throughput, walk.states, walk.bounces, event.alive, i, i + 1)


@njit(cache=True, nogil=True, error_model="numpy")
def transmit(content, states, point, direction, distance, share, begin, end):
    """Share (n, L) of light that gets from points (n, 3) m along directions to distances (n,) m.

    states : (n,) random streams, of which the share is an estimate where the medium varies
    """
    content = lent(content)
    memory, p, d, q = aggregate_scratch(), np.empty(3), np.empty(3), np.empty(3)
    unit, sigma = content.medium.unit, np.empty(content.varied.hits.shape)
    for i in range(begin, end):
        for k in range(3):
            p[k], d[k] = point[i, k] / unit, direction[i, k]
        _transmittance(content, (p, d), distance[i] / unit, share[i], states, i, (q, sigma, memory))


@njit(cache=True, nogil=True, error_model="numpy")
def _passes(medium, kind, throughput, states, i):
    """Whether light that has met a grain goes on as it came; throughputs change by their own share over the mean of all."""
    first, total, turned = kind * throughput.shape[1], 0.0, 0.0
    for w in range(throughput.shape[1]):
        total += throughput[i, w]
        turned += throughput[i, w] * medium.turned[first + w]
    if not total > 0.0:
        return False
    passes = uniform(states, i) * total >= turned
    for w in range(throughput.shape[1]):
        if passes:
            throughput[i, w] *= (1.0 - medium.turned[first + w]) * total / (total - turned)
        else:
            throughput[i, w] *= medium.turned[first + w] * total / turned
    return passes


@njit(cache=True, nogil=True, error_model="numpy")
def arrive(medium, met_by, walk, event, begin, end):
    """Makes scatterings of the grains that paths have met at their origins.

    met_by : `bakery.kernels.Varied` of all light that grains meet, with what the medium lets pass
    event : its kind becomes the component, its status LIGHT, TURNS, or PASSES where the light is in the forward peak
    """
    medium, met_by, walk, event = lent(medium), lent(met_by), lent(walk), lent(event)
    p, sigma, states = np.empty(3), np.empty(met_by.hits.shape), walk.states
    for i in range(begin, end):
        for k in range(3):
            p[k] = walk.origin[i, k] / medium.unit
        walk.bounces[i] += 1
        walk.sphere[i, 0], walk.triangle[i], walk.far[i] = NOWHERE, -1, np.nan
        event.kind[i] = grain_at(met_by, p, states, i, sigma) if len(sigma) > 1 else 0
        if medium.turned.size > 0 and _passes(medium, event.kind[i], walk.throughput, states, i):
            event.status[i], walk.single[i] = PASSES, True  # light samples end at grains
        else:
            walk.order[i] += 1
            walk.single[i] = False
            event.status[i] = LIGHT if uniform(states, i) < chance_at(medium.aggregate, medium.chance, p) else TURNS
