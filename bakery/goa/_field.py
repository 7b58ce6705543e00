"""Rays with their phases: amplitudes of one sphere from the geometry of `_rays`.

exp(+i w t) inside; the results are conjugated to exp(-i w t).  A single ray is a exp(i(Psi - s pi/4)) with
a = x e_j sqrt(sin t cos t/(sin theta |theta_p'|)), Psi = x PATH + KAPPA.  Pairs take uniform formulas that tend to their two
rays far from the caustic:

- rainbow (Chester, Friedman and Ursell 1957): Ai and Ai' of zeta = [(3/4)(Psi_+ - Psi_-)]^(2/3), beyond it with complex rays;
- axis: J0, J1, J2 of half the phase difference, from the integral over the ring.

Caustics without such a formula are floored at their diffraction width.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from bakery.goa._rays import (
    AXIAL,
    CHORD,
    CHORD_I,
    DARK,
    END,
    FLOOR,
    G_I,
    G_R,
    GEOMETRY,
    I1,
    I2,
    KAPPA,
    LAM,
    LAM_I,
    M_I1,
    M_I2,
    M_R1,
    M_R2,
    PATH,
    PATH_I,
    R1,
    R2,
    RAINBOW,
    SIGN,
    SINE,
    SINGLE,
    SLOPE,
)
from bakery.goa._special import airy, bessel, sincos, window

DARKEST = 40.0  # e^-40 of the bright side is nothing
STRICT = dict(cache=True, nogil=True, error_model="numpy")


@njit(**STRICT)
def _cis(angle):
    s, c = sincos(angle)
    return complex(c, s)


@njit(**STRICT)
def _modulus(x, ray, scales, sine, slope):
    """a without Fresnel's factor: x sqrt(D), weakened by absorption and by the share of the exact waves."""
    weight = 1.0 - window(x * ray[LAM], scales)
    if weight <= 0.0:
        return 0.0
    return x * weight * np.sqrt(ray[GEOMETRY] / (sine * slope)) * (np.exp(-x * ray[CHORD]) if ray[CHORD] != 0.0 else 1.0)


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
    for r in range(x.shape[0]):
        _add_rays(x[r], items, rays, scales[r], out[r])
        if scales[r, 1] <= 0.0:
            _add_diffraction(x[r], theta, out[r])


@njit(**STRICT)
def gather(field, weight, sums):
    """sums (4, A) += weighted S11, S12, S33, S34 of the field (R, A, 2), conjugated, in the order of the spheres."""
    for r in range(field.shape[0]):
        w = weight[r]
        for a in range(field.shape[1]):
            one, two = field[r, a, 0], field[r, a, 1]
            i1, i2 = one.real**2 + one.imag**2, two.real**2 + two.imag**2
            cross = np.conj(two) * one
            sums[0, a] += 0.5 * w * (i1 + i2)
            sums[1, a] += 0.5 * w * (i2 - i1)
            sums[2, a] += w * cross.real
            sums[3, a] += w * cross.imag


@njit(**STRICT)
def _add_rays(x, items, rays, scales, out):
    """Add all rays of the sphere x to out (A, 2)."""
    thin = 1.0 / np.cbrt(x)
    clear = scales[0] - 5.0 * scales[1] if scales[1] > 0.0 else np.inf  # below, no partial wave is summed exactly ..
    if scales[4] > 0.0:
        clear = scales[2] - 5.0 * scales[4]  # .. nor around the critical order
    for i in range(items.shape[0]):
        kind, a, k = items[i, 0], items[i, 1], items[i, 2]
        if kind == SINGLE:
            # The common case by itself, without views of rows: three times as fast.
            axial, slope, sine = rays[k, AXIAL], rays[k, SLOPE], rays[k, SINE]
            weight = 1.0 if x * rays[k, LAM] < clear else 1.0 - window(x * rays[k, LAM], scales)
            if weight <= 0.0:
                continue
            e1, e2 = complex(rays[k, R1], rays[k, I1]), complex(rays[k, R2], rays[k, I2])
            size = x * weight
            if axial == 2.0:  # reflection outside: D = 1/4
                size *= 0.5
            else:
                slope = max(slope, rays[k, FLOOR] * thin)
                if axial == 1.0:
                    focus = 0.5 / np.sqrt(x)  # a point focus at the axis (n = p) has the width x^(-1/4)
                    size *= np.sqrt(min(rays[k, GEOMETRY] / sine, 1.0 / focus) / max(slope, focus))
                else:
                    if x * sine < 1.0:
                        e1, e2 = _round(x * sine, rays[k, END], e1, e2)
                        sine = 1.0 / x
                    size *= np.sqrt(rays[k, GEOMETRY] / (sine * slope))
                if rays[k, CHORD] != 0.0:
                    size *= np.exp(-x * rays[k, CHORD])
            wave = size * _cis(x * rays[k, PATH] + rays[k, KAPPA] - 0.25 * np.pi * rays[k, SIGN])
            out[a, 0] += wave * e1
            out[a, 1] += wave * e2
            continue
        ray = rays[k]
        if kind == DARK:
            _add_dark(x, ray, scales, out[a])
            continue
        e1, e2 = complex(ray[R1], ray[I1]), complex(ray[R2], ray[I2])
        other = rays[items[i, 3]]
        f1, f2 = complex(other[R1], other[I1]), complex(other[R2], other[I2])
        half = max(0.5 * x * (ray[PATH] - other[PATH]), 0.0)
        mean = 0.5 * x * (ray[PATH] + other[PATH])
        if kind == RAINBOW:
            sine = max(ray[SINE], 1.0 / x)
            one, two = _modulus(x, ray, scales, sine, ray[SLOPE]), _modulus(x, other, scales, sine, other[SLOPE])
            if one == 0.0 and two == 0.0:
                continue
            zeta = np.cbrt(1.5 * half) ** 2
            ai, slope = airy(-zeta)
            quarter = np.sqrt(np.sqrt(zeta))
            wave = np.sqrt(np.pi) * _cis(mean + ray[KAPPA])
            ai, slope = ai * quarter, slope / quarter
            out[a, 0] += wave * ((one * e1 + two * f1) * ai + 1j * (one * e1 - two * f1) * slope)
            out[a, 1] += wave * ((one * e2 + two * f2) * ai + 1j * (one * e2 - two * f2) * slope)
        else:
            # sin theta needs no floor here: the Bessel functions cancel it
            one = _modulus(x, ray, scales, ray[SINE], max(ray[SLOPE], ray[FLOOR] * thin))
            two = _modulus(x, other, scales, other[SINE], max(other[SLOPE], other[FLOOR] * thin))
            if one == 0.0 and two == 0.0:
                continue
            j0, g, j2 = bessel(half)
            f, fs, gs = j0 - g, -g * half, 0.0
            if half > 1e-6:
                gs = -j2 / half
                fs -= gs
            sigma = ray[END]
            wave = np.sqrt(0.5 * np.pi * half) * _cis(mean + ray[KAPPA] + 0.25 * np.pi * (1.0 - ray[SIGN]))
            p1, m1 = one * e1 + two * f1, -1j * (one * e1 - two * f1)
            p2, m2 = one * e2 + two * f2, -1j * (one * e2 - two * f2)
            out[a, 0] += wave * (p1 * f + m1 * fs + sigma * (p2 * g + m2 * gs))
            out[a, 1] += wave * (p2 * f + m2 * fs + sigma * (p1 * g + m1 * gs))


@njit(**STRICT)
def _add_dark(x, ray, scales, out):
    big = x * abs(ray[PATH_I])
    if big > DARKEST:
        return
    weight = complex(1.0 - window(x * ray[LAM], scales))
    if scales[1] > 0.0:
        # Where the share of the rays changes across the pair, both sides of the rainbow have to meet: the share of a complex ray, to
        # first order in Im lam and fading where that is no longer small.
        apart = 1e-3 * scales[1]
        rise = (window(x * ray[LAM] - apart, scales) - window(x * ray[LAM] + apart, scales)) / (2.0 * apart)
        weight += 1j * rise * x * ray[LAM_I] / (1.0 + (x * ray[LAM_I] / scales[1]) ** 2)
    if weight == 0.0:
        return
    zeta = np.cbrt(1.5 * big) ** 2
    ai, slope = airy(zeta)
    quarter = np.sqrt(np.sqrt(zeta)) * _cis(0.25 * np.pi)
    wave = np.sqrt(np.pi) * x / np.sqrt(max(ray[SINE], 1.0 / x)) * _cis(x * ray[PATH] + ray[KAPPA])
    ai, slope = wave * ai * quarter, 1j * wave * slope / quarter
    # The chord of complex rays grows with k: exp(-x CHORD) of t+ and of its conjugate.
    fade = np.exp(-x * ray[CHORD])
    turn = _cis(-x * ray[CHORD_I])
    g = complex(ray[G_R], ray[G_I])
    plus, minus = weight * g * fade * turn, -1j * np.conj(weight * g) * fade * np.conj(turn)
    e1, e2 = _round(x * ray[SINE], ray[END], complex(ray[R1], ray[I1]), complex(ray[R2], ray[I2]))
    f1, f2 = _round(x * ray[SINE], ray[END], complex(ray[M_R1], ray[M_I1]), complex(ray[M_R2], ray[M_I2]))
    out[0] += (plus * e1 + minus * f1) * ai + (plus * e1 - minus * f1) * slope
    out[1] += (plus * e2 + minus * f2) * ai + (plus * e2 - minus * f2) * slope


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
