"""Rays with their phases: amplitudes of one sphere from the geometry of `_rays`.

exp(+i w t) inside; the results are conjugated to exp(-i w t).  A single ray is a exp(i(Psi - s pi/4)) with
a = x e_j sqrt(sin t cos t/(sin theta |theta_p'|)), Psi = x PATH + KAPPA.  Pairs take uniform formulas that tend to their two
rays far from the caustic:

- rainbow (Chester, Friedman and Ursell 1957): Ai and Ai' of zeta = [(3/4)(Psi_+ - Psi_-)]^(2/3), beyond it with complex rays;
- axis: J0, J1, J2 of half the phase difference, from the integral over the ring.

Caustics without such a formula are floored at their diffraction width.  Stretches of angles are taken WIDTH at a time: what all
lanes need in loops without branches, what few need (floors, shares of the exact waves) one by one.
"""

from typing import NamedTuple

import numpy as np

from bakery.physics.goa._rays import AXIS, DARK, DARKEST, FOCUS, RAINBOW, SINGLE
from bakery.physics.goa._solve import WIDTH, times
from bakery.physics.goa._special import BESSEL_END, STRICT, airy_of, bessel, bessel_far, bessel_near, decay, share, sincos, window
from bakery.physics.goa._surface import (
    ALWAYS,
    CHORD,
    CHORD_I,
    COLUMNS,
    CUBE,
    EXISTS,
    G_I,
    G_R,
    GEOMETRY,
    I1,
    I2,
    LAM,
    LAM_I,
    LIMIT,
    M_I1,
    M_I2,
    M_R1,
    M_R2,
    OF_REAL,
    PATH,
    PATH_I,
    R1,
    R2,
    SINE,
    SIZE,
    SLOPE,
)
from bakery.physics.lent import lent
from bakery.system.compiled import njit

# Rows of the lanes behind the columns of a ray: modulus, sin and cos of the phase; the waves of a single ray, or half the phase
# difference of a pair, its sin and cos, and Bessel functions of it
MOD, SIN, COS, HALF, HALF_SIN, HALF_COS, J_0, J_1, J_2 = range(COLUMNS, COLUMNS + 9)
WAVE, WAVE_I, WAVE_2, WAVE_2I = range(HALF, HALF + 4)
ROWS = COLUMNS + 9
EIGHTH = np.exp(0.25j * np.pi)


class Sphere(NamedTuple):
    """Size parameter, scales as `window`, and lam from which exact waves take a share."""

    x: float
    scales: np.ndarray
    clear: float


@njit(**STRICT)
def _load(rays, columns, row, count, w):
    for column in range(columns):
        if count == WIDTH:  # a known length: one instruction
            for j in range(WIDTH):
                w[column * WIDTH + j] = rays[column, row + j]
        else:
            for j in range(count):
                w[column * WIDTH + j] = rays[column, row + j]


@njit(**STRICT)
def _round(share, end, e1, e2):
    """Both polarisations mix in a ring around the axis: within its floor towards S1(0) = S2(0), S1(pi) = -S2(pi)."""
    share = min(share, 1.0)
    keep, mix = 0.5 * (1.0 + share), 0.5 * (1.0 - share) * end
    return keep * e1 + mix * e2, keep * e2 + mix * e1


@njit(**STRICT)
def ray_block(x, theta, items, rays, scales, out):
    """Fill out (R, A, 2), S1 and S2 for exp(+i w t), with the rays of the spheres x (R,).

    scales (R, 5) as `window`; without exact waves diffraction is added, tapered.
    """
    out[:] = 0.0
    rays, scales = lent(rays), lent(scales)
    w, second, clear = np.zeros(ROWS * WIDTH), np.zeros(ROWS * WIDTH), np.empty(x.shape[0])
    for r in range(x.shape[0]):
        # below, no partial wave is summed exactly, nor around the critical order
        clear[r] = scales[r, 0] - 5.0 * scales[r, 1] if scales[r, 1] > 0.0 else np.inf
        if scales[r, 4] > 0.0:
            clear[r] = scales[r, 2] - 5.0 * scales[r, 4]
    for i in range(items.shape[0]):
        kind, angle, length = int(items[i, 0]), int(items[i, 1]), int(items[i, 2])
        row, partner = int(items[i, 3]), int(items[i, 4])
        kappa, sign, end = items[i, 5], items[i, 6], items[i, 7]
        columns = COLUMNS if kind == DARK else (ALWAYS if kind in (SINGLE, FOCUS) else OF_REAL)
        for start in range(0, length, WIDTH):  # read once for all spheres
            count, a = min(WIDTH, length - start), angle + start
            _load(rays, columns, row + start, count, w)
            if kind in (RAINBOW, AXIS):
                _load(rays, OF_REAL, partner + start, count, second)
            for r in range(x.shape[0]):
                sphere, to = Sphere(x[r], scales[r], clear[r]), lent(out)[r, a : a + count]
                if kind == DARK:
                    _dark(sphere, kappa, end, w, to)
                elif kind == RAINBOW:
                    _rainbow(sphere, kappa, w, second, to)
                elif kind == AXIS:
                    _axis(sphere, kappa, sign, end, w, second, to)
                else:
                    _single(sphere, kind == FOCUS, kappa - 0.25 * np.pi * sign, end, w, rays, row + start, to)
    for r in range(x.shape[0]):
        if scales[r, 1] <= 0.0:
            _add_diffraction(x[r], theta, out[r])


@njit(**STRICT)
def gather(field, weight, sums):
    """sums (4, A) += weighted S11, S12, S33, S34 of the field (R, A, 2), conjugated, in the order of the spheres."""
    for r in range(field.shape[0]):
        w = weight[r]
        for a in range(field.shape[1]):
            s1, s2 = field[r, a, 0], field[r, a, 1]
            i1, i2 = s1.real**2 + s1.imag**2, s2.real**2 + s2.imag**2
            cross = np.conj(s2) * s1
            sums[0, a] += 0.5 * w * (i1 + i2)
            sums[1, a] += 0.5 * w * (i2 - i1)
            sums[2, a] += w * cross.real
            sums[3, a] += w * cross.imag


@njit(**STRICT)
def _single(sphere, focus, kappa, end, w, rays, row, out):
    """Add single rays to the amplitudes out (count, 2) of neighbouring angles."""
    x, count = sphere.x, len(out)
    floored = 0
    for j in range(WIDTH):
        w[SIN * WIDTH + j], w[COS * WIDTH + j] = sincos(x * w[PATH * WIDTH + j] + kappa)
        floored += not x >= w[LIMIT * WIDTH + j]
    _moduli(sphere, w)
    if floored:
        for j in range(count):
            if not x >= w[LIMIT * WIDTH + j]:
                _floor(sphere, j, focus, end, w, rays, row, out)
    for j in range(WIDTH):
        re, im = w[MOD * WIDTH + j] * w[COS * WIDTH + j], w[MOD * WIDTH + j] * w[SIN * WIDTH + j]
        w[WAVE * WIDTH + j], w[WAVE_I * WIDTH + j] = times(re, im, w[R1 * WIDTH + j], w[I1 * WIDTH + j])
        w[WAVE_2 * WIDTH + j], w[WAVE_2I * WIDTH + j] = times(re, im, w[R2 * WIDTH + j], w[I2 * WIDTH + j])
    for j in range(count):
        out[j, 0] += complex(w[WAVE * WIDTH + j], w[WAVE_I * WIDTH + j])
        out[j, 1] += complex(w[WAVE_2 * WIDTH + j], w[WAVE_2I * WIDTH + j])


@njit(**STRICT)
def _floor(sphere, j, focus, end, w, rays, row, out):
    """Add lane j of single rays, one near a caustic, and leave none of it."""
    x, scales, clear = sphere
    sine, geometry = rays[SINE, row + j], rays[GEOMETRY, row + j]
    slope = max(rays[SLOPE, row + j], np.cbrt(rays[CUBE, row + j] / x))
    e1, e2 = complex(w[R1 * WIDTH + j], w[I1 * WIDTH + j]), complex(w[R2 * WIDTH + j], w[I2 * WIDTH + j])
    if focus:
        width = 0.5 / np.sqrt(x)  # a point focus at the axis (n = p) has the width x^(-1/4)
        size = x * np.sqrt(min(geometry / sine, 1.0 / width) / max(slope, width))
    else:
        if x * sine < 1.0:
            e1, e2 = _round(x * sine, end, e1, e2)
            sine = 1.0 / x
        size = x * np.sqrt(geometry / (sine * slope))
    lam = x * w[LAM * WIDTH + j]
    if lam >= clear:
        size *= 1.0 - window(lam, scales)
    wave = size * decay(x * w[CHORD * WIDTH + j]) * complex(w[COS * WIDTH + j], w[SIN * WIDTH + j])
    out[j, 0] += wave * e1
    out[j, 1] += wave * e2
    w[MOD * WIDTH + j] = 0.0


@njit(**STRICT)
def _halves(x, kappa, w, second):
    """Mean phase of the pairs of rays, and half the difference."""
    for j in range(WIDTH):
        half = 0.5 * x * (w[PATH * WIDTH + j] - second[PATH * WIDTH + j])
        half = half if half > 0.0 else 0.0
        mean = 0.5 * x * (w[PATH * WIDTH + j] + second[PATH * WIDTH + j])
        w[SIN * WIDTH + j], w[COS * WIDTH + j] = sincos(mean + kappa)
        w[HALF_SIN * WIDTH + j], w[HALF_COS * WIDTH + j] = sincos(half)
        w[HALF * WIDTH + j] = half


@njit(**STRICT)
def _moduli(sphere, w):
    """a without Fresnel's factor: x sqrt(D), weakened by absorption and by the share of the exact waves."""
    x, scales, clear = sphere
    shared, absorbed = 0, 0
    for j in range(WIDTH):
        w[MOD * WIDTH + j] = x * w[SIZE * WIDTH + j]
        shared += x * w[LAM * WIDTH + j] >= clear
        absorbed += w[CHORD * WIDTH + j] != 0.0
    if shared:
        centre, width, low, high, soft = scales[0], scales[1], scales[2], scales[3], scales[4]
        for j in range(WIDTH):
            w[MOD * WIDTH + j] *= 1.0 - share(x * w[LAM * WIDTH + j], centre, width, low, high, soft)
    if absorbed:
        for j in range(WIDTH):
            w[MOD * WIDTH + j] *= decay(x * w[CHORD * WIDTH + j])


@njit(**STRICT)
def _rainbow(sphere, kappa, w, second, out):
    """Add pairs of rays across the rainbow."""
    x, count = sphere.x, len(out)
    _halves(x, kappa, w, second)
    _moduli(sphere, w)
    _moduli(sphere, second)
    for j in range(count):
        w_mod, other_mod = w[MOD * WIDTH + j], second[MOD * WIDTH + j]
        sine = x * w[SINE * WIDTH + j]
        if sine < 1.0:
            w_mod, other_mod = w_mod * np.sqrt(sine), other_mod * np.sqrt(sine)
        if w_mod == 0.0 and other_mod == 0.0:
            continue
        e1, e2 = complex(w[R1 * WIDTH + j], w[I1 * WIDTH + j]), complex(w[R2 * WIDTH + j], w[I2 * WIDTH + j])
        f1, f2 = complex(second[R1 * WIDTH + j], second[I1 * WIDTH + j]), complex(second[R2 * WIDTH + j], second[I2 * WIDTH + j])
        zeta = np.cbrt(1.5 * w[HALF * WIDTH + j]) ** 2
        ai, slope = airy_of(-zeta, w[HALF_SIN * WIDTH + j], w[HALF_COS * WIDTH + j])
        quarter = np.sqrt(np.sqrt(zeta))
        wave = np.sqrt(np.pi) * complex(w[COS * WIDTH + j], w[SIN * WIDTH + j])
        ai, slope = wave * (ai * quarter), wave * complex(0.0, slope / quarter)
        out[j, 0] += (w_mod * e1 + other_mod * f1) * ai + (w_mod * e1 - other_mod * f1) * slope
        out[j, 1] += (w_mod * e2 + other_mod * f2) * ai + (w_mod * e2 - other_mod * f2) * slope


@njit(**STRICT)
def _axis(sphere, kappa, sign, end, w, second, out):
    """Add pairs of rays across the axis."""
    x, count = sphere.x, len(out)
    # sin theta needs no floor here: the Bessel functions cancel it
    _halves(x, kappa + 0.25 * np.pi * (1.0 - sign), w, second)
    _moduli(sphere, w)
    _moduli(sphere, second)
    for j in range(WIDTH):
        half = w[HALF * WIDTH + j]
        half = half if half > BESSEL_END else BESSEL_END
        j0, j1, j2 = bessel_far(half, w[HALF_SIN * WIDTH + j], w[HALF_COS * WIDTH + j])
        w[J_0 * WIDTH + j], w[J_1 * WIDTH + j], w[J_2 * WIDTH + j] = j0, j1, j2
    for j in range(count):
        w_mod, other_mod, half = w[MOD * WIDTH + j], second[MOD * WIDTH + j], w[HALF * WIDTH + j]
        if w[CUBE * WIDTH + j] > 0.0:
            w_mod *= _flattened(x, w[SLOPE * WIDTH + j], w[CUBE * WIDTH + j])
            other_mod *= _flattened(x, second[SLOPE * WIDTH + j], second[CUBE * WIDTH + j])
        if w_mod == 0.0 and other_mod == 0.0:
            continue
        e1, e2 = complex(w[R1 * WIDTH + j], w[I1 * WIDTH + j]), complex(w[R2 * WIDTH + j], w[I2 * WIDTH + j])
        f1, f2 = complex(second[R1 * WIDTH + j], second[I1 * WIDTH + j]), complex(second[R2 * WIDTH + j], second[I2 * WIDTH + j])
        j0, g, j2 = w[J_0 * WIDTH + j], w[J_1 * WIDTH + j], w[J_2 * WIDTH + j]
        if half < BESSEL_END:
            j0, g, j2 = bessel_near(half)
        f, fs, gs = j0 - g, -g * half, 0.0
        if half > 1e-6:
            gs = -j2 / half
            fs -= gs
        wave = np.sqrt(0.5 * np.pi * half) * complex(w[COS * WIDTH + j], w[SIN * WIDTH + j])
        p1, m1 = w_mod * e1 + other_mod * f1, w_mod * e1 - other_mod * f1
        p2, m2 = w_mod * e2 + other_mod * f2, w_mod * e2 - other_mod * f2
        turned = wave * -1j
        out[j, 0] += wave * (p1 * f + p2 * (end * g)) + turned * (m1 * fs + m2 * (end * gs))
        out[j, 1] += wave * (p2 * f + p1 * (end * g)) + turned * (m2 * fs + m1 * (end * gs))


@njit(**STRICT)
def _flattened(x, slope, cube):
    """Factor of the modulus where the slope is below that which diffraction leaves."""
    if x * slope * slope * slope >= cube:
        return 1.0
    return np.sqrt(slope / np.cbrt(cube / x))


@njit(**STRICT)
def _dark(sphere, kappa, end, w, out):
    """Add complex rays, of the dark side of the rainbow."""
    (x, scales, clear), count = sphere, len(out)
    for j in range(WIDTH):
        w[SIN * WIDTH + j], w[COS * WIDTH + j] = sincos(x * w[PATH * WIDTH + j] + kappa)
    for j in range(count):
        big, lam = x * abs(w[PATH_I * WIDTH + j]), x * w[LAM * WIDTH + j]
        if big > DARKEST or w[EXISTS * WIDTH + j] == 0.0:
            continue
        weight = complex(1.0)
        step = 1e-3 * scales[1]
        if lam + step >= clear:
            # Where the share of the rays changes across the pair, both sides of the rainbow have to meet: the share of a complex
            # ray, to first order in Im lam and fading where that is no longer small.
            rise, deep = (window(lam - step, scales) - window(lam + step, scales)) / (2.0 * step), x * w[LAM_I * WIDTH + j]
            weight = complex(1.0 - window(lam, scales), rise * deep / (1.0 + (deep / scales[1]) ** 2))
            if weight == 0.0:
                continue
        zeta = np.cbrt(1.5 * big) ** 2
        ai, slope = airy_of(zeta, 0.0, 1.0)
        quarter = np.sqrt(np.sqrt(zeta)) * EIGHTH
        sine = x * w[SINE * WIDTH + j]
        wave = np.sqrt(np.pi) * x / np.sqrt(max(w[SINE * WIDTH + j], 1.0 / x)) * complex(w[COS * WIDTH + j], w[SIN * WIDTH + j])
        ai, slope = wave * ai * quarter, 1j * wave * slope / quarter
        g = weight * complex(w[G_R * WIDTH + j], w[G_I * WIDTH + j])
        if w[CHORD * WIDTH + j] != 0.0:
            # The chord of complex rays grows with k: exp(-x CHORD) of t+; of its conjugate t- the conjugate.
            s, c = sincos(-x * w[CHORD_I * WIDTH + j])
            g *= decay(x * w[CHORD * WIDTH + j]) * complex(c, s)
        plus, minus = g, -1j * np.conj(g)
        e1, e2 = complex(w[R1 * WIDTH + j], w[I1 * WIDTH + j]), complex(w[R2 * WIDTH + j], w[I2 * WIDTH + j])
        f1, f2 = complex(w[M_R1 * WIDTH + j], w[M_I1 * WIDTH + j]), complex(w[M_R2 * WIDTH + j], w[M_I2 * WIDTH + j])
        if sine < 1.0:
            (e1, e2), (f1, f2) = _round(sine, end, e1, e2), _round(sine, end, f1, f2)
        out[j, 0] += (plus * e1 + minus * f1) * ai + (plus * e1 - minus * f1) * slope
        out[j, 1] += (plus * e2 + minus * f2) * ai + (plus * e2 - minus * f2) * slope


@njit(**STRICT)
def _add_diffraction(x, theta, out):
    """Fraunhofer diffraction, tapered where the soft edge of a sphere ends it (theta ~ x^(-1/3))."""
    width = np.cbrt(x) / 1.75
    for a in range(theta.shape[0]):
        taper = (theta[a] * width) ** 2
        if taper < 50.0:
            wave = x * x * bessel(x * theta[a])[1] * np.exp(-taper)
            out[a, 0] += wave
            out[a, 1] += wave
