"""Loops of the renderer of particles: what stops a ray, where it goes on, and what of a light arrives there.

A path carries one weight a wavelength.  Where a disc stops it at some wavelengths only, or the continuous medium at some more
likely than at others, it is drawn by the weights which of them go on; so no wavelength is special.
"""

from __future__ import annotations

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
    phase_sample,
    phase_value,
    relative_density,
    turned_direction,
)
from bakery.system.compiled import njit
from renderers.transport.wavefront import to_rgb, uniform

FOLLOWED = 0.25  # share of the pencils of `splat` that also go on as their particles scatter, to find light by


class Events(NamedTuple):
    """Where n paths scatter.

    kind : (n,) class, or NO_DISC at surfaces;  place : (n, 3) m
    discrete : (n,) m, distance up to which particles hide light; beyond, the continuous medium does
    """

    kind: np.ndarray
    place: np.ndarray
    discrete: np.ndarray


class Guide(NamedTuple):
    """Lights that guide scattering.

    direction : (n, 3) of a light;  used : (n,) whether half of the new directions are drawn about it
    """

    direction: np.ndarray
    used: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def ray_of(origin, direction, i):
    """Ray i, origin and direction, as six numbers."""
    return (origin[i, 0], origin[i, 1], origin[i, 2],
            np.float64(direction[i, 0]), np.float64(direction[i, 1]), np.float64(direction[i, 2]))


@njit(cache=True, nogil=True, error_model="numpy")
def collide(medium, paths, far, discrete, kind, distance, point, begin, end):
    """The next scattering of paths begin to end; changes their throughput and streams.

    Parameters
    ----------
    paths : with origin, direction, left_out, throughput, states, such as those of `walk` or of `renderers.transport.paths`; a
        particle that is left out is also left out of the continuous medium
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
    """Null-collision tracking with the largest extinction of all wavelengths."""
    region, sigma, weight, states = medium.discs.region, medium.sigma_t, paths.throughput, paths.states
    share = medium.others if paths.left_out[i, 0] == paths.left_out[i, 0] else 1.0
    most = sigma.max()
    ray = ray_of(paths.origin, paths.direction, i)
    ox, oy, oz, dx, dy, dz = ray
    t, end = through_box(region, ray, begin, end)
    if not (t < end and most > 0):
        return NO_DISC
    while True:
        t -= math.log1p(-uniform(states, i)) / most
        if t >= end:
            return NO_DISC
        x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
        rho = share * relative_density(region, x, y, z, scratch)
        if rho <= 0:
            continue
        total, stopped = 0.0, 0.0
        for w in range(len(sigma)):
            total += weight[i, w]
            stopped += weight[i, w] * sigma[w]
        chance = rho * stopped / (total * most) if total > 0 else 1.0
        hit = chance >= 1.0 or uniform(states, i) < chance
        for w in range(len(sigma)):
            real = rho * sigma[w] / most
            weight[i, w] *= real / chance if hit else (1 - real) / (1 - chance)
        if hit:
            distance[i], point[i, 0], point[i, 1], point[i, 2] = t, x, y, z
            return len(medium.albedo) - 1


@njit(cache=True, nogil=True, error_model="numpy")
def transmit(medium, ray, far, discrete, left_out, states, i, passed, scratch):
    """What of light gets through along a ray to `far`: passed (L,), 0 or 1 among particles, an estimate beyond `discrete`.

    left_out : particle left out, or nan;  scratch : (L,) uint8 and that of meshes, for own use
    """
    sigma, region = medium.sigma_t, medium.discs.region
    ox, oy, oz, dx, dy, dz = ray
    open, mesh_room = scratch
    share = medium.others if left_out[0] == left_out[0] else 1.0
    open[:] = 1
    if discrete > 0:
        open_wavelengths(medium.discs, Pencil((ox, oy, oz), (dx, dy, dz), 0.0, min(far, discrete), left_out), open, mesh_room)
    for w in range(len(passed)):
        passed[w] = open[w]
    absorbed(medium, ray, far, passed)
    if not discrete < far:
        return
    t, end = through_box(region, ray, discrete, far)
    if not t < end:
        return
    if region.kind == 0:
        for w in range(len(passed)):
            passed[w] *= math.exp(-share * sigma[w] * (end - t))
        return
    most = sigma.max()
    while most > 0:
        t -= math.log1p(-uniform(states, i)) / most
        if t >= end:
            return
        rho = share * relative_density(region, ox + t * dx, oy + t * dy, oz + t * dz, mesh_room)
        brightest = 0.0
        for w in range(len(passed)):
            passed[w] *= 1 - rho * sigma[w] / most
            brightest = max(brightest, passed[w])
        if brightest < 0.1:  # Russian roulette
            if uniform(states, i) >= 0.5:
                for w in range(len(passed)):
                    passed[w] = 0.0
                return
            for w in range(len(passed)):
                passed[w] *= 2


@njit(cache=True, nogil=True, error_model="numpy")
def mixture(medium, kind, weight, i, v, values):
    """Mean (1/sr) of the phase functions, by what they scatter, at an angle of 1 - cos = v; values (L,) become each of them."""
    total, mean = 0.0, 0.0
    for w in range(len(values)):
        values[w] = phase_value(medium.v, medium.steps, medium.phase[kind, w], v)
        likely = weight[i, w] * medium.albedo[kind, w]
        total += likely
        mean += likely * values[w]
    return mean / total if total > 0 else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def scatter(medium, kind, paths, guide, begin, end):
    """New directions of paths that particles of classes kind (n,) scatter, and their densities.

    Angles are drawn from the phase functions of all wavelengths, mixed by what they would scatter: about the path's direction, or
    about that of a light (`Guide`), for the next particle scatters most light that comes from nearly behind it.
    """
    medium, paths, guide = lent(medium), lent(paths), lent(guide)
    weight, states, direction, density = paths.throughput, paths.states, paths.direction, paths.density
    values = np.empty(weight.shape[1])
    for i in range(begin, end):
        total = 0.0
        for w in range(weight.shape[1]):
            total += weight[i, w] * medium.albedo[kind[i], w]
        if not total > 0:
            density[i] = 0.0
            weight[i] = 0.0
            continue
        chosen, below = uniform(states, i) * total, 0.0
        wavelength = weight.shape[1] - 1
        for w in range(weight.shape[1]):
            below += weight[i, w] * medium.albedo[kind[i], w]
            if chosen < below:
                wavelength = w
                break
        v = phase_sample(medium.v, medium.steps, medium.phase[kind[i], wavelength], medium.cdf[kind[i], wavelength],
                         uniform(states, i))
        turn = 2 * math.pi * uniform(states, i)
        ox, oy, oz = direction[i, 0], direction[i, 1], direction[i, 2]
        if guide.used[i] and uniform(states, i) < 0.5:
            x, y, z = turned_direction(guide.direction[i, 0], guide.direction[i, 1], guide.direction[i, 2], v, turn)
            v = _turn(x, y, z, ox, oy, oz)
        else:
            x, y, z = turned_direction(ox, oy, oz, v, turn)
        density[i] = drawn(medium, kind[i], weight, guide, i, (x, y, z), v, values)
        for w in range(weight.shape[1]):
            weight[i, w] *= medium.albedo[kind[i], w] * values[w] / density[i] if density[i] > 0 else 0.0
        direction[i, 0], direction[i, 1], direction[i, 2] = x, y, z


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _turn(x, y, z, ux, uy, uz):
    """1 - cos between two unit directions, with the digits of small angles."""
    return min(0.5 * ((x - ux) ** 2 + (y - uy) ** 2 + (z - uz) ** 2), 2.0)


@njit(cache=True, nogil=True, error_model="numpy")
def drawn(medium, kind, weight, guide, i, towards, v, values):
    """Density (1/sr) with which `scatter` takes direction `towards`, 1 - cos = v off the path's; see `mixture`."""
    about = 0.0
    if guide.used[i]:
        x, y, z = towards
        off = _turn(x, y, z, guide.direction[i, 0], guide.direction[i, 1], guide.direction[i, 2])
        about = mixture(medium, kind, weight, i, off, values)
    ahead = mixture(medium, kind, weight, i, v, values)
    return 0.5 * (ahead + about) if guide.used[i] else ahead


@njit(cache=True, nogil=True, error_model="numpy")
def light(medium, events, paths, guide, together, sample, added, begin, end):
    """What sampled lights send by way of scatterings, added (n, 3) linear sRGB.

    Parameters
    ----------
    events : `Events`; at surfaces the radiance of the sample holds the reflection
    paths : as they arrived from the camera; a path that leaves a particle is not hidden by it
    guide : as `scatter` takes it
    together : (n, L) factors of `renderers.materials.particles.shadow`
    sample : `renderers.mitsuba.world.LightSample`
    """
    medium, events, paths = lent(medium), lent(events), lent(paths)
    waves = paths.throughput.shape[1]
    scratch = np.empty(waves, np.uint8), mesh_scratch()
    values, passed = np.empty(waves), np.empty(waves)
    for i in range(begin, end):
        added[i] = 0.0
        if _arrives(medium, events, paths, guide, sample, i, values, passed, scratch):
            for w in range(waves):
                values[w] *= together[i, w]
            to_rgb(medium, values, sample.radiance[i], added[i])


@njit(cache=True, nogil=True, error_model="numpy")
def light_alone(medium, events, paths, chance, together, sample, added, begin, end):
    """What sampled lights send by way of particles, added (n, 3) linear sRGB, beside a share `FOLLOWED` of them that goes on.

    chance : (n,) number in [0, 1): light is hidden where it is above what the mean medium lets through; nan: by others' discs
    together : (n, L) factors of `renderers.materials.particles.shadow`, where light is hidden by chance
    """
    medium, events, paths = lent(medium), lent(events), lent(paths)
    kind, weight, radiance, waves = events.kind, paths.throughput, sample.radiance, paths.throughput.shape[1]
    scratch = np.empty(waves, np.uint8), mesh_scratch()
    values, passed = np.empty(waves), np.empty(waves)
    for i in range(begin, end):
        if not (radiance[i, 0] > 0 or radiance[i, 1] > 0 or radiance[i, 2] > 0):
            continue
        ray = ray_of(events.place, sample.direction, i)
        v = _turn(sample.direction[i, 0], sample.direction[i, 1], sample.direction[i, 2], paths.direction[i, 0],
                  paths.direction[i, 1], paths.direction[i, 2])
        ahead = FOLLOWED * mixture(medium, kind[i], weight, i, v, values)
        balance = 1.0 if sample.delta[i] else sample.density[i] / (sample.density[i] + ahead)
        if chance[i] >= 0:
            column = in_box(medium.discs.region, ray, sample.distance[i])
            for w in range(waves):
                through = together[i, w] * math.exp(-medium.others * medium.sigma_t[w] * column)
                passed[w] = math.exp(-medium.host[w] * column) if chance[i] < through else 0.0
        else:
            transmit(medium, ray, sample.distance[i], np.inf, ray[:3], paths.states, i, passed, scratch)
        for w in range(waves):
            values[w] *= medium.albedo[kind[i], w] * weight[i, w] * passed[w] * balance
        to_rgb(medium, values, radiance[i], added[i])


@njit(cache=True, nogil=True, error_model="numpy")
def in_box(region, ray, far):
    """Length (m) of a ray up to `far` within the region's box."""
    begin, end = through_box(region, ray, 0.0, far)
    return max(end - begin, 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def absorbed(medium, ray, far, weight):
    """What the host of the particles leaves of a ray up to `far`: weight (L,) becomes less."""
    if medium.host.max() > 0:
        length = in_box(medium.discs.region, ray, far)
        for w in range(len(weight)):
            weight[w] *= math.exp(-medium.host[w] * length)


@njit(cache=True, nogil=True, error_model="numpy")
def absorb(medium, paths, distance, begin, end):
    """`absorbed` of paths begin to end, each up to its distance (n,) m."""
    for i in range(begin, end):
        absorbed(medium, ray_of(paths.origin, paths.direction, i), distance[i], paths.throughput[i])


@njit(cache=True, nogil=True, error_model="numpy")
def _arrives(medium, events, paths, guide, sample, i, values, passed, scratch):
    """Whether light of sample i arrives; values (L,) become what the path makes of radiance 1."""
    if not (sample.radiance[i, 0] > 0 or sample.radiance[i, 1] > 0 or sample.radiance[i, 2] > 0):
        return False
    for w in range(len(values)):
        values[w] = 1.0
    kind, ray, left_out = events.kind[i], ray_of(events.place, sample.direction, i), (np.nan, np.nan, np.nan)
    if kind != NO_DISC:
        lx, ly, lz = ray[3:]
        v = _turn(lx, ly, lz, paths.direction[i, 0], paths.direction[i, 1], paths.direction[i, 2])
        chance = drawn(medium, kind, paths.throughput, guide, i, (lx, ly, lz), v, values)
        balance = 1.0 if sample.delta[i] else sample.density[i] / (sample.density[i] + chance)
        for w in range(len(values)):
            values[w] *= medium.albedo[kind, w] * balance
        left_out = ray[:3]
    transmit(medium, ray, sample.distance[i], events.discrete[i], left_out, paths.states, i, passed, scratch)
    most = 0.0
    for w in range(len(values)):
        values[w] *= paths.throughput[i, w] * passed[w]
        most = max(most, values[w])
    return most > 0
