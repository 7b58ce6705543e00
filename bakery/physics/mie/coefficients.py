"""Lorenz-Mie coefficients and cross sections of spheres: arrays of floats in and out.  Equations and rounding: `series`."""

import numpy as np

from bakery.physics.mie.clear import BY_STEPS, COS_Z, SHARE, SIN_Z, Z, series_real, series_real_single
from bakery.physics.mie.series import (
    ABS,
    BACK_I,
    BACK_R,
    COS,
    CROSS,
    G_I,
    G_R,
    LANES,
    LAST,
    M_I,
    M_R,
    MV_I,
    MV_R,
    RATIO_I,
    RATIO_R,
    RATIO_X,
    SCA,
    SIN,
    START,
    V_I,
    V_R,
    WI,
    WI_LOW,
    WR,
    WR_LOW,
    XI,
    XI_LOW,
    X,
    series_absorbing,
    series_absorbing_single,
    series_near,
    series_near_single,
)
from bakery.physics.mie.vector import fma
from bakery.system.compiled import njit

WIDE = 12_000  # above so many terms one radius at a time: the lanes would leave the cache
NEAR = 0.02  # |m - 1| below which the difference form is used: the plain one loses eps/|m - 1|
# size and |m - 1| from which coefficients come by steps (`clear`): of soft spheres light backward would lose a digit or two
LARGE, HARD = 2.0, 0.1

STRICT = dict(cache=True, nogil=True, error_model="numpy")


@njit(**STRICT)
def terms(x):
    """Number of terms: |a_n| < 1e-17 beyond x + 7.5 x^(1/3) (Wiscombe's 4.05 leaves 1e-10 of an absorbing sphere)."""
    return int(np.ceil(x + 7.5 * np.cbrt(x))) + 2


@njit(**STRICT)
def start_order(m, x):
    """Order at which the downward recurrence of R_n(mx) may start from its asymptotic form."""
    size = abs(m) * x
    start = terms(size)
    if m.imag > 0.0:
        # Below |mx| a starting error shrinks by exp(-2 n Im(mx)/|mx|^2) a step: enough steps for 1e-17.
        start = min(start, int(np.ceil(np.sqrt(terms(x) ** 2.0 + 40.0 * abs(m) ** 2 * x / m.imag))) + 16)
    return max(start, terms(x) + 1)


@njit(**STRICT)
def _sum_error(a, b):
    """a + b and its rounding error."""
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


@njit(**STRICT)
def reciprocal(m, x):
    """1/(m x) to twice the working precision: high and low part.

    A rounded m x shifts every phase by up to x 1e-16, which costs four digits at x = 1e4.
    """
    zr, zi = m.real * x, m.imag * x
    zr_low, zi_low = fma(m.real, x, -zr), fma(m.imag, x, -zi)
    w = (1.0 / m) / x
    wr, wi = w.real, w.imag
    s, t1 = _sum_error(1.0, -wr * zr)
    s, t2 = _sum_error(s, wi * zi)
    er = s + (t1 + t2 - fma(wr, zr, -wr * zr) + fma(wi, zi, -wi * zi) - wr * zr_low + wi * zi_low)
    s, t1 = _sum_error(wr * zi, wi * zr)
    ei = -(s + (t1 + fma(wr, zi, -wr * zi) + fma(wi, zr, -wi * zr) + wr * zi_low + wi * zr_low))
    return w, w * complex(er, ei)


@njit(**STRICT)
def asymptotic_ratio(t):
    """R of the recurrence R = 1/(t - R) at rest, the root within the unit circle."""
    root = np.sqrt(t * t * 0.25 - 1.0 + 0j)
    up, down = 0.5 * t + root, 0.5 * t - root
    return 1.0 / (up if abs(up) >= abs(down) else down)


@njit(**STRICT)
def _decaying_ratio(t):
    """`asymptotic_ratio` of a real t > 2."""
    return 1.0 / (0.5 * t + np.sqrt(0.25 * t * t - 1.0))


@njit(**STRICT)
def order_weights(last):
    """Numbers of the orders n = row + 1 that `clear` reads: 2/n + 2/(n+1) - (2n+1), (n-1)(n+1)/n, n/(2n+1)."""
    weights = np.empty((last, 3))
    for n in range(1, last + 1):
        weights[n - 1, 0], weights[n - 1, 1] = 2.0 / n + 2.0 / (n + 1) - (2 * n + 1), n - 1.0 / n
        weights[n - 1, 2] = n / (2.0 * n + 1.0)
    return weights


@njit(**STRICT)
def _clear_coefficients(m, x, lane, work, weights, keep):
    """`_coefficients` of a real index, or of a conductor: 1e40 stands for the limit, R_n = 1 throughout and 1/m = 0."""
    rows, top, low_x, low_z, low_steps = 0, 0, 2**62, 2**62, 2**62
    conductor = np.isinf(m)
    inverse = 0.0 if conductor else 1.0 / m
    contrast = 1.0 if conductor else (m - 1.0) * (m + 1.0) * inverse * inverse
    for j in range(x.shape[0]):
        last, z = terms(x[j]), 0.0 if conductor else m * x[j]
        by_steps = z if x[j] >= LARGE and abs(m - 1.0) >= HARD else 0.0
        rows, low_x = max(rows, last), min(low_x, max(1, int(x[j])))
        low_z, low_steps = min(low_z, max(1, int(z))), min(low_steps, max(1, int(by_steps)))
        z_low, xi = 0.0 if conductor else fma(m, x[j], -z), 1.0 / x[j]
        w = inverse * xi
        lane[X, j], lane[Z, j], lane[LAST, j], lane[XI, j], lane[WR, j] = x[j], z, last, xi, w
        lane[XI_LOW, j], lane[WR_LOW, j] = xi * fma(-xi, x[j], 1.0), w * (fma(-w, z, 1.0) - w * z_low)
        lane[RATIO_X, j] = _decaying_ratio((2.0 * last + 5.0) * xi)
        lane[SIN, j], lane[COS, j] = np.sin(x[j]), np.cos(x[j])
        s, c = np.sin(z), np.cos(z)
        lane[SIN_Z, j], lane[COS_Z, j] = s + z_low * c, c - z_low * s
        lane[M_R, j], lane[V_R, j], lane[G_R, j] = 1e40 if conductor else m, inverse, contrast
        lane[SHARE, j], lane[BY_STEPS, j] = inverse * inverse / contrast, by_steps
        lane[START, j], lane[RATIO_R, j] = 0, 1.0
        if not conductor and z < last + 3:
            start = max(terms(z), last + 1)
            top, lane[START, j], lane[RATIO_R, j] = max(top, start), start, _decaying_ratio((2.0 * start + 3.0) * w)
    low = low_x, low_z, low_steps
    if x.shape[0] == 1:
        series_real_single(lane, work, weights, keep, max(top, rows + 1), rows, low)
    else:
        series_real(lane, work, weights, keep, max(top, rows + 1), rows, low)


@njit(**STRICT)
def wave_coefficients(m, x, lane, work):
    """a_n, b_n of the radii x (L,), L = LANES or 1: work (rows, 4, L) takes Re a, Im a, Re b, Im b of n = row + 1.

    lane (27, L) takes their sums; rows at least terms(max x) + 2.
    """
    _coefficients(m, x, lane, work, order_weights(work.shape[0] if is_clear(m) else 0), 1)


@njit(**STRICT)
def is_clear(m):
    """Whether a sphere takes the series of `clear`."""
    return np.isinf(m.real) or m.imag == 0.0 and abs(m - 1.0) > NEAR


@njit(**STRICT)
def _coefficients(m, x, lane, work, weights, keep):
    """`wave_coefficients` with `order_weights`; of a clear sphere only the sums, if `keep` is 0: work's first row is lost."""
    near = abs(m - 1.0) <= NEAR
    if is_clear(m):
        _clear_coefficients(m.real, x, lane, work, weights, keep)
        return
    rows, top, low = 0, 0, 2**62
    minv = 1.0 / m
    contrast = (m - 1.0) * (m + 1.0) * minv * minv
    for j in range(x.shape[0]):
        last, start = terms(x[j]), start_order(m, x[j])
        rows, top, low = max(rows, last), max(top, start), min(low, max(1, int(x[j])))
        lane[LAST, j], lane[START, j], lane[X, j] = last, start, x[j]
        lane[XI, j] = 1.0 / x[j]
        lane[XI_LOW, j] = lane[XI, j] * fma(-lane[XI, j], x[j], 1.0)
        rx = asymptotic_ratio((2.0 * (start if near else last + 1) + 3.0) * complex(lane[XI, j], 0.0)).real
        lane[RATIO_X, j] = rx
        w, low_w = reciprocal(m, x[j])
        r = asymptotic_ratio((2.0 * start + 3.0) * w)
        if near:
            w = (1.0 - m) * minv * lane[XI, j]
            r = (2.0 * start + 3.0) * w * rx * r
        lane[WR, j], lane[WI, j], lane[WR_LOW, j], lane[WI_LOW, j] = w.real, w.imag, low_w.real, low_w.imag
        lane[RATIO_R, j], lane[RATIO_I, j] = r.real, r.imag
        lane[SIN, j], lane[COS, j] = np.sin(x[j]), np.cos(x[j])
        lane[M_R, j], lane[M_I, j] = m.real, m.imag
        lane[V_R, j], lane[V_I, j] = minv.real, minv.imag
        excess = (m - 1.0) * minv if near else 0.0j
        lane[MV_R, j], lane[MV_I, j] = excess.real, excess.imag
        # Im(1 - 1/m^2) on its own: the product rounds it to an ulp of the real part.
        lane[G_R, j], lane[G_I, j] = contrast.real, -2.0 * minv.real * minv.imag
    top = max(top, rows + 1)
    if x.shape[0] == 1:
        if near:
            series_near_single(lane, work, top, rows, low)
        else:
            series_absorbing_single(lane, work, top, rows, low)
    elif near:
        series_near(lane, work, top, rows, low)
    else:
        series_absorbing(lane, work, top, rows, low)


@njit(**STRICT)
def lanes_of(x):
    return LANES if x.shape[0] > 1 and terms(np.max(x)) <= WIDE else 1


@njit(**STRICT)
def efficiency_block(m, x, q_ext, q_sca, q_abs, q_back, g):
    """Efficiencies and asymmetry of the spheres x (R,); fills five (R,) arrays.  Fastest when x is sorted."""
    if x.shape[0] == 0:
        return
    width = lanes_of(x)
    work, lane, xs = np.empty((terms(np.max(x)) + 2, 4, width)), np.empty((27, width)), np.empty(width)
    weights = order_weights(work.shape[0] if is_clear(m) else 0)
    for first in range(0, x.shape[0], width):
        for j in range(width):
            xs[j] = x[min(first + j, x.shape[0] - 1)]
        _coefficients(m, xs, lane, work, weights, 0)
        for j in range(min(width, x.shape[0] - first)):
            r = first + j
            scale = 2.0 / xs[j] / xs[j]
            q_sca[r] = scale * lane[SCA, j]
            q_abs[r] = scale * lane[ABS, j]
            q_ext[r] = q_sca[r] + q_abs[r]
            q_back[r] = 0.5 * scale * (lane[BACK_R, j] ** 2 + lane[BACK_I, j] ** 2)
            g[r] = 2.0 * lane[CROSS, j] / lane[SCA, j] if lane[SCA, j] > 0.0 else 0.0  # m = 1


@njit(**STRICT)
def cross_section_block(m, x, q_ext, q_sca, q_abs, g):
    """Efficiencies of the spheres x (R,) and their asymmetry; fills four (R,) arrays.  Fastest when x is sorted."""
    efficiency_block(m, x, q_ext, q_sca, q_abs, np.empty(x.shape[0]), g)


@njit(**STRICT)
def coefficients(m, x, work):
    """`work` of `wave_coefficients`, (rows, 4, LANES) for up to LANES spheres x (R,), (rows, 4, 1) for a single sphere."""
    xs, lane = np.empty(work.shape[2]), np.empty((27, work.shape[2]))
    for j in range(xs.shape[0]):
        xs[j] = x[min(j, x.shape[0] - 1)]
    wave_coefficients(m, xs, lane, work)
