"""A phase function as the small-angle model sees it: on a plane of angles, through its Fourier transform.

The sphere is laid on the plane by s = 2 sin(theta/2), which keeps solid angles, so any phase function stays normalised; P(q) is
the transform of p(s), P(0) = 1, and nearly the Legendre moment of order q - 1/2.  Only two integrals of it are needed:

    mean(q) = 1/q * integral of P from 0 to q,        beyond(t) = integral of p from t to infinity.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import interpolate, optimize, special

from bakery.physics.medium import phase as tables

_BINS = 400  # of the angle, from far below its median
_RESOLVED = 300.0  # wave number times angle


@dataclass(frozen=True)
class Planar:
    """mean(q) and beyond(t) take arrays; `width` (rad) is where P(1/width) = 1/e."""

    mean: Callable
    beyond: Callable
    width: float

    @property
    def B(self) -> float:
        """rad^2, of the Gaussian with the same 1/e point of the transform; for heavy tails better than the mean square angle."""
        return self.width**2


def table(theta, phase) -> Planar:
    """Any phase table.

    theta : (A,) rad, ascending from 0 (forward) to pi
    phase : (A,) 1/sr, linear in cos theta between the angles, normalised
    """
    s, light, s_edges, beyond_edges = _groups(theta, phase)
    # computed once: smooth in log q, 1 below and 1/q above
    log_q = np.linspace(math.log(1e-4), math.log(1e6 / s[np.searchsorted(np.cumsum(light), 0.5)]), 1000)
    node = np.empty(len(log_q))
    for i, q in enumerate(np.exp(log_q)):
        # integral of J_0 from 0 to y: 1 and waves that cancel, which are faded out before the groups are too coarse for them
        y = q * s
        waves = special.itj0y0(np.minimum(y, _RESOLVED))[0] - 1
        fading = 0.5 + 0.5 * np.cos(math.pi * (np.clip(y / _RESOLVED, 0.25, 1.0) - 0.25) / 0.75)
        node[i] = np.sum(light * np.where(y > 1e-6, (1 + waves * fading) / np.where(y > 0, y, 1.0), 1.0))
    spline = interpolate.CubicSpline(log_q, np.log(node / node[0]))

    def mean(q):
        x = np.log(np.maximum(np.asarray(q, float), 1e-300))
        return np.exp(spline(np.clip(x, log_q[0], log_q[-1])) - np.maximum(x - log_q[-1], 0.0))

    def beyond(t):
        return np.interp(t, s_edges, beyond_edges, right=0.0)

    return Planar(mean, beyond, _width(s, light))


def width(theta, phase) -> float:
    """`Planar.width` of a phase table, rad, without the rest."""
    return _width(*_groups(theta, phase)[:2])


def _groups(theta, phase):
    """s and power of groups of the light of a phase table; edges of s, and the integral of p beyond them."""
    theta, phase = np.asarray(theta, float), np.asarray(phase, float)
    median = float(np.interp(0.5, tables.cumulative(theta, phase), theta))
    edges = np.concatenate([[0.0], np.geomspace(1e-4 * min(theta[1], median), math.pi, _BINS)])
    edges = np.union1d(edges[:-1], theta)
    edges = edges[(edges >= 0) & (edges <= math.pi)]
    x, w = np.polynomial.legendre.leggauss(4)
    at = (edges[:-1, None] + edges[1:, None] + np.diff(edges)[:, None] * x) / 2
    value = tables.phase_at(theta, phase, at) * w * np.diff(edges)[:, None] / 2
    s = 2 * np.sin(at / 2).ravel()
    light = (2 * math.pi * value * np.sin(at)).ravel()
    s_edges = 2 * np.sin(edges / 2)
    beyond_edges = np.append(np.cumsum((value * np.cos(at / 2)).sum(axis=1)[::-1])[::-1], 0.0)
    if len(s) > 4 * _BINS:  # many angles: neighbours together, each group at its mean square angle
        group = np.unique(np.searchsorted(np.geomspace(s[0], 2.0, 4 * _BINS), s), return_inverse=True)[1]
        together = np.bincount(group, light)
        s = np.sqrt(np.divide(np.bincount(group, light * s * s), together, out=np.bincount(group, s * s) / np.bincount(group),
                              where=together > 0))
        light = together
    return s, light, s_edges, beyond_edges


def _width(s, light) -> float:
    """1/q where the transform falls to 1/e: the first such q, found from small ones upwards."""
    def transform(q):
        return float(np.sum(light * special.j0(q * s)))

    steps = 0.1 / float(np.sqrt(np.sum(light * s * s))) * 1.1 ** np.arange(400)
    falls = next(i for i, q in enumerate(steps) if transform(q) < math.exp(-1))
    return 1 / optimize.brentq(lambda q: transform(q) - math.exp(-1), steps[falls - 1], steps[falls])
