"""Harmonics about the normal of the plane through axis and position, where rotations in that plane are phases.

A lobe is c_lm in a frame with its axis e3 in the plane, x along e1 in the plane: even in azimuth.  About the normal, with
azimuth from e3 towards e1, it is b_lk = sum_m d^l_km(pi/2) (-i)^m c_lm, zero unless l + k is even;
b_l,-k = (-1)^k conj(b_lk).
Stored for one l: real parts of k = l, l - 2, ... >= 0, then imaginary parts of the same k (that of k = 0 is 0).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from bakery.multiple._kernels import packed

TAPS = 4  # coefficients of a cubic spline at a place


@njit(cache=True, nogil=True, error_model="numpy")
def quarter_turns(order):
    """d^l_km(pi/2) for 0 <= k, m <= l, (L + 1, L + 1, L + 1), by the recurrence in l for fixed k and m."""
    d = np.zeros((order + 1, order + 1, order + 1))
    for k in range(order + 1):
        for m in range(order + 1):
            l = max(k, m)
            low = min(k, m)
            # sqrt((2 l)! / ((l + low)! (l - low)!)) 2^-l
            start = 0.5 * (math.lgamma(2.0 * l + 1) - math.lgamma(l + low + 1.0) - math.lgamma(l - low + 1.0)) - l * math.log(2.0)
            value, before = math.exp(start), 0.0
            if k > m and (k - m) % 2 == 1:
                value = -value
            d[l, k, m] = value
            while l < order:
                grown = -(2 * l + 1.0) * k * m * value if l > 0 else 0.0
                fell = (l + 1.0) * math.sqrt((l * l - k * k) * (l * l - m * m * 1.0)) * before
                if l > 0:
                    n = l + 1.0
                    after = (grown - fell) / (l * math.sqrt((n * n - k * k) * (n * n - m * m)))
                else:
                    after = 0.0  # d^1_00(pi/2) = cos(pi/2)
                before, value = value, after
                l += 1
                d[l, k, m] = value
    return d


@njit(cache=True, nogil=True, error_model="numpy")
def to_normal(l, d, c, out):
    """b of one l from many c.

    Parameters
    ----------
    d : (L + 1, L + 1) quarter turn of this l
    c : (l + 1, A);  out : (2 K, A), K = l // 2 + 1
    """
    K, A = l // 2 + 1, c.shape[1]
    out[:] = 0.0
    for n in range(K):
        k = l - 2 * n
        for m in range(l + 1):
            # (-i)^m: 1, -i, -1, i
            factor = d[k, m] * (1.0 if m == 0 else 2.0) * (1.0 if m % 4 == 0 or m % 4 == 3 else -1.0)
            part = n if m % 2 == 0 else K + n
            for a in range(A):
                out[part, a] += factor * c[m, a]


@njit(cache=True, nogil=True, error_model="numpy")
def from_normal(l, d, b, out):
    """The inverse of `to_normal`."""
    K = l // 2 + 1
    for m in range(l + 1):
        total = 0.0
        part = 0 if m % 2 == 0 else K
        for n in range(K):
            k = l - 2 * n
            total += d[k, m] * b[part + n] * (1.0 if k == 0 else 2.0)
        out[m] = total if m % 4 == 0 or m % 4 == 3 else -total


@njit(cache=True, nogil=True, error_model="numpy")
def point_table(l, order, scaled, harmonics, d):
    """b of one l for every distance and angle of a table, times r exp(k0 r).

    Parameters
    ----------
    scaled : (P, R) of the propagator;  harmonics : ((L + 1)(L + 2)/2, A) of the angles
    d : (L + 1, L + 1) quarter turn of this l

    Returns
    -------
    (R, A, 2 K)
    """
    R, A = scaled.shape[1], harmonics.shape[1]
    K = l // 2 + 1
    out = np.empty((R, A, 2 * K))
    c, b = np.empty((l + 1, A)), np.empty((2 * K, A))
    for i in range(R):
        c[:] = 0.0
        for j in range(order + 1):
            for m in range(min(l, j) + 1):
                value = scaled[packed(j, l, m), i] if l <= j else scaled[packed(l, j, m), i]
                y = harmonics[j * (j + 1) // 2 + m]
                row = c[m]
                for a in range(A):
                    row[a] += value * y[a]
        to_normal(l, d, c, b)
        for a in range(A):
            for k in range(2 * K):
                out[i, a, k] = b[k, a]
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def along(l, table, d, start, row, row_weight, column, column_weight, weight, cosine, sine, out):
    """Sums a table of b over the points of segments, and turns the sums to c in frames with given axes.

    Parameters
    ----------
    table : (R, A, 2 K) from `point_table`, as spline coefficients
    start : (N + 1,) first point of each position, of Q in all
    row, column : (Q,) first of TAPS rows, columns;  row_weight, column_weight : (Q, TAPS)
    weight : (Q,) of the point of the segment
    cosine, sine : (Q,) of the angle from the frame's axis to the position as seen from that point
    out : (N, l + 1)
    """
    K = l // 2 + 1
    sums, here = np.empty(2 * K), np.empty(2 * K)
    for n in range(len(start) - 1):
        sums[:] = 0.0
        for q in range(start[n], start[n + 1]):
            for i in range(TAPS):
                share = weight[q] * row_weight[q, i]
                s0, s1 = share * column_weight[q, 0], share * column_weight[q, 1]
                s2, s3 = share * column_weight[q, 2], share * column_weight[q, 3]
                values, a = table[row[q] + i], column[q]
                if i == 0:
                    for k in range(2 * K):
                        here[k] = s0 * values[a, k] + s1 * values[a + 1, k] + s2 * values[a + 2, k] + s3 * values[a + 3, k]
                else:
                    for k in range(2 * K):
                        here[k] += s0 * values[a, k] + s1 * values[a + 1, k] + s2 * values[a + 2, k] + s3 * values[a + 3, k]
            # azimuth counted from the frame's axis: times exp(i k angle)
            c, s = cosine[q], sine[q]
            c2, s2 = c * c - s * s, 2 * c * s
            if l % 2 == 0:
                c, s = 1.0, 0.0
            for k in range(K - 1, -1, -1):
                sums[k] += here[k] * c - here[K + k] * s
                sums[K + k] += here[k] * s + here[K + k] * c
                c, s = c * c2 - s * s2, s * c2 + c * s2
        from_normal(l, d, sums, out[n])
