"""Which rays of a sphere leave at which angle: geometry, independent of its size.

Time factor exp(+i w t) with eta = n - ik, van de Hulst's signs.  A ray that meets the surface at incidence t (refracted: tt) and
leaves after p chords has turned by the unfolded angle

    theta_p(t) = 2 p tt - 2 t - (p - 1) pi,      d theta_p/dt = 2 (p cos t/w - 1),      w = sqrt(n^2 - sin^2 t),

and is seen at theta = q (theta_p - 2 pi l), q = +-1.  Here its target is written T = M pi + beta or M pi - beta, beta the angle
from the nearer end of the axis (M even: forward): the two signs are the two halves of a ring around the axis.  For 1 < n < p
theta_p has a maximum, the rainbow, at cos^2 t = (n^2 - 1)/(p^2 - 1); below it two rays share a target, above it there is a
pair of complex rays.

Absorption: chords of the real index n, weakened by exp(-2 x p k cos tt), and the complex index in Fresnel's formulas.  Bending
by k is left out: it shifts phases by x k^2, and where that counts exp(-x k) leaves nothing.
"""

from __future__ import annotations

import numpy as np
from numba import njit

STRICT = dict(cache=True, nogil=True, error_model="numpy")

# Columns of a ray
LAM, GEOMETRY, SINE, SLOPE, FLOOR, PATH, KAPPA, SIGN, CHORD, R1, I1, R2, I2, AXIAL = range(14)
# AXIAL: 2 reflected outside, 1 the ray along the axis, else 0
# and of a pair of complex rays (LAM, SINE, PATH = Re, KAPPA, CHORD as above); t- is the conjugate of t+
G_R, G_I, PATH_I, CHORD_I, LAM_I = 1, 3, 4, 7, 13
M_R1, M_I1, M_R2, M_I2 = 14, 15, 16, 17  # reflection and refraction of the ray t-
END = 18  # +1 in the forward half, -1 in the backward one
COLUMNS = 19
SINGLE, RAINBOW, AXIS, DARK = range(4)
FADED = 120.0  # exponent of the dark side, as estimated, from which nothing is left
REACH = 0.7  # rad that a complex ray is followed into the dark side
APART = 1e-9  # rad: nearer to the rainbow angle the two rays differ by rounding


@njit(**STRICT)
def _refracted(eta, sin2):
    """w = sqrt(eta^2 - sin^2 t), the branch that decays inwards for exp(+i w t)."""
    square = eta * eta - sin2
    if square.imag == 0.0 and square.real < 0.0:
        return complex(0.0, -np.sqrt(-square.real))
    root = np.sqrt(square)
    return -root if root.real < 0.0 else root


@njit(**STRICT)
def _fresnel(eta, sin2, cos):
    """r1 (perpendicular), r2 (parallel)."""
    if np.isinf(eta.real):
        return -1.0 + 0.0j, 1.0 + 0.0j
    w = _refracted(eta, sin2)
    e2cos = eta * eta * cos
    if cos == 0.0:
        return -1.0 + 0.0j, -1.0 + 0.0j
    return (cos - w) / (cos + w), (e2cos - w) / (e2cos + w)


@njit(**STRICT)
def _through(r, p):
    """(1 - r^2)(-r)^(p-1)."""
    value = 1.0 - r * r
    for _ in range(p - 1):
        value = value * -r
    return value


@njit(**STRICT)
def unfolded(n, p, t):
    return 2.0 * p * np.arcsin(min(np.sin(t) / n, 1.0)) - 2.0 * t - (p - 1.0) * np.pi


@njit(**STRICT)
def _solve(n, p, target, low, high, rising, guess):
    """The t of one monotone segment with theta_p(t) = target: Newton's method, kept inside a shrinking bracket."""
    t = guess if low < guess < high else 0.5 * (low + high)
    base = (p - 1.0) * np.pi + target
    for _ in range(100):
        s, c = np.sin(t), np.cos(t)
        excess = 2.0 * p * np.arcsin(min(s / n, 1.0)) - 2.0 * t - base
        if (excess > 0.0) == rising:
            high = t
        else:
            low = t
        w2 = n * n - s * s
        step = excess * 0.5 / (p * c / np.sqrt(w2) - 1.0) if w2 > 0.0 else np.inf
        new = t - step
        if not (low <= new <= high):
            new = 0.5 * (low + high)
        step = abs(new - t)
        t = new
        if step < 1e-8 * t * min(c, 1.0) or step < 1e-16:  # the next step would be its square
            break
    return t


@njit(**STRICT)
def _ray(eta, p, t, sine, kappa, axial, bow, row):
    """Fill one ray."""
    n = eta.real
    s, c = np.sin(t), np.cos(t)
    w = np.sqrt(max(n * n - s * s, 1e-300))
    slope = 2.0 * (p * c / w - 1.0)
    row[LAM], row[SINE], row[KAPPA], row[AXIAL] = s, sine, kappa, axial
    row[GEOMETRY], row[SLOPE] = s * c, abs(slope)
    bend = 2.0 * p * s * (n * n - 1.0) / (w * w * w)
    row[FLOOR] = np.cbrt(2.0 * bend * bend / max(c, 1e-12)) if bow else 0.0
    row[PATH] = 2.0 * (c - p * w)
    row[SIGN] = 1.0 if slope > 0.0 else -1.0
    row[CHORD] = -2.0 * p * eta.imag * w / n
    if eta.imag == 0.0:
        r1, r2 = (c - w) / (c + w), (n * n * c - w) / (n * n * c + w)
        row[R1], row[I1], row[R2], row[I2] = _through(r1, p), 0.0, _through(r2, p), 0.0
        return
    r1, r2 = _fresnel(eta, s * s, c)
    e1, e2 = _through(r1, p), _through(r2, p)
    row[R1], row[I1], row[R2], row[I2] = e1.real, e1.imag, e2.real, e2.imag


@njit(**STRICT)
def _dark(eta, p, target, bow, top, sine, kappa, guess, row):
    """Fill the pair of complex rays beyond the rainbow; returns t+, or 0 where there is none."""
    n = eta.real
    h = 2.0 * (p * p - 1.0) / (p * p) * np.tan(bow)
    t = bow - 1j * np.sqrt(2.0 * (target - top) / h) if guess == 0.0 else guess
    step = 1.0 + 0j
    for _ in range(40):
        s = np.sin(t)
        w = np.sqrt(n * n - s * s)
        slope = 2.0 * (p * np.cos(t) / w - 1.0)
        step = (2.0 * p * np.arcsin(s / n) - 2.0 * t - (p - 1.0) * np.pi - target) / slope
        t = t - step
        if abs(step) < 1e-8 * abs(t - bow) or abs(step) < 1e-15:
            break
    if not (abs(step) < 1e-4 * abs(t - bow) and 0.0 < t.real < 0.5 * np.pi and t.imag < 0.0):
        return 0.0j
    s, c = np.sin(t), np.cos(t)
    w = np.sqrt(n * n - s * s)
    geometry = np.sqrt(s * c) / np.sqrt(2.0 * (p * c / w - 1.0))
    path, chord = 2.0 * (c - p * w), -2.0 * p * eta.imag * w / n
    row[LAM], row[SINE], row[KAPPA] = np.sin(t.real), sine, kappa
    row[LAM_I] = np.cos(t.real) * t.imag
    row[G_R], row[G_I] = geometry.real, geometry.imag
    row[PATH], row[PATH_I], row[CHORD], row[CHORD_I] = path.real, path.imag, chord.real, chord.imag
    for side in range(2):
        if side == 1:
            s, c = np.conj(s), np.conj(c)
        w = np.sqrt(eta * eta - s * s)
        e1 = _through((c - w) / (c + w), p)
        e2 = _through((eta * eta * c - w) / (eta * eta * c + w), p)
        if side == 0:
            row[R1], row[I1], row[R2], row[I2] = e1.real, e1.imag, e2.real, e2.imag
        else:
            row[M_R1], row[M_I1], row[M_R2], row[M_I2] = e1.real, e1.imag, e2.real, e2.imag
    return t


@njit(**STRICT)
def trace(m, theta, orders, rainbow, axis, x=1.0):
    """Rays of the orders p = 0..orders at theta (A,) rad, nearby angles best together; x: the smallest sphere that will ask.

    Returns
    -------
    items : (I, 4) int64: kind, angle, row, row of the partner (-1: none)
    rays : (R, COLUMNS)
    """
    eta = np.conj(m)
    n = eta.real
    mirror = np.isinf(n)
    count = theta.shape[0]
    room = 4 * count + 16
    items, rays = np.empty((room, 4), np.int64), np.empty((room, COLUMNS))
    used, rows = 0, 0
    for a in range(count):
        t = 0.5 * (np.pi - theta[a])
        s, c = np.cos(0.5 * theta[a]), np.sin(0.5 * theta[a])
        r1, r2 = _fresnel(eta, s * s, c)
        ray = rays[rows]
        ray[LAM], ray[GEOMETRY], ray[SINE], ray[SLOPE], ray[FLOOR], ray[AXIAL] = s, 0.25, 1.0, 1.0, 0.0, 2.0
        ray[PATH], ray[KAPPA], ray[SIGN], ray[CHORD] = 2.0 * c, 0.25 * np.pi, -1.0, 0.0
        ray[R1], ray[I1], ray[R2], ray[I2] = r1.real, r1.imag, r2.real, r2.imag
        items[used, 0], items[used, 1], items[used, 2], items[used, 3] = SINGLE, a, rows, -1
        used, rows = used + 1, rows + 1
    if mirror or n <= 0.0:
        return items[:used], rays[:rows]
    end = 0.5 * np.pi if n >= 1.0 else np.arcsin(n)
    where, number = np.empty((2, 2), np.int64), np.empty((2, 2), np.bool_)
    guess, aim, tangent, across, around = np.empty((2, 2)), np.empty((2, 2)), np.empty((2, 2)), np.empty(2), np.empty(2)
    dark_row, dark_guess = np.empty(COLUMNS), np.empty(2, np.complex128)
    for p in range(1, orders + 1):
        bow = -1.0
        if p >= 2 and 1.0 < n < p:
            bow = np.arccos(np.sqrt((n * n - 1.0) / (p * p - 1.0)))
        segments = 2 if bow > 0.0 else 1
        reach = REACH
        if bow > 0.0:  # where the largest dark side has faded: exponent zeta^(3/2) 2/3, near the rainbow, with a margin
            h = 2.0 * (p * p - 1.0) / (p * p) * np.tan(bow)
            reach = min(REACH, (1.5 * FADED / x) ** (2.0 / 3.0) * np.cbrt(0.5 * h / np.cos(bow) ** 2))
        start, last = unfolded(n, p, 0.0), unfolded(n, p, end)
        top = unfolded(n, p, bow) if segments == 2 else max(start, last)
        bottom = min(start, last)
        first_pole = int(np.floor(bottom / np.pi)) - 1
        last_pole = int(np.ceil((top + REACH) / np.pi)) + 1
        for pole in range(first_pole, last_pole + 1):
            forward = pole % 2 == 0
            end_sign = 1.0 if forward else -1.0
            guess[:] = -1.0
            dark_guess[:] = 0.0
            for a in range(count):
                if (theta[a] <= 0.5 * np.pi) != forward:
                    continue
                beta = max(theta[a] if forward else np.pi - theta[a], 1e-10)
                sine = np.sin(beta)
                if pole * np.pi - beta > top + REACH or pole * np.pi + beta < bottom:
                    continue
                if rows + 8 > rays.shape[0] or used + 8 > items.shape[0]:
                    more, wider = np.empty((2 * items.shape[0], 4), np.int64), np.empty((2 * rays.shape[0], COLUMNS))
                    more[:used], wider[:rows] = items[:used], rays[:rows]
                    items, rays = more, wider
                number[:] = False
                for side in range(2):  # 0: +beta, 1: -beta
                    target = pole * np.pi + (beta if side == 0 else -beta)
                    if forward:
                        q, fold = (1.0, pole // 2) if side == 0 else (-1.0, pole // 2)
                    else:
                        q, fold = (-1.0, (pole + 1) // 2) if side == 0 else (1.0, (pole - 1) // 2)
                    kappa = 0.5 * np.pi * (1.0 + p - 2.0 * fold - 0.5 * q)
                    if segments == 2:
                        if rainbow and abs(target - top) < APART:
                            target = top - APART if target <= top else top + APART
                        if target > top:
                            if not rainbow or target - top > reach:
                                continue
                            dark_guess[side] = _dark(eta, p, target, bow, top, sine, kappa, dark_guess[side], dark_row)
                            if dark_guess[side] != 0.0:
                                dark_row[END] = end_sign
                                rays[rows] = dark_row
                                items[used, 0], items[used, 1], items[used, 2], items[used, 3] = DARK, a, rows, -1
                                used, rows = used + 1, rows + 1
                            continue
                    for part in range(segments):
                        low, high = (bow, end) if part == 1 else (0.0, bow if segments == 2 else end)
                        at_low = top if part == 1 else start
                        at_high = top if part == 0 and segments == 2 else last
                        if not min(at_low, at_high) <= target <= max(at_low, at_high):
                            continue
                        first = guess[part, side]  # from the last angle along the tangent
                        if first > 0.0:
                            first += (target - aim[part, side]) / tangent[part, side]
                        t = _solve(n, p, target, low, high, at_high > at_low, first)
                        guess[part, side], aim[part, side] = t, target
                        axial = 1.0 if part == 0 and pole == 1 - p else 0.0
                        _ray(eta, p, t, sine, kappa, axial, segments == 2, rays[rows])
                        tangent[part, side] = rays[rows, SIGN] * rays[rows, SLOPE]
                        if segments == 2:
                            rays[rows, SIGN] = 1.0 if part == 0 else -1.0
                        rays[rows, END] = end_sign
                        number[part, side], where[part, side] = True, rows
                        rows += 1
                # A ray may have a partner across the rainbow and one across the axis: the smaller phase difference wins.
                across[:] = np.inf
                around[:] = np.inf
                for side in range(2):
                    if rainbow and number[0, side] and number[1, side]:
                        across[side] = max(0.5 * (rays[where[0, side], PATH] - rays[where[1, side], PATH]), 0.0)
                for part in range(2):
                    if axis and number[part, 0] and number[part, 1]:
                        around[part] = max(0.5 * (rays[where[part, 0], PATH] - rays[where[part, 1], PATH]), 0.0)
                for part in range(2):
                    if around[part] > min(across[0], across[1]):
                        around[part] = np.inf
                bowed = np.isinf(min(around[0], around[1]))
                for part in range(2):
                    if around[part] < np.inf:
                        items[used, 0], items[used, 1] = AXIS, a
                        items[used, 2], items[used, 3] = where[part, 0], where[part, 1]
                        used += 1
                        number[part, 0], number[part, 1] = False, False
                for side in range(2):
                    if across[side] < np.inf and bowed:
                        items[used, 0], items[used, 1] = RAINBOW, a
                        items[used, 2], items[used, 3] = where[0, side], where[1, side]
                        used += 1
                        number[0, side], number[1, side] = False, False
                for part in range(2):
                    for side in range(2):
                        if number[part, side]:
                            items[used, 0], items[used, 1], items[used, 2], items[used, 3] = SINGLE, a, where[part, side], -1
                            used += 1
    return items[:used], rays[:rows]
