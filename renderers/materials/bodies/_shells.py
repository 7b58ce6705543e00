"""Loops of stored exits from spheres: how a path jumps to the surface of a sphere, and how the exits are made.

A row of exits is one walk from the centre of a sphere along z, turned so that it leaves in the half plane x > 0, y = 0: z of the
place over the radius; its direction; number of events, up to 3; factors of the weights, one a wavelength; likelihoods, one a
wavelength, of the flights and directions that were drawn.
"""

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import lent, phase_sample, phase_value, surface_frame, turned_direction
from bakery.system.compiled import njit
from renderers.transport.scattering import wavelength
from renderers.transport.wavefront import uniform

EVENTS, FACTORS = 4, 5  # columns of a row
_MOST = 3  # events that are told apart
_LEAST = 0.5  # of the weight with which a walk began: below that it ends by chance


class Shells(NamedTuple):
    """Stored exits from spheres in a medium.

    radii : (R,) m, ascending
    exits : (R, L, N, 5 + 2 L) float32, of N walks whose flights and directions were drawn for each of the L wavelengths
    """

    radii: np.ndarray
    exits: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def largest(radii, count, clear):
    """Number of the largest of the first `count` radii, not above `clear` (m); -1 where there is none."""
    at = count - 1
    while at >= 0 and radii[at] > clear:
        at -= 1
    return at


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _moved(row, radius, azimuth, origin, direction, i):
    """Takes ray i of origin, direction (n, 3) from the centre of a sphere to an exit."""
    x, y, z = direction[i, 0], direction[i, 1], direction[i, 2]
    sx, sy, sz, tx, ty, tz = surface_frame(x, y, z)
    c, s = math.cos(azimuth), math.sin(azimuth)
    px, py, pz = c * sx + s * tx, c * sy + s * ty, c * sz + s * tz
    qx, qy, qz = c * tx - s * sx, c * ty - s * sy, c * tz - s * sz
    along = float(row[0])
    across = math.sqrt(max(1 - along * along, 0.0))
    origin[i, 0] += radius * (across * px + along * x)
    origin[i, 1] += radius * (across * py + along * y)
    origin[i, 2] += radius * (across * pz + along * z)
    a, b, d = float(row[1]), float(row[2]), float(row[3])
    nx, ny, nz = a * px + b * qx + d * x, a * py + b * qy + d * y, a * pz + b * qz + d * z
    # single precision of the rows would add up
    norm = 1 / math.sqrt(nx * nx + ny * ny + nz * nz)
    direction[i, 0], direction[i, 1], direction[i, 2] = nx * norm, ny * norm, nz * norm


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def jump(shells, at, paths, i):
    """Takes path i to the surface of the sphere of radius number `at` about it, and returns the events on the way, up to 3.

    A walk of one wavelength is drawn, chosen by the weights, and counted for all (balance heuristic, over whole walks).
    """
    exits, weight, waves = shells.exits, paths.throughput, paths.throughput.shape[1]
    chosen, total = wavelength(weight, paths.states, i)
    row = exits[at, chosen, int(uniform(paths.states, i) * exits.shape[2])]
    _moved(row, shells.radii[at], 2 * math.pi * uniform(paths.states, i), paths.origin, paths.direction, i)
    density = 0.0
    for w in range(waves):
        density += weight[i, w] * row[FACTORS + waves + w]
    for w in range(waves):
        weight[i, w] *= row[FACTORS + w] * row[FACTORS + waves + w] * total / density if density > 0.0 else 0.0
    return int(row[EVENTS])


@njit(cache=True, nogil=True, error_model="numpy")
def fill(medium, shells, at, groups, states, begin, end):
    """Walks begin to end of L N that leave the sphere of radius number `at`: fills their rows of the exits.

    They jump by smaller spheres themselves.  `groups` parts of the rows, one after the other, know nothing of each other.
    states : (L N,) random streams
    """
    medium, shells = lent(medium), lent(shells)
    exits, radius = shells.exits, shells.radii[at]
    waves, count = exits.shape[1], exits.shape[2]
    share = count // groups
    origin, direction = np.empty((1, 3)), np.empty((1, 3))
    factor, like = np.empty(waves), np.empty(waves)
    for i in range(begin, end):
        wave, events, alive = i // count, 0, True
        group = (i % count) // share
        for k in range(3):
            origin[0, k], direction[0, k] = 0.0, 1.0 if k == 2 else 0.0
        for w in range(waves):
            factor[w], like[w] = 1.0, 1.0
        while alive:
            apart = math.sqrt(origin[0, 0] ** 2 + origin[0, 1] ** 2 + origin[0, 2] ** 2)
            inner = largest(shells.radii, at, radius - apart)
            if inner >= 0:
                row = exits[inner, wave, group * share + int(uniform(states, i) * share)]
                _moved(row, shells.radii[inner], 2 * math.pi * uniform(states, i), origin, direction, 0)
                events += int(row[EVENTS])
                for w in range(waves):
                    factor[w] *= row[FACTORS + w]
                    like[w] *= row[FACTORS + waves + w]
            elif _flown(medium, wave, radius, origin, direction, like, states, i):
                break
            else:
                events += 1
                _turned(medium, wave, direction, factor, like, states, i)
            alive = _goes_on(factor, like, states, i)
        _store(exits[at, wave, i % count], origin, direction, min(events, _MOST), factor, like, alive)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _flown(medium, wave, radius, origin, direction, like, states, i):
    """Takes a walk about 0 to its next event, or to the sphere: whether it has come there."""
    sigma = medium.sigma_t
    along, square = 0.0, 0.0
    for k in range(3):
        along += origin[0, k] * direction[0, k]
        square += origin[0, k] ** 2
    far = math.sqrt(max(along * along + radius * radius - square, 0.0)) - along
    t = -math.log1p(-uniform(states, i)) / sigma[wave] if sigma[wave] > 0.0 else np.inf
    leaves = not t < far
    t = min(t, far)
    for k in range(3):
        origin[0, k] += t * direction[0, k]
    for w in range(len(sigma)):
        # relative to the wavelength of the walk
        like[w] *= math.exp((sigma[wave] - sigma[w]) * t) * (1.0 if leaves else sigma[w] / sigma[wave])
    return leaves


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _turned(medium, wave, direction, factor, like, states, i):
    """Turns a walk at an event."""
    v = phase_sample(medium.v, medium.steps, medium.phase[wave], medium.cdf[wave], uniform(states, i))
    direction[0, 0], direction[0, 1], direction[0, 2] = turned_direction(
        direction[0, 0], direction[0, 1], direction[0, 2], v, 2 * math.pi * uniform(states, i))
    likely = phase_value(medium.v, medium.steps, medium.phase[wave], v)
    for w in range(len(factor)):
        factor[w] *= medium.albedo[w]
        if w != wave:
            like[w] *= phase_value(medium.v, medium.steps, medium.phase[w], v) / likely


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _goes_on(factor, like, states, i):
    """Russian roulette of a walk, by its mean weight over the wavelengths that may have drawn it."""
    most, mean, total = 0.0, 0.0, 0.0
    for w in range(len(like)):
        most = max(most, like[w])
    for w in range(len(like)):
        like[w] /= most  # only their ratios matter
        mean += like[w] * factor[w]
        total += like[w]
    mean /= total
    if mean >= _LEAST:
        return True
    if not uniform(states, i) < mean:
        return False
    for w in range(len(factor)):
        factor[w] /= mean
    return True


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _store(row, origin, direction, events, factor, like, alive):
    across = math.hypot(origin[0, 0], origin[0, 1])
    c, s = (origin[0, 0] / across, origin[0, 1] / across) if across > 0 else (1.0, 0.0)
    row[0] = origin[0, 2] / math.hypot(across, origin[0, 2])
    row[1] = c * direction[0, 0] + s * direction[0, 1]
    row[2] = c * direction[0, 1] - s * direction[0, 0]
    row[3], row[EVENTS] = direction[0, 2], events
    most = 0.0
    for w in range(len(like)):
        most = max(most, like[w])
    for w in range(len(like)):
        row[FACTORS + w] = factor[w] if alive else 0.0
        row[FACTORS + len(like) + w] = like[w] / most
