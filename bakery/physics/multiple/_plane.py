"""Harmonics about the normal of the plane through axis and position, where rotations in that plane are phases.

A lobe is c_lm in a frame with its axis e3 in the plane, x along e1 in the plane: even in azimuth.  About the normal, with
azimuth from e3 towards e1, it is b_lk = sum_m d^l_km(pi/2) (-i)^m c_lm, zero unless l + k is even;
b_l,-k = (-1)^k conj(b_lk).
Stored for one l: k = ..., l - 4, l - 2, l from 0 or 1 on, with zeros up to a multiple K' of `LANES`; of each `LANES` of them the
real parts, then the imaginary ones (that of k = 0 is 0).
"""

import math
from typing import NamedTuple

import numpy as np

from bakery.physics.multiple._kernels import packed
from bakery.physics.multiple._products import multiply
from bakery.physics.multiple._turned import LANES, add_turned
from bakery.system.compiled import njit

TAPS = 4  # coefficients of a cubic spline at a place
_LINE = 8  # numbers of a line of the cache
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


@njit(cache=True, nogil=True, error_model="numpy")
def turn_of(l, d, doubled, out):
    """The quarter turn of one l between c and b into out (2, >= l // 2 + 1, K') by parity of m, m and k; zeros beyond the last k.

    d : (L + 1, L + 1) quarter turn of this l
    doubled : whether what is summed over is m (to b) or k (to c): those above 0 stand for themselves and their negatives
    """
    out[:] = 0.0
    for odd in range(2):
        for i in range((l + 2 - odd) // 2):
            m = odd + 2 * i
            for n in range(l // 2 + 1):
                k = l % 2 + 2 * n
                twice = 2.0 if (m if doubled else k) > 0 else 1.0
                # (-i)^m: 1, -i, -1, i
                out[odd, i, n] = d[k, m] * twice * (1.0 if m % 4 == 0 or m % 4 == 3 else -1.0)


@njit(cache=True, nogil=True, error_model="numpy")
def to_normal(l, turn, c, out):
    """b of one l from many c.

    turn : from `turn_of`, of c's type
    c : (l + 1, A);  out : (A, 2 K')
    """
    A, whole = c.shape[1], turn.shape[2]
    for odd in range(2):
        for k in range(0, whole, LANES):
            multiply((c, odd * A, 1, 2 * A), (turn[odd], k, whole), (out, 2 * k + odd * LANES, 2 * whole), A, LANES,
                     (l + 2 - odd) // 2)


@njit(cache=True, nogil=True, error_model="numpy")
def from_normal(l, d, b, out, first):
    """The inverse of `to_normal`, of many: b (N, 2 K') to out (N, first <= .. < first + l + 1)."""
    N, K, whole = len(b), l // 2 + 1, b.shape[1] // 2
    turn = np.empty((2, K, whole))
    turn_of(l, d, False, turn)
    for odd in range(2):  # orders m from real and from imaginary parts
        count = (l + 2 - odd) // 2
        of, part, c = np.empty((K, count)), np.empty((N, K)), np.empty((N, count))
        for n in range(K):
            for i in range(count):
                of[n, i] = turn[odd, i, n]
        for i in range(N):
            for n in range(K):
                part[i, n] = b[i, n + n // LANES * LANES + odd * LANES]
        multiply((part, 0, K, 1), (of, 0, count), (c, 0, count), N, count, K)
        for n in range(N):
            for i in range(count):
                out[n, first + odd + 2 * i] = c[n, i]


@njit(cache=True, nogil=True, error_model="numpy")
def splines(l, order, by_distance):
    """Coefficients of cubic splines through a propagator's elements of one l, which go on straight beyond the far end.

    Returns
    -------
    flat : for m = 0 .. l, then by distance (R + `_BEYOND`), elements l' = m, m + 2, .. and then l' = m + 1, m + 3, ..
    start : (l + 1,) where those of m begin;  there are 2 * `_half(order, m)` a distance
    """
    R = len(by_distance)
    start = np.empty(l + 1, np.intp)
    size = 0
    for m in range(l + 1):
        start[m] = size
        size += (R + _BEYOND) * 2 * _half(order, m)
    flat = np.empty(size)
    element = np.array([packed(j, l, 0) if l <= j else packed(l, j, 0) for j in range(order + 1)])
    for low in range(0, l + 1, _LINE):  # orders of a line of the cache
        high = min(low + _LINE, l + 1)
        for r in range(R):
            source = by_distance[r]
            for m in range(low, high):
                half = _half(order, m)
                for odd in range(2):
                    to = start[m] + (2 * r + odd) * half
                    for n in range((order - m - odd) // 2 + 1):
                        flat[to + n] = source[element[m + odd + 2 * n] + m]
        for m in range(low, high):
            half = _half(order, m)
            lines = flat[start[m]:start[m] + (R + _BEYOND) * 2 * half].reshape(R + _BEYOND, 2 * half)
            if (order - m) % 2 == 0:
                lines[:R, -1] = 0.0  # there is one l' less of the other parity
            _filtered(lines, R)
    return flat, start


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _half(order, m):
    """Number of l' = m, m + 2, .. up to the order."""
    return (order - m) // 2 + 1


@njit(cache=True, nogil=True, error_model="numpy")
def _filtered(f, R):
    """Turns values (R + _BEYOND, E), of which R are given, into coefficients by the two recursive filters of a cubic spline.

    It goes on straight beyond those given, and is even about its first point.
    """
    last, E = len(f) - 1, f.shape[1]
    for n in range(R, last + 1):
        for e in range(E):
            f[n, e] = f[R - 1, e] + (f[R - 1, e] - f[R - 2, e]) * (n - R + 1)
    first, share = np.zeros(E), 1.0
    for n in range(min(R, _FORGOTTEN)):
        for e in range(E):
            first[e] += share * f[n, e]
        share *= _POLE
    for e in range(E):
        f[0, e] = 6 * first[e]
    for n in range(1, last + 1):
        for e in range(E):
            f[n, e] = 6 * f[n, e] + _POLE * f[n - 1, e]
    for e in range(E):
        f[last, e] = _POLE / (_POLE * _POLE - 1) * (f[last, e] + _POLE * f[last - 1, e])
    for n in range(last - 1, -1, -1):
        for e in range(E):
            f[n, e] = _POLE * (f[n + 1, e] - f[n, e])


@njit(cache=True, nogil=True, error_model="numpy")
def point_table(l, order, by_distance, rows, harmonics, columns, d):
    """b of one l for every distance and angle of a table, times r exp(k0 r).

    by_distance : (.., P) of the propagator, of whose splines
    rows : those distances are wanted: number of the first, and how many
    harmonics : (L + 1, L + 1, H) by m and l, of the first half of the angles; the others mirror them about a right angle
    columns : A, H = (A + 1) // 2
    d : (L + 1, L + 1) quarter turn of this l

    Returns (R, A, 2 K') float32, K padded with zeros to K'.  Only the sum over l' cancels, and it is in double precision
    """
    (lowest, R), A, H = rows, columns, harmonics.shape[2]
    K = l // 2 + 1
    whole = -(-K // LANES) * LANES
    flat, start = splines(l, order, by_distance)
    turn = np.empty((2, K, whole), np.float32)
    turn_of(l, d, True, turn)
    out = np.empty((R, A, 2 * whole), np.float32)
    c, half = np.empty((_ROWS, l + 1, A), np.float32), np.empty((2, _ROWS, H))
    for first in range(0, R, _ROWS):
        height = min(_ROWS, R - first)
        for m in range(l + 1):
            width = _half(order, m)
            for odd in range(2):  # of j + m: Y_jm is odd or even about a right angle
                multiply((flat, start[m] + (2 * (lowest + first) + odd) * width, 2 * width, 1),
                         (harmonics, (m * (order + 1) + m + odd) * H, 2 * H), (half, odd * _ROWS * H, H), height, H,
                         (order - m - odd) // 2 + 1)
            for i in range(height):
                row, even, odd_part = c[i, m], half[0, i], half[1, i]
                for a in range(H):
                    row[a] = even[a] + odd_part[a]
                    row[A - 1 - a] = even[a] - odd_part[a]
        for i in range(height):
            to_normal(l, turn, c[i], out[first + i])
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def phases(angle, first):
    """Phases of k times angles (Q,), from which `add_turned` makes all others.

    Returns
    -------
    begin : (Q, 2 LANES) float32, cosines and then sines for k = first, first + 2, ..
    turn : (Q, 2) float32, cosine and sine of the angle that leads to the k that comes `LANES` later
    """
    begin, turn = np.empty((len(angle), 2 * LANES), np.float32), np.empty((len(angle), 2), np.float32)
    for q in range(len(angle)):
        c, s = math.cos(first * angle[q]), math.sin(first * angle[q])
        c2, s2 = math.cos(2 * angle[q]), math.sin(2 * angle[q])
        for k in range(LANES):
            begin[q, k], begin[q, k + LANES] = c, s
            c, s = c * c2 - s * s2, s * c2 + c * s2
        turn[q, 0], turn[q, 1] = math.cos(2 * LANES * angle[q]), math.sin(2 * LANES * angle[q])
    return begin, turn


class Points(NamedTuple):
    """Q points of segments, in the order of row and column, in which they read the table once: those of one position after the
    other read it from memory again and again.

    owner : (Q,) number of the position that a point belongs to
    weight : (Q, TAPS * TAPS) float32, of the coefficients of TAPS rows and columns, that of the point in them
    cell : (C + 1,) first of the points that have the same coefficients, then Q
    row, column : (C,) first of those coefficients
    """

    owner: np.ndarray
    weight: np.ndarray
    cell: np.ndarray
    row: np.ndarray
    column: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy")
def along(l, table, d, points, phases, out):
    """Sums a table of b over the points of segments, and turns the sums to c in frames with given axes.

    table : (R, A, 2 K') from `point_table`, as spline coefficients
    points : `Points`
    phases : from `phases`, of the angles from the frame's axis to the position as seen from that point
    out : (N, (L + 1)(L + 2)/2), of which those of l are set
    """
    column, row_of_table = table.shape[2], table.shape[1] * table.shape[2]
    owner, weight, cell, row, first = points
    begin, turn = phases
    scratch = np.empty((np.diff(cell).max(), 2 * LANES), np.float32)
    sums = np.zeros((len(out), column))
    for n in range(len(row)):
        # azimuth counted from the frame's axis: times exp(i k angle)
        add_turned(table, row[n] * row_of_table + first[n] * column, row_of_table, column, (cell[n], cell[n + 1], owner), weight,
                   (begin, turn, scratch), sums)
    from_normal(l, d, sums, out, l * (l + 1) // 2)
