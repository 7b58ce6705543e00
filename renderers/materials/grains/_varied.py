"""Collisions in a medium of which there is more in some places than in others (`bakery.kernels.Varied`)."""

import math

from bakery.kernels import extinctions_at
from bakery.system.compiled import njit
from renderers.transport.wavefront import uniform

_FAINT = 1 / 16  # light samples of which less is left are ended by chance


@njit(cache=True, nogil=True, error_model="numpy")
def collision(varied, x, y, z, weight, states, i, sigma):
    """What a flight in the densest part of a medium that varies has met at a point: a component, or -1, nothing.

    Chances are means over the wavelengths by weight, and weights change by theirs over the mean: spectral tracking (Kutz et al.
    2017, ACM Trans. Graph. 36, 111).
    """
    extinctions_at(varied, x, y, z, sigma)
    count, waves = sigma.shape
    total = 0.0
    for w in range(waves):
        total += weight[i, w]
    chosen = uniform(states, i) * total * varied.most
    for c in range(count):
        share = 0.0
        for w in range(waves):
            share += weight[i, w] * sigma[c, w]
        chosen -= share
        if chosen < 0.0:
            for w in range(waves):
                weight[i, w] *= sigma[c, w] * total / share
            return c
    share = 0.0
    for w in range(waves):
        nothing = varied.most
        for c in range(count):
            nothing -= sigma[c, w]
        sigma[0, w] = max(nothing, 0.0)
        share += weight[i, w] * sigma[0, w]
    for w in range(waves):
        weight[i, w] *= sigma[0, w] * total / share if share > 0.0 else 0.0
    return -1


@njit(cache=True, nogil=True, error_model="numpy")
def thinned(varied, p, d, t, passed, states, i, sigma):
    """Whether light is left after a way of length t in a medium that varies: passed (L,) loses its share (ratio tracking)."""
    distance, most = 0.0, varied.most
    while True:
        distance -= math.log1p(-uniform(states, i)) / most
        if distance >= t:
            return True
        extinctions_at(varied, p[0] + distance * d[0], p[1] + distance * d[1], p[2] + distance * d[2], sigma)
        largest = 0.0
        for w in range(len(passed)):
            null_sigma = most
            for c in range(len(sigma)):
                null_sigma -= sigma[c, w]
            passed[w] *= max(null_sigma, 0.0) / most
            largest = max(largest, passed[w])
        if largest < _FAINT:
            ends = uniform(states, i) < 0.5
            for w in range(len(passed)):
                passed[w] *= 0.0 if ends else 2.0
            if ends:
                return False


@njit(cache=True, nogil=True, error_model="numpy")
def grain_at(varied, p, states, i, sigma):
    """Which component a grain is of that light meets at p (3,), by their extinction, that of all wavelengths."""
    extinctions_at(varied, p[0], p[1], p[2], sigma)
    chosen, last = uniform(states, i) * sigma.sum(), len(sigma) - 1
    for c in range(last):
        chosen -= sigma[c].sum()
        if chosen < 0.0:
            return c
    return last
