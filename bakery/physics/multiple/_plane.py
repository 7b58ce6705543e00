"""Harmonics about the normal of the plane through axis and position, where rotations in that plane are phases.

A lobe is c_lm in a frame with its axis e3 in the plane, x along e1 in the plane: even in azimuth.  About the normal, with
azimuth from e3 towards e1, it is b_lk = sum_m d^l_km(pi/2) (-i)^m c_lm, zero unless l + k is even;
b_l,-k = (-1)^k conj(b_lk).
Stored for one l: real parts of k = ..., l - 4, l - 2, l from 0 or 1 on, then imaginary parts of the same k (that of k = 0 is 0).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bakery.physics.multiple._kernels import packed
from bakery.physics.multiple._products import add_four, product
from bakery.physics.multiple._turned import LANES, add_turned
from bakery.system.compiled import njit

TAPS = 4  # coefficients of a cubic spline at a place
_ROWS = 8  # distances at a time: what they need stays in the second level of the cache
_BEYOND = 10  # distances after which the end of a spline does not matter
_POLE = math.sqrt(3.0) - 2  # of the filter that turns values into coefficients of a cubic spline
_FORGOTTEN = 40  # points after which that filter has forgotten the first


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


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _add(factors, rows, first, count, out):
    """out += sum over n < count of factors[n] rows[first + 2 n]: four at a time, as loads and stores cost more than sums."""
    whole = count - count % 4
    for n in range(0, whole, 4):
        f0, f1, f2, f3 = factors[n], factors[n + 1], factors[n + 2], factors[n + 3]
        at = first + 2 * n
        r0, r1, r2, r3 = rows[at], rows[at + 2], rows[at + 4], rows[at + 6]
        for a in range(len(out)):
            out[a] += f0 * r0[a] + f1 * r1[a] + f2 * r2[a] + f3 * r3[a]
    for n in range(whole, count):
        f, r = factors[n], rows[first + 2 * n]
        for a in range(len(out)):
            out[a] += f * r[a]


@njit(cache=True, nogil=True, error_model="numpy")
def to_normal(l, d, c, out):
    """b of one l from many c.

    Parameters
    ----------
    d : (L + 1, L + 1) quarter turn of this l
    c : (l + 1, A);  out : (2 K, A), K = l // 2 + 1
    """
    K = l // 2 + 1
    factors = np.empty((4, K), c.dtype)
    out[:] = 0.0
    for odd in range(2):
        count = (l + 2 - odd) // 2
        for first in range(0, K, 4):
            rows = min(4, K - first)
            for n in range(rows):
                k = l % 2 + 2 * (first + n)
                for i in range(count):
                    m = odd + 2 * i
                    # (-i)^m: 1, -i, -1, i
                    factors[n, i] = d[k, m] * (1.0 if m == 0 else 2.0) * (1.0 if m % 4 == 0 or m % 4 == 3 else -1.0)
            if rows == 4:
                add_four(factors, c, odd, 2, count, out[first + odd * K:first + odd * K + 4])
            else:
                for n in range(rows):
                    _add(factors[n], c, odd, count, out[first + n + odd * K])


@njit(cache=True, nogil=True, error_model="numpy")
def from_normal(l, d, b, out):
    """The inverse of `to_normal`, of many: b (N, 2 K'), the imaginary parts from K' on, to out (N, l + 1)."""
    K, whole = l // 2 + 1, b.shape[1] // 2
    for odd in range(2):  # orders m from real and from imaginary parts
        count = (l + 2 - odd) // 2
        turn = np.empty((K, count))
        for n in range(K):
            k = l % 2 + 2 * n
            for i in range(count):
                m = odd + 2 * i
                turn[n, i] = d[k, m] * (1.0 if k == 0 else 2.0) * (1.0 if m % 4 == 0 or m % 4 == 3 else -1.0)
        c = product(b[:, odd * whole:odd * whole + K], turn)
        for n in range(len(out)):
            for i in range(count):
                out[n, odd + 2 * i] = c[n, i]


@njit(cache=True, nogil=True, error_model="numpy")
def splines(l, order, by_distance):
    """Coefficients of cubic splines through a propagator's elements of one l, which go on straight beyond the far end.

    Returns
    -------
    (R + 1, l + 1, L + 1) by distance, m and l', for m <= l'
    """
    R, beyond = len(by_distance), _BEYOND
    f = np.empty((R + beyond, l + 1, order + 1))
    for r in range(R):
        row, source = f[r], by_distance[r]
        for j in range(order + 1):
            at = packed(j, l, 0) if l <= j else packed(l, j, 0)
            for m in range(min(j, l) + 1):
                row[m, j] = source[at + m]
    for m in range(l + 1):
        for j in range(m):
            f[:R, m, j] = 0.0
    flat = f.reshape(R + beyond, -1)
    for n in range(beyond):
        for e in range(flat.shape[1]):
            flat[R + n, e] = flat[R - 1, e] + (flat[R - 1, e] - flat[R - 2, e]) * (n + 1)
    # the two recursive filters of a cubic spline, which is even about its first point
    share = 1.0
    first = np.zeros(flat.shape[1])
    for n in range(min(R, _FORGOTTEN)):
        for e in range(len(first)):
            first[e] += share * flat[n, e]
        share *= _POLE
    for e in range(len(first)):
        flat[0, e] = 6 * first[e]
    last = R + beyond - 1
    for n in range(1, last + 1):
        for e in range(len(first)):
            flat[n, e] = 6 * flat[n, e] + _POLE * flat[n - 1, e]
    for e in range(len(first)):
        flat[last, e] = _POLE / (_POLE * _POLE - 1) * (flat[last, e] + _POLE * flat[last - 1, e])
    for n in range(last - 1, -1, -1):
        for e in range(len(first)):
            flat[n, e] = _POLE * (flat[n + 1, e] - flat[n, e])
    return f[:R + 1]


@njit(cache=True, nogil=True, error_model="numpy")
def point_table(l, order, by_distance, lowest, R, harmonics, columns, d):
    """b of one l for every distance and angle of a table, times r exp(k0 r).

    Parameters
    ----------
    by_distance : (.., P) of the propagator, of whose splines R distances from number `lowest` on are wanted
    harmonics : (L + 1, L + 1, H) by m and l, of the first half of the angles; the others mirror them about a right angle
    columns : A, H = (A + 1) // 2
    d : (L + 1, L + 1) quarter turn of this l

    Returns
    -------
    (R, A, 2 K') float32, K padded with zeros to K'.  Only the sum over l' cancels, and it is in double precision
    """
    A, H = columns, harmonics.shape[2]
    K = l // 2 + 1
    whole = -(-K // LANES) * LANES
    spline = splines(l, order, by_distance)
    out = np.zeros((R, A, 2 * whole), np.float32)
    c, b = np.empty((_ROWS, l + 1, A), np.float32), np.empty((2 * K, A), np.float32)
    factors, half = np.zeros((4, order // 2 + 1)), np.empty((2, 4, H))
    for first in range(0, R, _ROWS):
        rows = min(_ROWS, R - first)
        for m in range(l + 1):
            for four in range(0, rows, 4):
                for odd in range(2):  # of j + m: Y_jm is odd or even about a right angle
                    count = (order - m - odd) // 2 + 1
                    for i in range(min(4, rows - four)):
                        line = spline[lowest + first + four + i, m]
                        for n in range(count):
                            factors[i, n] = line[m + odd + 2 * n]
                    half[odd] = 0.0
                    add_four(factors, harmonics[m], m + odd, 2, count, half[odd])
                for i in range(min(4, rows - four)):
                    row, even, odd_part = c[four + i, m], half[0, i], half[1, i]
                    for a in range(H):
                        row[a] = even[a] + odd_part[a]
                        row[A - 1 - a] = even[a] - odd_part[a]
        for i in range(rows):
            to_normal(l, d, c[i], b)
            for a in range(A):
                for k in range(K):
                    out[first + i, a, k], out[first + i, a, whole + k] = b[k, a], b[K + k, a]
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def phases(angle, first, last):
    """Cosines and sines (Q, K') float32 of k times angles (Q,), k = first, first + 2, .. last, padded."""
    K = (last - first) // 2 + 1
    whole = -(-K // LANES) * LANES
    cosine, sine = np.zeros((len(angle), whole), np.float32), np.zeros((len(angle), whole), np.float32)
    for q in range(len(angle)):
        c, s = math.cos(first * angle[q]), math.sin(first * angle[q])
        c2, s2 = math.cos(2 * angle[q]), math.sin(2 * angle[q])
        for k in range(K):
            cosine[q, k], sine[q, k] = c, s
            c, s = c * c2 - s * s2, s * c2 + c * s2
    return cosine, sine


class Points(NamedTuple):
    """Q points of segments, in the order of row and column, in which they read the table once: those of one position after the
    other read it from memory again and again.

    owner : (Q,) number of the position that a point belongs to
    row, column : (Q,) first of TAPS rows, columns
    row_weight, column_weight : (Q, TAPS) float32, the former times the weight of the point
    """

    owner: np.ndarray
    row: np.ndarray
    row_weight: np.ndarray
    column: np.ndarray
    column_weight: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy")
def along(l, table, d, points, cosine, sine, out):
    """Sums a table of b over the points of segments, and turns the sums to c in frames with given axes.

    Parameters
    ----------
    table : (R, A, 2 K') from `point_table`, as spline coefficients
    points : `Points`
    cosine, sine : (Q, >= K') float32, of k times the angle from the frame's axis to the position as seen from that point
    out : (N, l + 1)
    """
    whole, width = table.shape[2] // 2, table.shape[1] * table.shape[2]
    owner, row, row_weight, column, column_weight = points
    sums = np.zeros((len(out), 2 * whole))
    for q in range(len(owner)):
        p, w = row_weight[q], column_weight[q]
        weights = (p[0], p[1], p[2], p[3]), (w[0], w[1], w[2], w[3])
        # azimuth counted from the frame's axis: times exp(i k angle)
        add_turned(table, row[q] * width + column[q] * table.shape[2], width, whole, weights,
                   (cosine, sine, q * cosine.shape[1]), sums, owner[q] * 2 * whole)
    from_normal(l, d, sums, out)
