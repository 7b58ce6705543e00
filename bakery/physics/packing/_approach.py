"""Which neighbour a sphere touches first, eight of them side by side.

Written in the compiler's own vectors: a record of eight numbers is one load, eight records are turned into eight vectors, and all
that follows is the same for each, roots and quotients too.  A loop over neighbours takes them one by one, and a branch on which
of them come near at all is one that no predictor foresees.
"""

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from bakery.physics.vectors import at, bits, loop, splat

LANES = 8

_VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_INT, _LONG = ir.IntType(32), ir.IntType(64)


@intrinsic
def first_touch(typingctx, sphere, near, first, last, shift, moving, now):
    """Time from now until the first of the neighbours near[first] .. near[last - 1] is touched, and its entry in `near`.

    The squared gap of a pair is c + 2 b tau + a tau^2; a root later than the neighbour's own next event does not count.  inf
    where none is touched.  Lists take whole cache lines: what stands behind the last one is some sphere's number, or was.

    sphere, near, shift : of `State`
    moving : x, y, z now, velocity, radius of the sphere
    now : scale, rate, time
    """
    signature = types.Tuple((types.float64, types.uint32))(
        sphere, near, types.int64, types.int64, shift, types.UniTuple(types.float64, 7), types.UniTuple(types.float64, 3))
    return signature, _code


def _code(context, builder, signature, args):
    sphere, near, first, last, shift, moving, now = args
    sphere, near, shift = (context.make_array(signature.args[n])(context, builder, args[n]).data for n in (0, 1, 4))
    moving = [splat(builder, builder.extract_value(moving, n), LANES) for n in range(7)]
    now = [splat(builder, builder.extract_value(now, n), LANES) for n in range(3)]
    never = ir.Constant(_VECTOR, [float("inf")] * LANES)
    lane = ir.Constant(ir.VectorType(_LONG, LANES), list(range(LANES)))

    def turn(n, soonest, who):
        entries = builder.load(at(builder, near, n, ir.VectorType(_INT, LANES)), align=32)
        records = _columns(builder, sphere, entries)
        due = builder.fsub(records[7], now[2])
        tau = _touching(builder, *_gap(builder, records, _shifts(builder, shift, entries), moving, now))
        listed = builder.icmp_signed("<", lane, splat(builder, builder.sub(last, n), LANES))
        sooner = builder.and_(listed, builder.and_(builder.fcmp_ordered("<", tau, due), builder.fcmp_ordered("<", tau, soonest)))
        return builder.select(sooner, tau, soonest), builder.select(sooner, entries, who)

    soonest, who = loop(builder, first, last, LANES, turn, [never, _whole(0)])
    least = _least(builder, soonest)
    k = cgutils.get_or_insert_function(builder.module, ir.FunctionType(_LONG, [_LONG, ir.IntType(1)]), "llvm.cttz.i64")
    k = builder.call(k, [bits(builder, builder.fcmp_ordered("==", soonest, least)), ir.IntType(1)(1)])
    return context.make_tuple(builder, signature.return_type,
                              [builder.extract_element(least, _INT(0)), builder.extract_element(who, k)])


def _gap(builder, records, shifts, moving, now):
    """a, b, c of the squared gaps."""
    x, y, z, vx, vy, vz, radius = moving
    scale, rate, t = now
    px, py, pz, ux, uy, uz, r, _ = records
    sx, sy, sz = shifts
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
    return form(u, u), form(d, u), form(d, d)


def _touching(builder, a, b, c):
    """The first tau >= 0 at which c + 2 b tau + a tau^2 falls below 0; inf where it never does.

    In touch, c <= 0 within rounding: at once where both come closer; else where growth overtakes, when they are as far apart
    again as now.
    """
    sub, mul, less, select = builder.fsub, builder.fmul, builder.fcmp_ordered, builder.select
    zero, never = (ir.Constant(_VECTOR, [value] * LANES) for value in (0.0, float("inf")))
    square = sub(mul(b, b), mul(a, c))
    root = ir.FunctionType(_VECTOR, [_VECTOR])
    root = cgutils.get_or_insert_function(builder.module, root, f"llvm.sqrt.v{LANES}f64")
    root = builder.call(root, [select(less(">", square, zero), square, zero)])
    closing, overtaken, touching = less("<", b, zero), less("<", a, zero), less("<=", c, zero)
    above = select(closing, select(touching, zero, c), sub(zero, builder.fadd(b, select(touching, b, root))))
    below = select(closing, sub(root, b), a)
    ever = builder.and_(builder.or_(closing, overtaken), builder.or_(touching, less(">=", square, zero)))
    return select(ever, builder.fdiv(above, below), never)


def _least(builder, numbers):
    """The least of all lanes, in each."""
    half = LANES
    while half > 1:
        half //= 2
        turned = builder.shuffle_vector(numbers, numbers, _indices([(n + half) % LANES for n in range(LANES)]))
        numbers = builder.select(builder.fcmp_ordered("<", turned, numbers), turned, numbers)
    return numbers


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
