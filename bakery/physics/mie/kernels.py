"""Lorenz-Mie coefficients and angular sums: arrays of floats in and out.

Coefficients.  With psi, chi the Riccati-Bessel functions of x, R_n = psi_n(mx)/psi_{n-1}(mx), and

    A = R_{n+1}/m + (n+1)/x (1 - 1/m^2)   for a_n,      A = m R_{n+1}   for b_n,
    N = psi_{n+1} - A psi_n,              M = chi_{n+1} - A chi_n,

a_n (or b_n) = N/(N - iM).  This is Bohren & Huffman eq. 4.88 with psi'_n = (n+1)/z psi_n - psi_{n+1}: the leading powers
of x then cancel on paper, and every coefficient keeps its digits as x -> 0.  The Wronskian psi_n chi_{n+1} - psi_{n+1} chi_n = 1
gives Re a_n = |a_n|^2 + Im A/|N - iM|^2: scattering and absorption are sums of positive terms.

Near m = 1, N is a difference of nearly equal numbers.  There D_n = psi_n/psi_{n-1}(x) - R_n has its own recurrence,
D_n = u R_n psi_n/psi_{n-1}(x) with u = (2n+1) (1/(mx) - 1/x) + D_{n+1}, and N_b = m D_{n+1} psi_n - (m-1) psi_{n+1}.

Angles.  p_n = (pi_n + tau_n)/(n(n+1)) and q_n = (pi_n - tau_n)/(n(n+1)) are the Wigner functions d^n_{1,1}, d^n_{1,-1}.  With
v = 2 sin^2(theta/2) their recurrences in difference form are

    e_{n+1} = e_n - (2n+1) v p_n,                    p_{n+1} = p_n + (n+1)/(n(n+2)) e_{n+1},    e_1 = 0, p_1 = 1 - v/2,
    f_{n+1} = f_n + (2n+1) (2/(n(n+1)) - v) q_n,     q_{n+1} = q_n + (n+1)/(n(n+2)) f_{n+1},    f_1 = 0, q_1 = v/2,

stable for v <= 1; S1 + S2 = sum (2n+1)(a_n + b_n) p_n and S1 - S2 = sum (2n+1)(a_n - b_n) q_n.  Beyond 90 degrees
p_n(pi - theta) = (-1)^(n+1) q_n(theta).

Rounding.  Operations are those written here, in this order, fused where it says so (`_vector`): results depend neither on
the processor, nor on the number of threads, nor on a radius' neighbours.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from bakery.physics.mie.vector import Memory, Registers, fma, integer
from bakery.system.compiled import njit

LANES = 16  # radii computed side by side: enough independent work to hide the latency of the division chain
WIDE = 12_000  # above so many terms one radius at a time: the lanes would leave the cache
ANGLES = 16  # angles whose state stays in registers
NEAR = 0.02  # |m - 1| below which the difference form is used: the plain one loses eps/|m - 1|
BLOCK = 1024  # terms per sweep over all angles: their coefficients (64 kB) stay in the cache

STRICT = dict(cache=True, nogil=True, error_model="numpy")

# Rows of the lane array: constants and state of each radius, and the sums of its series.
WR, WI, WR_LOW, WI_LOW, XI, XI_LOW, X, LAST, START, RATIO_R, RATIO_I, RATIO_X, SIN, COS = range(14)
SCA, ABS, CROSS, BACK_R, BACK_I = range(14, 19)
# and of the index, all lanes equal: m, 1/m, 1 - 1/m^2, 1 - 1/m
M_R, M_I, V_R, V_I, G_R, G_I, MV_R, MV_I = range(19, 27)


def _coefficient_code(width, absorbing, near=False):
    """The series of `width` radii side by side.  Real indices leave out all imaginary parts.  `near`: the difference form."""

    @intrinsic
    def series(typingctx, lane, work, top, rows, low):
        def codegen(context, builder, signature, args):
            lanes, rows_ = (Memory(context, builder, signature.args[k], args[k], width) for k in range(2))
            _Series(builder, lanes, rows_, absorbing, near).write(*args[2:])
            return context.get_dummy_value()

        return types.void(lane, work, top, rows, low), codegen

    return series


_TINY, _POLE = 1e-290, 1e-100  # a denominator that is exactly zero: its inverse still has a finite square


class _Series:
    """Code of the series; methods write what their docstrings say for one n, all radii side by side."""

    def __init__(self, builder, lanes, rows, absorbing, near):
        self.builder, self.lanes, self.rows, self.absorbing, self.near = builder, lanes, rows, absorbing, near
        self.wr, self.wr_low, self.start, self.wi, self.wi_low = (lanes[row] for row in (WR, WR_LOW, START, WI, WI_LOW))
        self.xi, self.xi_low, self.last, self.x = (lanes[row] for row in (XI, XI_LOW, LAST, X))
        self.state = Registers(builder, r=lanes[RATIO_R], i=lanes[RATIO_I])
        self.ratio = Registers(builder, x=lanes[RATIO_X])

    def write(self, top, count, low):
        """The ratios of the Bessel functions, downward, then coefficients and sums."""
        builder, self.below = self.builder, low
        above = builder.add(count, integer(1))
        with cgutils.for_range(builder, builder.sub(top, above)) as loop:
            self.descend(builder.sub(top, loop.index))
        with cgutils.for_range(builder, count) as loop:
            n = builder.sub(above, loop.index)
            self.descend(n)
            self.keep(n)
        if self.near:
            self.descend_near(integer(1))
            low = builder.add(above, integer(1))
        # psi_n(x)/psi_{n-1}(x) downward, wanted for n > x only; row n-1 keeps it.
        with cgutils.for_range(builder, builder.sub(builder.add(above, integer(1)), low)) as loop:
            self.ratio_of_psi(builder.sub(above, loop.index))
        self.begin()
        # orders below all sizes: psi goes upward and no series has ended
        inner = builder.sub(self.below, integer(1))
        inner = builder.select(builder.icmp_signed("<", inner, count), inner, count)
        with cgutils.for_range(builder, inner) as loop:
            self.ascend(loop.index, True)
        with cgutils.for_range(builder, builder.sub(count, inner)) as loop:
            self.ascend(builder.add(inner, loop.index), False)
        up = self.up
        for row, value in ((SCA, up.sca), (ABS, up.ab), (CROSS, up.cross), (BACK_R, up.pr), (BACK_I, up.pi)):
            self.lanes[row] = value

    def real(self, number):
        return self.builder.sitofp(number, ir.DoubleType())

    def four(self, index, part):
        return self.builder.add(self.builder.mul(index, integer(4)), integer(part))

    def descend(self, n):
        """R_n(mx) from R_{n+1}."""
        if self.near:
            self.descend_near(n)
            return
        state = self.state
        order = self.wr.fill(self.real(n))
        k = order * 2.0 + 1.0
        tr = k.times_plus(self.wr, k * self.wr_low) - state.r
        if self.absorbing:
            ti = k.times_plus(self.wi, k * self.wi_low) - state.i
            size = tr * tr + ti * ti
            # the comparison beside the quotient: either is on the path from one order to the next
            scale = size.inverse().where(">", (size, _TINY), 1.0 / _TINY)
            state.r = (tr * scale).where("<=", (order, self.start), state.r)
            state.i = (-(ti * scale)).where("<=", (order, self.start), state.i)
        else:
            state.r = tr.inverse().where("!=", (tr, 0.0), 1.0 / _POLE).where("<=", (order, self.start), state.r)

    def descend_near(self, n):
        """The difference D_n of R_n(x) and R_n(mx), and R_n(x), from those of n + 1."""
        state, ratio = self.state, self.ratio
        order = self.wr.fill(self.real(n))
        k = order * 2.0 + 1.0
        tx = k.times_plus(self.xi, k * self.xi_low) - ratio.x
        tx = tx.where("!=", (tx, 0.0), _POLE)
        ur, ui = k.times_plus(self.wr, state.r), k.times_plus(self.wi, state.i)
        zr = tx + ur
        zr = zr.where("!=", (zr, 0.0), _POLE)
        sr, si = tx * zr, tx * ui
        size = sr * sr + si * si
        scale = size.where(">", (size, _TINY), _TINY).inverse()
        state.r = ((ur * sr + ui * si) * scale).where("<=", (order, self.start), state.r)
        state.i = ((ui * sr - ur * si) * scale).where("<=", (order, self.start), state.i)
        ratio.x = tx.inverse().where("<=", (order, self.start), ratio.x)

    def keep(self, n):
        """R_n in row n-2, and in the difference form R_n(x) in row n-1."""
        row = self.builder.sub(n, integer(2))
        self.rows[self.four(row, 0)] = self.state.r
        if self.absorbing:
            self.rows[self.four(row, 1)] = self.state.i
        if self.near:
            self.rows[self.four(self.builder.sub(n, integer(1)), 2)] = self.ratio.x

    def ratio_of_psi(self, n):
        """psi_n(x)/psi_{n-1}(x) from that of n + 1, into row n-1."""
        ratio = self.ratio
        order = self.x.fill(self.real(n))
        k = order * 2.0 + 1.0
        ratio.x = (k.times_plus(self.xi, k * self.xi_low) - ratio.x).inverse().where("<=", (order, self.last + 1.0), ratio.x)
        self.rows[self.four(self.builder.sub(n, integer(1)), 2)] = ratio.x

    def begin(self):
        """What is carried upward: psi_n, chi_n, the sums, the coefficients before."""
        lanes, x, xi = self.lanes, self.x, self.xi
        sin, cos, zero = lanes[SIN], lanes[COS], x.fill(0.0)
        self.up = Registers(self.builder, p0=sin, c0=cos, c1=cos.times_plus(xi, sin),
                            p1=(sin * xi - cos).where(">=", (x, 1.0), self.ratio.x * sin),
                            sca=zero, ab=zero, cross=zero, pr=zero, pi=zero, ar=zero, ai=zero, br=zero, bi=zero)
        self.sign = Registers(self.builder, k=x.fill(-1.0))
        self.index = [lanes[row] for row in range(M_R, MV_I + 1)]

    def ascend(self, i, inner):
        """a_n and b_n of n = i + 1, which take the place of the ratios in row n-1, and what they add to the sums.

        `inner`: n + 1 is at most the smallest of the sizes.
        """
        up, rows, builder = self.up, self.rows, self.builder
        number = self.real(builder.add(i, integer(1)))
        order = self.x.fill(number)
        k, after, weight, mixed = (self.x.fill(value) for value in self.weights(number))
        f = k.times_plus(self.xi, k * self.xi_low)
        p1, c1 = up.p1, up.c1
        p2 = f.times_plus(p1, -up.p0)
        if not inner:
            p2 = p2.where("<=", (after, self.x), rows[self.four(builder.add(i, integer(1)), 2)] * p1)
        c2 = f.times_plus(c1, -up.c0)
        rr = rows[self.four(i, 0)]
        ri = rows[self.four(i, 1)] if self.absorbing else None
        of_a, of_b = self.fractions(i, after * self.xi, rr, ri, (p1, p2, c1, c2))
        live = None if inner else ("<=", (order, self.last), 0.0)
        a2, lost_a, ar, ai = self.coefficient(live, *of_a[:-1], of_a[-1].inverse())
        b2, lost_b, br, bi = self.coefficient(live, *of_b[:-1], of_b[-1].inverse())
        if self.absorbing:
            up.ab = k.times_plus(lost_a + lost_b, up.ab)
        for part, value in enumerate((ar, ai, br, bi)):
            rows[self.four(i, part)] = value
        up.sca = k.times_plus(a2 + b2, up.sca)
        # (n-1)(n+1)/n Re(a_{n-1} a_n* + ..) and (2n+1)/(n(n+1)) Re(a_n b_n*); 1/(n(n+1)) = 1/n - 1/(n+1)
        before = ar.times_plus(up.ar, ai * up.ai) + br.times_plus(up.br, bi * up.bi)
        same = ar.times_plus(br, ai * bi)
        up.cross = mixed.times_plus(same, weight.times_plus(before, up.cross))
        s = self.sign.k * k
        self.sign.k = -self.sign.k
        up.pr, up.pi = s.times_plus(ar - br, up.pr), s.times_plus(ai - bi, up.pi)
        up.ar, up.ai, up.br, up.bi = ar, ai, br, bi
        up.p0, up.p1, up.c0, up.c1 = p1, p2, c1, c2

    def weights(self, number):
        """2n + 1, n + 1, (n-1)(n+1)/n and (2n+1)/(n(n+1)): once for all radii, which spares the units of vectors."""
        builder, one = self.builder, ir.Constant(ir.DoubleType(), 1.0)
        k = builder.fadd(builder.fmul(number, ir.Constant(ir.DoubleType(), 2.0)), one)
        after = builder.fadd(number, one)
        inverse = builder.fdiv(one, builder.fmul(number, after))
        weight = builder.fmul(builder.fmul(builder.fsub(number, one), builder.fmul(after, after)), inverse)
        return k, after, weight, builder.fmul(k, inverse)

    def fractions(self, i, h, rr, ri, waves):
        """`fraction` of a_n and of b_n."""
        mr, mi, vr, vi, gr, gi, mvr, mvi = self.index
        p1, p2, _, _ = waves
        numerator_a = numerator_b = None, None
        if self.near:
            er, ei = rr, ri
            ratio_x = self.rows[self.four(self.builder.add(i, integer(1)), 2)]
            rr, ri = ratio_x - er, -ei
            # At a zero of psi_n, R_{n+1}(x) and D_{n+1} share a large factor that psi_n takes back: divide it out.
            base = p1.where("<=", (ratio_x * ratio_x, 1.0), p2 * ratio_x.inverse())
            qr, qi = er * vr - ei * vi, er * vi + ei * vr
            numerator_a = qr * base - h * gr * p1 + mvr * p2, qi * base - h * gi * p1 + mvi * p2
            numerator_b = (er * mr - ei * mi) * base - (mr - 1.0) * p2, (er * mi + ei * mr) * base - mi * p2
        if not self.absorbing:
            return self.fraction(waves, rr * vr + h * gr, None), self.fraction(waves, rr * mr, None)
        return (self.fraction(waves, (rr * vr - ri * vi) + h * gr, (rr * vi + ri * vr) + h * gi, *numerator_a),
                self.fraction(waves, rr * mr - ri * mi, rr * mi + ri * mr, *numerator_b))

    def fraction(self, waves, sr, si, nr=None, ni=None):
        """N and M of one coefficient and |N - iM|^2; imaginary parts are None for a real index."""
        p1, p2, c1, c2 = waves
        nr = p2 - sr * p1 if nr is None else nr
        dr = c2 - sr * c1
        if not self.absorbing:
            return nr, None, dr, None, None, nr.times_plus(nr, dr * dr)
        ni = -(si * p1) if ni is None else ni
        di = -(si * c1)
        tr, ti = nr + di, ni - dr
        return nr, ni, dr, di, si, tr.times_plus(tr, ti * ti)

    def coefficient(self, live, nr, ni, dr, di, si, scale):
        """|a|^2, Re a - |a|^2, Re a, Im a; 0 where it is not `live`, if that is a condition."""
        def kept(value):
            return value.where(*live) if live else value

        if not self.absorbing:
            square = kept(nr * nr * scale)
            return square, None, square, kept(nr * dr * scale)
        square, absorbed = kept(nr.times_plus(nr, ni * ni) * scale), kept(si * scale)
        return square, absorbed, square + absorbed, kept(nr.times_plus(dr, ni * di) * scale)


_series_real, _series_absorbing = _coefficient_code(LANES, False), _coefficient_code(LANES, True)
_series_real_single, _series_absorbing_single = _coefficient_code(1, False), _coefficient_code(1, True)
_series_near, _series_near_single = _coefficient_code(LANES, True, near=True), _coefficient_code(1, True, near=True)


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
def wave_coefficients(m, x, lane, work):
    """a_n, b_n of the radii x (L,), L = LANES or 1: work (rows, 4, L) takes Re a, Im a, Re b, Im b of n = row + 1.

    lane (27, L) takes their sums; rows at least terms(max x) + 2.
    """
    rows, top, low = 0, 0, 2**62
    conductor = np.isinf(m.real)
    near = abs(m - 1.0) <= NEAR
    minv = 0.0j if conductor else 1.0 / m
    contrast = 1.0 + 0.0j if conductor else (m - 1.0) * (m + 1.0) * minv * minv
    for j in range(x.shape[0]):
        last, start = terms(x[j]), 0 if conductor else start_order(m, x[j])
        rows, top, low = max(rows, last), max(top, start), min(low, max(1, int(x[j])))
        lane[LAST, j], lane[START, j], lane[X, j] = last, start, x[j]
        lane[XI, j] = 1.0 / x[j]
        lane[XI_LOW, j] = lane[XI, j] * fma(-lane[XI, j], x[j], 1.0)
        rx = asymptotic_ratio((2.0 * (start if near else last + 1) + 3.0) * complex(lane[XI, j], 0.0)).real
        lane[RATIO_X, j] = rx
        if conductor:  # its index 1e40 stands for the limit: R_n = 1 throughout, 1/m = 0
            w, low_w, r = 0.0j, 0.0j, 1.0 + 0.0j
        else:
            w, low_w = reciprocal(m, x[j])
            r = asymptotic_ratio((2.0 * start + 3.0) * w)
        if near:
            w = (1.0 - m) * minv * lane[XI, j]
            r = (2.0 * start + 3.0) * w * rx * r
        lane[WR, j], lane[WI, j], lane[WR_LOW, j], lane[WI_LOW, j] = w.real, w.imag, low_w.real, low_w.imag
        lane[RATIO_R, j], lane[RATIO_I, j] = r.real, r.imag
        lane[SIN, j], lane[COS, j] = np.sin(x[j]), np.cos(x[j])
        lane[M_R, j], lane[M_I, j] = 1e40 if conductor else m.real, 0.0 if conductor else m.imag
        lane[V_R, j], lane[V_I, j] = minv.real, minv.imag
        excess = (m - 1.0) * minv if near else 0.0j
        lane[MV_R, j], lane[MV_I, j] = excess.real, excess.imag
        # Im(1 - 1/m^2) on its own: the product rounds it to an ulp of the real part.
        lane[G_R, j], lane[G_I, j] = contrast.real, -2.0 * minv.real * minv.imag
    top = max(top, rows + 1)
    if x.shape[0] == 1:
        if near:
            _series_near_single(lane, work, top, rows, low)
        elif m.imag == 0.0 or conductor:
            _series_real_single(lane, work, top, rows, low)
        else:
            _series_absorbing_single(lane, work, top, rows, low)
    elif near:
        _series_near(lane, work, top, rows, low)
    elif m.imag == 0.0 or conductor:
        _series_real(lane, work, top, rows, low)
    else:
        _series_absorbing(lane, work, top, rows, low)


@njit(**STRICT)
def _lanes(x):
    return LANES if x.shape[0] > 1 and terms(np.max(x)) <= WIDE else 1


@njit(**STRICT)
def efficiency_block(m, x, q_ext, q_sca, q_abs, q_back, g):
    """Efficiencies and asymmetry of the spheres x (R,); fills five (R,) arrays.  Fastest when x is sorted."""
    if x.shape[0] == 0:
        return
    width = _lanes(x)
    work, lane, xs = np.empty((terms(np.max(x)) + 2, 4, width)), np.empty((27, width)), np.empty(width)
    for first in range(0, x.shape[0], width):
        for j in range(width):
            xs[j] = x[min(first + j, x.shape[0] - 1)]
        wave_coefficients(m, xs, lane, work)
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


# Rows of an angle tile: v, the recurrences, the four sums.
V, P, E, Q, F, SUM_R, SUM_I, DIF_R, DIF_I = range(9)


@intrinsic
def sweep(typingctx, order, coefficient, first, count, tile):
    """Add `count` terms to one tile of angles (9, ANGLES): rows of order (N, 3) from `first`, of coefficient (.., 4) from 0."""

    def codegen(context, builder, signature, args):
        of_n = Memory(context, builder, signature.args[0], args[0], 1)
        of_sphere = Memory(context, builder, signature.args[1], args[1], 1)
        angles = Memory(context, builder, signature.args[4], args[4], ANGLES)
        v = angles[V]
        state = Registers(builder, p=angles[P], e=angles[E], q=angles[Q], f=angles[F],
                          sr=angles[SUM_R], si=angles[SUM_I], dr=angles[DIF_R], di=angles[DIF_I])

        def columns(memory, row, width):
            for part in range(width):
                yield v.fill(memory.scalar(builder.add(builder.mul(row, integer(width)), integer(part))))

        with cgutils.for_range(builder, args[3]) as loop:
            k, c, step = columns(of_n, builder.add(args[2], loop.index), 3)
            sum_r, sum_i, dif_r, dif_i = columns(of_sphere, loop.index, 4)
            p, q = state.p, state.q
            state.sr, state.si = p.times_plus(sum_r, state.sr), p.times_plus(sum_i, state.si)
            state.dr, state.di = q.times_plus(dif_r, state.dr), q.times_plus(dif_i, state.di)
            w = v * k
            e = (-w).times_plus(p, state.e)
            f = (c - w).times_plus(q, state.f)
            state.e, state.f = e, f
            state.p, state.q = e.times_plus(step, p), f.times_plus(step, q)
        for row, name in zip(range(P, DIF_I + 1), ("p", "e", "q", "f", "sr", "si", "dr", "di")):
            angles[row] = getattr(state, name)
        return context.get_dummy_value()

    return types.void(order, coefficient, first, count, tile), codegen


@njit(**STRICT)
def order_table(rows):
    """What the recurrences need of n alone, row n-1: 2n+1, 2(2n+1)/(n(n+1)), (n+1)/(n(n+2))."""
    table = np.empty((rows, 3))
    for i in range(rows):
        n = i + 1.0
        table[i, 0] = 2.0 * n + 1.0
        table[i, 1] = 2.0 * (2.0 * n + 1.0) / (n * (n + 1.0))
        table[i, 2] = (n + 1.0) / (n * (n + 2.0))
    return table


@njit(**STRICT)
def angular_coefficients(work, j, first, count, ahead, behind):
    """(2n+1)(a+b), (2n+1)(a-b) of lane j for theta <= 90 degrees, and their reflected twins, of rows first..first+count-1."""
    for c in range(count):
        i = first + c
        k = 2.0 * i + 3.0
        sr, si = k * (work[i, 0, j] + work[i, 2, j]), k * (work[i, 1, j] + work[i, 3, j])
        dr, di = k * (work[i, 0, j] - work[i, 2, j]), k * (work[i, 1, j] - work[i, 3, j])
        sign = -1.0 if i % 2 else 1.0
        ahead[c, 0], ahead[c, 1], ahead[c, 2], ahead[c, 3] = sr, si, dr, di
        behind[c, 0], behind[c, 1], behind[c, 2], behind[c, 3] = sign * dr, sign * di, sign * sr, sign * si


@njit(**STRICT)
def tiles_of(theta, ahead):
    """The angles up to 90 degrees (or those beyond, reflected) in tiles (T, 9, ANGLES), and where each came from."""
    count = 0
    for t in range(theta.shape[0]):
        count += (theta[t] <= 0.5 * np.pi) == ahead
    source = np.empty(count, np.int64)
    tiles = np.zeros(((count + ANGLES - 1) // ANGLES, 9, ANGLES))
    count = 0
    for t in range(theta.shape[0]):
        if (theta[t] <= 0.5 * np.pi) == ahead:
            s = np.sin(0.5 * theta[t]) if ahead else np.cos(0.5 * theta[t])
            tiles[count // ANGLES, V, count % ANGLES] = 2.0 * s * s
            source[count] = t
            count += 1
    return tiles, source


@njit(**STRICT)
def reset(tiles):
    """State at n = 1."""
    for t in range(tiles.shape[0]):
        for j in range(ANGLES):
            half = 0.5 * tiles[t, V, j]
            tiles[t, P, j], tiles[t, Q, j] = 1.0 - half, half
            for part in (E, F, SUM_R, SUM_I, DIF_R, DIF_I):
                tiles[t, part, j] = 0.0


@njit(**STRICT)
def gather(tiles, source, swapped, mode, weight, out):
    """Add one sphere's amplitudes (mode 0), weighted intensity (1) or weighted Mueller elements (2) to out (A, ..)."""
    s, d = (DIF_R, SUM_R) if swapped else (SUM_R, DIF_R)
    w = 0.25 * weight
    for c in range(source.shape[0]):
        t, j, o = c // ANGLES, c % ANGLES, source[c]
        sr, si, dr, di = tiles[t, s, j], tiles[t, s + 1, j], tiles[t, d, j], tiles[t, d + 1, j]
        plus, minus = sr * sr + si * si, dr * dr + di * di
        if mode == 0:
            out[o, 0], out[o, 1], out[o, 2], out[o, 3] = 0.5 * (sr + dr), 0.5 * (si + di), 0.5 * (sr - dr), 0.5 * (si - di)
        elif mode == 1:
            out[o, 0] += w * (plus + minus)
        else:
            out[o, 0] += w * (plus + minus)
            out[o, 1] -= 2.0 * w * (sr * dr + si * di)
            out[o, 2] += w * (plus - minus)
            out[o, 3] += 2.0 * w * (si * dr - sr * di)


@njit(**STRICT)
def _spheres(m, x, weight, theta, mode, out):
    """The walk over spheres x (R,) that the public kernels share, in the order of x; out (R or 1, A, ..) starts at zero."""
    if x.shape[0] == 0:
        return
    width = _lanes(x)
    most = terms(np.max(x)) + 2
    work, lane, xs = np.empty((most, 4, width)), np.empty((27, width)), np.empty(width)
    order, front, back = order_table(most), np.empty((BLOCK, 4)), np.empty((BLOCK, 4))
    ahead, ahead_source = tiles_of(theta, True)
    behind, behind_source = tiles_of(theta, False)
    for first in range(0, x.shape[0], width):
        for j in range(width):
            xs[j] = x[min(first + j, x.shape[0] - 1)]
        wave_coefficients(m, xs, lane, work)
        for j in range(min(width, x.shape[0] - first)):
            r, rows = first + j, terms(xs[j])
            reset(ahead)
            reset(behind)
            for start in range(0, rows, BLOCK):
                count = min(BLOCK, rows - start)
                angular_coefficients(work, j, start, count, front, back)
                for t in range(ahead.shape[0]):
                    sweep(order, front, start, count, ahead[t])
                for t in range(behind.shape[0]):
                    sweep(order, back, start, count, behind[t])
            into = out[r if mode == 0 else 0]
            gather(ahead, ahead_source, False, mode, weight[r], into)
            gather(behind, behind_source, True, mode, weight[r], into)


@njit(**STRICT)
def amplitude_block(m, x, theta, out):
    """S1, S2 of the spheres x (R,) at theta (A,) rad: out (R, A, 4) = Re S1, Im S1, Re S2, Im S2."""
    _spheres(m, x, x, theta, 0, out)


@njit(**STRICT)
def intensity_block(m, x, weight, theta, out):
    """out (A,) = sum over the spheres x (R,) of weight (|S1|^2 + |S2|^2)/2 at theta (A,) rad, summed in the order of x."""
    sums = np.zeros((1, theta.shape[0], 4))
    _spheres(m, x, weight, theta, 1, sums)
    for t in range(theta.shape[0]):
        out[t] = sums[0, t, 0]


@njit(**STRICT)
def mueller_block(m, x, weight, theta, out):
    """out (4, A) = weighted sums of S11, S12, S33, S34 (Bohren & Huffman eq. 4.77) over the spheres x (R,), in their order."""
    sums = np.zeros((1, theta.shape[0], 4))
    _spheres(m, x, weight, theta, 2, sums)
    for t in range(theta.shape[0]):
        for part in range(4):
            out[part, t] = sums[0, t, part]
