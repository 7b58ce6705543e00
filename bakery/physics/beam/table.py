"""A kernel as a table over depth and the ratio of r to it, and its look-up in some fifty nanoseconds.

What is stored is r z Psi, a pure number without the 1/r of single scattering, on equal steps of log z and log(r/z).  At shallow
depths it is z times a function of the ratio alone, so the table begins where that holds.
"""

import math
from dataclasses import dataclass

import numpy as np

from bakery.system.compiled import njit

FIRST = 1e-3  # mfp, smallest depth of a table; shallower ones are scaled from it: 1e-3 is lost there
PER_DECADE = (16, 18)  # steps of depth, of the ratio
_INNER = 1e-3  # smallest ratio over the width; nearer to the axis r Psi is constant or rises as a power
_OUTER = 60.0  # mfp, largest r at the smallest depth
_NEVER = -690.0  # logarithm of what counts as nothing
_SWING = 0.5  # of a logarithm; more than any smooth table needs between two nodes
_BACK = 30.0  # ratio beyond which the light at shallow depths has forgotten the depth


@dataclass(frozen=True)
class Table:
    """A kernel."""

    depth: np.ndarray  # (D,) mfp, equal steps of the logarithm
    ratio: np.ndarray  # (U,) r/depth, equal steps of the logarithm
    value: np.ndarray  # (D, U) 1, r depth Psi

    def __post_init__(self):
        value = np.asarray(self.value, float)
        step = math.log(self.ratio[1] / self.ratio[0])
        object.__setattr__(self, "_log", np.log(np.maximum(value, 1e-300)))
        # power within a radius, 2 pi integral of r Psi: constant below the first ratio, cubic between the others
        g = 2 * math.pi * value * self.ratio
        middle = (13 * (g[:, 1:-2] + g[:, 2:-1]) - g[:, :-3] - g[:, 3:]) / 24
        middle = np.where(middle > 0, middle, (g[:, 1:-2] + g[:, 2:-1]) / 2)
        cells = np.concatenate([(g[:, :1] + g[:, 1:2]) / 2, middle, (g[:, -2:-1] + g[:, -1:]) / 2], axis=1) * step
        within = np.concatenate([np.zeros((len(g), 1)), np.cumsum(cells, axis=1)], axis=1) + g[:, :1]
        object.__setattr__(self, "_log_within", np.log(np.maximum(within, 1e-300)))

    def kernel(self, depth, r):
        """Psi, mfp^-2, at depths (mfp, >= 0) and distances r > 0 from the axis; broadcast.

        Raises ValueError : deeper than the table, or negative
        """
        return self._look(depth, r, False)

    def within(self, depth, r):
        """Power within r of the axis, 1: the integral of 2 pi r Psi from 0 to r; r = inf for all that the table holds."""
        return self._look(depth, r, True)

    def stretched(self, tau, effective, r):
        """Psi behind a layered density: that of the homogeneous medium with the same M0 and M2/M0.

        tau : optical depth
        effective : sqrt(3 S_2/S_0), length; with all density at the near end it is sqrt(3) times the distance, at the plane 0
        r : the same unit of length

        Returns Psi, 1 over that unit squared
        """
        scale = np.asarray(tau, float) / effective
        return self.kernel(tau, r * scale) * scale**2

    def rings(self, depth, edges):
        """Psi averaged over rings, (..., R) mfp^-2 at depth (...,) between edges (R + 1,) mfp."""
        edges = np.asarray(edges, float)
        power = self.within(np.asarray(depth, float)[..., None], edges)
        return np.diff(power, axis=-1) / (math.pi * np.diff(edges**2))

    def _look(self, depth, r, within):
        depth, r = np.broadcast_arrays(np.asarray(depth, float), np.asarray(r, float))
        if not ((depth >= 0) & (depth <= self.depth[-1] * (1 + 1e-12)) & (r >= 0)).all():
            raise ValueError(f"depths lie between 0 and {self.depth[-1]:g} mean free paths, distances are not negative")
        out = np.empty(depth.size)
        _look_up(self.depth, self.ratio, self._log_within if within else self._log, self._log,
                 np.array(depth, order="C").ravel(), np.array(r, order="C").ravel(), within, out)
        return out.reshape(depth.shape)


def grid(depth, width):
    """Nodes of a table.

    depth : mfp, the deepest
    width : rad, of the phase function (`planar.Planar.width`)

    Returns depth (D,) mfp, ratio (U,)
    """
    first = min(FIRST, depth / 10)
    inner, outer = min(_INNER * width, 1e-3), _OUTER / first
    return (np.geomspace(first, depth, 1 + math.ceil(PER_DECADE[0] * math.log10(depth / first))),
            np.geomspace(inner, outer, 1 + math.ceil(PER_DECADE[1] * math.log10(outer / inner))))


@njit(cache=True, nogil=True, error_model="numpy")
def _four(a, b, c, d, f):
    """Cubic through values at 0, 1, 2, 3; linear between the nearest two where one of the four is nothing."""
    low, high, share = (b, c, f - 1) if 1 <= f <= 2 else ((a, b, f) if f < 1 else (c, d, f - 2))
    if min(min(a, b), min(c, d)) <= _NEVER:
        return low + share * (high - low) if share < 1 else high
    cubic = (-(f - 1) * (f - 2) * (f - 3) * a + 3 * f * (f - 2) * (f - 3) * b - 3 * f * (f - 1) * (f - 3) * c
            + f * (f - 1) * (f - 2) * d) / 6
    # beside the last values above nothing the fall is so steep that a cubic swings up by factors of 1e7
    return min(max(cubic, min(low, high) - _SWING), max(low, high) + _SWING)


@njit(cache=True, nogil=True, error_model="numpy")
def _at(x, y, i_last, j_last, log_value):
    i, j = min(max(int(x) - 1, 0), i_last - 3), min(max(int(y) - 1, 0), j_last - 3)
    f = y - j
    return _four(_four(log_value[i, j], log_value[i, j + 1], log_value[i, j + 2], log_value[i, j + 3], f),
                 _four(log_value[i + 1, j], log_value[i + 1, j + 1], log_value[i + 1, j + 2], log_value[i + 1, j + 3], f),
                 _four(log_value[i + 2, j], log_value[i + 2, j + 1], log_value[i + 2, j + 2], log_value[i + 2, j + 3], f),
                 _four(log_value[i + 3, j], log_value[i + 3, j + 1], log_value[i + 3, j + 2], log_value[i + 3, j + 3], f), x - i)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _power(logarithm):
    return math.exp(logarithm) if logarithm > _NEVER else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _look_up(depths, ratios, log_value, log_kernel, depth, r, within, out):
    first, lowest = math.log(depths[0]), math.log(ratios[0])
    down = 1 / (math.log(depths[1]) - first)
    across = 1 / (math.log(ratios[1]) - lowest)
    i_last, j_last = len(depths) - 1, len(ratios) - 1
    for n in range(len(depth)):
        z, distance = depth[n], r[n]
        scale = 1.0
        if z == 0.0 or distance == 0.0:
            # nothing is scattered at once; on the axis the kernel is infinite, the power within is none
            out[n] = 0.0 if within or z == 0.0 else math.inf
            continue
        if z < depths[0]:
            # light near the axis scales with the depth; farther out it is that of depth 0, 1/r in between
            scale, seam = z / depths[0], _BACK * depths[0]
            if within and distance > _BACK * z:
                y = (math.log(_BACK) - lowest) * across
                inner = _power(_at(0.0, y, i_last, j_last, log_value))
                total = scale * inner
                constant = 2 * math.pi * _power(_at(0.0, y, i_last, j_last, log_kernel)) / depths[0]
                total += constant * (min(distance, seam) - _BACK * z)
                if distance > seam:
                    y = min((math.log(distance / depths[0]) - lowest) * across, float(j_last))
                    total += _power(_at(0.0, y, i_last, j_last, log_value)) - inner
                out[n] = total
                continue
            distance, z = max(distance, min(distance / scale, seam)), depths[0]
        ratio = distance / z
        x = (math.log(z) - first) * down
        y = (math.log(ratio) - lowest) * across
        if y > j_last:
            out[n] = scale * _power(_at(x, float(j_last), i_last, j_last, log_value)) if within else 0.0
            continue
        value = _at(x, max(y, 0.0), i_last, j_last, log_value)
        if y < 0:
            # a power of r: r Psi is constant where single scattering leads, rises where it is gone
            least = 1 / across if within else 0.0
            value += y * min(max(_at(x, 1.0, i_last, j_last, log_value) - value, least), least + 1 / across)
        # r z Psi goes with the depth below the first one
        out[n] = scale * _power(value) / (1.0 if within else r[n] * depth[n])
