"""Four channels at once, in the compiler's own vectors: numba makes single numbers of a loop over them (22 ns a block, not 6)."""

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

LANES = 4
_FLOATS, _DOUBLES = (ir.VectorType(kind(), LANES) for kind in (ir.FloatType, ir.DoubleType))


@intrinsic
def add_light(typingctx, sums, at, profile, node, fraction, weight, light, source):
    """sums[at:at + 8] += weight * share * light[source:source + 8], share (4 channels, twice) the profile between two nodes.

    sums, light : C-contiguous float64, any number of axes; `at` and `source` count numbers
    profile : C-contiguous float32, (nodes, 4);  node + fraction, where on it;  weight : float32
    """
    i, f = types.intp, types.float32
    return types.void(sums, i, profile, i, f, f, light, i), _add_light


@intrinsic
def add_share(typingctx, sums, at, profile, node, fraction, weight):
    """sums[at:at + 4] += weight * share."""
    i, f = types.intp, types.float32
    return types.void(sums, i, profile, i, f, f), _add_share


def _add_light(context, builder, signature, args):
    sums, at, profile, node, fraction, weight, light, source = args
    share = _share(context, builder, signature, profile, node, fraction, weight)
    for n in (0, LANES):
        pointer = _pointer(context, builder, signature.args[6], light, builder.add(source, source.type(n)), _DOUBLES)
        brought = _fma(builder, share, builder.load(pointer, align=8))
        _add(context, builder, signature.args[0], sums, builder.add(at, at.type(n)), brought)
    return context.get_dummy_value()


def _add_share(context, builder, signature, args):
    sums, at, profile, node, fraction, weight = args
    share = _share(context, builder, signature, profile, node, fraction, weight)
    _add(context, builder, signature.args[0], sums, at, lambda total: builder.fadd(total, share))
    return context.get_dummy_value()


def _share(context, builder, signature, profile, node, fraction, weight):
    """weight * (profile[node] + fraction * (profile[node + 1] - profile[node])), in double precision."""
    first = builder.mul(node, node.type(LANES))
    kind = signature.args[2]
    pointers = (_pointer(context, builder, kind, profile, builder.add(first, first.type(n)), _FLOATS) for n in (0, LANES))
    below, above = (builder.load(pointer, align=4) for pointer in pointers)
    mixed = _fma(builder, _fill(builder, fraction), builder.fsub(above, below))(below)
    return builder.fpext(builder.fmul(_fill(builder, weight), mixed), _DOUBLES)


def _add(context, builder, kind, sums, at, added):
    pointer = _pointer(context, builder, kind, sums, at, _DOUBLES)
    builder.store(added(builder.load(pointer, align=8)), pointer, align=8)


def _pointer(context, builder, kind, array, index, vector):
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())


def _fill(builder, number):
    lane = builder.insert_element(ir.Constant(_FLOATS, ir.Undefined), number, ir.IntType(32)(0))
    return builder.shuffle_vector(lane, lane, ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES))


def _fma(builder, a, b):
    """total -> total + a b."""
    bits = 32 if a.type == _FLOATS else 64
    kind = ir.FunctionType(a.type, [a.type] * 3)
    function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.fmuladd.v{LANES}f{bits}")
    return lambda total: builder.call(function, [a, b, total])
