"""One point of a segment: sixteen neighbours in a table of the point source, blended, turned and added, eight orders at a time.

Written in the compiler's own vectors: numba checks for each of the sixteen whether it overlaps what is written, which takes as
long as the sum.  The order of the sums is fixed, so it does not depend on how wide the processor's vectors are.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

LANES = 8  # float32; arrays are padded with zeros to a multiple of it

_VECTOR, _WIDE = ir.VectorType(ir.FloatType(), LANES), ir.VectorType(ir.DoubleType(), LANES)
_INT = ir.IntType(32)


@intrinsic
def add_turned(typingctx, table, at, row, count, weights, phases, sums, to):
    """sums += (a + i b) (cosine + i sine) for each order k, with a + i b = sum over four rows and columns of p w times the table.

    Parameters
    ----------
    table : C-contiguous float32, along the last axis the real parts of all k, then the imaginary ones
    at : of the first neighbour, counted in numbers;  row : from one row to the next
    count : of k, padded; from one column to the next is twice that
    weights : p of rows and w of columns, four float32 each
    phases : cosine, sine, C-contiguous float32, and where their k begin
    sums : C-contiguous float64;  to : where these begin, `count` real parts, then imaginary ones
    """
    indices = [types.intp] * 3
    return types.void(table, *indices, weights, phases, sums, types.intp), _code


def _code(context, builder, signature, args):
    table, at, row, count, weights, phases, sums, to = args
    cosine, sine, angle = (builder.extract_value(phases, n) for n in range(3))
    kinds = (signature.args[0], *signature.args[5].types[:2], signature.args[6])
    table, cosine, sine, sums = (context.make_array(kind)(context, builder, array).data
                                 for kind, array in zip(kinds, (table, cosine, sine, sums)))
    p, w = ([_splat(builder, builder.extract_value(weights, [n, k])) for k in range(4)] for n in range(2))
    step = count.type
    column = builder.add(count, count)

    def weighted(weights, numbers):
        products = [builder.fmul(*pair) for pair in zip(weights, numbers, strict=True)]
        return builder.fadd(builder.fadd(*products[:2]), builder.fadd(*products[2:]))

    def blended(first):
        rows = [builder.add(first, builder.mul(row, step(n))) for n in range(4)]
        return weighted(p, [weighted(w, [_load(builder, table, builder.add(start, builder.mul(column, step(m))), _VECTOR)
                                         for m in range(4)]) for start in rows])

    before = builder.block
    head, body, done = (builder.append_basic_block(name) for name in ("turned", "turned.more", "turned.done"))
    builder.branch(head)
    builder.position_at_end(head)
    k = builder.phi(step)
    builder.cbranch(builder.icmp_signed("<", k, count), body, done)
    builder.position_at_end(body)
    a, b = blended(builder.add(at, k)), blended(builder.add(builder.add(at, k), count))
    c, s = (_load(builder, of, builder.add(angle, k), _VECTOR) for of in (cosine, sine))
    real = builder.fsub(builder.fmul(a, c), builder.fmul(b, s))
    imaginary = builder.fadd(builder.fmul(a, s), builder.fmul(b, c))
    for value, part in ((real, k), (imaginary, builder.add(k, count))):
        at_sum = builder.add(to, part)
        _store(builder, sums, at_sum, builder.fadd(_load(builder, sums, at_sum, _WIDE), builder.fpext(value, _WIDE)))
    k.add_incoming(step(0), before)
    k.add_incoming(builder.add(k, step(LANES)), body)
    builder.branch(head)
    builder.position_at_end(done)
    return context.get_dummy_value()


def _splat(builder, x):
    vector = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), x, _INT(0))
    return builder.shuffle_vector(vector, vector, ir.Constant(ir.VectorType(_INT, LANES), [0] * LANES))


def _at(builder, base, index, kind):
    return builder.bitcast(builder.gep(base, [index]), kind.as_pointer())


def _load(builder, base, index, kind):
    numbers = builder.load(_at(builder, base, index, kind))
    numbers.align = 4 if kind is _VECTOR else 8
    return numbers


def _store(builder, base, index, value):
    builder.store(value, _at(builder, base, index, _WIDE)).align = 8
