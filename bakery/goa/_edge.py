"""The edge sum: partial waves near n = x exactly, those far below by their sum in closed form.

The kernels of `bakery.mie` and of `_special` are compiled in; numba's disk cache here does not see changes there.

The rays have the share 1 - W(n + 1/2) of each partial wave, so with c_n = 2n + 1 and p_n, q_n, e_n, f_n of `bakery.mie._kernels`

    S1 + S2 = sum c_n [W_n (a_n + b_n) + (1 - W_n)] p_n + 2 rays,      S1 - S2 = sum c_n W_n (a_n - b_n) q_n.

The second part is diffraction by a soft edge.  Where W = 0 it has the sum T_N = sum_{n<N} c_n p_n, from pi_{N-1} and pi_N; the
recurrences start there from Bessel functions with a phase of the next order (relative error 1/N^2), or at n = 1 where that
is soon reached.  So a sphere costs O(x^(1/3)) an angle, and O(x) once for its coefficients.

Bubbles have a second window around the critical order n x, as wide as sqrt(x).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from bakery.goa._special import bessel_of, sincos, window
from bakery.mie._kernels import (
    ANGLES,
    DIF_R,
    LANES,
    SUM_R,
    E,
    F,
    P,
    Q,
    V,
    _coefficients,
    _order_table,
    _reset,
    _sweep,
    _tiles,
    terms,
)

STRICT = dict(cache=True, nogil=True, error_model="numpy")
NEAR_START = 400  # below, a recurrence from n = 1 is as cheap as Bessel functions
EDGE_MAX = 2e6  # as bakery.mie.X_MAX: above, the coefficients are not computed and diffraction is the tapered one
CHUNK = 1024  # terms whose coefficients (64 kB) stay in the cache


def scales_of(m, x, edge):
    """(R, 5) windows of the spheres x (R,), as `_special.window` takes them; edge: None, "narrow" or "wide"."""
    scales = np.zeros((x.size, 5))
    if edge is None:
        return scales
    c, root = np.cbrt(x), np.sqrt(x)
    scales[:, 0], scales[:, 1] = (x - 3.0 * c, 2.0 * c) if edge == "wide" else (x - 0.5 * c, c)
    if m.imag < m.real < 1.0:  # metals have no critical order
        scales[:, 2], scales[:, 3], scales[:, 4] = m.real * x - 2.5 * root, m.real * x + 2.5 * root, 1.25 * root
    scales[x > EDGE_MAX] = 0.0
    return scales


@njit(**STRICT)
def _spans(x, scales, spans):
    """First and last + 1 order of the stretches that are summed term by term; returns their number."""
    last = min(int(x + 3.0 * np.cbrt(x)) + 4, terms(x)) + 1
    first = int(scales[0] - 2.5 * scales[1])
    count = 0
    if scales[4] > 0.0:
        low, high = int(scales[2] - 2.5 * scales[4]), int(scales[3] + 2.5 * scales[4]) + 1
        if high + NEAR_START < first:
            spans[0, 0], spans[0, 1] = low, high
            count = 1
        else:
            first = min(first, low)
    spans[count, 0], spans[count, 1] = first, last
    count += 1
    for s in range(count):
        if spans[s, 0] < NEAR_START:
            spans[s, 0] = 1
    return count


# Rows of the constants of an angle beta: sin beta, 1/beta - cot beta, tan(beta/2), cot(beta/2) - 2/beta, sqrt(beta/sin beta),
# sin and cos of beta/2
BETA, SINE, BEND, LEAN, LIFT, ROOT, HALF_SIN, HALF_COS = range(8)


@njit(**STRICT)
def _angle_constants(tiles):
    out = np.empty((tiles.shape[0], 8, ANGLES))
    for t in range(tiles.shape[0]):
        for j in range(ANGLES):
            s = np.sqrt(0.5 * tiles[t, V, j])
            b = 2.0 * np.arcsin(s)
            out[t, BETA, j], out[t, SINE, j], out[t, LEAN, j] = b, np.sin(b), np.tan(0.5 * b)
            out[t, HALF_SIN, j], out[t, HALF_COS, j] = s, np.cos(0.5 * b)
            if b < 0.05:
                out[t, BEND, j], out[t, LIFT, j] = b / 3.0 * (1.0 + b * b / 15.0), -b / 6.0 * (1.0 + b * b / 60.0)
                out[t, ROOT, j] = 1.0 + b * b / 12.0
            else:
                out[t, BEND, j] = 1.0 / b - 1.0 / np.tan(b)
                out[t, LIFT, j] = 1.0 / np.tan(0.5 * b) - 2.0 / b
                out[t, ROOT, j] = np.sqrt(b / np.sin(b))
    return out


@njit(**STRICT)
def _turned(u, shift, s, c):
    """J0, J1/u, J2 of u + shift, from sin u and cos u; shift < 0.01."""
    y = shift * shift
    ds, dc = shift * (1.0 - y / 6.0), 1.0 - 0.5 * y
    return bessel_of(max(u + shift, 0.0), s * dc + c * ds, c * dc - s * ds)


@njit(**STRICT)
def _closed(n, before, after):
    """T_n from pi_{n-1}, pi_n."""
    return before + after - 0.5 * ((2.0 * n + 1.0) / (n * (n + 1.0)) * after - (2.0 * n - 1.0) / (n * (n - 1.0)) * before)


@njit(**STRICT)
def _start(tiles, constants, first, sign, behind):
    """Put the state of order `first` into all tiles and sign T_first into their sums."""
    n, nu = float(first), first + 0.5
    swing = 1.0 if first % 2 else -1.0
    for t in range(tiles.shape[0]):
        for j in range(ANGLES):
            b, sine, bend, lean, lift, root, half_s, half_c = constants[t, :, j]
            s, c = sincos(n * b)  # one sine for the five arguments near n b
            up_s, up_c = s * half_c + c * half_s, c * half_c - s * half_s
            down_s, down_c = s * half_c - c * half_s, c * half_c + s * half_s
            low, high = (nu - 1.0) * b, nu * b
            stretch = root * (b / sine if b > 0.0 else 1.0)
            before = (n - 1.0) * n * stretch * _turned(low, -0.375 * bend / (nu - 1.0), down_s, down_c)[1]
            after = n * (n + 1.0) * stretch * _turned(high, -0.375 * bend / nu, up_s, up_c)[1]
            ahead = _closed(n, before, after)
            if behind:  # pi_n(pi - b) = (-1)^(n+1) pi_n(b)
                tiles[t, DIF_R, j] += sign * swing * _closed(n, -before, after)
            else:
                tiles[t, SUM_R, j] += sign * ahead
            if sign > 0.0:
                q = root * _turned(high, (0.125 * bend + lift) / nu, up_s, up_c)[2]
                q_before = root * _turned(low, (0.125 * bend + lift) / (nu - 1.0), down_s, down_c)[2]
                tiles[t, P, j] = root * _turned(high, (0.125 * bend - lean) / nu, up_s, up_c)[0]
                tiles[t, E, j] = -tiles[t, V, j] * ahead
                tiles[t, Q, j] = q
                tiles[t, F, j] = (q - q_before) * (n - 1.0) * (n + 1.0) / n


@njit(**STRICT)
def _mix(work, lane, rows, first, count, scales, front, back):
    """Coefficients of the two sums, for exp(+i w t), and their twins beyond 90 degrees; row c is of n = first + c."""
    for c in range(count):
        n = first + c
        w, k = window(n + 0.5, scales), 2.0 * n + 1.0
        kw = k * w
        ar, ai, br, bi = 0.0, 0.0, 0.0, 0.0
        if n <= rows:
            ar, ai, br, bi = work[n - 1, 0, lane], work[n - 1, 1, lane], work[n - 1, 2, lane], work[n - 1, 3, lane]
        sr, si, dr, di = kw * (ar + br) + (k - kw), -kw * (ai + bi), kw * (ar - br), -kw * (ai - bi)
        sign = 1.0 if n % 2 else -1.0
        front[c, 0], front[c, 1], front[c, 2], front[c, 3] = sr, si, dr, di
        back[c, 0], back[c, 1], back[c, 2], back[c, 3] = sign * dr, sign * di, sign * sr, sign * si


@njit(**STRICT)
def _collect(tiles, source, swapped, out):
    s, d = (DIF_R, SUM_R) if swapped else (SUM_R, DIF_R)
    for c in range(source.shape[0]):
        t, j, o = c // ANGLES, c % ANGLES, source[c]
        plus = complex(tiles[t, s, j], tiles[t, s + 1, j])
        minus = complex(tiles[t, d, j], tiles[t, d + 1, j])
        out[o, 0] += 0.5 * (plus + minus)
        out[o, 1] += 0.5 * (plus - minus)


@njit(**STRICT)
def wave_block(m, x, theta, scales, out):
    """Add the edge sums of the spheres x (R,) to out (R, A, 2), S1 and S2 for exp(+i w t); those without a window stay."""
    width = LANES if x.shape[0] > 1 and terms(min(np.max(x), EDGE_MAX)) <= 12_000 else 1
    size = 0.0
    for r in range(x.shape[0]):
        if scales[r, 1] > 0.0:
            size = max(size, x[r])
    if size == 0.0 or theta.shape[0] == 0:
        return
    most = terms(size) + 6
    work, lane, xs = np.empty((most, 4, width)), np.empty((27, width)), np.empty(width)
    order, front, back = _order_table(most), np.empty((CHUNK, 4)), np.empty((CHUNK, 4))
    ahead, ahead_source = _tiles(theta, True)
    behind, behind_source = _tiles(theta, False)
    ahead_constants, behind_constants = _angle_constants(ahead), _angle_constants(behind)
    spans = np.empty((2, 2), np.int64)
    for first in range(0, x.shape[0], width):
        for j in range(width):
            xs[j] = min(x[min(first + j, x.shape[0] - 1)], size)
        _coefficients(m, xs, lane, work)
        for j in range(min(width, x.shape[0] - first)):
            r = first + j
            if scales[r, 1] <= 0.0:
                continue
            _reset(ahead)
            _reset(behind)
            for span in range(_spans(x[r], scales[r], spans)):
                low, high = spans[span]
                if low > 1:
                    _start(ahead, ahead_constants, low, 1.0, False)
                    _start(behind, behind_constants, low, 1.0, True)
                if span == 1:  # what the first span has had already
                    _start(ahead, ahead_constants, spans[0, 1], -1.0, False)
                    _start(behind, behind_constants, spans[0, 1], -1.0, True)
                for start in range(low, high, CHUNK):
                    count = min(CHUNK, high - start)
                    _mix(work, j, terms(x[r]), start, count, scales[r], front, back)
                    for t in range(ahead.shape[0]):
                        _sweep(order, front, start - 1, count, ahead[t])
                    for t in range(behind.shape[0]):
                        _sweep(order, back, start - 1, count, behind[t])
            _collect(ahead, ahead_source, False, out[r])
            _collect(behind, behind_source, True, out[r])
