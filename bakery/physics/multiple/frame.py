"""Where a table of multiple scattering is looked up: the plane of positions, the singular part, the frame of directions.

Positions (rho, z) map to (u, v) in the unit square, in which the light divided by its singular part is smooth.

Point source: r and the angle Theta from +z; singular part 1/r.
Segment of length l along z from the origin: ellipses about its ends.  b = sqrt((r1 + r2)^2 - l^2)/2, the semi-minor axis, and the
angle nu with cos nu = (r1 - r2)/l, where r1 and r2 are the distances from both ends; both become r and Theta far away or for
l = 0.  Singular part 2 artanh(l/(r1 + r2)), the integral of 1/r.
Then u = arsinh(m / CORE) / arsinh(extent / CORE) with m = r or b, and v = (2/pi) arctan(SKEW tan(angle/2)): odd at both ends of
the axis, so that what is even in the angle is even in v.

Directions are taken in a frame at the position itself: its axis points away from the origin, +z is at azimuth 0.  In units of a
square: s = (2/pi) arctan(SHARP tan(polar/2)), t = |azimuth| / pi.

The kernels of it are in `locate`.
"""

import math
from functools import lru_cache

import numpy as np

from bakery.physics.multiple.kinds import POINT

CORE = (0.05, 0.002)  # m below which u is linear in it, logarithmic above, of point and segment
SKEW = (1.0, 0.6)  # of point and segment: places on the axis ahead are denser by its square than behind
SHARP = 2.5  # q: the same for directions
NEAREST = (1e-3, 1e-4)  # m of the first places: the solver's shortest distance, and what it makes of it beside a segment
CLOSEST = 1e-6  # mfp from the axis; nearer positions are answered as there
INSIDE = 0.5  # of the extent: from there on coefficients go as 1/m


def position(kind, length, extent, u, v):
    """rho, z of places (u, v) of the square."""
    u, v = np.asarray(u, float), np.asarray(v, float)
    m = np.maximum(CORE[kind] * np.sinh(u * math.asinh(extent / CORE[kind])), NEAREST[kind])
    angle = np.where(v < 1, 2 * np.arctan(np.tan(np.minimum(v, 1 - 1e-15) * math.pi / 2) / SKEW[kind]), math.pi)
    if kind == POINT:
        return m * np.sin(angle), m * np.cos(angle)
    # (l/2) (cosh(mu) cos(nu) + 1) with b = (l/2) sinh(mu), without cancellation at the origin
    half = length / 2
    excess = m**2 / (half + np.hypot(m, half))
    return m * np.sin(angle), excess * np.cos(angle) + length * np.cos(angle / 2) ** 2


def polar(s):
    """Angle from the axis at s."""
    s = np.asarray(s, float)
    return np.where(s < 1, 2 * np.arctan(np.tan(np.minimum(s, 1 - 1e-15) * math.pi / 2) / SHARP), math.pi)


@lru_cache(maxsize=8)
def solid_angles(shape):
    """Weights of a grid of directions (A, B), s and t equidistant with both ends: sum = 4 pi.

    Spectral: exact for cosine series in s, to which everything even about the axis belongs, times cos(m phi) with m < 2 (B - 1).
    """
    A, B = shape
    order = np.arange(A)
    x, gauss = np.polynomial.legendre.leggauss(4 * A)
    s = (1 + x) / 2
    half = polar(s) / 2
    # d(polar)/ds of tan(half) = tan(pi s / 2) / SHARP
    slope = math.pi / SHARP * np.cos(half) ** 2 / np.cos(math.pi * s / 2) ** 2
    moments = ((gauss / 2 * np.sin(2 * half) * slope) * np.cos(math.pi * order[:, None] * s)).sum(axis=1)
    ends = np.where((order == 0) | (order == A - 1), 0.5, 1.0)
    rings = 2 / (A - 1) * ends * ((ends * moments) * np.cos(math.pi * order[:, None] * order / (A - 1))).sum(axis=1)
    across = np.full(B, 2 * math.pi / (B - 1))
    across[[0, -1]] /= 2
    return rings[:, None] * across
