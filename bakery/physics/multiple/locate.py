"""Kernels of `frame`: where a position and a direction lie in the plane and the square of a table.

Every difference that could cancel is formed as rho^2 over a sum.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from bakery.physics.multiple import frame
from bakery.physics.multiple.kinds import POINT


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def place(kind, length, rho, z):
    """m, tan(angle/2), the singular part, sine and cosine of the axis.

    Parameters
    ----------
    kind : POINT or SEGMENT
    length : of the segment, mfp
    rho, z : mfp, rho >= frame.CLOSEST
    """
    square = rho * rho
    r1 = math.sqrt(square + z * z)
    if z > 0:
        plus1 = r1 + z
        minus1 = square / plus1
    else:
        minus1 = r1 - z
        plus1 = square / minus1
    if kind == POINT:
        return r1, rho / plus1, 1 / r1, rho / r1, z / r1
    after = z - length
    r2 = math.sqrt(square + after * after)
    if after > 0:
        plus2 = r2 + after
        minus2 = square / plus2
    else:
        minus2 = r2 - after
        plus2 = square / minus2
    beyond = minus1 + plus2  # r1 + r2 - length
    m = math.sqrt(beyond * (2 * length + beyond)) / 2
    tangent = math.sqrt((minus1 + minus2) / (plus1 + plus2))
    return m, tangent, math.log(1 + 2 * length / beyond), rho / r1, z / r1


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def direction(sine, cosine, x, y, z):
    """s, t of a direction of travel (x along rho, y across, z) in the frame whose axis has this sine and cosine to +z."""
    forward, side = x * sine + z * cosine, z * sine - x * cosine
    across = math.sqrt(side * side + y * y)
    s = (2 / math.pi) * math.atan2(frame.SHARP * across, 1 + forward if forward > 0 else across * across / (1 - forward))
    return s, math.atan2(abs(y), side) / math.pi


def measure(kind, length, rho, z):
    """m (see `frame`) and the singular part at positions."""
    rho, z = np.broadcast_arrays(np.asarray(rho, float), np.asarray(z, float))
    m, singular = _measure(kind, length, rho.ravel(), z.ravel())
    return m.reshape(rho.shape), singular.reshape(rho.shape)


@njit(cache=True, nogil=True, error_model="numpy")
def _measure(kind, length, rho, z):
    m, singular = np.empty(len(rho)), np.empty(len(rho))
    for n in range(len(rho)):
        m[n], _, singular[n], _, _ = place(kind, length, max(rho[n], frame.CLOSEST), z[n])
    return m, singular
