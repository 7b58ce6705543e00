"""What a ray brings from its angles of incidence: path, spreading, Fresnel's coefficients; lanes as in `_solve`.

Absorption: chords of the real index n, weakened by exp(-2 x p k cos tt), and the complex index in Fresnel's formulas.  Bending
by k is left out: it shifts phases by x k^2, and where that counts exp(-x k) leaves nothing.
"""

import numpy as np

from bakery.physics.goa._solve import C_I, FOUND, S_I, T_I, V_I, WIDTH, C, S, T, V, over, root, times
from bakery.physics.goa._special import INLINE, STRICT, sincos
from bakery.system.compiled import njit

# Columns of a real ray, those that `_field` always reads first: sin t; phase over x; sqrt(geometry/(sine slope)); the x from
# which that needs no floor; the amplitudes of both polarisations; absorption over x; sin theta; geometry = sin t cos t;
# |d theta_p/dt|; x times the cube of the smallest slope that diffraction leaves
LAM, PATH, SIZE, LIMIT, R1, R2, I1, I2, CHORD, SINE, GEOMETRY, SLOPE, CUBE = range(13)
ALWAYS, OF_REAL = 9, 13
# and of a pair of complex rays t+ and its conjugate: sqrt(geometry/slope), imaginary parts, amplitudes of the ray t-, 1 if found
G_R, G_I, PATH_I, CHORD_I, LAM_I, M_R1, M_R2, M_I1, M_I2, EXISTS = 2, 3, 10, 11, 12, 13, 14, 15, 16, 17
COLUMNS = 18
_X1, _Y1, _X2, _Y2 = range(COLUMNS * WIDTH, (COLUMNS + 4) * WIDTH, WIDTH)  # reflection, while it is multiplied up
OUT_ROWS = COLUMNS + 4


@njit(**INLINE)
def _reflected(er, ei, sr, si, cr, ci):
    """Fresnel's r1 (perpendicular), r2 (parallel) from eta^2, sin^2 t, cos t."""
    wr, wi = root(er - sr, ei - si)
    ar, ai = over(cr - wr, ci - wi, cr + wr, ci + wi)
    qr, qi = times(er, ei, cr, ci)
    br, bi = over(qr - wr, qi - wi, qr + wr, qi + wi)
    return ar, ai, br, bi


@njit(**STRICT)
def _through(p, re1, o):
    """(1 - r^2)(-r)^(p-1) of the r in the last rows, into four rows from `re1`: both real parts, both imaginary parts."""
    re2, im1, im2 = re1 + WIDTH, re1 + 2 * WIDTH, re1 + 3 * WIDTH
    for j in range(WIDTH):
        a, b = times(o[_X1 + j], o[_Y1 + j], o[_X1 + j], o[_Y1 + j])
        c, d = times(o[_X2 + j], o[_Y2 + j], o[_X2 + j], o[_Y2 + j])
        o[re1 + j], o[im1 + j], o[re2 + j], o[im2 + j] = 1.0 - a, -b, 1.0 - c, -d
    for _ in range(p - 1):
        for j in range(WIDTH):
            a, b = times(o[re1 + j], o[im1 + j], -o[_X1 + j], -o[_Y1 + j])
            c, d = times(o[re2 + j], o[im2 + j], -o[_X2 + j], -o[_Y2 + j])
            o[re1 + j], o[im1 + j], o[re2 + j], o[im2 + j] = a, b, c, d


@njit(**STRICT)
def outside(eta, mirror, w, o):
    """Rays reflected outside, of the scattering angles in row T: D = 1/4 and sin t = cos theta/2."""
    er, ei = (eta * eta).real, (eta * eta).imag
    for j in range(WIDTH):
        c, s = sincos(0.5 * w[T + j])
        ar, ai, br, bi = _reflected(er, ei, s * s, 0.0, c, 0.0)
        grazing = c == 0.0
        o[LAM * WIDTH + j], o[PATH * WIDTH + j], o[CHORD * WIDTH + j] = s, 2.0 * c, 0.0
        o[R1 * WIDTH + j], o[I1 * WIDTH + j] = (-1.0 if mirror or grazing else ar), (0.0 if mirror or grazing else ai)
        o[R2 * WIDTH + j] = 1.0 if mirror else (-1.0 if grazing else br)
        o[I2 * WIDTH + j] = 0.0 if mirror or grazing else bi
        o[SINE * WIDTH + j], o[SIZE * WIDTH + j], o[LIMIT * WIDTH + j] = 1.0, 0.5, 0.0
        o[GEOMETRY * WIDTH + j], o[SLOPE * WIDTH + j], o[CUBE * WIDTH + j] = 0.25, 1.0, 0.0


@njit(**STRICT)
def real(eta, p, bow, focus, w, o):
    """Real rays of order p >= 1 from S, C, V; row SINE of o is given.

    bow: their segment ends at a rainbow, which floors slopes; focus: they are next to the ray along the axis.
    """
    n, er, ei = eta.real, (eta * eta).real, (eta * eta).imag
    fade, flat = -2.0 * p * eta.imag, 4.0 * p * (n * n - 1.0) if bow else 0.0
    for j in range(WIDTH):
        s, c, v, sine = w[S + j], w[C + j], w[V + j], o[SINE * WIDTH + j]
        s, c = (s if s > 0.0 else 0.0), (c if c > 0.0 else 0.0)
        u = n * (v if v > 1e-150 else 1e-150)
        slope, geometry = abs(2.0 * (p * c / u - 1.0)), s * c
        half = flat * s / (u * u * u)
        cube = 0.5 * half * half / (c if c > 1e-12 else 1e-12)
        steep, width = cube / (slope * slope * slope), 1.0 / sine
        if focus:  # floors of `_field` instead: slope and sine/geometry >= x^(-1/2)/2
            width, flat_axis = 0.25 * (geometry / sine) ** 2, 0.25 / (slope * slope)
            width = width if width > flat_axis else flat_axis
        o[LAM * WIDTH + j], o[PATH * WIDTH + j], o[CHORD * WIDTH + j] = s, 2.0 * (c - p * u), fade * v
        o[SIZE * WIDTH + j] = np.sqrt(geometry / (sine * slope))
        o[LIMIT * WIDTH + j] = steep if steep > width else width
        o[GEOMETRY * WIDTH + j], o[SLOPE * WIDTH + j], o[CUBE * WIDTH + j] = geometry, slope, cube
        o[_X1 + j], o[_Y1 + j], o[_Y2 + j] = (c - u) / (c + u), 0.0, 0.0
        o[_X2 + j] = (er * c - u) / (er * c + u)
    if ei != 0.0:
        for j in range(WIDTH):
            s, c = w[S + j], w[C + j]
            o[_X1 + j], o[_Y1 + j], o[_X2 + j], o[_Y2 + j] = _reflected(er, ei, s * s, 0.0, c, 0.0)
    _through(p, R1 * WIDTH, o)


@njit(**STRICT)
def beyond(eta, p, w, o):
    """Pairs of complex rays beyond a rainbow from the rows of `_solve.complex_rays`; row SINE of o is given."""
    n, er, ei = eta.real, (eta * eta).real, (eta * eta).imag
    fade = -2.0 * p * eta.imag
    for j in range(WIDTH):
        sr, si, cr, ci = w[S + j], w[S_I + j], w[C + j], w[C_I + j]
        ur, ui = n * w[V + j], n * w[V_I + j]
        gr, gi = times(sr, si, cr, ci)
        gr, gi = root(gr, gi)
        fr, fi = over(p * cr, p * ci, ur, ui)
        fr, fi = root(2.0 * (fr - 1.0), 2.0 * fi)
        o[G_R * WIDTH + j], o[G_I * WIDTH + j] = over(gr, gi, fr, fi)
        o[PATH * WIDTH + j], o[PATH_I * WIDTH + j] = 2.0 * (cr - p * ur), 2.0 * (ci - p * ui)
        o[CHORD * WIDTH + j], o[CHORD_I * WIDTH + j] = fade * w[V + j], fade * w[V_I + j]
        real_sin, real_cos = sincos(w[T + j])
        o[LAM * WIDTH + j], o[LAM_I * WIDTH + j] = real_sin, real_cos * w[T_I + j]
        o[EXISTS * WIDTH + j] = w[FOUND + j]
    for side in range(2):
        turn = 1.0 if side == 0 else -1.0
        for j in range(WIDTH):
            sr, si, cr, ci = w[S + j], turn * w[S_I + j], w[C + j], turn * w[C_I + j]
            sr, si = times(sr, si, sr, si)
            o[_X1 + j], o[_Y1 + j], o[_X2 + j], o[_Y2 + j] = _reflected(er, ei, sr, si, cr, ci)
        _through(p, R1 * WIDTH if side == 0 else M_R1 * WIDTH, o)
