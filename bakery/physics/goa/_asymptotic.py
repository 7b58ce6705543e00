"""Coefficients a_n, b_n of a stretch of orders alone: recurrences that start there, from asymptotic forms, instead of at n = 1.

The notation of `bakery.mie.series`: psi, chi the Riccati-Bessel functions of x, R_n = psi_n/psi_{n-1}(m x).  Start values are

- psi_n, chi_n(x): Debye's expansion to the fifth order (DLMF 10.19.6) at an order at least KEEP x^(1/3) below x, then upward.
  Beyond n = x errors of psi grow like chi/psi, while psi/chi, which a_n follows, falls: 1e-8 stays below 1e-7 of a_n's scale;
- R_n(m x): downward, from the fixed point of its recurrence where that forgets its start (orders above |m x|, strong
  absorption), from Debye's expansion where m x is that far from the order, both for complex m too.

Where neither holds `reach` says so, and the series from n = 1 has to serve.
"""

import numpy as np

from bakery.physics.goa._special import STRICT
from bakery.physics.mie.coefficients import NEAR, asymptotic_ratio
from bakery.system.compiled import njit

KEEP = 10.0  # distance from a turning point, in units of its x^(1/3): the sixth term of Debye's series is 3e-8 there
FORGOTTEN = 10.0  # exp(-2 * 10) is left of an error of the start
MOST = 400.0  # such steps that are worth it


@njit(**STRICT)
def _phase(nu, z):
    """Debye's phase, cos and sin of its angle."""
    cos = nu / z
    sin = np.sqrt((1.0 - cos) * (1.0 + cos))
    return z * sin + 1j * nu * np.log(cos + 1j * sin) - 0.25 * np.pi, cos, sin


@njit(**STRICT)
def _debye(nu, z, shift):
    """psi and chi of order nu - 1/2 at z, away from the turning point, times exp(-shift)."""
    phase, cos, sin = _phase(nu, z)
    cot = cos / sin
    a, q = cot / nu, cot * cot
    b = a * a
    even = 1.0 + b * (-(81.0 + q * (462.0 + q * 385.0)) / 1152.0 + b * (
        4465125.0 + q * (94121676.0 + q * (349922430.0 + q * (446185740.0 + q * 185910725.0)))) / 39813120.0)
    odd = a * ((3.0 + 5.0 * q) / 24.0 + b * (-(30375.0 + q * (369603.0 + q * (765765.0 + q * 425425.0))) / 414720.0 + b * (
        1519035525.0 + q * (49286948607.0 + q * (284499769554.0 + q * (614135872350.0 + q * (
            566098157625.0 + q * 188699385875.0))))) / 6688604160.0))
    scale = np.sqrt(1.0 / sin)
    plus, minus = np.exp(1j * phase - shift), np.exp(-1j * phase - shift)
    c, s = 0.5 * (plus + minus), -0.5j * (plus - minus)
    return scale * (c * even + s * odd), scale * (c * odd - s * even)


@njit(**STRICT)
def _steps_to_forget(m, x, order):
    """Steps of the downward recurrence of R_n(mx) from above `order` after which its start is forgotten."""
    z = m * x
    rate = -np.log(abs(asymptotic_ratio((2.0 * order + 1.0) / z)))
    return FORGOTTEN / rate if rate > 0.0 else np.inf


@njit(**STRICT)
def reach(m, x, low, high):
    """Whether the coefficients of the orders low..high-1 may start here."""
    if low < 100 or x - KEEP * np.cbrt(x) < 100.0:
        return False
    if np.isinf(m.real):
        return True
    if abs(m - 1.0) <= NEAR:
        return False
    size = abs(m) * x
    return _steps_to_forget(m, x, high) <= MOST or (m.real > 0.0 and abs(m * x - high) > KEEP * np.cbrt(size) and size > 100.0)


@njit(**STRICT)
def stretch(m, x, low, high, table, work):
    """a_n, b_n of the orders low..high-1: work (rows, 4) takes Re a, Im a, Re b, Im b; table (4, rows + 1) is scratch."""
    count = high - low
    psi, chi, ratio, ratio_i = table[0], table[1], table[2], table[3]
    xi = 1.0 / x
    n = min(low, int(x - KEEP * np.cbrt(x)))
    p, c = _debye(n + 0.5, complex(x), 0.0)
    p_next, c_next = _debye(n + 1.5, complex(x), 0.0)
    p0, c0, p1, c1 = p.real, c.real, p_next.real, c_next.real
    while n < low:
        f = (2.0 * n + 3.0) * xi
        p0, p1, c0, c1, n = p1, f * p1 - p0, c1, f * c1 - c0, n + 1
    for i in range(count + 1):
        psi[i], chi[i] = p0, c0
        f = (2.0 * (low + i) + 3.0) * xi
        p0, p1, c0, c1 = p1, f * p1 - p0, c1, f * c1 - c0
    mirror = np.isinf(m.real)
    if mirror:
        for i in range(count):
            ratio[i], ratio_i[i] = 1.0, 0.0
    else:
        _inner(m, x, low, high, ratio, ratio_i)
    v = 0.0j if mirror else 1.0 / m
    g = 1.0 + 0.0j if mirror else (m - 1.0) * (m + 1.0) * v * v
    gi = -2.0 * v.real * v.imag
    mr, mi = (1e40 if mirror else m.real), (0.0 if mirror else m.imag)
    for i in range(count):
        rr, ri, h = ratio[i], ratio_i[i], (low + i + 1.0) * xi
        ar, ai = rr * v.real - ri * v.imag + h * g.real, rr * v.imag + ri * v.real + h * gi
        br, bi = rr * mr - ri * mi, rr * mi + ri * mr
        work[i, 0], work[i, 1] = _fraction(ar, ai, psi[i], psi[i + 1], chi[i], chi[i + 1])
        work[i, 2], work[i, 3] = _fraction(br, bi, psi[i], psi[i + 1], chi[i], chi[i + 1])


@njit(**STRICT)
def _fraction(ar, ai, p1, p2, c1, c2):
    """N/(N - iM)."""
    nr, ni, dr, di = p2 - ar * p1, -ai * p1, c2 - ar * c1, -ai * c1
    tr, ti = nr + di, ni - dr
    scale = 1.0 / (tr * tr + ti * ti)
    return (nr * tr + ni * ti) * scale, (ni * tr - nr * ti) * scale


@njit(**STRICT)
def _inner(m, x, low, high, ratio, ratio_i):
    """R_{n+1}(mx) of the orders low..high-1."""
    w = (1.0 / m) / x
    steps = _steps_to_forget(m, x, high)
    if steps <= MOST:
        n = high + int(steps) + 1
        r = asymptotic_ratio((2.0 * n + 3.0) * w)
    else:
        n = high
        shift = abs(_phase(n + 0.5, m * x)[0].imag)
        before, after = _debye(n + 0.5, m * x, shift)[0], _debye(n + 1.5, m * x, shift)[0]
        r = after / (before if abs(before) > 1e-100 else 1e-100 + 0.0j)
    if m.imag == 0.0:  # n: order of the ratio R_{n+1} held
        a, b = w.real, r.real
        while n >= low:
            if n < high:
                ratio[n - low], ratio_i[n - low] = b, 0.0
            t = (2.0 * n + 1.0) * a - b
            b = 1.0 / (t if t != 0.0 else 1e-100)
            n -= 1
        return
    wr, wi, rr, ri = w.real, w.imag, r.real, r.imag
    while n >= low:
        if n < high:
            ratio[n - low], ratio_i[n - low] = rr, ri
        tr, ti = (2.0 * n + 1.0) * wr - rr, (2.0 * n + 1.0) * wi - ri
        scale = 1.0 / max(tr * tr + ti * ti, 1e-290)
        rr, ri = tr * scale, -ti * scale
        n -= 1
