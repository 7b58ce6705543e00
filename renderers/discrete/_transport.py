"""Loops of the renderer of particles: what stops a ray, where it goes on, and what of a light arrives there.

A path carries one weight a wavelength.  Where a disc stops it at some wavelengths only, or the continuous medium at some more
likely than at others, it is drawn by the weights which of them go on; so no wavelength is special.
"""

from __future__ import annotations

import math

import numpy as np

from bakery.kernels import (
    NO_DISC,
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
from renderers.wavefront import to_rgb, uniform


@njit(cache=True, nogil=True, error_model="numpy")
def collide(medium, origin, direction, far, discrete, left_out, weight, states, kind, distance, place, begin, end):
    """The next scattering of rays begin to end.

    Parameters
    ----------
    origin, direction : (n, 3) m, unit;  far : (n,) m, where a surface ends the ray, or inf
    discrete : (n,) m, distance up to which particles stop the ray; beyond, the continuous medium
    left_out : (n, 3) m, particle that the ray starts at, also of the continuous medium, or nan
    weight : (n, L), changed;  states : (n,), changed
    kind : (n,) int64, becomes the class, or NO_DISC where the ray reaches `far`
    distance : (n,) m, place : (n, 3) m, become those of the scattering
    """
    medium = lent(medium)
    room = mesh_scratch()
    for i in range(begin, end):
        near = min(far[i], discrete[i])
        kind[i] = _particle(medium, origin, direction, near, left_out, weight, states, distance, place, i, room)
        if kind[i] == NO_DISC and discrete[i] < far[i]:
            share = medium.others if left_out[i, 0] == left_out[i, 0] else 1.0
            kind[i] = _continuum(medium, share, origin, direction, discrete[i], far[i], weight, states, distance, place, i, room)


@njit(cache=True, nogil=True, error_model="numpy")
def _particle(medium, origin, direction, end, left_out, weight, states, distance, place, i, room):
    begin, square = 0.0, medium.discs.square
    while begin < end:
        kind, t, d2, x, y, z = first_disc(medium.discs, origin[i, 0], origin[i, 1], origin[i, 2], direction[i, 0],
                                          direction[i, 1], direction[i, 2], begin, end, left_out[i, 0], left_out[i, 1],
                                          left_out[i, 2], room)
        if kind == NO_DISC:
            break
        total, stopped = 0.0, 0.0
        for w in range(weight.shape[1]):
            total += weight[i, w]
            if d2 < square[kind, w]:
                stopped += weight[i, w]
        chance = stopped / total if total > 0 else 1.0
        hit = chance >= 1.0 or (chance > 0.0 and uniform(states, i) < chance)
        factor = 1 / chance if hit else 1 / (1 - chance)
        for w in range(weight.shape[1]):
            weight[i, w] *= factor if (d2 < square[kind, w]) == hit else 0.0
        if hit:
            distance[i], place[i, 0], place[i, 1], place[i, 2] = t, x, y, z
            return kind
        begin = t
    return NO_DISC


@njit(cache=True, nogil=True, error_model="numpy")
def through_box(region, ox, oy, oz, dx, dy, dz, begin, end):
    """The part of (begin, end) of a ray that is in the region's box."""
    lo, hi = region.lo, region.hi
    for o, d, a, b in ((ox, dx, lo[0], hi[0]), (oy, dy, lo[1], hi[1]), (oz, dz, lo[2], hi[2])):
        if d == 0.0:
            if not a <= o <= b:
                return 1.0, 0.0
        else:
            p, q = (a - o) / d, (b - o) / d
            begin, end = max(begin, min(p, q)), min(end, max(p, q))
    return begin, end


@njit(cache=True, nogil=True, error_model="numpy")
def _continuum(medium, share, origin, direction, begin, end, weight, states, distance, place, i, room):
    """Null-collision tracking with the largest extinction of all wavelengths; a share of the medium."""
    region, sigma = medium.discs.region, medium.sigma_t
    most = sigma.max()
    ox, oy, oz, dx, dy, dz = origin[i, 0], origin[i, 1], origin[i, 2], direction[i, 0], direction[i, 1], direction[i, 2]
    t, end = through_box(region, ox, oy, oz, dx, dy, dz, begin, end)
    if not (t < end and most > 0):
        return NO_DISC
    while True:
        t -= math.log1p(-uniform(states, i)) / most
        if t >= end:
            return NO_DISC
        x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
        rho = share * relative_density(region, x, y, z, room)
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
            distance[i], place[i, 0], place[i, 1], place[i, 2] = t, x, y, z
            return len(medium.albedo) - 1


@njit(cache=True, nogil=True, error_model="numpy")
def transmit(medium, ox, oy, oz, dx, dy, dz, far, discrete, sx, sy, sz, states, i, passed, open, room):
    """What of light gets through from a point to `far`: passed (L,), 0 or 1 among particles, an estimate beyond `discrete`.

    sx, sy, sz : particle left out, or nan;  open : (L,) uint8, for own use
    """
    sigma, region = medium.sigma_t, medium.discs.region
    share = medium.others if sx == sx else 1.0
    open[:] = 1
    if discrete > 0:
        open_wavelengths(medium.discs, ox, oy, oz, dx, dy, dz, 0.0, min(far, discrete), sx, sy, sz, open, room)
    for w in range(len(passed)):
        passed[w] = open[w]
    absorbed(medium, ox, oy, oz, dx, dy, dz, far, passed)
    if not discrete < far:
        return
    t, end = through_box(region, ox, oy, oz, dx, dy, dz, discrete, far)
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
        rho = share * relative_density(region, ox + t * dx, oy + t * dy, oz + t * dz, room)
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
def scatter(medium, kind, direction, weight, states, guide, guided, density, begin, end):
    """New directions of paths that particles of classes kind (n,) scatter; density (n,) 1/sr becomes that of each direction.

    guide : (n, 3) direction of a light;  guided : (n,) whether half of the new directions are drawn about it

    Angles are drawn from the phase functions of all wavelengths, mixed by what they would scatter: about the path's direction, or
    about that of a light, for the next particle scatters most light that comes from nearly behind it.
    """
    medium = lent(medium)
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
        one = weight.shape[1] - 1
        for w in range(weight.shape[1]):
            below += weight[i, w] * medium.albedo[kind[i], w]
            if chosen < below:
                one = w
                break
        v = phase_sample(medium.v, medium.steps, medium.phase[kind[i], one], medium.cdf[kind[i], one], uniform(states, i))
        turn = 2 * math.pi * uniform(states, i)
        ox, oy, oz = direction[i, 0], direction[i, 1], direction[i, 2]
        if guided[i] and uniform(states, i) < 0.5:
            x, y, z = turned_direction(guide[i, 0], guide[i, 1], guide[i, 2], v, turn)
            v = _turn(x, y, z, ox, oy, oz)
        else:
            x, y, z = turned_direction(ox, oy, oz, v, turn)
        density[i] = drawn(medium, kind[i], weight, i, guide, guided, x, y, z, v, values)
        for w in range(weight.shape[1]):
            weight[i, w] *= medium.albedo[kind[i], w] * values[w] / density[i] if density[i] > 0 else 0.0
        direction[i, 0], direction[i, 1], direction[i, 2] = x, y, z


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _turn(x, y, z, ux, uy, uz):
    """1 - cos between two unit directions, with the digits of small angles."""
    return min(0.5 * ((x - ux) ** 2 + (y - uy) ** 2 + (z - uz) ** 2), 2.0)


@njit(cache=True, nogil=True, error_model="numpy")
def drawn(medium, kind, weight, i, guide, guided, x, y, z, v, values):
    """Density (1/sr) with which `scatter` takes direction (x, y, z), 1 - cos = v off the path's; see `mixture`."""
    about = 0.0
    if guided[i]:
        about = mixture(medium, kind, weight, i, _turn(x, y, z, guide[i, 0], guide[i, 1], guide[i, 2]), values)
    ahead = mixture(medium, kind, weight, i, v, values)
    return 0.5 * (ahead + about) if guided[i] else ahead


@njit(cache=True, nogil=True, error_model="numpy")
def light(medium, kind, origin, direction, weight, states, discrete, order, guide, guided, together, lit, distance, radiance,
          density, single, index, added, begin, end):
    """What sampled lights send by way of scatterings, added (n, 3) linear sRGB.

    Parameters
    ----------
    kind : (n,) class, or NO_DISC at surfaces, where `radiance` holds the reflection and `direction` does not matter
    origin : (n, 3) m, where the paths scatter;  direction : (n, 3), in which they arrived from the camera
    discrete : (n,) m, see `collide`
    order : (n,) scatterings so far, this one included; below 0: nothing is added
    guide, guided : as `scatter` takes them
    together : (n, L) factors of `renderers.discrete.shadow`
    lit, distance, radiance, density, single, index : of the lights' samples: (n, 3) direction, (n,) m, (n, 3) sRGB over the
        sampling density, (n,) 1/sr, (n,) whether no direction drawn by a phase function could meet it, (n,) number of the light
    """
    medium = lent(medium)
    room, waves = mesh_scratch(), weight.shape[1]
    values, passed, open = np.empty(waves), np.empty(waves), np.empty(waves, np.uint8)
    for i in range(begin, end):
        added[i] = 0.0
        if order[i] >= 0 and _arrives(medium, kind, origin, direction, weight, states, discrete, guide, guided, lit, distance,
                                      radiance, density, single[i], i, values, passed, open, room):
            for w in range(waves):
                values[w] *= together[i, w]
            to_rgb(medium, values, radiance[i], added[i])


@njit(cache=True, nogil=True, error_model="numpy")
def light_alone(medium, kind, origin, direction, weight, states, chance, together, lit, distance, radiance, density, single,
                index, added, begin, end):
    """What sampled lights send by way of particles, added (n, 3) linear sRGB, where nothing but light sampling looks for them.

    chance : (n,) number in [0, 1): light is hidden where it is above what the mean medium lets through; nan: by others' discs
    together : (n, L) factors of `renderers.discrete.shadow`, where light is hidden by chance
    """
    medium = lent(medium)
    room, waves = mesh_scratch(), weight.shape[1]
    values, passed, open = np.empty(waves), np.empty(waves), np.empty(waves, np.uint8)
    for i in range(begin, end):
        if not (radiance[i, 0] > 0 or radiance[i, 1] > 0 or radiance[i, 2] > 0):
            continue
        v = _turn(lit[i, 0], lit[i, 1], lit[i, 2], direction[i, 0], direction[i, 1], direction[i, 2])
        mixture(medium, kind[i], weight, i, v, values)
        if chance[i] >= 0:
            column = in_box(medium.discs.region, origin[i, 0], origin[i, 1], origin[i, 2], np.float64(lit[i, 0]),
                            np.float64(lit[i, 1]), np.float64(lit[i, 2]), distance[i])
            for w in range(waves):
                through = together[i, w] * math.exp(-medium.others * medium.sigma_t[w] * column)
                passed[w] = math.exp(-medium.host[w] * column) if chance[i] < through else 0.0
        else:
            transmit(medium, origin[i, 0], origin[i, 1], origin[i, 2], np.float64(lit[i, 0]), np.float64(lit[i, 1]),
                     np.float64(lit[i, 2]), distance[i], np.inf, origin[i, 0], origin[i, 1], origin[i, 2], states, i, passed,
                     open, room)
        for w in range(waves):
            values[w] *= medium.albedo[kind[i], w] * weight[i, w] * passed[w]
        to_rgb(medium, values, radiance[i], added[i])


@njit(cache=True, nogil=True, error_model="numpy")
def in_box(region, ox, oy, oz, dx, dy, dz, far):
    """Length (m) of a ray up to `far` within the region's box."""
    begin, end = through_box(region, ox, oy, oz, dx, dy, dz, 0.0, far)
    return max(end - begin, 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def absorbed(medium, ox, oy, oz, dx, dy, dz, far, weight):
    """What the host of the particles leaves of a ray up to `far`: weight (L,) becomes less."""
    if medium.host.max() > 0:
        length = in_box(medium.discs.region, ox, oy, oz, dx, dy, dz, far)
        for w in range(len(weight)):
            weight[w] *= math.exp(-medium.host[w] * length)


@njit(cache=True, nogil=True, error_model="numpy")
def absorb(medium, origin, direction, distance, weight, begin, end):
    """`absorbed` of rays begin to end, each up to its distance (n,) m."""
    for i in range(begin, end):
        absorbed(medium, origin[i, 0], origin[i, 1], origin[i, 2], direction[i, 0], direction[i, 1], direction[i, 2], distance[i],
                 weight[i])


@njit(cache=True, nogil=True, error_model="numpy")
def _arrives(medium, kind, origin, direction, weight, states, discrete, guide, guided, lit, distance, radiance, density,
             single, i, values, passed, open, room):
    """Whether light of sample i arrives; values (L,) become what the path makes of radiance 1."""
    if not (radiance[i, 0] > 0 or radiance[i, 1] > 0 or radiance[i, 2] > 0):
        return False
    for w in range(len(values)):
        values[w] = 1.0
    if kind[i] != NO_DISC:
        lx, ly, lz = np.float64(lit[i, 0]), np.float64(lit[i, 1]), np.float64(lit[i, 2])
        v = _turn(lx, ly, lz, direction[i, 0], direction[i, 1], direction[i, 2])
        chance = drawn(medium, kind[i], weight, i, guide, guided, lx, ly, lz, v, values)
        balance = 1.0 if single else density[i] / (density[i] + chance)
        for w in range(len(values)):
            values[w] *= medium.albedo[kind[i], w] * balance
    sx, sy, sz = np.nan, np.nan, np.nan
    if kind[i] != NO_DISC:
        sx, sy, sz = origin[i, 0], origin[i, 1], origin[i, 2]
    lx, ly, lz = np.float64(lit[i, 0]), np.float64(lit[i, 1]), np.float64(lit[i, 2])
    transmit(medium, origin[i, 0], origin[i, 1], origin[i, 2], lx, ly, lz, distance[i], discrete[i], sx, sy, sz, states,
             i, passed, open, room)
    most = 0.0
    for w in range(len(values)):
        values[w] *= weight[i, w] * passed[w]
        most = max(most, values[w])
    return most > 0
