"""Phase functions inside compiled loops: a table laid out for them, values, samples, turns of a direction.

All is in v = 1 - cos theta, which keeps its digits in a forward peak; between the nodes phase functions are linear in it.
"""

import math

import numpy as np

from bakery.physics.medium import phase
from bakery.system.compiled import njit


def phase_layout(theta, f):
    """A normalised phase table for compiled loops.

    Parameters
    ----------
    theta : (A,) rad, ascending from 0 (forward) to pi
    f : (A,) 1/sr, integral over the sphere 1

    Returns
    -------
    v : (A,) 1 - cos theta
    steps : (A - 1,) differences of v, to full relative precision
    f : (A,) as given
    cdf : (A,) probability of a smaller angle
    """
    theta, f = np.asarray(theta, float), np.array(f, float, order="C")
    return 2 * np.sin(theta / 2) ** 2, phase.steps(theta), f, phase.cumulative(theta, f)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def phase_value(v_nodes, steps, f, v):
    """Phase function (1/sr) at v = 1 - cos theta, 0 to 2; arrays of `phase_layout`."""
    i = min(max(np.searchsorted(v_nodes, v, side="right") - 1, 0), len(steps) - 1)
    share = min(max((v - v_nodes[i]) / steps[i], 0.0), 1.0)
    return f[i] + share * (f[i + 1] - f[i])


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def phase_sample(v_nodes, steps, f, cdf, xi):
    """v = 1 - cos theta of a scattering angle distributed as the table, from a uniform number xi in [0, 1)."""
    # the cumulative distribution is a quadratic in v between the nodes
    i = min(max(np.searchsorted(cdf, xi, side="right") - 1, 0), len(steps) - 1)
    slope = (f[i + 1] - f[i]) / steps[i]
    c = (xi - cdf[i]) / (2 * math.pi)
    root = f[i] + math.sqrt(max(f[i] ** 2 + 2 * slope * c, 0.0))
    return v_nodes[i] + (min(max(2 * c / root, 0.0), steps[i]) if root > 0 else 0.0)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def turned_direction(ux, uy, uz, v, turn):
    """Unit direction u after a turn by an angle of 1 - cos = v, at azimuth `turn` (rad) about the old direction."""
    sine = math.sqrt(max(v * (2 - v), 0.0))
    a, b = sine * math.cos(turn), sine * math.sin(turn)
    # a frame about u without a special case (Duff et al. 2017)
    sign = math.copysign(1.0, uz)
    s = -1 / (sign + uz)
    t = ux * uy * s
    nx = a * (1 + sign * ux * ux * s) + b * t + (1 - v) * ux
    ny = a * sign * t + b * (sign + uy * uy * s) + (1 - v) * uy
    nz = -a * sign * ux - b * uy + (1 - v) * uz
    norm = 1 / math.sqrt(nx * nx + ny * ny + nz * nz)
    return nx * norm, ny * norm, nz * norm
