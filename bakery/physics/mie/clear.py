"""The series of spheres with a real index, as `series` has it for any, with half of its operations.

psi_n(mx) = q_n, psi_n(x) = p_n and chi_n(x) = c_n go upward, which is stable up to the order of their argument.  With both
fractions of `series` multiplied by q_n,

    N_a = p_{n+1} q_n - p_n E_a,   E_a = q_{n+1}/m + (n+1)/x (1 - 1/m^2) q_n,      N_b = p_{n+1} q_n - p_n m q_{n+1},

and the same with c for M.  Beyond mx, where q_n falls without bound, its ratio comes downward and stands for q_{n+1}, 1 for q_n.

Factors that grow with n, (2n+1)/x, (2n+1)/(mx) and (n+1)/x (1 - 1/m^2), are added up: of 1/x the first 29 bits, of which such
sums are exact, and the other bits on their own.  The weights 2n + 1 come from sums of sums:

    sum_{n<=N} (2n+1) s_n = (2N+1) S_N - 2 sum_{n<N} S_n,      S_n = s_1 + .. + s_n.

Sums have units of their own in many processors; products are what bounds this loop.  So do quotients: one shared by a_n and b_n
takes as long as two, which take three products' time each (docs/measurements/limits.md).
"""

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from bakery.physics.mie.series import (
    ABS,
    BACK_I,
    BACK_R,
    COS,
    CROSS,
    G_R,
    LANES,
    LAST,
    M_R,
    RATIO_I,
    RATIO_R,
    RATIO_X,
    SCA,
    SIN,
    START,
    V_R,
    WI,
    WI_LOW,
    WR,
    WR_LOW,
    XI,
    XI_LOW,
    X,
)
from bakery.physics.mie.vector import Memory, Registers, integer

SIDE = 8  # radii side by side going upward, whose state fits the registers; downward all of a block, for quotients in a chain
SPLIT = 2.0**24 + 1.0  # leaves 29 bits, to be added up over orders below 2^22
Z, SIN_Z, COS_Z = WI, WI_LOW, RATIO_I  # rows of the lane array that only an absorbing index needs elsewhere: m x, its sin and cos


def _code(width):
    """The series of `width` radii side by side."""

    @intrinsic
    def series(typingctx, lane, work, weights, top, rows, low_x, low_z):
        def codegen(context, builder, signature, args):
            def memories(columns=None):
                return [Memory(context, builder, signature.args[k], args[k], width, columns) for k in range(2)]

            table = Memory(context, builder, signature.args[2], args[2], 1)
            _Downward(builder, *memories()).write(*args[3:])
            for first in range(0, width, SIDE):
                _Upward(builder, *memories((first, min(width, SIDE))), table).write(*args[4:])
            return context.get_dummy_value()

        return types.void(lane, work, weights, top, rows, low_x, low_z), codegen

    return series


def _row(builder, index, part):
    """Row of the vectors of Re a, Im a, Re b, Im b at n = index + 1."""
    return builder.add(builder.mul(index, integer(4)), integer(part))


class _Downward:
    """Code of the ratios of Bessel functions beyond their arguments: psi_{n+1}/psi_n of mx in row n-1, of x in row n."""

    def __init__(self, builder, lanes, rows):
        self.builder, self.lanes, self.rows = builder, lanes, rows

    def write(self, top, count, low_x, low_z):
        builder, lanes = self.builder, self.lanes
        self.state = Registers(builder, z=lanes[RATIO_R], x=lanes[RATIO_X])
        above = builder.add(count, integer(1))
        end = builder.select(builder.icmp_signed(">", low_z, integer(1)), builder.sub(low_z, integer(1)), integer(1))
        with builder.if_then(builder.icmp_signed("<=", low_z, above)):
            self.descend("z", (WR, WR_LOW, START), 0.0, top, above, None)
            self.descend("z", (WR, WR_LOW, START), 0.0, above, end, (2, 0))
        self.descend("x", (XI, XI_LOW, LAST), 1.0, above, builder.sub(low_x, integer(1)), (1, 2))

    def descend(self, name, rows, extra, first, end, kept):
        """Orders first, first - 1 .. end + 1, n into part `kept[1]` of row n - kept[0]."""
        builder = self.builder
        inverse, low, start = (self.lanes[row] for row in rows)
        with cgutils.for_range(builder, builder.sub(first, end)) as loop:
            n = builder.sub(first, loop.index)
            order = inverse.fill(builder.sitofp(n, ir.DoubleType()))
            k = order * 2.0 + 1.0
            ratio = getattr(self.state, name)
            ratio = (k.times_plus(inverse, k * low) - ratio).inverse().where("<=", (order, start + extra), ratio)
            setattr(self.state, name, ratio)
            if kept:
                self.rows[_row(builder, builder.sub(n, integer(kept[0])), kept[1])] = ratio


class _Upward:
    """Code of coefficients and sums."""

    def __init__(self, builder, lanes, rows, weights):
        self.builder, self.lanes, self.rows, self.weights = builder, lanes, rows, weights
        self.x, self.z, self.last, self.m, self.v = (lanes[row] for row in (X, Z, LAST, M_R, V_R))

    def write(self, count, low_x, low_z):
        builder = self.builder
        self.begin()
        low = builder.select(builder.icmp_signed("<", low_x, low_z), low_x, low_z)
        # orders n with n + 1 below all arguments: everything goes upward and no series has ended
        inner = builder.sub(low, integer(1))
        inner = builder.select(builder.icmp_signed("<", inner, count), inner, count)
        with cgutils.for_range(builder, inner) as loop:
            self.add(loop.index, self.fractions(loop.index, True), True)
        with cgutils.for_range(builder, builder.sub(count, inner)) as loop:
            i = builder.add(inner, loop.index)
            self.add(i, self.fractions(i, False), False)
        up, lanes = self.up, self.lanes
        ends = self.last * 2.0 + 1.0
        lanes[SCA] = ends * up.sca - up.sca_before * 2.0
        lanes[BACK_R] = ends * up.back_r + up.back_r_before * 2.0
        lanes[BACK_I] = ends * up.back_i + up.back_i_before * 2.0
        lanes[CROSS], lanes[ABS] = up.cross, self.x.fill(0.0)

    def begin(self):
        """State at n = 1: the functions, factors with their steps, the sums, the coefficients before."""
        lanes, x, zero = self.lanes, self.x, self.x.fill(0.0)
        sin, cos, sin_z, cos_z, xi = (lanes[row] for row in (SIN, COS, SIN_Z, COS_Z, XI))
        p1 = (sin * xi - cos).where(">=", (x, 1.0), self.rows[_row(self.builder, integer(0), 2)] * sin)
        state = dict(p0=sin, p1=p1, c0=cos, c1=cos.times_plus(xi, sin), q0=sin_z, q1=sin_z * lanes[WR] - cos_z)
        self.steps = {}
        for name, value, beyond, first in (("x", xi, lanes[XI_LOW], 3.0), ("z", lanes[WR], lanes[WR_LOW], 3.0),
                                         ("h", xi * lanes[G_R], zero, 2.0)):
            moved = value * SPLIT
            high = moved - (moved - value)
            low = (value - high) + beyond
            state |= {f"f{name}": high * first, f"l{name}": low * first}
            step = 1.0 if name == "h" else 2.0
            self.steps[name] = high * step, low * step
        sums = ("sca", "sca_before", "back_r", "back_r_before", "back_i", "back_i_before", "cross", "ar", "ai", "br", "bi")
        self.up = Registers(self.builder, **state, **dict.fromkeys(sums, zero))

    def factor(self, name):
        """What the next order is multiplied by, which goes on to the one after."""
        up = self.up
        high, low = getattr(up, f"f{name}"), getattr(up, f"l{name}")
        step, step_low = self.steps[name]
        setattr(up, f"f{name}", high + step)
        setattr(up, f"l{name}", low + step_low)
        return high + low

    def fractions(self, i, inner):
        """N, M and one over |N + iM|^2 of a_n and of b_n, n = i + 1; functions go on to the next order."""
        up, rows, builder = self.up, self.rows, self.builder
        f, fz, h = self.factor("x"), self.factor("z"), self.factor("h")
        p1, c1, q1 = up.p1, up.c1, up.q1
        p2, c2, q2 = f.times_plus(p1, -up.p0), f.times_plus(c1, -up.c0), fz.times_plus(q1, -up.q0)
        up.q0, up.q1 = q1, q2
        if not inner:
            after = self.x.fill(builder.sitofp(builder.add(i, integer(2)), ir.DoubleType()))
            p2 = p2.where("<=", (after, self.x), rows[_row(builder, builder.add(i, integer(1)), 2)] * p1)
            q1, q2 = q1.where("<=", (after, self.z), 1.0), q2.where("<=", (after, self.z), rows[_row(builder, i, 0)])
        up.p0, up.p1, up.c0, up.c1 = p1, p2, c1, c2
        of_a, of_b = self.v.times_plus(q2, h * q1), self.m * q2
        p, c = p2 * q1, c2 * q1
        result = []
        for factor in (of_a, of_b):
            n, m = (-p1).times_plus(factor, p), (-c1).times_plus(factor, c)
            result.append((n, m, m.times_plus(m, n * n).inverse()))
        return result

    def add(self, i, fractions, inner):
        """a_n, b_n of n = i + 1, which take the place of the ratios, and what they add to the sums."""
        up, builder, x = self.up, self.builder, self.x
        order = None if inner else x.fill(builder.sitofp(builder.add(i, integer(1)), ir.DoubleType()))

        def live(value, dead=0.0):
            return value if inner else value.where("<=", (order, self.last), dead)

        values = []
        for n, m, inverse in fractions:
            share = n * inverse
            values += [live(n * share), live(m * share)]
        ar, ai, br, bi = values
        for part, value in enumerate(values):
            self.rows[_row(builder, i, part)] = value
        up.sca_before = live(up.sca_before + up.sca, up.sca_before)
        up.sca = up.sca + (ar + br)
        for name, value in (("back_r", ar - br), ("back_i", ai - bi)):  # with alternating signs
            partial, before = getattr(up, name), getattr(up, f"{name}_before")
            setattr(up, f"{name}_before", live(partial - before, before))
            setattr(up, name, live(value - partial, partial))
        # (n-1)(n+1)/n Re(a_{n-1} a_n* + ..) and (2n+1)/(n(n+1)) Re(a_n b_n*)
        before = ar.times_plus(up.ar, ai * up.ai) + br.times_plus(up.br, bi * up.bi)
        same = ar.times_plus(br, ai * bi)
        row = builder.mul(i, integer(2))
        weight, mixed = (x.fill(self.weights.scalar(builder.add(row, integer(k)))) for k in range(2))
        up.cross = mixed.times_plus(same, weight.times_plus(before, up.cross))
        up.ar, up.ai, up.br, up.bi = ar, ai, br, bi


series_real, series_real_single = _code(LANES), _code(1)
