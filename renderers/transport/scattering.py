"""Flights and scatterings of paths with one weight a wavelength, for compiled loops.

A flight or a direction is drawn for one wavelength, chosen by the weights, and counted for all that might have been chosen
(balance heuristic), so weights stay as they are where all wavelengths scatter alike.  A medium is a `Scatterer`, or has its
fields.
"""

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import lent, phase_layout, phase_sample, phase_value, relative_density, turned_direction
from bakery.system.compiled import njit
from renderers.transport.wavefront import to_rgb, uniform

DIFFUSE = -1  # in place of the component that scatters: a point whose fluence counts, the same in all directions
UNIFORM = 1 / (4 * math.pi)  # 1/sr
_DIM, _GOES_ON = 0.1, 0.5  # transmittance below which an estimate of it ends by chance, and the share that goes on


class Scatterer(NamedTuple):
    """A homogeneous medium.

    sigma_t, albedo : (L,) 1/m, 1
    v, steps (A,), (A - 1,), phase, cdf (L, A) : as `bakery.kernels.phase_layout` has them
    """

    sigma_t: np.ndarray
    albedo: np.ndarray
    v: np.ndarray
    steps: np.ndarray
    phase: np.ndarray
    cdf: np.ndarray


class Points(NamedTuple):
    """Where n paths are turned.

    kind : (n,) component of the medium that scatters, or DIFFUSE
    chance : (n,) of a light sample there
    """

    kind: np.ndarray
    chance: np.ndarray


def of_one_component(n) -> Points:
    """Points in a medium of one component, at each of which light is sampled."""
    return Points(np.zeros(n, np.int64), np.ones(n))


def scatterer(sigma_t, albedo, theta, phase) -> Scatterer:
    """A medium of sigma_t, albedo (L,) 1/m, 1 and phase functions (L, A) 1/sr over angles theta (A,) rad."""
    layouts = [phase_layout(theta, row) for row in np.asarray(phase, float)]
    return Scatterer(np.array(sigma_t, float), np.array(albedo, float), *layouts[0][:2],
                     *(np.array([layout[k] for layout in layouts]) for k in (2, 3)))


def of_asset(asset) -> Scatterer:
    """The medium of an asset, with all of its phase function."""
    medium = asset.medium
    return scatterer(medium.sigma_t, medium.albedo, np.asarray(medium.theta, float), medium["phase"])


def vacuum(waves) -> Scatterer:
    """What neither scatters nor absorbs, at so many wavelengths."""
    return scatterer(np.zeros(waves), np.zeros(waves), [0, np.pi], np.full((waves, 2), UNIFORM))


def mean_cosines(medium) -> np.ndarray:
    """(L,) mean cosines of the phase functions, which are linear in v = 1 - cos theta between their nodes."""
    a, b, p, q = 1 - medium.v[:-1], 1 - medium.v[1:], medium.phase[:, :-1], medium.phase[:, 1:]
    return 2 * np.pi / 6 * np.sum(np.diff(medium.v) * (2 * p * a + p * b + q * a + 2 * q * b), axis=1)


# forceinline: a call would hand over every array of the tuple
@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def wavelength(weight, states, i):
    """Number of a wavelength drawn in proportion to the weights (n, L) of path i, and their sum."""
    waves, total = weight.shape[1], 0.0
    for w in range(waves):
        total += weight[i, w]
    chosen = uniform(states, i) * total
    for w in range(waves):
        chosen -= weight[i, w]
        if chosen < 0.0:
            return w, total
    return waves - 1, total


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def flight(medium, weight, states, i):
    """Length (m) of a flight of path i with weights (n, L); inf where nothing ends it."""
    sigma = medium.sigma_t[wavelength(weight, states, i)[0]]
    u = uniform(states, i)
    return -math.log1p(-u) / sigma if sigma > 0.0 else np.inf


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def flown(medium, weight, i, t, ends):
    """Changes the weights of path i for a flight of length t (m) that `ends` with a scattering, or goes on."""
    sigma, total, density = medium.sigma_t, 0.0, 0.0
    for w in range(len(sigma)):
        total += weight[i, w]
        density += weight[i, w] * math.exp(-sigma[w] * t) * (sigma[w] if ends else 1.0)
    for w in range(len(sigma)):
        weight[i, w] *= math.exp(-sigma[w] * t) * (sigma[w] if ends else 1.0) * total / density if density > 0.0 else 0.0


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def collides(sigma, rho, most, weight, states, i):
    """Whether a flight of path i through the densest part of a medium ends where its density is rho; changes the weights.

    sigma : (L,) 1/m, where the relative density is 1;  most : the largest extinction anywhere
    """
    total, stopped = 0.0, 0.0
    for w in range(len(sigma)):
        total += weight[i, w]
        stopped += weight[i, w] * sigma[w]
    chance = rho * stopped / (total * most) if total > 0.0 else 1.0
    ends = chance >= 1.0 or uniform(states, i) < chance
    for w in range(len(sigma)):
        real = rho * sigma[w] / most
        weight[i, w] *= real / chance if ends else (1.0 - real) / (1.0 - chance)
    return ends


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def ray_of(origin, direction, i):
    """Ray i, origin and direction, as six numbers."""
    return (origin[i, 0], origin[i, 1], origin[i, 2],
            np.float64(direction[i, 0]), np.float64(direction[i, 1]), np.float64(direction[i, 2]))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _density(region, ray, t, scratch):
    ox, oy, oz, dx, dy, dz = ray
    return relative_density(region, ox + t * dx, oy + t * dy, oz + t * dz, scratch)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def collision(region, sigma, share, ray, span, weight, states, i, scratch):
    """Distance at which path i scatters on a span of its ray, or the end of that; changes the weights.

    region, sigma, share : where there is how much of a medium, its sigma_t (L,) 1/m at 1, and the share of it that counts
    """
    (t, end), most = span, sigma.max()
    while most > 0.0:
        t -= math.log1p(-uniform(states, i)) / most
        if t >= end:
            break
        rho = share * _density(region, ray, t, scratch)
        if rho > 0.0 and collides(sigma, rho, most, weight, states, i):
            return t
    return end


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def dimmed(region, sigma, share, ray, span, passed, states, i, scratch):
    """Multiplies passed (L,) by an estimate of what a medium leaves of light on a span of a ray; arguments as of `collision`."""
    (t, end), most = span, sigma.max()
    while most > 0.0:
        t -= math.log1p(-uniform(states, i)) / most
        if t >= end or not lessened(passed, sigma, share * _density(region, ray, t, scratch), most, states, i):
            break


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def lessened(share, sigma, rho, most, states, i):
    """Whether an estimate share (L,) of what gets through goes on after such a point, at which it becomes less."""
    brightest = 0.0
    for w in range(len(sigma)):
        share[w] *= max(1.0 - rho * sigma[w] / most, 0.0)
        brightest = max(brightest, share[w])
    if brightest >= _DIM:
        return True
    goes_on = uniform(states, i) < _GOES_ON
    for w in range(len(sigma)):
        share[w] *= 1.0 / _GOES_ON if goes_on else 0.0
    return goes_on


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def left(medium, weight, i, t):
    """Changes the weights of path i by what a medium leaves of light along t (m)."""
    for w in range(weight.shape[1]):
        weight[i, w] *= math.exp(-medium.sigma_t[w] * t)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def mean_phase(medium, first, weight, i, v, values):
    """Mean (1/sr) of phase functions, by what they scatter, at an angle of 1 - cos = v; values (L,) become each of them.

    first : row of the medium's albedo and phase that is of wavelength 0; 0 unless it has several components
    """
    total, mean = 0.0, 0.0
    for w in range(len(values)):
        values[w] = phase_value(medium.v, medium.steps, medium.phase[first + w], v)
        total += weight[i, w] * medium.albedo[first + w]
        mean += weight[i, w] * medium.albedo[first + w] * values[w]
    return mean / total if total > 0 else 0.0


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def angle(medium, first, weight, states, i):
    """1 - cos of an angle by which path i is scattered, drawn from the phase functions mixed by what they scatter; -1 where that
    is nothing.  first : as in `mean_phase`"""
    waves, total = weight.shape[1], 0.0
    for w in range(waves):
        total += weight[i, w] * medium.albedo[first + w]
    if not total > 0.0:
        return -1.0
    chosen, row = uniform(states, i) * total, first + waves - 1
    for w in range(waves):
        chosen -= weight[i, w] * medium.albedo[first + w]
        if chosen < 0.0:
            row = first + w
            break
    return phase_sample(medium.v, medium.steps, medium.phase[row], medium.cdf[row], uniform(states, i))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def scattered(medium, first, x, y, z, weight, states, i, values):
    """A direction after a scattering of path i along the unit vector x, y, z, and its density (1/sr); changes the weights.

    first : as in `mean_phase`
    """
    v = angle(medium, first, weight, states, i)
    if v < 0.0:
        weight[i] = 0.0
        return x, y, z, 0.0
    x, y, z = turned_direction(x, y, z, v, 2 * math.pi * uniform(states, i))
    density = mean_phase(medium, first, weight, i, v, values)
    for w in range(len(values)):
        weight[i, w] *= medium.albedo[first + w] * values[w] / density if density > 0.0 else 0.0
    return x, y, z, density


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def turned(medium, paths, i, values):
    """Gives path i of a record a new direction at its scattering, with density and place; values (L,) become phase functions."""
    x, y, z = paths.direction[i, 0], paths.direction[i, 1], paths.direction[i, 2]
    x, y, z, paths.density[i] = scattered(medium, 0, x, y, z, paths.throughput, paths.states, i, values)
    paths.direction[i, 0], paths.direction[i, 1], paths.direction[i, 2] = x, y, z
    for k in range(3):
        paths.drawn[i, k] = paths.origin[i, k]


@njit(cache=True, nogil=True, error_model="numpy")
def turn(medium, paths, begin, end):
    """New directions of paths begin to end at scatterings."""
    medium, paths = lent(medium), lent(paths)
    values = np.empty(paths.throughput.shape[1])
    for i in range(begin, end):
        turned(medium, paths, i, values)


@njit(cache=True, nogil=True, error_model="numpy")
def _towards(medium, kind, throughput, i, v, values):
    """Density (1/sr) of directions at an angle of 1 - cos = v; values (L,) become what the throughputs take towards it."""
    if kind == DIFFUSE:
        for w in range(len(values)):
            values[w] = UNIFORM
        return UNIFORM
    first = kind * len(values)
    mean = mean_phase(medium, first, throughput, i, v, values)
    for w in range(len(values)):
        values[w] *= medium.albedo[first + w]
    return mean


@njit(cache=True, nogil=True, error_model="numpy")
def next_event(medium, colours, paths, points, sample, passed, added, begin, end):
    """What light samples send by way of scatterings: added (n, 3), linear sRGB.

    points : `Points`
    sample : `renderers.mitsuba.shading.LightSample`;  passed : (n, L), what gets through of its light
    """
    medium, colours, paths, points, sample = lent(medium), lent(colours), lent(paths), lent(points), lent(sample)
    values, radiance = np.empty(paths.throughput.shape[1]), sample.radiance
    for i in range(begin, end):
        added[i] = 0.0
        if not (radiance[i, 0] > 0 or radiance[i, 1] > 0 or radiance[i, 2] > 0):
            continue
        square = 0.0
        for k in range(3):
            square += (paths.direction[i, k] - sample.direction[i, k]) ** 2
        chance = points.chance[i]
        density = _towards(medium, points.kind[i], paths.throughput, i, min(0.5 * square, 2.0), values) / chance
        balance = 1.0 if sample.delta[i] else sample.density[i] / (sample.density[i] + density)
        for w in range(len(values)):
            values[w] *= paths.throughput[i, w] * passed[i, w] * balance / chance
        to_rgb(colours, values, radiance[i], added[i])
