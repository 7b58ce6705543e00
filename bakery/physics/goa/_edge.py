"""The edge sum: partial waves near n = x exactly, those far below by their sum in closed form.

The rays have the share 1 - W(n + 1/2) of each partial wave, so with c_n = 2n + 1 and p_n, q_n, e_n, f_n of `bakery.mie.angular`

    S1 + S2 = sum c_n [W_n (a_n + b_n) + (1 - W_n)] p_n + 2 rays,      S1 - S2 = sum c_n W_n (a_n - b_n) q_n.

The second part is diffraction by a soft edge.  Where W = 0 it has the sum T_N = sum_{n<N} c_n p_n, from pi_{N-1} and pi_N; the
recurrences start there from Bessel functions with a phase of the next order (relative error 1/N^2), or at n = 1 where that
is soon reached.  The coefficients start there too (`_asymptotic`): a sphere costs O(x^(1/3)) an angle, and as much once.

Bubbles have a second window around the critical order n x, as wide as sqrt(x).

The kernels of `bakery.mie`, `_special` and `_asymptotic` are compiled in; numba's disk cache does not see changes there.
"""

import numpy as np

from bakery.physics.goa._asymptotic import reach, stretch
from bakery.physics.goa._special import BESSEL_END, STRICT, bessel_far, bessel_near, share, sincos
from bakery.physics.mie.angular import ANGLES, DIF_R, SUM_R, E, F, P, Q, V, reset, sweep
from bakery.physics.mie.coefficients import LANES, terms, wave_coefficients
from bakery.system.compiled import njit

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


# Rows of the constants of an angle beta: beta, sin and cos of beta/2; 1/beta - cot beta, cot(beta/2) - 2/beta, tan(beta/2),
# sqrt(beta/sin beta); then of a start: sin and cos of n beta, and five Bessel functions
BETA, HALF_SIN, HALF_COS, BEND, LIFT, LEAN, ROOT, SINE, COSINE = range(0, 9 * ANGLES, ANGLES)
BEFORE, AFTER, Q_BEFORE, Q_AFTER, P_AFTER = range(9 * ANGLES, 14 * ANGLES, ANGLES)
CONSTANTS = 14 * ANGLES
# Which order below n + 1/2, which of J0, J1/u, J2, and the shift of the argument in parts of BEND, LIFT, LEAN over the order
STARTS = ((1.0, 1.0, -0.375, 0.0, 0.0), (0.0, 1.0, -0.375, 0.0, 0.0), (1.0, 2.0, 0.125, 1.0, 0.0), (0.0, 2.0, 0.125, 1.0, 0.0),
          (0.0, 0.0, 0.125, 0.0, -1.0))


@njit(**STRICT)
def _angles(theta, ahead):
    """The angles up to 90 degrees (or those beyond, reflected): tiles, constants (T, CONSTANTS) and where each came from."""
    count = 0
    for a in range(theta.shape[0]):
        count += (theta[a] <= 0.5 * np.pi) == ahead
    number = (count + ANGLES - 1) // ANGLES
    tiles, source, constants = np.zeros((number, 9, ANGLES)), np.empty(count, np.int64), np.zeros((number, CONSTANTS))
    count = 0
    for a in range(theta.shape[0]):
        if (theta[a] <= 0.5 * np.pi) == ahead:
            constants[count // ANGLES, count % ANGLES] = theta[a] if ahead else np.pi - theta[a]
            source[count] = a
            count += 1
    for t in range(number):
        tile = constants[t]
        for j in range(ANGLES):
            b = tile[BETA + j]
            s, c = sincos(0.5 * b)
            sine, cosine = 2.0 * s * c, 1.0 - 2.0 * s * s
            near = b < 0.05
            d = 0.05 if near else b
            sine, cosine, half = (0.05 if near else sine), (0.0 if near else cosine), (0.05 if near else s)
            tile[HALF_SIN + j], tile[HALF_COS + j], tile[LEAN + j] = s, c, s / c
            tile[BEND + j] = b / 3.0 * (1.0 + b * b / 15.0) if near else 1.0 / d - cosine / sine
            tile[LIFT + j] = -b / 6.0 * (1.0 + b * b / 60.0) if near else c / half - 2.0 / d
            tile[ROOT + j] = 1.0 + b * b / 12.0 if near else np.sqrt(d / sine)
        for j in range(ANGLES):
            tiles[t, V, j] = 2.0 * tile[HALF_SIN + j] ** 2
    return tiles, constants, source


@njit(**STRICT)
def _bessel_start(nu, tile):
    """The five Bessel functions at the order nu of one tile."""
    for j in range(ANGLES):
        tile[SINE + j], tile[COSINE + j] = sincos((nu - 0.5) * tile[BETA + j])  # one sine for five arguments
    for function in range(5):
        below, kind, of_bend, of_lift, of_lean = STARTS[function]
        order, turn, row = nu - below, (1.0 if below == 0.0 else -1.0), BEFORE + function * ANGLES
        for j in range(ANGLES):
            s, c, half_s, half_c = tile[SINE + j], tile[COSINE + j], turn * tile[HALF_SIN + j], tile[HALF_COS + j]
            s, c = s * half_c + c * half_s, c * half_c - s * half_s
            shift = (of_bend * tile[BEND + j] + of_lift * tile[LIFT + j] + of_lean * tile[LEAN + j]) / order  # < 0.01
            ds, dc = shift * (1.0 - shift * shift * (1.0 / 6.0)), 1.0 - 0.5 * shift * shift
            u = order * tile[BETA + j] + shift
            j0, j1, j2 = bessel_far(u if u > BESSEL_END else BESSEL_END, s * dc + c * ds, c * dc - s * ds)
            tile[row + j] = j0 if kind == 0.0 else (j1 if kind == 1.0 else j2)
        for j in range(ANGLES):
            b = tile[BETA + j]
            if order * b < BESSEL_END + 0.1:
                u = order * b + (of_bend * tile[BEND + j] + of_lift * tile[LIFT + j] + of_lean * tile[LEAN + j]) / order
                if u < BESSEL_END:
                    j0, j1, j2 = bessel_near(max(u, 0.0))
                    tile[row + j] = j0 if kind == 0.0 else (j1 if kind == 1.0 else j2)


@njit(**STRICT)
def _closed(n, before, after):
    """T_n from pi_{n-1}, pi_n."""
    return before + after - 0.5 * ((2.0 * n + 1.0) / (n * (n + 1.0)) * after - (2.0 * n - 1.0) / (n * (n - 1.0)) * before)


@njit(**STRICT)
def _start(tiles, constants, first, sign, behind):
    """Put the state of order `first` into all tiles and sign T_first into their sums."""
    n = float(first)
    swing = 1.0 if first % 2 else -1.0
    for t in range(tiles.shape[0]):
        tile = constants[t]
        _bessel_start(n + 0.5, tile)
        for j in range(ANGLES):
            root = tile[ROOT + j]
            stretched = root * root * root  # with b/sin b
            before, after = (n - 1.0) * n * stretched * tile[BEFORE + j], n * (n + 1.0) * stretched * tile[AFTER + j]
            ahead = _closed(n, before, after)
            if behind:  # pi_n(pi - b) = (-1)^(n+1) pi_n(b)
                tiles[t, DIF_R, j] += sign * swing * _closed(n, -before, after)
            else:
                tiles[t, SUM_R, j] += sign * ahead
            if sign > 0.0:
                q = root * tile[Q_AFTER + j]
                tiles[t, P, j] = root * tile[P_AFTER + j]
                tiles[t, E, j] = -tiles[t, V, j] * ahead
                tiles[t, Q, j] = q
                tiles[t, F, j] = (q - root * tile[Q_BEFORE + j]) * (n - 1.0) * (n + 1.0) / n


@njit(**STRICT)
def _mix(work, rows, first, count, scales, order, front, back):
    """Coefficients of the two sums, for exp(+i w t), and their twins beyond 90 degrees, and what the recurrences need of n.

    Row c is of n = first + c; work (.., 4) has `rows` of them, zero beyond.
    """
    for c in range(count):
        n = float(first + c)
        k = 2.0 * n + 1.0
        order[c, 0], order[c, 1], order[c, 2] = k, 2.0 * k / (n * (n + 1.0)), (n + 1.0) / (n * (n + 2.0))
    weight = np.empty(count)
    centre, width, low, high, soft = scales[0], scales[1], scales[2], scales[3], scales[4]
    for c in range(count):
        weight[c] = share(first + c + 0.5, centre, width, low, high, soft)
    for c in range(count):
        n = first + c
        k = 2.0 * n + 1.0
        kw = k * weight[c]
        ar, ai, br, bi = 0.0, 0.0, 0.0, 0.0
        if c < rows:
            ar, ai, br, bi = work[c, 0], work[c, 1], work[c, 2], work[c, 3]
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
def _near(m, x, spans, count):
    """Whether the coefficients of all spans may start at the span."""
    good = True
    for span in range(count):
        good = good and reach(m, x, spans[span, 0], spans[span, 1])
    return good


@njit(**STRICT)
def _whole(m, x, scales, spans):
    """Which of the spheres x (R,) need their coefficients from n = 1 on, and the largest of them (0: none)."""
    from_first, size = np.zeros(x.shape[0], np.bool_), 0.0
    for r in range(x.shape[0]):
        if scales[r, 1] > 0.0 and not _near(m, x[r], spans, _spans(x[r], scales[r], spans)):
            from_first[r], size = True, max(size, x[r])
    return from_first, size


@njit(**STRICT)
def wave_block(m, x, theta, scales, out):
    """Add the edge sums of the spheres x (R,) to out (R, A, 2), S1 and S2 for exp(+i w t); those without a window stay."""
    spans = np.empty((2, 2), np.int64)
    from_first, size = _whole(m, x, scales, spans)
    width = LANES if x.shape[0] > 1 and terms(size) <= 12_000 else 1
    work, lane, xs = np.empty((terms(size) + 6 if size > 0.0 else 0, 4, width)), np.empty((27, width)), np.empty(width)
    coefficients, table = np.empty((0, 4)), np.empty((4, 0))
    order, front, back = np.empty((CHUNK, 3)), np.empty((CHUNK, 4)), np.empty((CHUNK, 4))
    ahead, ahead_constants, ahead_source = _angles(theta, True)
    behind, behind_constants, behind_source = _angles(theta, False)
    for r in range(x.shape[0]):
        if r % width == 0:
            needed = False
            for j in range(width):
                k = min(r + j, x.shape[0] - 1)
                xs[j], needed = min(x[k], size), needed or from_first[k]
            if needed:
                wave_coefficients(m, xs, lane, work)
        if scales[r, 1] <= 0.0:
            continue
        reset(ahead)
        reset(behind)
        for span in range(_spans(x[r], scales[r], spans)):
            low, high = spans[span]
            if low > 1:
                _start(ahead, ahead_constants, low, 1.0, False)
                _start(behind, behind_constants, low, 1.0, True)
            if span == 1:  # what the first span has had already
                _start(ahead, ahead_constants, spans[0, 1], -1.0, False)
                _start(behind, behind_constants, spans[0, 1], -1.0, True)
            if not from_first[r]:
                if high - low > coefficients.shape[0]:
                    coefficients, table = np.empty((high - low + 100, 4)), np.empty((4, high - low + 101))
                stretch(m, x[r], low, high, table, coefficients)
            for start in range(low, high, CHUNK):
                count = min(CHUNK, high - start)
                if from_first[r]:
                    _mix(work[start - 1 :, :, r % width], terms(x[r]) + 1 - start, start, count, scales[r], order, front, back)
                else:
                    _mix(coefficients[start - low :], count, start, count, scales[r], order, front, back)
                for t in range(ahead.shape[0]):
                    sweep(order, front, 0, count, ahead[t])
                for t in range(behind.shape[0]):
                    sweep(order, back, 0, count, behind[t])
        _collect(ahead, ahead_source, False, out[r])
        _collect(behind, behind_source, True, out[r])
