"""Legendre moments of a phase table, and how many of them are needed.

p_l = 2 pi int f(mu) P_l(mu) dmu with mu = cos theta: p_0 = 1, p_1 = g.
"""

import math

import numpy as np

from bakery.physics.multiple.backward import SHARE
from bakery.system.compiled import njit

_GAUSS = 10  # points of a piece of the table
_PIECE = 2.0  # order * width of a piece in rad: ten points are then exact to rounding


def moments(theta, phase, order):
    """Legendre moments of a table that is linear in cos theta, exact for that interpolant.

    theta : (A,) rad, ascending from 0 (forward) to pi
    phase : (A,) 1/sr, integrates to 1 over the sphere
    order : highest moment

    Returns (order + 1,) 1, within 1e-13

    Gauss-Legendre on pieces short enough for P_order, with P_l from its recurrence in v = 1 - cos theta: moments of a peak of
    1e-4 rad keep their digits.
    """
    theta, phase = np.asarray(theta, float), np.array(phase, float)  # a copy, as that of an asset is read-only
    pieces = np.maximum(1, np.ceil(np.diff(theta) * max(order, 1) / _PIECE)).astype(int)
    first = np.repeat(np.arange(len(pieces)), pieces)
    part = np.arange(len(first)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    width = np.diff(theta)[first] / pieces[first]
    low = theta[first] + part * width
    right = np.where(part == pieces[first] - 1, theta[first + 1], low + width)
    whole = _drop(theta[:-1], theta[1:])[first]
    x, weight = np.polynomial.legendre.leggauss(_GAUSS)
    return _moments(2 * np.sin(low / 2) ** 2, _drop(low, right), _drop(theta[first], low) / whole, _drop(low, right) / whole,
                    phase, first, x, weight, order)


def _drop(a, b):
    """cos a - cos b to full relative precision."""
    return 2 * np.sin((a + b) / 2) * np.sin((b - a) / 2)


def henyey_greenstein(g, order):
    """g^l, (order + 1,)."""
    return float(g) ** np.arange(order + 1)


def order_needed(p, tolerance=2e-4):
    """Smallest L beyond which no moment exceeds the tolerance; None where the last given one still does.

    At 2e-4 the directions behind the source, a thousand times darker than the brightest, are right as well; 5e-3 is enough in
    front of it.
    """
    large = np.flatnonzero(np.abs(np.asarray(p, float)) > tolerance)
    last = int(large[-1]) if large.size else 0
    return None if last == len(p) - 1 and last > 0 else last


def refuse_backward(p, order):
    """ValueError where moments beyond `order` alternate: light in a narrow backward peak, which cannot count as unscattered."""
    backward = abs(float(np.asarray(p, float)[order + 1:order + 4] @ np.array([0.25, -0.5, 0.25])))
    if backward > SHARE:
        raise ValueError(f"the phase function has a narrow peak backward ({backward:.2g} of the light) that {order} moments do "
                         "not resolve; only forward peaks can be left out (photons can follow both)")


@njit(cache=True, nogil=True, error_model="numpy")
def _moments(low, width, share_left, share_width, f, first, x, weight, order):
    """Pieces from v = left on, `width` wide; share of their angle interval where they begin, and that they take."""
    total = np.zeros(order + 1)
    v, value, p, step = np.empty(len(x)), np.empty(len(x)), np.empty(len(x)), np.empty(len(x))
    for piece in range(len(low)):
        i = first[piece]
        for n in range(len(x)):
            t = 0.5 * (1 + x[n])
            v[n] = low[piece] + t * width[piece]
            share = share_left[piece] + t * share_width[piece]
            value[n] = (f[i] + share * (f[i + 1] - f[i])) * weight[n] * 0.5 * width[piece] * 2 * math.pi
            p[n], step[n] = 1.0, 0.0
            total[0] += value[n]
        for l in range(order):
            # P_(l+1) - P_l from the difference before it: no rounding of 1 - v; all points of a piece side by side, for vectors
            for n in range(len(x)):
                step[n] = (l * step[n] - (2 * l + 1) * v[n] * p[n]) / (l + 1)
                p[n] += step[n]
            for n in range(len(x)):
                total[l + 1] += value[n] * p[n]
    return total
