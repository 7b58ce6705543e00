"""Angles of incidence of the rays that leave at given angles, real and complex, many side by side.

The ray of order p that has turned by theta_p meets the surface at t and v inside, n sin v = sin t, with p v - t = b,
b = (theta_p + (p - 1) pi)/2.  So t is a zero of

    g(t) = n sin((b + t)/p) - sin t,

which knows neither inverse functions nor roots, for real and complex t alike.  2 g is the slope along t of the phase
2 (cos t - p n cos v): phases are exact to the square of an error of t.  g > 0 where theta_p(t) is below its target.

Real rays: the parabola through value, slope and curvature of g, on the side of its vertex where the segment lies (the error falls
with its cube, at the rainbow too), inside a shrinking bracket.  Complex rays: Halley's method.

Lanes.  A buffer of rows of WIDTH doubles; loops over the lanes of a row have no branches, so that they become vector
instructions.  A lane that is done stands still: its result does not depend on the others.
"""

import numpy as np

from bakery.physics.goa._special import INLINE, STRICT, sincos
from bakery.system.compiled import njit

WIDTH = 16
# Rows: half the turning b, guess then t (Re, Im), sin t, cos t, cos v (Re, Im), bracket, last step, 1 while searching, 1 if found
B, T, T_I, S, S_I, C, C_I, V, V_I, LOW, HIGH, STEP, ACTIVE, FOUND = range(0, 14 * WIDTH, WIDTH)
ROWS = 14
MOST = 80  # steps


@njit(**INLINE)
def _all_done(w):
    active = 0
    for j in range(WIDTH):
        active += w[ACTIVE + j] > 0.0
    return active == 0


@njit(**STRICT)
def real_rays(n, p, side, low, high, w):
    """Fill T, S, C, V from B and the guesses in T; low and high bound the monotone segment.

    side: +1 where theta_p falls with t, -1 where it rises.
    """
    for j in range(WIDTH):
        w[LOW + j], w[HIGH + j], w[STEP + j], w[ACTIVE + j] = low, high, np.inf, 1.0
        t = w[T + j]
        t = t if t > low else low
        w[T + j] = t if t < high else high
    share, nose = 1.0 / p, n / p
    for _ in range(MOST):
        for j in range(WIDTH):
            t, lower, upper, active = w[T + j], w[LOW + j], w[HIGH + j], w[ACTIVE + j] > 0.0
            s, c = sincos(t)
            v = (w[B + j] + t) * share
            sv, cv = sincos(v)
            sv, cv = (1.0 if v > 0.5 * np.pi else sv), (cv if cv > 0.0 else 0.0)  # far from the root: keep the sign of g
            g, slope, bend = n * sv - s, nose * cv - c, s - nose * share * sv
            below = g > 0.0
            raise_low = below == (side < 0.0)
            lower, upper = (t if raise_low else lower), (upper if raise_low else t)
            square = slope * slope - 2.0 * g * bend
            root = np.sqrt(square if square > 0.0 else 0.0)
            step = -2.0 * g / (slope + side * root)
            new = t + step
            size = abs(step)
            good = (new >= lower) & (new <= upper) & (size <= 0.7 * w[STEP + j])
            middle = 0.5 * (lower + upper)
            new = new if good else middle
            step = step if good else middle - t
            size = abs(step)
            scale = new if new < root else root
            near = good & (size <= 1e-4 * scale)
            converged = near | (size < 1e-15) | (g == 0.0)
            step = step if size < 1e-2 else 0.0
            # sin and cos at the new place from those at the old one: the steps that end a search are small
            small, inner = step * step, step * share
            ds, dc = step * (1.0 - small * (1.0 / 6.0)), 1.0 - 0.5 * small
            w[S + j] = s * dc + c * ds if active else w[S + j]
            w[C + j] = c * dc - s * ds if active else w[C + j]
            w[V + j] = cv * (1.0 - 0.5 * inner * inner) - sv * inner if active else w[V + j]
            w[T + j] = new if active else t
            w[LOW + j], w[HIGH + j], w[STEP + j] = lower, upper, size
            w[ACTIVE + j] = 0.0 if converged else w[ACTIVE + j]
        if _all_done(w):
            break


@njit(**INLINE)
def times(a, b, c, d):
    """(a + ib)(c + id)."""
    return a * c - b * d, a * d + b * c


@njit(**INLINE)
def over(a, b, c, d):
    """(a + ib)/(c + id), of moduli well inside the range of doubles."""
    scale = 1.0 / (c * c + d * d)
    return (a * c + b * d) * scale, (b * c - a * d) * scale


@njit(**INLINE)
def root(a, b):
    """Square root of a + ib with a real part >= 0; -i |.| of a negative number, the wave that decays for exp(+i w t)."""
    big = np.sqrt(0.5 * (np.sqrt(a * a + b * b) + abs(a)))
    small = 0.5 * b / (big if big > 0.0 else 1.0)
    turned = big if b > 0.0 else -big
    return (big if a >= 0.0 else abs(small)), (small if a >= 0.0 else turned)


@njit(**INLINE)
def waves(a, b):
    """sin and cos of a + ib, |b| < 6: Re sin, Im sin, Re cos, Im cos."""
    y = 0.125 * b
    q = y * y
    sh = y * (1.0 + q * (1.0 / 6.0 + q * (1.0 / 120.0 + q * (1.0 / 5040.0 + q * (1.0 / 362880.0 + q * (1.0 / 39916800.0 + q * (
        1.0 / 6227020800.0)))))))
    ch = 1.0 + q * (0.5 + q * (1.0 / 24.0 + q * (1.0 / 720.0 + q * (1.0 / 40320.0 + q * (1.0 / 3628800.0 + q * (
        1.0 / 479001600.0 + q * (1.0 / 87178291200.0)))))))
    for _ in range(3):
        sh, ch = 2.0 * sh * ch, 1.0 + 2.0 * sh * sh
    s, c = sincos(a)
    return s * ch, c * sh, c * ch, -s * sh


@njit(**STRICT)
def complex_rays(n, p, bow, w):
    """Fill T, S, C, V and FOUND from B and the guesses in T, T_I: one of each pair of rays beyond the rainbow at t = bow."""
    share, nose = 1.0 / p, n / p
    for j in range(WIDTH):
        w[ACTIVE + j], w[FOUND + j] = 1.0, 0.0
    for _ in range(MOST):
        for j in range(WIDTH):
            active, tr, ti = w[ACTIVE + j] > 0.0, w[T + j], w[T_I + j]
            sr, si, cr, ci = waves(tr, ti)
            vr, vi, ur, ui = waves((w[B + j] + tr) * share, ti * share)
            gr, gi = n * vr - sr, n * vi - si
            fr, fi = nose * ur - cr, nose * ui - ci
            hr, hi = sr - nose * share * vr, si - nose * share * vi
            er, ei = over(gr, gi, fr, fi)  # Newton's step, to be bent
            br, bi = over(hr, hi, fr, fi)
            br, bi = times(br, bi, er, ei)
            er, ei = over(er, ei, 1.0 - 0.5 * br, -0.5 * bi)
            x, y = tr - bow - er, ti - ei
            size, scale = er * er + ei * ei, x * x + y * y
            inside = (abs(y) < 6.0) & (x + bow > 0.0) & (x + bow < 0.5 * np.pi)
            converged = (size < 1e-30 + 1e-10 * scale) | (not inside)
            w[FOUND + j] = (1.0 if inside & (y < 0.0) & (size < 1e-8 * scale) else 0.0) if active else w[FOUND + j]
            w[T + j], w[T_I + j] = (x + bow if active else tr), (y if active else ti)
            w[ACTIVE + j] = 0.0 if converged else w[ACTIVE + j]
        if _all_done(w):
            break
    for j in range(WIDTH):
        traced = w[FOUND + j] > 0.0
        tr, ti = (w[T + j] if traced else bow), (w[T_I + j] if traced else -0.1)
        w[T + j], w[T_I + j] = tr, ti
        w[S + j], w[S_I + j], w[C + j], w[C_I + j] = waves(tr, ti)
        _, _, w[V + j], w[V_I + j] = waves((w[B + j] + tr) * share, ti * share)
