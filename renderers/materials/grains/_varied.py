"""Collisions in a medium of which there is more in some places than in others (`bakery.kernels.Varied`)."""

import math

from bakery.kernels import extinctions_at
from bakery.system.compiled import njit
from renderers.transport.scattering import lessened
from renderers.transport.wavefront import uniform


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
    distance = 0.0
    while True:
        distance -= math.log1p(-uniform(states, i)) / varied.most
        if distance >= t:
            return True
        extinctions_at(varied, p[0] + distance * d[0], p[1] + distance * d[1], p[2] + distance * d[2], sigma)
        for c in range(1, len(sigma)):
            for w in range(len(passed)):
                sigma[0, w] += sigma[c, w]
        if not lessened(passed, sigma[0], 1.0, varied.most, states, i):
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
