"""Tiles of a product of matrices whose sums stay in the processor's registers.

Written in the compiler's own vectors: of loops in Python numba makes such that load and store every sum again and again, which
takes twice as long.  Each sum goes by the same order of terms, each product added to it with one rounding, whatever the tile
and the processor.
"""

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

LANES = 8  # columns of a vector
ROWS, VECTORS = 4, 2  # of a tile: eight sums on the way, as many as hide how long a sum takes
TALL = ROWS * VECTORS  # rows of a tile of one vector

_INT = ir.IntType(32)


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

    def pointer(base, index):
        return builder.bitcast(builder.gep(base, [index]), vector.as_pointer())

    before = builder.block
    head, body, done = (builder.append_basic_block(name) for name in ("tile", "tile.more", "tile.done"))
    builder.branch(head)
    builder.position_at_end(head)
    n, factor, at = (builder.phi(of) for _ in range(3))
    totals = [[builder.phi(vector) for _ in range(vectors)] for _ in range(rows)]
    builder.cbranch(builder.icmp_signed("<", n, count), body, done)
    builder.position_at_end(body)
    numbers = []
    for v in range(vectors):
        loaded = builder.load(pointer(lines, builder.add(at, of(v * LANES))))
        loaded.align = 4
        numbers.append(loaded)
    after, beside = [], factor
    for i in range(rows):
        share = _splat(builder, builder.load(builder.gep(factors, [beside])), vector)
        after.append([fused(builder, share, x, total) for total, x in zip(totals[i], numbers, strict=True)])
        beside = builder.add(beside, row)
    zero = ir.Constant(vector, [0.0] * LANES)
    turns = [(n, of(0), builder.add(n, of(1))), (factor, first, builder.add(factor, step)), (at, start, builder.add(at, line))]
    turns += [(totals[i][v], zero, after[i][v]) for i in range(rows) for v in range(vectors)]
    for phi, entry, again in turns:
        phi.add_incoming(entry, before)
        phi.add_incoming(again, body)
    builder.branch(head)
    builder.position_at_end(done)
    for i in range(rows):
        for v in range(vectors):
            builder.store(totals[i][v], pointer(sums, builder.add(to, of(v * LANES)))).align = 4
        to = builder.add(to, below)
    return context.get_dummy_value()


def _splat(builder, x, vector):
    single = builder.insert_element(ir.Constant(vector, ir.Undefined), x, _INT(0))
    return builder.shuffle_vector(single, single, ir.Constant(ir.VectorType(_INT, LANES), [0] * LANES))


def fused(builder, x, y, z):
    """x y + z of vectors, rounded once on any processor."""
    name = f"llvm.fma.v{x.type.count}f{64 if isinstance(x.type.element, ir.DoubleType) else 32}"
    return builder.call(cgutils.get_or_insert_function(builder.module, ir.FunctionType(x.type, [x.type] * 3), name), [x, y, z])
