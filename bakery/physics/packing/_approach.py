"""How eight neighbours of a sphere come closer, side by side.

Written in the compiler's own vectors: a record of eight numbers is one load, eight records are turned into eight vectors, and all
that follows is the same for each.  A loop over neighbours takes them one by one.  No sum is in another order than in such a loop.
"""

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from bakery.physics.vectors import at, bits, splat, store

LANES = 8
A, B, C, DUE = range(0, 4 * LANES, LANES)  # of what `approach` writes

_VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_INT, _LONG = ir.IntType(32), ir.IntType(64)


@intrinsic
def scratch(typingctx):
    """Memory for what `approach` writes, on the stack of the function that calls."""

    def code(context, builder, signature, args):
        stack = cgutils.alloca_once(builder, ir.DoubleType(), context.get_constant(types.intp, 4 * LANES))
        return stack

    return types.CPointer(types.float64)(), code


@intrinsic
def approach(typingctx, sphere, near, first, shift, moving, now, soon, out):
    """Which of the eight neighbours near[first] .. near[first + 7] may touch: a bit each.

    The squared gap is c + 2 b tau + a tau^2; none before `until` where c > 0 and c + until (2 b + until min(a, 0)) >= 0.

    sphere, near, shift : of `State`
    moving : x, y, z now, velocity, radius of the sphere
    now : scale, rate, time
    soon : time from now after which nothing matters; the neighbour's own next event, where that is earlier
    out : memory for a, b, c and the time until a neighbour's next event, LANES of each
    """
    signature = types.int64(sphere, near, types.int64, shift, types.UniTuple(types.float64, 7),
                            types.UniTuple(types.float64, 3), types.float64, out)
    return signature, _code


def _code(context, builder, signature, args):
    sphere, near, first, shift, moving, now, soon, out = args
    sphere, near, shift = (context.make_array(signature.args[n])(context, builder, args[n]).data for n in (0, 1, 3))
    x, y, z, vx, vy, vz, radius = (splat(builder, builder.extract_value(moving, n), LANES) for n in range(7))
    scale, rate, t = (splat(builder, builder.extract_value(now, n), LANES) for n in range(3))
    entries = builder.load(at(builder, near, first, ir.VectorType(_INT, LANES)), align=32)
    px, py, pz, ux, uy, uz, r, due = _columns(builder, sphere, entries)
    sx, sy, sz = _shifts(builder, shift, entries)
    sub, mul, add = builder.fsub, builder.fmul, builder.fadd
    dx, dy, dz = (sub(sub(at, s), add(p, mul(v, t))) for at, s, p, v in ((x, sx, px, ux), (y, sy, py, uy), (z, sz, pz, uz)))
    ux, uy, uz = sub(vx, ux), sub(vy, uy), sub(vz, uz)
    radii = add(radius, r)
    s, g = mul(radii, scale), mul(radii, rate)

    def form(left, right):
        """The indefinite product of two differences of places, velocities and radii."""
        terms = [mul(*pair) for pair in zip(left, right, strict=True)]
        return sub(add(add(terms[0], terms[1]), terms[2]), terms[3])

    u, d = (ux, uy, uz, g), (dx, dy, dz, s)
    a, b, c = form(u, u), form(d, u), form(d, d)
    due = sub(due, t)
    zero = ir.Constant(_VECTOR, [0.0] * LANES)
    soon = splat(builder, soon, LANES)
    until = builder.select(builder.fcmp_ordered("<", due, soon), due, soon)
    least = builder.select(builder.fcmp_ordered("<", a, zero), a, zero)
    bound = add(c, mul(until, add(mul(ir.Constant(_VECTOR, [2.0] * LANES), b), mul(until, least))))
    apart = builder.and_(builder.fcmp_ordered(">", c, zero), builder.fcmp_ordered(">=", bound, zero))
    for value, start in ((a, A), (b, B), (c, C), (due, DUE)):
        store(builder, out, _LONG(start), value)
    return bits(builder, builder.not_(apart))


def _columns(builder, sphere, entries):
    """The records of eight spheres as eight vectors, one for each number of a record."""
    rows = []
    for n in range(LANES):
        entry = builder.extract_element(entries, _INT(n))
        record = builder.mul(builder.zext(builder.lshr(entry, entry.type(5)), _LONG), _LONG(8))
        rows.append(builder.load(at(builder, sphere, record, _VECTOR), align=64))
    for half in (1, 2, 4):  # halves of blocks of 2 half x 2 half change places
        low = [n + LANES - half if n & half else n for n in range(LANES)]
        high = [n + LANES if n & half else n + half for n in range(LANES)]
        turned = list(rows)
        for n in range(LANES):
            if not n & half:
                turned[n] = builder.shuffle_vector(rows[n], rows[n + half], _indices(low))
                turned[n + half] = builder.shuffle_vector(rows[n], rows[n + half], _indices(high))
        rows = turned
    return rows


def _shifts(builder, shift, entries):
    """Translations of the images of eight neighbours, from their codes 9 a + 3 b + c of 0, 1, 2 along each axis.

    Without a branch: in a tile of 1000 spheres a third of the eights has a translated neighbour.
    """
    codes = builder.and_(entries, _whole(31))
    nines, threes = (builder.lshr(builder.mul(codes, _whole(factor)), _whole(bits)) for factor, bits in ((57, 9), (43, 7)))
    steps = nines, builder.sub(threes, builder.mul(nines, _whole(3))), builder.sub(codes, builder.mul(threes, _whole(3)))
    edges = [builder.load(builder.gep(shift, [_LONG(3 * code + axis)])) for axis, code in enumerate((22, 16, 14))]
    return [builder.fmul(builder.sitofp(builder.sub(step, _whole(1)), _VECTOR), splat(builder, edge, LANES))
            for step, edge in zip(steps, edges, strict=True)]


def _whole(number):
    return ir.Constant(ir.VectorType(_INT, LANES), [number] * LANES)


def _indices(numbers):
    return ir.Constant(ir.VectorType(_INT, LANES), numbers)
