"""Points of segments: sixteen neighbours in a table of the point source, blended, turned and added, eight orders at a time.

Written in the compiler's own vectors: numba checks for each of the sixteen whether it overlaps what is written, which takes as
long as the sum.  Points that have the same neighbours take eight orders of them one after the other, from the first level of the
cache.  The order of the sums is fixed, so it does not depend on how wide the processor's vectors are.
"""

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from bakery.physics.vectors import fused, load, loop, splat, store

LANES = 8  # orders at a time: a vector has the real parts of as many, then the imaginary ones

_BOTH, _WIDE = ir.VectorType(ir.FloatType(), 2 * LANES), ir.VectorType(ir.DoubleType(), LANES)
_INT = ir.IntType(32)


@intrinsic
def add_turned(typingctx, table, at, row, column, points, weight, phases, sums):
    """sums += (a + i b) (cosine + i sine) for each point and order k, a + i b the weighted sum over four rows and columns.

    table : C-contiguous float32, by `LANES` along the last axis real parts of so many k, then their imaginary ones
    at : of the first neighbour, counted in numbers;  row, column : from one to the next, `column` also of k, both parts
    points : the first, the one after the last, and whose they are (Q,)
    weight : (Q, 16) C-contiguous float32, by rows and columns
    phases : (Q, 2 LANES) cosines and sines of the first k, as the table's parts; (Q, 2) cosine and sine of what leads from each
        to the one `LANES` later; room for the phases of the points, all C-contiguous float32
    sums : (N, column) C-contiguous float64, parts as the table's
    """
    return types.void(table, *[types.intp] * 3, points, weight, phases, sums), _code


def _code(context, builder, signature, args):
    kinds = signature.args
    table, at, row, column, points, weight, phases, sums = args
    first, after, owner = (builder.extract_value(points, n) for n in range(3))
    begin, turn, scratch = (builder.extract_value(phases, n) for n in range(3))
    first, after = (context.cast(builder, number, kind, types.intp)
                    for number, kind in zip((first, after), kinds[4].types[:2], strict=True))
    arrays = ((kinds[0], table), (kinds[4].types[2], owner), (kinds[5], weight), (kinds[7], sums),
              *zip(kinds[6].types, (begin, turn, scratch), strict=True))
    table, owner, weight, sums, begin, turn, scratch = (context.make_array(kind)(context, builder, array).data
                                                        for kind, array in arrays)
    step = column.type

    def point(k, neighbours, q):
        """Adds eight orders of a point."""
        start = builder.gep(weight, [builder.mul(q, step(len(neighbours)))])
        shares = [splat(builder, builder.load(builder.gep(start, [step(n)])), 2 * LANES) for n in range(len(neighbours))]
        a, b = _parts(builder, _weighted(builder, shares, neighbours))
        kept = builder.gep(scratch, [builder.mul(builder.sub(q, first), step(2 * LANES))])
        phase = builder.select(builder.icmp_signed("==", k, step(0)), builder.gep(begin, [builder.mul(q, step(2 * LANES))]), kept)
        c, s = _parts(builder, load(builder, phase, step(0), _BOTH))
        _turn(builder, (c, s), builder.gep(turn, [builder.add(q, q)]), kept)
        real = builder.fsub(builder.fmul(a, c), builder.fmul(b, s))
        imaginary = builder.fadd(builder.fmul(a, s), builder.fmul(b, c))
        to = builder.add(builder.mul(builder.load(builder.gep(owner, [q])), column), k)
        for value, where in ((real, to), (imaginary, builder.add(to, step(LANES)))):
            store(builder, sums, where, builder.fadd(load(builder, sums, where, _WIDE), builder.fpext(value, _WIDE)))

    def orders(k):
        neighbours = [load(builder, table, builder.add(builder.add(at, builder.add(builder.mul(row, step(n)),
                                                                                   builder.mul(column, step(m)))), k), _BOTH)
                      for n in range(4) for m in range(4)]
        loop(builder, first, after, 1, lambda q: point(k, neighbours, q))

    loop(builder, step(0), column, 2 * LANES, orders)
    return context.get_dummy_value()


def _turn(builder, phases, by, to):
    """Stores phases times one of which cosine and sine stand at `by`."""
    c, s = phases
    x, y = (splat(builder, builder.load(builder.gep(by, [ir.IntType(64)(n)])), LANES) for n in range(2))
    turned = fused(builder, c, x, builder.fneg(builder.fmul(s, y))), fused(builder, s, x, builder.fmul(c, y))
    for n, part in enumerate(turned):
        store(builder, to, ir.IntType(64)(n * LANES), part)


def _parts(builder, both):
    """Real and imaginary parts."""
    undefined = ir.Constant(_BOTH, ir.Undefined)
    return [builder.shuffle_vector(both, undefined, ir.Constant(ir.VectorType(_INT, LANES), list(range(n, n + LANES))))
            for n in (0, LANES)]


def _weighted(builder, weights, numbers):
    """Sum of products, by fours: each waits for the one four before it."""
    sums = [builder.fmul(*pair) for pair in zip(weights[:4], numbers[:4], strict=True)]
    for n in range(4, len(weights)):
        sums[n % 4] = fused(builder, weights[n], numbers[n], sums[n % 4])
    return builder.fadd(builder.fadd(*sums[:2]), builder.fadd(*sums[2:]))
