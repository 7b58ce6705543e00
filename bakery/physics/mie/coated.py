"""Coefficients and angular sums of a sphere in a concentric shell: arrays of floats in and out.

The shell is solved as the homogeneous sphere is (`kernels`): with R_n the ratio of the radial function of order n + 1 to that of
order n just inside the surface, A = R/m + (n+1)/y (1 - 1/m^2) for a_n and A = m R for b_n, and a_n (or b_n) = N/(N - iM).
In a homogeneous sphere R is psi_{n+1}/psi_n(my).  In a shell the radial function is psi - t f of the shell, where f is a second
solution and t = N/M the coefficient of the core, seen from within the shell, so that with z1, z2 the phases m_shell x and
m_shell y of the shell's two surfaces

    R = (R2 - S F2)/(1 - S),   S = Q (R1 - A1)/(F1 - A1),   Q = psi_n(z1) f_n(z2)/(f_n(z1) psi_n(z2)),

R1, R2 and F1, F2 the ratios of psi and f at z1 and z2, and A1 the A of the core.  All of these are ratios of order 1: none
overflows where the textbook's Bessel functions do (thick, large or absorbing shells), Q falls below 1e-300 where the core is no
longer seen, and as x -> 0 the leading powers cancel on paper as in `kernels`.

Source: Bohren & Huffman 1983, section 8.1; Q by its recurrence as in Yang, Appl. Opt. 42, 1710 (2003).

f is chi where the shell is nearly clear: all is real then if both indices are, and what is absorbed keeps its digits.  Where
light fades in the shell (Im z2 >= 1), psi and chi are nearly the same function, and f is zeta = psi - i chi.

Where psi_0 is small its rounding error is not: Q then starts from psi_1 over the ratio that the recurrence gives.
"""

import numpy as np

from bakery.physics.mie.angular import BLOCK, angular_coefficients, gather, order_table, reset, sweep, tiles_of
from bakery.physics.mie.coefficients import STRICT, asymptotic_ratio, reciprocal, terms, wave_coefficients
from bakery.physics.mie.series import ABS, BACK_I, BACK_R, CROSS, SCA
from bakery.physics.mie.vector import fma
from bakery.system.compiled import njit

FADED = 1.0  # Im z2 from which on f is zeta
_SMALLEST = 1e-60  # size parameter of a core that is none


@njit(**STRICT)
def _inverse(z):
    """1/z; at a pole a large number."""
    size = z.real * z.real + z.imag * z.imag
    if size < 1e-290:
        return complex(1e100, 0.0)
    size = 1.0 / size
    return complex(z.real * size, -z.imag * size)


@njit(**STRICT)
def _psi_ratios(m, x, count, ratio):
    """ratio[n] = psi_n/psi_{n-1}(mx) for n = 1 .. count, downward."""
    w, low = reciprocal(m, x)
    size = abs(m) * x
    start = terms(size)
    if m.imag > 0.0:
        # a starting error shrinks by exp(-2 n Im(mx)/|mx|^2) a step: enough steps for 1e-17
        start = min(start, int(np.ceil(np.sqrt(float(count) ** 2 + 40.0 * abs(m) ** 2 * x / m.imag))) + 16)
    start = max(start, count + 1)
    r = asymptotic_ratio((2.0 * start + 3.0) * w)
    for n in range(start, 0, -1):
        k = 2.0 * n + 1.0
        t = complex(fma(k, w.real, k * low.real), fma(k, w.imag, k * low.imag))
        r = _inverse(t - r)
        if n <= count:
            ratio[n] = r


@njit(**STRICT)
def _other_ratios(m, x, count, first, ratio):
    """ratio[n] = f_n/f_{n-1}(mx) for n = 1 .. count, upward from the first."""
    w, low = reciprocal(m, x)
    ratio[1] = first
    for n in range(1, count):
        k = 2.0 * n + 1.0
        t = complex(fma(k, w.real, k * low.real), fma(k, w.imag, k * low.imag))
        ratio[n + 1] = t - _inverse(ratio[n])


@njit(**STRICT)
def _start(m, x, faded, ratio):
    """psi_0 as the ratio psi_1/psi_0 has it, f_0, and f_1/f_0 at z = mx; with zeta without their factors exp(-iz) and exp(iz)."""
    zr, zi = m.real * x, m.imag * x
    z, low = complex(zr, zi), complex(fma(m.real, x, -zr), fma(m.imag, x, -zi))
    w = reciprocal(m, x)[0]
    if z.imag < 20.0:
        s, c = np.sin(z), np.cos(z)
        s, c = s + low * c, c - low * s
    else:
        s = c = 0.0j
    if not faded:
        f, first = c, w + s * _inverse(c)
    else:
        e = np.exp(1j * z)
        e += 1j * low * e
        f, first = -1j, w - 1j
        s, c = (e * s, e * c) if z.imag < 20.0 else (0.5j * (1.0 - e * e), 0.5 * (1.0 + e * e))
    second = s * w - c
    if abs(second) > abs(s):
        s = second * _inverse(ratio)
    return s, f, first


@njit(**STRICT)
def _shell_ratios(core, shell, x, y, count, of_a, of_b):
    """R of a_n and b_n just inside the shell's surface, of orders 1 .. count."""
    inner, r1, f1, r2, f2 = np.empty((5, count + 2), np.complex128)
    _psi_ratios(core, x, count + 1, inner)
    _psi_ratios(shell, x, count + 1, r1)
    _psi_ratios(shell, y, count + 1, r2)
    faded = shell.imag * y >= FADED
    p1, s1, first = _start(shell, x, faded, r1[1])
    _other_ratios(shell, x, count + 1, first, f1)
    p2, s2, first = _start(shell, y, faded, r2[1])
    _other_ratios(shell, y, count + 1, first, f2)
    q = p1 * s2 * _inverse(s1 * p2)
    if faded:
        q *= np.exp(2j * shell * (y - x))
    m = core / shell
    contrast = (core - shell) / shell * (m + 1.0) / (m * m)
    w = reciprocal(shell, x)[0]
    for n in range(1, count + 1):
        q = q * (r1[n] * f2[n]) * _inverse(f1[n] * r2[n]) if abs(q) > 1e-300 else 0.0j
        electric = inner[n + 1] / m + (n + 1.0) * w * contrast
        magnetic = m * inner[n + 1]
        s = q * (r1[n + 1] - electric) * _inverse(f1[n + 1] - electric)
        of_a[n] = (r2[n + 1] - s * f2[n + 1]) * _inverse(1.0 - s)
        s = q * (r1[n + 1] - magnetic) * _inverse(f1[n + 1] - magnetic)
        of_b[n] = (r2[n + 1] - s * f2[n + 1]) * _inverse(1.0 - s)


@njit(**STRICT)
def _coefficient(a, p1, p2, c1, c2):
    """a_n, |a_n|^2 and Re a_n - |a_n|^2 of an A and psi_n, psi_{n+1}, chi_n, chi_{n+1} outside."""
    n, m = p2 - a * p1, c2 - a * c1
    tr, ti = n.real + m.imag, n.imag - m.real
    scale = 1.0 / (tr * tr + ti * ti)
    square, lost = (n.real * n.real + n.imag * n.imag) * scale, a.imag * scale
    return complex(square + lost, (n.real * m.real + n.imag * m.imag) * scale), square, lost


@njit(**STRICT)
def coated_coefficients(core, shell, x, y, lane, work):
    """a_n, b_n of one sphere and their sums, laid out as by `coefficients.wave_coefficients` of one lane.

    core, shell: indices relative to the host; x, y: size parameters of core and whole, 0 <= x <= y.
    """
    if x <= _SMALLEST or core == shell or x >= y:
        wave_coefficients(core if x >= y else shell, np.full(1, y), lane, work)
        return
    count = terms(y)
    of_a, of_b = np.empty((2, count + 1), np.complex128)
    _shell_ratios(core, shell, x, y, count, of_a, of_b)
    outer = np.empty(count + 2, np.complex128)
    _psi_ratios(1.0 + 0.0j, y, count + 1, outer)
    inverse, w = 1.0 / shell, 1.0 / y
    low = w * fma(-w, y, 1.0)
    contrast = (shell - 1.0) * (shell + 1.0) * inverse * inverse
    p0, c0 = np.sin(y), np.cos(y)
    p1, c1 = p0 * w - c0 if y >= 1.0 else outer[1].real * p0, c0 * w + p0
    lane[SCA, 0] = lane[ABS, 0] = lane[CROSS, 0] = lane[BACK_R, 0] = lane[BACK_I, 0] = 0.0
    before_a, before_b, sign = 0.0j, 0.0j, -1.0
    for n in range(1, count + 1):
        k = 2.0 * n + 1.0
        f = fma(k, w, k * low)
        p2 = f * p1 - p0 if n + 1 <= y else outer[n + 1].real * p1
        c2 = f * c1 - c0
        a, a2, lost_a = _coefficient(of_a[n] * inverse + (n + 1.0) * w * contrast, p1, p2, c1, c2)
        b, b2, lost_b = _coefficient(of_b[n] * shell, p1, p2, c1, c2)
        work[n - 1, 0, 0], work[n - 1, 1, 0], work[n - 1, 2, 0], work[n - 1, 3, 0] = a.real, a.imag, b.real, b.imag
        lane[SCA, 0] += k * (a2 + b2)
        lane[ABS, 0] += k * (lost_a + lost_b)
        before = (before_a * a.conjugate() + before_b * b.conjugate()).real
        lane[CROSS, 0] += (n - 1.0) * (n + 1.0) / n * before + k / (n * (n + 1.0)) * (a * b.conjugate()).real
        lane[BACK_R, 0] += sign * k * (a - b).real
        lane[BACK_I, 0] += sign * k * (a - b).imag
        before_a, before_b, sign = a, b, -sign
        p0, p1, c0, c1 = p1, p2, c1, c2


@njit(**STRICT)
def coated_efficiency_block(core, shell, x, y, q_ext, q_sca, q_abs, q_back, g):
    """Efficiencies and asymmetry of spheres with cores x (R,) and sizes y (R,); fills five (R,) arrays."""
    if y.shape[0] == 0:
        return
    work, lane = np.empty((terms(np.max(y)) + 2, 4, 1)), np.empty((27, 1))
    for r in range(y.shape[0]):
        coated_coefficients(core, shell, x[r], y[r], lane, work)
        scale = 2.0 / y[r] / y[r]
        q_sca[r], q_abs[r] = scale * lane[SCA, 0], scale * lane[ABS, 0]
        q_ext[r] = q_sca[r] + q_abs[r]
        q_back[r] = 0.5 * scale * (lane[BACK_R, 0] ** 2 + lane[BACK_I, 0] ** 2)
        g[r] = 2.0 * lane[CROSS, 0] / lane[SCA, 0] if lane[SCA, 0] > 0.0 else 0.0


@njit(**STRICT)
def coated_angles(core, shell, x, y, weight, theta, mode, out):
    """What spheres scatter at theta (A,), in their order, added to out.

    out: (R, A, 4) amplitudes (mode 0), or (1, A, 4) weighted sums of the intensity (mode 1) or of Mueller elements (mode 2).
    """
    if y.shape[0] == 0:
        return
    most = terms(np.max(y)) + 2
    work, lane = np.empty((most, 4, 1)), np.empty((27, 1))
    order, front, back = order_table(most), np.empty((BLOCK, 4)), np.empty((BLOCK, 4))
    ahead, ahead_source = tiles_of(theta, True)
    behind, behind_source = tiles_of(theta, False)
    for r in range(y.shape[0]):
        coated_coefficients(core, shell, x[r], y[r], lane, work)
        rows = terms(y[r])
        reset(ahead)
        reset(behind)
        for start in range(0, rows, BLOCK):
            count = min(BLOCK, rows - start)
            angular_coefficients(work, 0, start, count, front, back)
            for t in range(ahead.shape[0]):
                sweep(order, front, start, count, ahead[t])
            for t in range(behind.shape[0]):
                sweep(order, back, start, count, behind[t])
        into = out[r if mode == 0 else 0]
        gather(ahead, ahead_source, False, mode, weight[r], into)
        gather(behind, behind_source, True, mode, weight[r], into)
