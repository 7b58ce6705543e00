"""Light that has been scattered once, exactly: a single integral over the scattering angle for any phase table.

A photon that leaves the axis at an angle theta and meets the point at depth z, distance r, has flown z - r cot(theta) before and
r / sin(theta) after the event, so (cot and sine cancel into one tangent)

    Psi_1 = albedo e^-z / r * integral of p(theta) e^(-r tan(theta/2)) dtheta from arctan(r/z) to pi;   flux: times |cos theta|.
"""

import math
from dataclasses import dataclass

import numpy as np

from bakery.physics.medium import phase as tables
from bakery.system.compiled import njit

# Ranges of the angle forward and back; within one the exponential is taken at the mean tangent: 1e-4 at most.
_BINS, _BACK = 720, 180


@dataclass(frozen=True)
class Line:
    """A phase table summed over ranges of theta (not of solid angle)."""

    theta: np.ndarray  # (N + 1,) rad, edges of the ranges
    edge: np.ndarray  # (N + 1,) 1/sr, p at the edges
    weight: np.ndarray  # (2, N) 1/sr rad, integral of p, and of p |cos theta|
    tangent: np.ndarray  # (N,) tan(theta/2), mean weighted with p
    forward: int  # number of ranges below pi/2


def line(theta, phase) -> Line:
    """Sums of a phase table over theta, exact for the interpolant that is linear in cos theta.

    theta, phase : (A,) rad, 1/sr, ascending from 0 (forward) to pi
    """
    theta, phase = np.asarray(theta, float), np.asarray(phase, float)
    # half of all light within this angle or more: far below it nothing changes any more
    small = 1e-4 * min(theta[1], float(np.interp(0.5, tables.cumulative(theta, phase), theta)))
    ahead = np.concatenate([[0.0], np.geomspace(small, math.pi / 2, _BINS)])
    edges = np.concatenate([ahead[:-1], np.linspace(math.pi / 2, math.pi, _BACK + 1)])
    pieces = np.union1d(theta, edges)
    pieces = pieces[(pieces >= 0) & (pieces <= math.pi)]
    x, w = np.polynomial.legendre.leggauss(4)
    at = (pieces[:-1, None] + pieces[1:, None] + np.diff(pieces)[:, None] * x) / 2
    value = tables.phase_at(theta, phase, at) * w * np.diff(pieces)[:, None] / 2
    bin_of = np.clip(np.searchsorted(edges, at[:, 0], side="right") - 1, 0, len(edges) - 2)

    def total(values):
        return np.bincount(bin_of, values.sum(axis=1), len(edges) - 1)

    # tan(theta/2) has a pole at pi, where e^(-r tan) is nothing: the last range is cut there
    tangent = np.minimum(np.tan(at / 2), 1e6)
    weight = np.array([total(value), total(value * np.abs(np.cos(at)))])
    middle = np.tan((edges[1:] + edges[:-1]) / 4)
    mean = np.divide(total(value * tangent), weight[0], out=middle, where=weight[0] > 0)
    return Line(edges, tables.phase_at(theta, phase, edges), weight, mean, len(ahead) - 1)


def single(albedo, line: Line, depth, r):
    """Light scattered once.

    albedo : 1
    depth, r : mfp, r > 0; broadcast against each other

    Returns forward, back : (2, ...) mfp^-2, fluence and flux of the light that travels forward, and back, of the shape of depth
        and r
    """
    depth, r = np.broadcast_arrays(np.asarray(depth, float), np.asarray(r, float))
    out = np.empty((2, 2, depth.size))
    _single(np.array(depth, order="C").ravel(), np.array(r, order="C").ravel(), line.theta, line.edge, line.weight,
            line.tangent, line.forward, out)
    out *= albedo
    return tuple(out.reshape(2, 2, *depth.shape))


@njit(cache=True, nogil=True, error_model="numpy")
def _single(depth, r, theta, edge, weight, tangent, forward, out):
    """out: forward and back; fluence and flux; points."""
    bins = len(tangent)
    for n in range(len(depth)):
        least = math.atan2(r[n], depth[n])
        first = min(max(np.searchsorted(theta, least, side="right") - 1, 0), bins - 1)
        out[:, :, n] = 0.0
        over = math.exp(-depth[n]) / r[n]
        for j in range(first, bins):
            light, through, middle = weight[0, j], weight[1, j], tangent[j]
            if j == first:  # what is left of it, as if p were linear
                share = (theta[j + 1] - least) / (theta[j + 1] - theta[j])
                low, high = edge[j], edge[j + 1]
                light *= share * (1 + (1 - share) * (high - low) / (high + low) if high + low > 0 else 1.0)
                through = light * abs(math.cos(0.5 * (least + theta[j + 1])))
                middle = math.tan(0.25 * (least + theta[j + 1]))
            thickness = r[n] * middle
            if thickness > 60:
                break
            damped = math.exp(-thickness) * over
            side = 0 if j < forward else 1
            out[side, 0, n] += damped * light
            out[side, 1, n] += damped * through
