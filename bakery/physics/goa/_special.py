"""Functions of the wave field: phase factors, Bessel and Airy functions to 1e-7 of the local modulus, the share of exact waves.

Taylor polynomials about the nodes of a small table for small arguments, asymptotic series beyond (Abramowitz & Stegun 9.2.5;
DLMF 9.7).
"""

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from bakery.physics.mie.vector import fma
from bakery.system.compiled import njit

STRICT = dict(cache=True, nogil=True, error_model="numpy")
INLINE = dict(STRICT, forceinline=True)  # parts of loops that the compiler turns into vector instructions

STEP = 0.5  # between nodes: with TERMS terms the remainder is (STEP/2)^TERMS/TERMS! < 2e-13
TERMS = 10
BESSEL_END, AIRY_END = 12.0, 8.0


def _bessel_table():
    """Taylor coefficients of J0(u) and of J1(u)/u about u = 0, 0.5, .. 12: their differential equations, term by term."""
    table = np.zeros((int(BESSEL_END / STEP) + 1, 2, TERMS))
    for node, row in enumerate(table):
        u = node * STEP
        y = -0.25 * u * u
        values, slopes, term = np.zeros(2), np.zeros(2), np.array([1.0, 0.5])  # y^k/k!^2, y^k/(2 k! (k+1)!)
        for k in range(60):
            values += term
            slopes += 2 * k * term / u if u else 0.0
            term = term * y / ((k + 1.0) * (k + 1.0 + np.arange(2)))
        for which, first in enumerate((1.0, 3.0)):  # u f'' + first f' + u f = 0
            f = row[which]
            f[0], f[1] = values[which], slopes[which]
            for k in range(TERMS - 2):
                before = f[k - 1] if k else 0.0
                if u:
                    f[k + 2] = -((k + 1.0) * (k + first) * f[k + 1] + u * f[k] + before) / (u * (k + 2.0) * (k + 1.0))
                else:
                    f[k + 2] = -f[k] / ((k + 2.0) * (k + 1.0 + first))
    return table


def _airy_table():
    """Taylor coefficients of Ai about z = -8, -7.5, .. 8, from z = 12 downward, where Ai grows and errors with it do not."""

    def taylor(z, value, slope, terms):
        a = np.zeros(terms)
        a[0], a[1], a[2] = value, slope, 0.5 * z * value
        for k in range(1, terms - 2):
            a[k + 2] = (z * a[k] + a[k - 1]) / ((k + 1.0) * (k + 2.0))
        return a

    z, xi = 12.0, 2.0 / 3.0 * 12.0**1.5
    u, value, slope = 1.0, 0.0, 0.0
    for k in range(20):
        value, slope = value + u, slope + u * (6.0 * k + 1.0) / (1.0 - 6.0 * k)
        u *= -(6.0 * k + 1.0) * (6.0 * k + 3.0) * (6.0 * k + 5.0) / (216.0 * (k + 1.0) * (2.0 * k + 1.0)) / xi
    scale = 0.5 * np.exp(-xi) / np.sqrt(np.pi)
    value, slope = scale * value / z**0.25, -scale * slope * z**0.25
    table = np.zeros((int(2 * AIRY_END / STEP) + 1, TERMS))
    powers = np.arange(30)
    while z >= -AIRY_END:
        a = taylor(z, value, slope, 30)
        if z <= AIRY_END:
            table[round((z + AIRY_END) / STEP)] = a[:TERMS]
        value = np.sum(a * (-STEP) ** powers)
        slope = np.sum(a[1:] * powers[1:] * (-STEP) ** powers[:-1])
        z -= STEP
    return table


BESSEL, AIRY = _bessel_table(), _airy_table()


@njit(**INLINE)
def sincos(angle):
    """sin and cos to 1e-15 + 1e-17 |angle|: half the time of the library's for the angles up to 1e9 met here, and in lanes."""
    k = np.floor(angle * 0.6366197723675814 + 0.5)
    r = fma(-k, 6.123233995736766e-17, fma(-k, 1.5707963267948966, angle))
    y = r * r
    s = r + r * y * (-1.0 / 6.0 + y * (1.0 / 120.0 + y * (-1.0 / 5040.0 + y * (1.0 / 362880.0 + y * (
        -1.0 / 39916800.0 + y * (1.0 / 6227020800.0 - y / 1307674368000.0))))))
    c = 1.0 + y * (-0.5 + y * (1.0 / 24.0 + y * (-1.0 / 720.0 + y * (1.0 / 40320.0 + y * (
        -1.0 / 3628800.0 + y * (1.0 / 479001600.0 - y / 87178291200.0))))))
    quadrant = int(k) & 3
    odd = (quadrant & 1) != 0
    sine, cosine = (c if odd else s), (s if odd else c)
    return (-sine if quadrant >= 2 else sine), (-cosine if quadrant == 1 or quadrant == 2 else cosine)


@intrinsic
def _two_to(typingctx, k):
    """2^k for whole k from -1022 to 1023."""

    def codegen(context, builder, signature, args):
        word = ir.IntType(64)
        biased = builder.add(builder.fptosi(args[0], word), ir.Constant(word, 1023))
        return builder.bitcast(builder.shl(biased, ir.Constant(word, 52)), ir.DoubleType())

    return types.float64(types.float64), codegen


@njit(**INLINE)
def decay(y):
    """exp(-y) for y >= 0, to 3e-16 + 1e-16 y; below e^-700 that."""
    y = y if y < 700.0 else 700.0
    k = np.floor(0.5 - y * 1.4426950408889634)
    r = fma(-k, 1.9082149292705877e-10, fma(-k, 0.6931471803691238, -y))
    total = 1.0 / 6227020800.0
    total = total * r + 1.0 / 479001600.0
    total = total * r + 1.0 / 39916800.0
    total = total * r + 1.0 / 3628800.0
    total = total * r + 1.0 / 362880.0
    total = total * r + 1.0 / 40320.0
    total = total * r + 1.0 / 5040.0
    total = total * r + 1.0 / 720.0
    total = total * r + 1.0 / 120.0
    total = total * r + 1.0 / 24.0
    total = total * r + 1.0 / 6.0
    total = total * r + 0.5
    return (1.0 + r * (1.0 + r * total)) * _two_to(k)


@njit(**INLINE)
def _soft_step(z):
    """erfc(z)/2 to 5e-12, 0 and 1 beyond |z| = 5: exp(z^2) erfc(z)/2 is a polynomial of t = 1/(1 + z/2), Chebyshev nodes."""
    a = abs(z)
    y = 2.8 / (1.0 + 0.5 * a) - 1.8  # 5 to 0: -1 to 1
    total = -4.56443884139871e-08
    total = total * y - 5.0370862071829516e-08
    total = total * y + 8.219780929509192e-07
    total = total * y - 1.0263361064159335e-06
    total = total * y - 8.207771666544314e-06
    total = total * y + 3.258523837852555e-05
    total = total * y + 6.179515599588094e-05
    total = total * y - 0.0006356672552326292
    total = total * y - 0.0008481423010964532
    total = total * y + 0.014096894115969705
    total = total * y + 0.0789552953159341
    total = total * y + 0.2088311051707809
    total = total * y + 0.19951464270045854
    tail = total * decay(a * a) if a <= 5.0 else 0.0
    return tail if z >= 0.0 else 1.0 - tail


@njit(**INLINE)
def share(lam, centre, width, low, high, soft):
    """`window` with its scales one by one, for loops over lanes."""
    edge = _soft_step((centre - lam) / width) if width > 0.0 else 0.0
    if soft > 0.0:
        inside = _soft_step((low - lam) / soft) + _soft_step((lam - high) / soft) - 1.0
        edge += (1.0 - edge) * (inside if inside > 0.0 else 0.0)
    return edge


@njit(**STRICT)
def window(lam, scales):
    """Share of the partial wave at lam = n + 1/2 that is summed exactly: 1 around the edge (and the critical order).

    scales (5,): centre and width of the edge, both ends and width around the critical order; a width of 0 is none.
    """
    return share(lam, scales[0], scales[1], scales[2], scales[3], scales[4])


@njit(**STRICT)
def bessel_near(u):
    """J0(u), J1(u)/u, J2(u) for 0 <= u <= 12."""
    node = int(u / STEP + 0.5)
    h = u - node * STEP
    j0, j1 = BESSEL[node, 0, TERMS - 1], BESSEL[node, 1, TERMS - 1]
    for k in range(TERMS - 2, -1, -1):
        j0, j1 = j0 * h + BESSEL[node, 0, k], j1 * h + BESSEL[node, 1, k]
    if u < 0.25:  # 2 J1/u - J0 loses the digits of u^2/8
        y = -0.25 * u * u
        return j0, j1, -0.5 * y * (1.0 + y / 3.0 * (1.0 + y / 8.0 * (1.0 + y / 15.0)))
    return j0, j1, 2.0 * j1 - j0


@njit(**INLINE)
def bessel_far(u, sin, cos):
    """J0(u), J1(u)/u, J2(u) for u >= 12, from sin u and cos u."""
    v = 1.0 / u
    w = v * v
    scale = np.sqrt(v / np.pi)
    s, c = sin - cos, sin + cos  # sin and cos of u - pi/4, times sqrt(2)
    p0 = 1.0 + w * (-9.0 / 128.0 + w * (3675.0 / 32768.0))
    q0 = v * (-1.0 / 8.0 + w * (75.0 / 1024.0 + w * (-59535.0 / 262144.0)))
    p1 = 1.0 + w * (15.0 / 128.0 + w * (-4725.0 / 32768.0))
    q1 = v * (3.0 / 8.0 + w * (-105.0 / 1024.0 + w * (72765.0 / 262144.0)))
    j0 = scale * (p0 * c - q0 * s)
    j1 = scale * (p1 * s + q1 * c) * v
    return j0, j1, 2.0 * j1 - j0


@njit(**STRICT)
def bessel(u):
    """J0(u), J1(u)/u, J2(u) for u >= 0."""
    if u < BESSEL_END:
        return bessel_near(u)
    s, c = sincos(u)
    return bessel_far(u, s, c)


@njit(**STRICT)
def airy_of(z, sin, cos):
    """Ai(z), Ai'(z) for real z, from sin and cos of (2/3)(-z)^(3/2) where z is negative."""
    if abs(z) <= AIRY_END:
        node = int((z + AIRY_END) / STEP + 0.5)
        h = z - (node * STEP - AIRY_END)
        value = AIRY[node, TERMS - 1]
        slope = 0.0
        for k in range(TERMS - 2, -1, -1):
            slope = slope * h + value
            value = value * h + AIRY[node, k]
        return value, slope
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
    s, c = 0.7071067811865476 * (sin - cos), 0.7071067811865476 * (sin + cos)  # of (2/3)(-z)^(3/2) - pi/4
    value = c * (1.0 - w * (u2 - w * u4)) + s * v * (u1 - w * (u3 - w * u5))
    slope = s * (1.0 - w * (v2 - w * v4)) - c * v * (v1 - w * (v3 - w * v5))
    return norm / quarter * value, norm * quarter * slope
