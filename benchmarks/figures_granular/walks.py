"""Walks of light without absorption in an infinite packing, from a beam source: where they leave spheres about it, and how far
they get.  Among explicit grains and among drawn ones, what a ray meets is found by the renderer's loops.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from bakery.kernels import lent, phase_sample, stream_key, turned_direction
from renderers.materials.grains import _grains, _teleport
from renderers.materials.grains._paths import turn
from renderers.materials.grains.teleport import flights
from renderers.threads import run
from renderers.transport import wavefront
from renderers.transport.wavefront import uniform

WARM = 10  # grains that light meets before it is the beam source


class Walks(NamedTuple):
    """Of n walkers, lengths in radii.

    cosines, hits : (n, D) of the inclination and number of grains met where each leaves the spheres about the source
    squares : (n, 2) squared distances from the source at two numbers of hits
    flight : (n,) mean way from the sphere of a hit to that of the next
    """

    cosines: np.ndarray
    hits: np.ndarray
    squares: np.ndarray
    flight: np.ndarray


def among_grains(grains, count, spheres, numbers, *, law=None, seed=0) -> Walks:
    """Walks among the grains of a large mesh about the origin, or, with a law of `teleport.flights`, among drawn ones.

    grains : `Grains` without losses, whose mesh is so large that no walk gets out
    spheres : (D,) ascending radii of detectors;  numbers : (n, 2 n) of hits after which squared distances are noted
    """
    found = _empty(count, len(spheres))
    half = 0.25 * float(np.min(grains.aggregate.edge * grains.aggregate.voxels.shape))
    run(_among_grains, count, grains, flights(grains.aggregate, exponential=True) if law is None else law, law is not None, half,
        np.asarray(spheres, float), np.asarray(numbers, np.int64), _streams(count, seed), *found)
    return found


def in_medium(sigma_t, theta, phase, count, spheres, numbers, *, seed=0) -> Walks:
    """The same in a medium: sigma_t in 1/radius, phase (A,) 1/sr at angles theta."""
    from bakery.kernels import phase_layout

    found = _empty(count, len(spheres))
    run(_in_medium, count, float(sigma_t), phase_layout(theta, phase), np.asarray(spheres, float), np.asarray(numbers, np.int64),
        _streams(count, seed), *found)
    return found


def _empty(count, spheres):
    return Walks(np.empty((count, spheres)), np.empty((count, spheres)), np.empty((count, 2)), np.empty(count))


def _streams(count, seed):
    states = np.empty(count, np.uint64)
    wavefront.begin_streams(stream_key(seed, "render.walk", 0), 0, states)
    return states


@njit(cache=True, nogil=True, error_model="numpy")
def _left(o, beam, p, d, t, spheres, k, hits, cosines, counts):
    """Notes which spheres about o a way of length t from p leaves, from the k-th on; returns the first one that it does not."""
    x, y, z = p[0] - o[0], p[1] - o[1], p[2] - o[2]
    along = x * d[0] + y * d[1] + z * d[2]
    across = x * x + y * y + z * z - along * along
    while k < len(spheres):
        s = math.sqrt(max(spheres[k] ** 2 - across, 0.0)) - along
        if s > t:
            break
        cosines[k] = ((x + s * d[0]) * beam[0] + (y + s * d[1]) * beam[1] + (z + s * d[2]) * beam[2]) / spheres[k]
        counts[k] = hits
        k += 1
    return k


@njit(cache=True, nogil=True, error_model="numpy")
def _away(p, o):
    return (p[0] - o[0]) ** 2 + (p[1] - o[1]) ** 2 + (p[2] - o[2]) ** 2


@njit(cache=True, nogil=True, error_model="numpy")
def _ends(grains, drawn, met, centre, p, d):
    """Distances along d to where a line enters and leaves the sphere `met`."""
    aggregate, c = grains.aggregate, np.empty(3)
    for k in range(3):
        c[k] = (centre[k] if drawn else aggregate.centers[met[0], k] + met[1 + k] * aggregate.cell[k]) - p[k]
    far = _grains.far_side(c[0], c[1], c[2], d, aggregate.radii[met[0]])
    return 2.0 * (c[0] * d[0] + c[1] * d[1] + c[2] * d[2]) - far, far


@njit(cache=True, nogil=True, error_model="numpy")
def _anywhere(half, stream, p, d, met, at):
    """A ray from anywhere in a cube."""
    for axis in range(3):
        p[axis] = half * (2.0 * uniform(stream, 0) - 1.0)
    d[0], d[1], d[2] = _teleport._sphere_point(stream, 0)
    met[0], at[0] = _grains.UNKNOWN, -1


@njit(cache=True, nogil=True, error_model="numpy")
def _among_grains(grains, law, drawn, half, spheres, numbers, states, cosines, hits, squares, flight, begin, end):
    grains, law = lent(grains), lent(law)
    room, p, d, n, o, beam = _grains.scratch(), np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    now, at, centre, weight = np.empty(4, np.int64), np.empty(2, np.int64), np.empty(3), np.ones((1, grains.channels.shape[2]))
    one = np.empty(1, np.uint64)
    for i in range(begin, end):
        one[0] = states[i]
        _anywhere(half, one, p, d, now, at)
        count, k, started, free, flown = 0, 0, False, 0.0, 0
        while k < len(spheres) or count < numbers[1]:
            before0, before1, before2, before3, leaves = now[0], now[1], now[2], now[3], 0.0
            if now[0] >= 0:
                leaves = _ends(grains, drawn, now, centre, p, d)[1]
            if drawn:
                t = _teleport.next_surface(grains, law, (p, d), np.inf, _teleport.Contact(now, centre, at, n), one, 0, room)
            else:
                t = _grains.next_surface(grains, p, d, np.inf, now, at, n, room)
            if t == np.inf:
                break
            if before0 < 0 and d[0] * n[0] + d[1] * n[1] + d[2] * n[2] > 0.0:  # in a grain, which may keep the light
                _anywhere(half, one, p, d, now, at)
                continue
            new = before0 != now[0] or before1 != now[1] or before2 != now[2] or before3 != now[3]
            if new and count == WARM and not started:
                started, count = True, 0
                for axis in range(3):
                    o[axis], beam[axis] = p[axis] + leaves * d[axis], d[axis]
            if started:
                k = _left(o, beam, p, d, t, spheres, k, count, cosines[i], hits[i])
            for axis in range(3):
                p[axis] += t * d[axis]
            if new:
                count += 1
                if started:
                    free += t + _ends(grains, drawn, now, centre, p, d)[0] - leaves
                    flown += 1
                    for w in range(2):
                        if count == numbers[w]:
                            squares[i, w] = _away(p, o)
            turn(grains, at[1], n, d, weight, one, 0, 1.0)
        if k < len(spheres) or count < numbers[1]:
            for w in range(2):
                squares[i, w] = np.nan
        flight[i] = free / max(flown, 1)


@njit(cache=True, nogil=True, error_model="numpy")
def _in_medium(sigma_t, layout, spheres, numbers, states, cosines, hits, squares, flight, begin, end):
    v, steps, phase, cdf = layout
    p, d, o, beam = np.empty(3), np.empty(3), np.zeros(3), np.array([0.0, 0.0, 1.0])
    for i in range(begin, end):
        for axis in range(3):
            p[axis], d[axis] = 0.0, beam[axis]
        count, k, free = 0, 0, 0.0
        while k < len(spheres) or count < numbers[1]:
            t = -math.log1p(-uniform(states, i)) / sigma_t
            k = _left(o, beam, p, d, t, spheres, k, count, cosines[i], hits[i])
            free, count = free + t, count + 1
            for axis in range(3):
                p[axis] += t * d[axis]
            for w in range(2):
                if count == numbers[w]:
                    squares[i, w] = _away(p, o)
            cosine = phase_sample(v, steps, phase, cdf, uniform(states, i))
            d[0], d[1], d[2] = turned_direction(d[0], d[1], d[2], cosine, 2.0 * math.pi * uniform(states, i))
        flight[i] = free / count
