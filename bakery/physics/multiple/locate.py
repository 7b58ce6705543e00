"""Kernels of `frame`: where a position and a direction lie in the plane and the square of a table.

Every difference that could cancel is formed as rho^2 over a sum.
"""

import math

import numpy as np

from bakery.physics.multiple import frame
from bakery.physics.multiple.kinds import POINT
from bakery.system.compiled import njit


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def distances(kind, length, rho, z):
    """m^2, numerator and denominator of tan^2(angle/2), r1 + r2 - length (r1 for a point), 1/r1: what `place` is made of.

    kind : POINT or SEGMENT;  length : of the segment, mfp;  rho, z : mfp, rho >= frame.CLOSEST
    """
    square = rho * rho
    r1 = math.sqrt(square + z * z)
    long1 = r1 + abs(z)
    short1 = square / long1
    plus1, minus1 = (long1, short1) if z > 0 else (short1, long1)
    if kind == POINT:
        return square + z * z, minus1, plus1, r1, 1 / r1
    after = z - length
    long2 = math.sqrt(square + after * after) + abs(after)
    short2 = square / long2
    plus2, minus2 = (long2, short2) if after > 0 else (short2, long2)
    beyond = minus1 + plus2
    return beyond * (2 * length + beyond) / 4, minus1 + minus2, plus1 + plus2, beyond, 1 / r1


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def place(kind, length, rho, z):
    """m, tan(angle/2), the singular part, sine and cosine of the axis; arguments as of `distances`."""
    square, above, below, beyond, inverse = distances(kind, length, rho, z)
    singular = inverse if kind == POINT else math.log(1 + 2 * length / beyond)
    return math.sqrt(square), math.sqrt(above / below), singular, rho * inverse, z * inverse


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def turned(sine, cosine, x, y, z):
    """tan(polar/2) as a fraction, and the direction across the axis, along rho: what `direction` is made of."""
    forward, side = x * sine + z * cosine, z * sine - x * cosine
    across = math.sqrt(side * side + y * y)
    # (1 - cos)/sin where 1 + cos would cancel
    return (across, 1 + forward, side) if forward > 0 else (1 - forward, across, side)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def direction(sine, cosine, x, y, z):
    """s, t of a direction of travel (x along rho, y across, z) in the frame whose axis has this sine and cosine to +z."""
    above, below, side = turned(sine, cosine, x, y, z)
    return (2 / math.pi) * math.atan2(frame.SHARP * above, below), math.atan2(abs(y), side) / math.pi


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
