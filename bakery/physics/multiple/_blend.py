"""The sum over the functions of a table, eight at a time: sum over k of (sum over 16 corners of a_k) (sum over 4 of B_k).

Written in the compiler's own vectors: of the loop in Python numba makes single numbers or gathers (120 ns against 30 with 16
functions).  The order of the sums is fixed, so it does not depend on how wide the processor's vectors are.
"""

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from bakery.physics.vectors import load, loop, splat

LANES = 8  # float32; arrays are padded with zeros to a multiple of it.  16 is slower on processors that have them

_VECTOR = ir.VectorType(ir.FloatType(), LANES)
_INT = ir.IntType(32)


@intrinsic
def combine(typingctx, coefficient, basis, shift, ring, count, weights):
    """a_0 + B_0 + sum over k of a_k B_k, float32, of a_k that are known: arguments as those of `blend`.

    coefficient : (count,) float32, C-contiguous
    weights : f
    """
    return types.float32(coefficient, basis, *[types.intp] * 3, weights), _code_of_one


@intrinsic
def blend(typingctx, grid, at, row, basis, shift, ring, count, weights):
    """a_0 + B_0 + sum over k of a_k B_k, float32.

    grid, basis : C-contiguous float32, a_k and B_k with k along the last axis
    at, shift : of the first corner, counted in numbers; row, ring : from one corner to the next along the first axis
    count : of k, padded, also from one corner to the next along the second axis
    weights : p, w, f, four float32 each: along the first and the second axis of the grid; and in the basis here, next along the
        second axis, along the first, along both
    """
    indices = [types.intp] * 5
    signature = types.float32(grid, *indices[:2], basis, *indices[2:], weights)
    return signature, _code


def _code(context, builder, signature, args):
    grid, at, row, basis, shift, ring, count, weights = args
    grid, basis = (context.make_array(signature.args[n])(context, builder, args[n]).data for n in (0, 3))
    p, w, f = ([splat(builder, builder.extract_value(weights, [n, k]), LANES) for k in range(4)] for n in range(3))

    def factors(k):
        rows = _corners(builder, grid, builder.add(at, k), (row, count), 4)
        return (_weighted(builder, p, [_weighted(builder, w, four) for four in rows]),
                _function(builder, basis, builder.add(shift, k), (ring, count), f))

    return _total(builder, factors, count)


def _code_of_one(context, builder, signature, args):
    coefficient, basis, shift, ring, count, weights = args
    coefficient, basis = (context.make_array(signature.args[n])(context, builder, args[n]).data for n in (0, 1))
    f = [splat(builder, builder.extract_value(weights, k), LANES) for k in range(4)]
    return _total(builder, lambda k: (load(builder, coefficient, k, _VECTOR),
                                      _function(builder, basis, builder.add(shift, k), (ring, count), f)), count)


def _weighted(builder, weights, numbers):
    pairs = [_fma(builder, weights[n + 1], numbers[n + 1], builder.fmul(weights[n], numbers[n])) for n in (0, 2)]
    return builder.fadd(*pairs)


def _corners(builder, base, first, strides, across):
    """The numbers of `across` by `across` corners, `strides` apart along both axes."""
    step = first.type
    return [[load(builder, base, builder.add(builder.add(first, builder.mul(strides[0], step(n))),
                                             builder.mul(strides[1], step(m))), _VECTOR) for m in range(across)]
            for n in range(across)]


def _function(builder, basis, first, strides, f):
    (b0, b1), (b2, b3) = _corners(builder, basis, first, strides, 2)
    return _weighted(builder, f, [b0, b1, b2, b3])


def _total(builder, factors, count):
    """a_0 + B_0 + the sum of a_k B_k, of `factors` (k) -> eight of each."""
    step = count.type
    # k = 0 is added, the others are multiplied
    a, b = factors(step(0))
    zeroth = ir.Constant(ir.VectorType(ir.IntType(1), LANES), [1] + [0] * (LANES - 1))
    start = builder.select(zeroth, builder.fadd(a, b), builder.fmul(a, b))

    def turn(k, total):
        return [_fma(builder, *factors(k), total)]

    (total,) = loop(builder, step(LANES), count, LANES, turn, [start])
    return _sum(builder, total)


def _fma(builder, x, y, z):
    kind = ir.FunctionType(_VECTOR, [_VECTOR] * 3)
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.fmuladd.v{LANES}f32"), [x, y, z])


def _sum(builder, numbers):
    half = LANES
    while half > 1:
        half //= 2
        turned = ir.Constant(ir.VectorType(_INT, LANES), [(n + half) % LANES for n in range(LANES)])
        numbers = builder.fadd(numbers, builder.shuffle_vector(numbers, numbers, turned))
    return builder.extract_element(numbers, _INT(0))
