"""Fourier orders in azimuth of a phase function between directions."""

import math

import numpy as np

from bakery.system.compiled import njit


def harmonics(mu, order: int, count: int):
    """Normalised associated Legendre functions sqrt((l-m)!/(l+m)!) P_l^m(mu), without the sign (-1)^m.

    mu : (N,)
    order : m
    count : degrees l below this one

    Returns (count - m, N) for l = m, m + 1, ...
    """
    mu = np.ascontiguousarray(mu, float)
    values = np.zeros((max(count - order, 0), len(mu)))
    if not len(values):
        return values
    values[0] = math.sqrt(math.comb(2 * order, order) / 4**order) * ((1 - mu) * (1 + mu)) ** (order / 2)
    _upward(mu, order, values)
    return values


@njit(cache=True, nogil=True, error_model="numpy")
def _upward(mu, order, values):
    """All rows from the first one, by recurrence over the degree."""
    for row in range(len(values) - 1):
        degree = row + order
        last, scale = math.sqrt(degree**2 - order**2), math.sqrt((degree + 1) ** 2 - order**2)
        for k in range(len(mu)):
            before = last * values[row - 1, k] if row else 0.0
            values[row + 1, k] = ((2 * degree + 1) * mu[k] * values[row, k] - before) / scale


def phase_matrices(moments, mu, order: int):
    """Even and odd part of the phase function of one Fourier order between the directions mu (N,), each (N, N).

    Their sum is the phase function between directions of one hemisphere, their difference between opposite ones; its integral
    over the sphere is 4 pi.
    """
    values = harmonics(mu, order, len(moments))
    weights = (2 * np.arange(order, len(moments)) + 1) * moments[order:]
    even = (values[::2].T * weights[::2]) @ values[::2]
    odd = (values[1::2].T * weights[1::2]) @ values[1::2]
    return even, odd


def unresolved(moments, mu, flux):
    """(N,) what nodes too few for a forward peak miss of it, as a delta function: to be added to the diagonals of both parts.

    It is the same in all orders.  With it the phase function of order 0 has the integral 1 over the nodes: nothing is lost.
    Nodes over the root of the cosine resolve the peak at grazing angles, where it matters, and not where it hardly does.
    """
    weight = 0.5 * flux / mu
    return (1 - phase_matrices(moments, mu, 0)[0] @ weight) / weight
