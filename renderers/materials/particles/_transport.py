"""Loops of the renderer of particles: what stops a ray, where it goes on, and what of a light arrives there.

A path carries one weight a wavelength.  Where a disc stops it at some wavelengths only, or the continuous medium at some more
likely than at others, it is drawn by the weights which of them go on; so no wavelength is special.
"""

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import (
    NO_DISC,
    Pencil,
    first_disc,
    lent,
    mesh_scratch,
    open_wavelengths,
    turned_direction,
)
from bakery.system.compiled import njit
from renderers.transport.scattering import angle, collision, dimmed, mean_phase, ray_of
from renderers.transport.wavefront import to_rgb, uniform


class Walk(NamedTuple):
    """What loops read and change of n paths.

    origin, direction : (n, 3) m, unit;  throughput : (n, L);  states : (n,) random streams
    left_out : (n, 3) m, the particle that each starts at, or nan
    density : (n,) 1/sr, with which the direction was drawn
    """

    origin: np.ndarray
    direction: np.ndarray
    throughput: np.ndarray
    states: np.ndarray
    left_out: np.ndarray
    density: np.ndarray


class Ways(NamedTuple):
    """Straight ways of light, n of them.

    states : (n,) random streams;  origin, direction : (n, 3) m, unit;  distance : (n,) m
    discrete : (n,) m, distance up to which particles hide light; beyond, the continuous medium does
    left_out : (n, 3) m, a particle that hides nothing, or nan
    """

    states: np.ndarray
    origin: np.ndarray
    direction: np.ndarray
    distance: np.ndarray
    discrete: np.ndarray
    left_out: np.ndarray


class Guide(NamedTuple):
    """Lights that guide scattering.

    direction : (n, 3) of a light;  used : (n,) whether half of the new directions are drawn about it
    followed : share of the scatterings that are followed, to find light by
    """

    direction: np.ndarray
    used: np.ndarray
    followed: float = 1.0


@njit(cache=True, nogil=True, error_model="numpy")
def collide(medium, paths, far, discrete, kind, distance, point, begin, end):
    """The next scattering of paths begin to end; changes their throughput and streams.

    paths : `Walk`; a particle that is left out is also left out of the continuous medium
    far : (n,) m, where a surface ends the ray, or inf
    discrete : (n,) m, distance up to which particles stop the ray; beyond, the continuous medium
    kind : (n,) int64, becomes the class, or NO_DISC where the ray reaches `far`
    distance : (n,) m, point : (n, 3) m, become those of the scattering
    """
    medium, paths = lent(medium), lent(paths)
    scratch = mesh_scratch()
    for i in range(begin, end):
        kind[i] = _particle(medium, paths, min(far[i], discrete[i]), distance, point, i, scratch)
        if kind[i] == NO_DISC and discrete[i] < far[i]:
            kind[i] = _continuum(medium, paths, discrete[i], far[i], distance, point, i, scratch)


@njit(cache=True, nogil=True, error_model="numpy")
def _particle(medium, paths, end, distance, point, i, scratch):
    begin, square, weight, left_out = 0.0, medium.discs.square, paths.throughput, paths.left_out
    ox, oy, oz, dx, dy, dz = ray_of(paths.origin, paths.direction, i)
    while begin < end:
        pencil = Pencil((ox, oy, oz), (dx, dy, dz), begin, end, (left_out[i, 0], left_out[i, 1], left_out[i, 2]))
        kind, t, d2, x, y, z = first_disc(medium.discs, pencil, scratch)
        if kind == NO_DISC:
            break
        total, stopped = 0.0, 0.0
        for w in range(weight.shape[1]):
            total += weight[i, w]
            if d2 < square[kind, w]:
                stopped += weight[i, w]
        chance = stopped / total if total > 0 else 1.0
        hit = chance >= 1.0 or (chance > 0.0 and uniform(paths.states, i) < chance)
        factor = 1 / chance if hit else 1 / (1 - chance)
        for w in range(weight.shape[1]):
            weight[i, w] *= factor if (d2 < square[kind, w]) == hit else 0.0
        if hit:
            distance[i], point[i, 0], point[i, 1], point[i, 2] = t, x, y, z
            return kind
        begin = t
    return NO_DISC


@njit(cache=True, nogil=True, error_model="numpy")
def through_box(region, ray, begin, end):
    """The part of (begin, end) of a ray that is in the region's box."""
    lo, hi = region.lo, region.hi
    ox, oy, oz, dx, dy, dz = ray
    for o, d, a, b in ((ox, dx, lo[0], hi[0]), (oy, dy, lo[1], hi[1]), (oz, dz, lo[2], hi[2])):
        if d == 0.0:
            if not a <= o <= b:
                return 1.0, 0.0
        else:
            p, q = (a - o) / d, (b - o) / d
            begin, end = max(begin, min(p, q)), min(end, max(p, q))
    return begin, end


@njit(cache=True, nogil=True, error_model="numpy")
def _continuum(medium, paths, begin, end, distance, point, i, scratch):
    region, ray = medium.discs.region, ray_of(paths.origin, paths.direction, i)
    share = medium.others if paths.left_out[i, 0] == paths.left_out[i, 0] else 1.0
    begin, end = through_box(region, ray, begin, end)
    if not begin < end:
        return NO_DISC
    t = collision(region, medium.sigma_t, share, ray, (begin, end), paths.throughput, paths.states, i, scratch)
    if not t < end:
        return NO_DISC
    distance[i] = t
    for k in range(3):
        point[i, k] = ray[k] + t * ray[3 + k]
    return len(medium.albedo) - 1


@njit(cache=True, nogil=True, error_model="numpy")
def transmit(medium, ways, share, begin, end):
    """Multiplies share (n, L) by what gets through along `Ways`: 0 or 1 among particles, an estimate beyond, and what their host
    leaves.  Ways on which there is no light take no random numbers."""
    medium, ways = lent(medium), lent(ways)
    waves, mesh_room = share.shape[1], mesh_scratch()
    open, passed = np.empty(waves, np.uint8), np.empty(waves)
    for i in range(begin, end):
        bright = False
        for w in range(waves):
            open[w] = share[i, w] > 0
            bright = bright or share[i, w] > 0
        if not bright:
            continue
        ray, far, discrete = ray_of(ways.origin, ways.direction, i), ways.distance[i], ways.discrete[i]
        left_out = ways.left_out[i, 0], ways.left_out[i, 1], ways.left_out[i, 2]
        if discrete > 0:
            open_wavelengths(medium.discs, Pencil(ray[:3], ray[3:], 0.0, min(far, discrete), left_out), open, mesh_room)
        for w in range(waves):
            passed[w] = open[w]
        absorbed(medium, ray, far, passed)
        if discrete < far:
            others = medium.others if left_out[0] == left_out[0] else 1.0
            _through_continuum(medium, others, ray, (discrete, far), ways.states, i, passed, mesh_room)
        for w in range(waves):
            share[i, w] *= passed[w]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _through_continuum(medium, others, ray, span, states, i, passed, scratch):
    """Multiplies passed (L,) by what a share of the continuous medium leaves of light on a span of a ray, or its estimate."""
    sigma, region = medium.sigma_t, medium.discs.region
    begin, end = through_box(region, ray, span[0], span[1])
    if not begin < end:
        return
    if region.kind == 0:
        for w in range(len(passed)):
            passed[w] *= math.exp(-others * sigma[w] * (end - begin))
        return
    dimmed(region, sigma, others, ray, (begin, end), passed, states, i, scratch)


@njit(cache=True, nogil=True, error_model="numpy")
def scatter(scatterer, kind, paths, guide, begin, end):
    """New directions of paths, a `Walk`, that particles of classes kind (n,) scatter, and their densities.

    Angles are drawn from the phase functions of all wavelengths, mixed by what they would scatter: about the path's direction, or
    about that of a light (`Guide`), for the next particle scatters most light that comes from nearly behind it.
    """
    scatterer, paths, guide = lent(scatterer), lent(paths), lent(guide)
    weight, states, direction, density = paths.throughput, paths.states, paths.direction, paths.density
    values = np.empty(weight.shape[1])
    for i in range(begin, end):
        first = kind[i] * weight.shape[1]
        v = angle(scatterer, first, weight, states, i)
        if v < 0.0:
            density[i] = 0.0
            weight[i] = 0.0
            continue
        turn = 2 * math.pi * uniform(states, i)
        ox, oy, oz = direction[i, 0], direction[i, 1], direction[i, 2]
        if guide.used[i] and uniform(states, i) < 0.5:
            x, y, z = turned_direction(guide.direction[i, 0], guide.direction[i, 1], guide.direction[i, 2], v, turn)
            v = _turn(x, y, z, ox, oy, oz)
        else:
            x, y, z = turned_direction(ox, oy, oz, v, turn)
        density[i] = drawn(scatterer, first, weight, guide, i, (x, y, z), v, values)
        for w in range(weight.shape[1]):
            weight[i, w] *= scatterer.albedo[first + w] * values[w] / density[i] if density[i] > 0 else 0.0
        direction[i, 0], direction[i, 1], direction[i, 2] = x, y, z


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _turn(x, y, z, ux, uy, uz):
    """1 - cos between two unit directions, with the digits of small angles."""
    return min(0.5 * ((x - ux) ** 2 + (y - uy) ** 2 + (z - uz) ** 2), 2.0)


@njit(cache=True, nogil=True, error_model="numpy")
def drawn(scatterer, first, weight, guide, i, towards, v, values):
    """Density (1/sr) with which `scatter` takes direction `towards`, 1 - cos = v off the path's; see `mean_phase`."""
    about = 0.0
    if guide.used[i]:
        x, y, z = towards
        off = _turn(x, y, z, guide.direction[i, 0], guide.direction[i, 1], guide.direction[i, 2])
        about = mean_phase(scatterer, first, weight, i, off, values)
    ahead = mean_phase(scatterer, first, weight, i, v, values)
    return 0.5 * (ahead + about) if guide.used[i] else ahead


@njit(cache=True, nogil=True, error_model="numpy")
def light(scatterer, kind, paths, guide, share, sample, added, begin, end):
    """What sampled lights send by way of particles of classes kind (n,), added (n, 3) linear sRGB.

    scatterer : `renderers.materials.particles.medium.Scatterer`
    paths : `Walk`, as they arrived from the camera;  guide : as `scatter` takes it
    share : (n, L) of the light that gets through
    sample : `renderers.mitsuba.world.LightSample`
    """
    scatterer, paths, guide, sample = lent(scatterer), lent(paths), lent(guide), lent(sample)
    radiance, waves = sample.radiance, paths.throughput.shape[1]
    values = np.empty(waves)
    for i in range(begin, end):
        added[i] = 0.0
        if not (radiance[i, 0] > 0 or radiance[i, 1] > 0 or radiance[i, 2] > 0):
            continue
        lx, ly, lz = np.float64(sample.direction[i, 0]), np.float64(sample.direction[i, 1]), np.float64(sample.direction[i, 2])
        v = _turn(lx, ly, lz, paths.direction[i, 0], paths.direction[i, 1], paths.direction[i, 2])
        chance = guide.followed * drawn(scatterer, kind[i] * waves, paths.throughput, guide, i, (lx, ly, lz), v, values)
        balance = 1.0 if sample.delta[i] else sample.density[i] / (sample.density[i] + chance)
        for w in range(waves):
            values[w] *= scatterer.albedo[kind[i] * waves + w] * balance
            values[w] *= paths.throughput[i, w]
            values[w] *= share[i, w]
        to_rgb(scatterer, values, radiance[i], added[i])


@njit(cache=True, nogil=True, error_model="numpy")
def absorbed(medium, ray, far, weight):
    """What the host of the particles leaves of a ray up to `far`: weight (L,) becomes less."""
    if medium.host.max() > 0:
        begin, end = through_box(medium.discs.region, ray, 0.0, far)
        length = max(end - begin, 0.0)
        for w in range(len(weight)):
            weight[w] *= math.exp(-medium.host[w] * length)
