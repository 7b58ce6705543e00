"""The series of spheres with a real index, as `series` has it for any, with half of its operations.

psi_n(mx) = q_n, psi_n(x) = p_n and chi_n(x) = c_n go upward, which is stable up to the order of their argument.  With both
fractions of `series` multiplied by q_n,

    N_a = p_{n+1} q_n - p_n E_a,   E_a = q_{n+1}/m + (n+1)/x (1 - 1/m^2) q_n,      N_b = p_{n+1} q_n - p_n m q_{n+1},

and the same with c for M.  Beyond mx, where q_n falls without bound, its ratio comes downward and stands for q_{n+1}, 1 for q_n.

Up to the order mx, nine products of these give way to four.  Of the two recurrences follows, with K = m - 1/m,

    N_b(n+1) = N_b(n-1) + K (2n+1)/x p_n q_n,      m N_a(n) = N_b(n-1) + n K/x p_n q_n:

b takes a step of (2n+1)/(mx) q_n, which q_{n+1} needs anyway, times p_n, in units of m^2 - 1, and a the share n/(2n+1) of it.
Even and odd orders have rounding errors of their own: soft spheres, whose light backward is their difference, take no steps.

In sums, with s_n = Re a_n b_n* and 4 products in place of 6,

    Re(a_{n-1} a_n* + b_{n-1} b_n*) = Re (a_n + b_{n-1})(b_n + a_{n-1})* - s_n - s_{n-1}.

Factors that grow with n, (2n+1)/x and (2n+1)/(mx), are added up: of 1/x the first 29 bits, of which such sums are exact, and the
other bits on their own.  The weights 2n + 1 come from sums of sums:

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
    MV_I,
    MV_R,
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
from bakery.physics.mie.vector import Memory, Registers, align_stack, integer

SIDE = 8  # radii side by side going upward, whose state fits the registers; downward all of a block, for quotients in a chain
INNER, UPWARD, ANY = range(3)  # orders below all x, and all below mx come by steps; steps below all mx; any
COEFFICIENTS = "ar", "ai", "br", "bi"
SPLIT = 2.0**24 + 1.0  # leaves 29 bits, to be added up over orders below 2^22
# rows of the lane array that only an absorbing index needs elsewhere: m x, its sin and cos, 1/(m^2 - 1), last n + 1 by steps
Z, SIN_Z, COS_Z, SHARE, BY_STEPS = WI, WI_LOW, RATIO_I, MV_R, MV_I


def _code(width):
    """The series of `width` radii side by side; `low` are the least x, m x, and last n + 1 by steps, of them all."""

    @intrinsic
    def series(typingctx, lane, work, weights, keep, top, rows, low):
        def codegen(context, builder, signature, args):
            align_stack(builder)
            keep, top, rows = args[3:6]
            low_x, low_z, low_steps = (builder.extract_value(args[6], k) for k in range(3))

            def memories(columns=None):
                return [Memory(context, builder, signature.args[k], args[k], width, columns) for k in range(2)]

            table = Memory(context, builder, signature.args[2], args[2], 1)
            _Downward(builder, *memories()).write(top, rows, low_x, low_z)
            for first in range(0, width, SIDE):
                _Upward(builder, *memories((first, min(width, SIDE))), table, keep).write(rows, low_x, low_steps)
            return context.get_dummy_value()

        return types.void(lane, work, weights, types.int64, top, rows, types.UniTuple(types.int64, 3)), codegen

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

    def __init__(self, builder, lanes, rows, weights, keep):
        self.builder, self.lanes, self.rows, self.weights, self.keep = builder, lanes, rows, weights, keep
        self.x, self.z, self.last, self.m, self.v = (lanes[row] for row in (X, Z, LAST, M_R, V_R))

    def write(self, count, low_x, low_steps):
        builder = self.builder
        self.begin()

        def until(low):
            """Orders n with n + 1 up to an argument."""
            orders = builder.sub(low, integer(1))
            return builder.select(builder.icmp_signed("<", orders, count), orders, count)

        upward = until(low_steps)
        inner = until(builder.select(builder.icmp_signed("<", low_x, low_steps), low_x, low_steps))
        for first, end, kind in ((integer(0), inner, INNER), (inner, upward, UPWARD), (upward, count, ANY)):
            with cgutils.for_range(builder, builder.sub(end, first)) as loop:
                self.step(builder.add(first, loop.index), kind)
        self.add(builder.sub(count, integer(1)), ANY)
        up, lanes = self.up, self.lanes
        ends = self.last * 2.0 + 1.0
        lanes[SCA] = ends * up.sca - up.sca_before * 2.0
        lanes[BACK_R] = ends * up.back_r + up.back_r_before * 2.0
        lanes[BACK_I] = ends * up.back_i + up.back_i_before * 2.0
        lanes[CROSS], lanes[ABS] = up.cross, self.x.fill(0.0)

    def begin(self):
        """State at n = 1: the functions, factors with their steps, N and M of b_0 and b_1, the sums, the coefficients before."""
        lanes, x, zero = self.lanes, self.x, self.x.fill(0.0)
        p0, c0, q0, q_below, xi = (lanes[row] for row in (SIN, COS, SIN_Z, COS_Z, XI))
        p1 = (p0 * xi - c0).where(">=", (x, 1.0), self.rows[_row(self.builder, integer(0), 2)] * p0)
        c1, q1 = c0.times_plus(xi, p0), q0 * lanes[WR] - q_below
        share, mq = lanes[SHARE], self.m * q0
        state = dict(p0=p0, p1=p1, c0=c0, c1=c1, q0=q0, q1=q1,
                     n_before=(self.m * p0 * q_below - c0 * q0) * share, n_now=(p1 * mq - p0 * q1) * share,
                     m_before=(self.m * c0 * q_below + p0 * q0) * share, m_now=(c1 * mq - c0 * q1) * share)
        self.steps = {}
        for name, value, beyond in (("x", xi, lanes[XI_LOW]), ("z", lanes[WR], lanes[WR_LOW])):
            moved = value * SPLIT
            high = moved - (moved - value)
            low = (value - high) + beyond
            state |= {f"f{name}": high * 3.0, f"l{name}": low * 3.0}
            self.steps[name] = high * 2.0, low * 2.0
        sums = ("sca", "sca_before", "back_r", "back_r_before", "back_i", "back_i_before", "cross",
                "ar_before", "ai_before", "br_before", "bi_before")
        self.up = Registers(self.builder, **state, **dict.fromkeys((*sums, *COEFFICIENTS), zero))

    def factor(self, name):
        """What the next order is multiplied by, which goes on to the one after."""
        up = self.up
        high, low = getattr(up, f"f{name}"), getattr(up, f"l{name}")
        step, step_low = self.steps[name]
        setattr(up, f"f{name}", high + step)
        setattr(up, f"l{name}", low + step_low)
        return high + low

    def weight(self, i, k):
        """A number of order n = i + 1 in all lanes, see `coefficients.order_weights`."""
        return self.x.fill(self.weights.scalar(self.builder.add(self.builder.mul(i, integer(3)), integer(k))))

    def fractions(self, i, kind):
        """N and M of a_n and of b_n, n = i + 1; functions go on to the next order."""
        up, builder = self.up, self.builder
        f, fz = self.factor("x"), self.factor("z")
        p1, c1, q1 = up.p1, up.c1, up.q1
        p2, c2, step = f.times_plus(p1, -up.p0), f.times_plus(c1, -up.c0), fz * q1
        q2 = step - up.q0
        up.q0, up.q1 = q1, q2
        ends = self.x.fill(builder.sitofp(builder.add(i, integer(2)), ir.DoubleType()))
        if kind != INNER:
            p2 = p2.where("<=", (ends, self.x), self.rows[_row(builder, builder.add(i, integer(1)), 2)] * p1)
        up.p0, up.p1, up.c0, up.c1 = p1, p2, c1, c2
        result = [*self.from_before("n", p1 * step, i), *self.from_before("m", c1 * step, i)]
        if kind != ANY:
            return result
        q1, q2 = q1.where("<=", (ends, self.z), 1.0), q2.where("<=", (ends, self.z), self.rows[_row(builder, i, 0)])
        of_a, of_b = self.v.times_plus(q2, (f + self.lanes[XI]) * self.lanes[G_R] * 0.5 * q1), self.m * q2
        p, c = p2 * q1, c2 * q1
        beyond = ((-p1).times_plus(of_a, p), (-p1).times_plus(of_b, p), (-c1).times_plus(of_a, c), (-c1).times_plus(of_b, c))
        return [value.where("<=", (ends, self.lanes[BY_STEPS]), direct) for value, direct in zip(result, beyond)]

    def from_before(self, name, step, i):
        """N, or M, of a_n and b_n, by that of b_{n+1} = that of b_{n-1} + step."""
        up = self.up
        before, now = getattr(up, f"{name}_before"), getattr(up, f"{name}_now")
        setattr(up, f"{name}_before", now)
        setattr(up, f"{name}_now", before + step)
        return step.times_plus(self.weight(i, 2), before), now

    def step(self, i, kind):
        """a_n and b_n of n = i + 1, which take the place of the ratios; sums are of the order before, for quotients take long."""
        up, builder = self.up, self.builder
        na, nb, ma, mb = self.fractions(i, kind)
        values = []
        for n, m in ((na, ma), (nb, mb)):
            share = n / m.times_plus(m, n * n)
            values += [n * share, m * share]
        before = builder.sub(i, integer(1))
        self.add(builder.select(builder.icmp_signed("<", before, integer(0)), integer(0), before), kind)
        order = self.x.fill(builder.sitofp(builder.add(i, integer(1)), ir.DoubleType()))
        for part, (name, value) in enumerate(zip(COEFFICIENTS, values)):
            value = value if kind == INNER else value.where("<=", (order, self.last), 0.0)
            self.rows[_row(builder, builder.mul(i, self.keep), part)] = value
            setattr(up, name, value)

    def add(self, i, kind):
        """What a_n, b_n of n = i + 1 add to the sums."""
        up, builder, x = self.up, self.builder, self.x
        order = x.fill(builder.sitofp(builder.add(i, integer(1)), ir.DoubleType()))

        def live(value, dead):
            return value if kind == INNER else value.where("<=", (order, self.last), dead)

        ar, ai, br, bi = (getattr(up, name) for name in COEFFICIENTS)
        up.sca_before = live(up.sca_before + up.sca, up.sca_before)
        up.sca = up.sca + (ar + br)
        for name, value in (("back_r", ar - br), ("back_i", ai - bi)):  # with alternating signs
            partial, before = getattr(up, name), getattr(up, f"{name}_before")
            setattr(up, f"{name}_before", live(partial - before, before))
            setattr(up, name, live(value - partial, partial))
        same = ar.times_plus(br, ai * bi)
        crossed = (ar + up.br_before).times_plus(br + up.ar_before, (ai + up.bi_before) * (bi + up.ai_before))
        up.cross = self.weight(i, 0).times_plus(same, self.weight(i, 1).times_plus(crossed, up.cross))
        up.ar_before, up.ai_before, up.br_before, up.bi_before = ar, ai, br, bi


series_real, series_real_single = _code(LANES), _code(1)
