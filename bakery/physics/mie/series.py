"""The series of Lorenz-Mie coefficients as code of the compiler, the same for several radii side by side.

With psi, chi the Riccati-Bessel functions of x, R_n = psi_n(mx)/psi_{n-1}(mx), and

    A = R_{n+1}/m + (n+1)/x (1 - 1/m^2)   for a_n,      A = m R_{n+1}   for b_n,
    N = psi_{n+1} - A psi_n,              M = chi_{n+1} - A chi_n,

a_n (or b_n) = N/(N - iM).  This is Bohren & Huffman eq. 4.88 with psi'_n = (n+1)/z psi_n - psi_{n+1}: the leading powers
of x then cancel on paper, and every coefficient keeps its digits as x -> 0.  The Wronskian psi_n chi_{n+1} - psi_{n+1} chi_n = 1
gives Re a_n = |a_n|^2 + Im A/|N - iM|^2: scattering and absorption are sums of positive terms.

A real index takes half of these operations: `clear`.  Near m = 1, N is a difference of nearly equal numbers.  There
D_n = psi_n/psi_{n-1}(x) - R_n has its own recurrence,
D_n = u R_n psi_n/psi_{n-1}(x) with u = (2n+1) (1/(mx) - 1/x) + D_{n+1}, and N_b = m D_{n+1} psi_n - (m-1) psi_{n+1}.

Rounding.  Operations are those written here, in this order, fused where it says so (`vector`): results depend neither on
the processor, nor on the number of threads, nor on a radius' neighbours.
"""

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from bakery.physics.mie.vector import Memory, Registers, integer

LANES = 16  # radii computed side by side: enough independent work to hide the latency of the division chain

# Rows of the lane array: constants and state of each radius, and the sums of its series.
WR, WI, WR_LOW, WI_LOW, XI, XI_LOW, X, LAST, START, RATIO_R, RATIO_I, RATIO_X, SIN, COS = range(14)
SCA, ABS, CROSS, BACK_R, BACK_I = range(14, 19)
# and of the index, all lanes equal: m, 1/m, 1 - 1/m^2, 1 - 1/m
M_R, M_I, V_R, V_I, G_R, G_I, MV_R, MV_I = range(19, 27)


def _coefficient_code(width, near=False):
    """The series of `width` radii side by side.  `near`: the difference form."""

    @intrinsic
    def series(typingctx, lane, work, top, rows, low):
        def codegen(context, builder, signature, args):
            lanes, rows_ = (Memory(context, builder, signature.args[k], args[k], width) for k in range(2))
            _Series(builder, lanes, rows_, near).write(*args[2:])
            return context.get_dummy_value()

        return types.void(lane, work, top, rows, low), codegen

    return series


_TINY, _POLE = 1e-290, 1e-100  # a denominator that is exactly zero: its inverse still has a finite square


class _Series:
    """Code of the series; methods write what their docstrings say for one n, all radii side by side."""

    def __init__(self, builder, lanes, rows, near):
        self.builder, self.lanes, self.rows, self.near = builder, lanes, rows, near
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
        ti = k.times_plus(self.wi, k * self.wi_low) - state.i
        size = tr * tr + ti * ti
        # the comparison beside the quotient: either is on the path from one order to the next
        scale = size.inverse().where(">", (size, _TINY), 1.0 / _TINY)
        state.r = (tr * scale).where("<=", (order, self.start), state.r)
        state.i = (-(ti * scale)).where("<=", (order, self.start), state.i)

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
        rr, ri = rows[self.four(i, 0)], rows[self.four(i, 1)]
        of_a, of_b = self.fractions(i, after * self.xi, rr, ri, (p1, p2, c1, c2))
        live = None if inner else ("<=", (order, self.last), 0.0)
        a2, lost_a, ar, ai = self.coefficient(live, *of_a[:-1], of_a[-1].inverse())
        b2, lost_b, br, bi = self.coefficient(live, *of_b[:-1], of_b[-1].inverse())
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
        return (self.fraction(waves, (rr * vr - ri * vi) + h * gr, (rr * vi + ri * vr) + h * gi, *numerator_a),
                self.fraction(waves, rr * mr - ri * mi, rr * mi + ri * mr, *numerator_b))

    def fraction(self, waves, sr, si, nr=None, ni=None):
        """N and M of one coefficient and |N - iM|^2."""
        p1, p2, c1, c2 = waves
        nr = p2 - sr * p1 if nr is None else nr
        dr = c2 - sr * c1
        ni = -(si * p1) if ni is None else ni
        di = -(si * c1)
        tr, ti = nr + di, ni - dr
        return nr, ni, dr, di, si, tr.times_plus(tr, ti * ti)

    def coefficient(self, live, nr, ni, dr, di, si, scale):
        """|a|^2, Re a - |a|^2, Re a, Im a; 0 where it is not `live`, if that is a condition."""
        def kept(value):
            return value.where(*live) if live else value

        square, absorbed = kept(nr.times_plus(nr, ni * ni) * scale), kept(si * scale)
        return square, absorbed, square + absorbed, kept(nr.times_plus(dr, ni * di) * scale)


series_absorbing, series_absorbing_single = _coefficient_code(LANES), _coefficient_code(1)
series_near, series_near_single = _coefficient_code(LANES, near=True), _coefficient_code(1, near=True)
