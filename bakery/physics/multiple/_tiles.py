"""Tiles of a product of matrices whose sums stay in the processor's registers.

Written in the compiler's own vectors: of loops in Python numba makes such that load and store every sum again and again, which
takes twice as long.  Each sum goes by the same order of terms, each product added to it with one rounding, whatever the tile
and the processor.
"""

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from bakery.physics.vectors import fused, load, loop, splat, store

LANES = 8  # columns of a vector
ROWS, VECTORS = 4, 2  # of a tile: eight sums on the way, as many as hide how long a sum takes
TALL = ROWS * VECTORS  # rows of a tile of one vector


def _tile(rows, vectors):
    """An intrinsic that sets a tile of so many rows and vectors."""

    @intrinsic
    def tile(typingctx, factors, lines, out, count):
        def code(context, builder, signature, args):
            return _code(context, builder, signature.args, args, (rows, vectors))

        return types.void(factors, lines, out, types.intp), code

    return tile


whole_tile, flat_tile = _tile(ROWS, VECTORS), _tile(1, VECTORS)
tall_tile, narrow_tile, least_tile = _tile(TALL, 1), _tile(ROWS, 1), _tile(1, 1)


def _code(context, builder, kinds, args, tile):
    count = args[3]
    rows, vectors = tile
    number = context.get_data_type(kinds[2].types[0].dtype)
    vector = ir.VectorType(number, LANES)

    def record(n):
        fields = [builder.extract_value(args[n], k) for k in range(len(kinds[n].types))]
        return context.make_array(kinds[n].types[0])(context, builder, fields[0]).data, *fields[1:]

    (factors, first, row, step), (lines, start, line), (sums, to, below) = (record(n) for n in range(3))
    of = count.type

    def turn(n, factor, at, *totals):
        numbers = [load(builder, lines, builder.add(at, of(v * LANES)), vector) for v in range(vectors)]
        after, beside = [], factor
        for i in range(rows):
            share = splat(builder, builder.load(builder.gep(factors, [beside])), LANES)
            after += [fused(builder, share, x, total) for total, x in zip(totals[i * vectors:], numbers, strict=False)]
            beside = builder.add(beside, row)
        return [builder.add(factor, step), builder.add(at, line), *after]

    zero = ir.Constant(vector, [0.0] * LANES)
    _, _, *totals = loop(builder, of(0), count, 1, turn, [first, start] + [zero] * (rows * vectors))
    for i in range(rows):
        for v in range(vectors):
            store(builder, sums, builder.add(to, of(v * LANES)), totals[i * vectors + v])
        to = builder.add(to, below)
    return context.get_dummy_value()
