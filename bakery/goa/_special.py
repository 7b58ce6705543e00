"""Functions of the wave field: phase factors, Bessel and Airy functions to 2e-6 of the local modulus, the share of exact waves.

Power series for small arguments, asymptotic series beyond (Abramowitz & Stegun 9.1.10, 9.2.5; DLMF 9.4, 9.7).  `_field` and
`_edge` compile these in and numba's disk cache there does not see changes here: clear it after an edit.
"""

from __future__ import annotations

from math import erfc

import numpy as np
from numba import njit

from bakery.mie._vector import fma

STRICT = dict(cache=True, nogil=True, error_model="numpy")
AI_0, AI_PRIME_0 = 0.355028053887817239, -0.258819403792806798


@njit(**STRICT)
def sincos(angle):
    """sin and cos to 1e-15 + 1e-17 |angle|: half the time of the library's for the angles up to 1e9 met here."""
    k = np.floor(angle * 0.6366197723675814 + 0.5)
    r = fma(-k, 6.123233995736766e-17, fma(-k, 1.5707963267948966, angle))
    y = r * r
    s = r + r * y * (-1.0 / 6.0 + y * (1.0 / 120.0 + y * (-1.0 / 5040.0 + y * (1.0 / 362880.0 + y * (
        -1.0 / 39916800.0 + y * (1.0 / 6227020800.0 - y / 1307674368000.0))))))
    c = 1.0 + y * (-0.5 + y * (1.0 / 24.0 + y * (-1.0 / 720.0 + y * (1.0 / 40320.0 + y * (
        -1.0 / 3628800.0 + y * (1.0 / 479001600.0 - y / 87178291200.0))))))
    quadrant = int(k) & 3
    if quadrant & 1:
        s, c = c, s
    return (-s if quadrant >= 2 else s), (-c if quadrant == 1 or quadrant == 2 else c)


@njit(**STRICT)
def window(lam, scales):
    """Share of the partial wave at lam = n + 1/2 that is summed exactly: 1 around the edge (and the critical order).

    scales (5,): centre and width of the edge, both ends and width around the critical order; a width of 0 is none.
    """
    if scales[1] <= 0.0:
        return 0.0
    z = (scales[0] - lam) / scales[1]
    w = 0.0 if z > 5.0 else (1.0 if z < -5.0 else 0.5 * erfc(z))
    if scales[4] > 0.0:
        low, high = (scales[2] - lam) / scales[4], (lam - scales[3]) / scales[4]
        if low < 5.0 and high < 5.0:
            w += (1.0 - w) * max(0.5 * (erfc(low) + erfc(high)) - 1.0, 0.0)
    return w


@njit(**STRICT)
def _bessel_series(u):
    y = -0.25 * u * u
    zero, one, term0, term1 = 1.0, 1.0, 1.0, 1.0
    for k in range(1, 60):
        term0 *= y / (k * k)
        term1 *= y / (k * (k + 1.0))
        zero += term0
        one += term1
        if abs(term0) < 1e-17 * k:
            break
    one *= 0.5
    if u < 0.1:  # 2 J1/u - J0 loses the digits of u^2/8
        return zero, one, 0.125 * u * u * (1.0 + y / 3.0 * (1.0 + y / 8.0))
    return zero, one, 2.0 * one - zero


@njit(**STRICT)
def bessel_of(u, sin, cos):
    """J0(u), J1(u)/u, J2(u) for u >= 0, from sin u and cos u."""
    if u < 12.0:
        return _bessel_series(u)
    v = 1.0 / u
    w = v * v
    scale = np.sqrt(v / np.pi)
    s, c = sin - cos, sin + cos  # sin and cos of u - pi/4, times sqrt(2)
    p0 = 1.0 + w * (-9.0 / 128.0 + w * (3675.0 / 32768.0))
    q0 = v * (-1.0 / 8.0 + w * (75.0 / 1024.0 + w * (-59535.0 / 262144.0)))
    p1 = 1.0 + w * (15.0 / 128.0 + w * (-4725.0 / 32768.0))
    q1 = v * (3.0 / 8.0 + w * (-105.0 / 1024.0 + w * (72765.0 / 262144.0)))
    zero = scale * (p0 * c - q0 * s)
    one = scale * (p1 * s + q1 * c) * v
    return zero, one, 2.0 * one - zero


@njit(**STRICT)
def bessel(u):
    """J0(u), J1(u)/u, J2(u) for u >= 0."""
    if u < 12.0:
        return _bessel_series(u)
    s, c = sincos(u)
    return bessel_of(u, s, c)


@njit(**STRICT)
def airy(z):
    """Ai(z), Ai'(z) for real z."""
    if abs(z) <= 5.0:
        f, g, fp, gp = 1.0, z, 0.0, 1.0
        tf, tg, cube = 1.0, z, z * z * z
        for k in range(1, 40):
            n = 3.0 * k
            dfp = tf * z * z / (n - 1.0)  # derivative of the next term of f
            dgp = tg * z * z / n
            tf *= cube / (n * (n - 1.0))
            tg *= cube / (n * (n + 1.0))
            f, g, fp, gp = f + tf, g + tg, fp + dfp, gp + dgp
            if abs(tf) + abs(tg) + abs(dfp) + abs(dgp) < 1e-16:
                break
        return AI_0 * f + AI_PRIME_0 * g, AI_0 * fp + AI_PRIME_0 * gp
    root = np.sqrt(abs(z))
    v = 1.5 / (abs(z) * root)
    quarter = np.sqrt(root)
    u1, u2, u3, u4, u5 = 5.0 / 72.0, 385.0 / 10368.0, 85085.0 / 2239488.0, 37182145.0 / 644972544.0, 5391411025.0 / 46438023168.0
    v1, v2, v3, v4, v5 = -7.0 / 5.0 * u1, -13.0 / 11.0 * u2, -19.0 / 17.0 * u3, -25.0 / 23.0 * u4, -31.0 / 29.0 * u5
    w = v * v
    norm = 0.5641895835477563
    if z > 0.0:
        e = 0.5 * norm * np.exp(-1.0 / v)
        value = 1.0 - v * (u1 - v * (u2 - v * (u3 - v * (u4 - v * u5))))
        slope = 1.0 - v * (v1 - v * (v2 - v * (v3 - v * (v4 - v * v5))))
        return e / quarter * value, -e * quarter * slope
    s, c = sincos(1.0 / v - 0.25 * np.pi)
    value = c * (1.0 - w * (u2 - w * u4)) + s * v * (u1 - w * (u3 - w * u5))
    slope = s * (1.0 - w * (v2 - w * v4)) - c * v * (v1 - w * (v3 - w * v5))
    return norm / quarter * value, norm * quarter * slope
