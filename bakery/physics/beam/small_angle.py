"""The small-angle beam without further approximation: one Hankel transform for any phase function, homogeneous or layered.

With angles on a plane and depth for length of path, light that is scattered at z' moves off the axis by (z - z') s.  The
transform of Psi over the plane is therefore e^-tau (e^E - 1) with E(kappa) = integral of sigma_s P(kappa (z - z')) dz'.
Homogeneous: E = S mean(kappa z), so that Psi z^2 depends on S = sigma_s z and r/z only, whatever the phase function.
Single scattering has a closed form, a sharp 1/r; the transform takes the rest, e^E - 1 - E.
"""

import math

import numpy as np
from scipy import fft, interpolate

from bakery.physics.beam import moments
from bakery.physics.beam.planar import Planar

_PER_DECADE = 48
_REACH = 1e6  # of kappa about 1 over the width
_FLOOR = 1e-6


def homogeneous(planar: Planar, albedo, depth, ratio, absorb=False):
    """The kernel.

    planar : phase function
    albedo : 0 to 1
    depth : (D,) mfp, > 0
    ratio : (U,) r/depth, > 0
    absorb : whether longer paths are absorbed more (see `moments.absorbed`)

    Returns (D, U) mfp^-2; its integral over the plane is M0 within 1e-4 (times the weight of `absorbed`)
    """
    depth, ratio = np.atleast_1d(np.asarray(depth, float)), np.asarray(ratio, float)
    S = albedo * depth
    q, t = _grid(planar.width)
    mean = planar.mean(q)
    weight, shrink = np.ones_like(depth), np.ones_like(depth)
    if absorb:
        weight, shrink = moments.absorbed(depth, albedo, 1 - albedo, planar.B)
    out = np.empty((len(depth), len(ratio)))
    for i, z in enumerate(depth):
        scaled = ratio / math.sqrt(shrink[i])
        remainder = _transformed(q, t, _remainder(S[i], mean), scaled)
        once = S[i] * math.exp(-S[i]) * planar.beyond(scaled) / scaled
        out[i] = math.exp(-(1 - albedo) * z) * weight[i] / (shrink[i] * z * z) * (remainder + once)
    return out


def layered(planar: Planar, albedo, edges, density, r, once=True):
    """The kernel behind layers of constant density, at the last edge.

    planar : phase function
    albedo : 0 to 1
    edges : (N + 1,) ascending, of the layers, from where the beam enters to the plane; mfp at density 1
    density : (N,) >= 0
    r : (R,) > 0
    once : whether light that was scattered once is counted too

    Returns (R,) mfp^-2
    """
    edges, density, r = (np.asarray(x, float) for x in (edges, density, r))
    sigma = albedo * density
    S = float(np.sum(sigma * np.diff(edges)))
    out = np.zeros_like(r)
    if S == 0:
        return out
    near, far = (edges[-1] - edges[1:]), (edges[-1] - edges[:-1])
    scale = math.sqrt(3 * moments.layered_levers(edges, sigma)[1][-1] / S)  # depth of the homogeneous medium that is most like it
    q, t = _grid(planar.width)
    kappa = q / scale
    E = np.zeros_like(kappa)
    for a, b, s in zip(near, far, sigma, strict=True):
        if s > 0:
            E += s * (b * planar.mean(kappa * b) - (a * planar.mean(kappa * a) if a > 0 else 0.0))
            out += s * once * (planar.beyond(r / b) - (planar.beyond(r / a) if a > 0 else 0.0))
    out *= math.exp(-S) / r
    transmitted = math.exp(-(1 - albedo) * float(np.sum(density * np.diff(edges))))
    return transmitted * (out + _transformed(q, t, _remainder(S, E / S), r / scale) / scale**2)


def _grid(width):
    """Wave numbers of the ratio r/z about 1/width, and the ratios that belong to them.

    A narrow peak may have a tail to ratios of 2, which small wave numbers carry.
    """
    low, high = min(1 / (_REACH * width), 0.1 / _REACH), _REACH / width
    q = np.geomspace(low, high, round(math.log10(high / low) * _PER_DECADE))
    return q, 1 / q[::-1]


def _remainder(S, mean):
    """e^-S (e^(S mean) - 1 - S mean), every digit kept for small and large S."""
    x = S * mean
    series = x * x / 2 * (1 + x / 3 * (1 + x / 4 * (1 + x / 5 * (1 + x / 6 * (1 + x / 7)))))
    with np.errstate(over="ignore", invalid="ignore"):
        return np.where(x < 0.1, np.exp(-S) * series, np.exp(-S * (1 - mean)) - np.exp(-S) * (1 + x))


def _transformed(q, t, h, ratio):
    """1/(2 pi) integral of q h(q) J_0(q ratio) dq.

    Beyond 1e-6 of the largest t^2 times it, or where that rises below 1e-5, rounding shows (it grows as t): the last slope is
    continued.
    """
    inner = slice(_PER_DECADE, -_PER_DECADE)  # the transform repeats itself at its ends
    at, log_t = t[inner], np.log(t[inner])
    # A Gaussian with all of the power is transformed by hand: what is left falls as q^3 at small q, as 1/q at large q; with a
    # bias of 0.7 both ends, where the transform jumps, are 1e-9 of the middle or less.
    width = 1 / np.interp(-0.5 * h[0], -h, q)
    sharp = fft.fht(q * (h - h[0] * np.exp(-np.square(q * width))), math.log(q[1] / q[0]), 0.0, 0.0, 0.7)[inner] / (2 * math.pi)
    sharp += at * h[0] / (4 * math.pi * width * width) * np.exp(-np.square(at / width) / 4)  # t times the result
    rings = sharp * at
    top = int(np.argmax(rings))
    if not rings[top] > 0:  # nothing scatters, or twice so rarely that no double has it
        return np.zeros_like(ratio)
    tail = rings[top:] / rings[top]
    low = np.flatnonzero((tail < _FLOOR) | ((tail < 10 * _FLOOR) & (np.diff(tail, prepend=np.inf) > 0)))
    last = top + int(low[0]) - 1 if low.size else len(at) - 1
    slope = math.log(sharp[last] / sharp[last - 2]) / (log_t[last] - log_t[last - 2]) if last >= top + 2 else -2.0
    slope = min(slope, -2.0)
    # smooth in log t; towards the axis it rises as the logarithm, or not at all
    x = np.log(np.clip(ratio, at[0], None))
    inside = interpolate.CubicSpline(log_t[:last + 1], sharp[:last + 1])(np.minimum(x, log_t[last]))
    return np.maximum(inside, 0.0) * np.exp(slope * np.maximum(x - log_t[last], 0.0)) / ratio
