"""Vectors in the code of intrinsics, where the compiler makes single numbers, or gathers, of loops in Python."""

from collections.abc import Callable, Sequence

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

_INT, _LONG = ir.IntType(32), ir.IntType(64)


@intrinsic
def lowest(typingctx, bits):
    """Number of the lowest bit that is set; bits is not 0."""

    def code(context, builder, signature, args):
        return builder.cttz(args[0], ir.IntType(1)(1))

    return types.int64(types.int64), code


def splat(builder, number, lanes: int):
    """A number in every lane."""
    lane = builder.insert_element(ir.Constant(ir.VectorType(number.type, lanes), ir.Undefined), number, _INT(0))
    return builder.shuffle_vector(lane, lane, ir.Constant(ir.VectorType(_INT, lanes), [0] * lanes))


def at(builder, base, index, vector):
    """Where the vector stands whose first number is base[index]."""
    return builder.bitcast(builder.gep(base, [index]), vector.as_pointer())


def load(builder, base, index, vector):
    """The numbers from base[index] on, aligned as one of them is."""
    return builder.load(at(builder, base, index, vector), align=_bytes(vector))


def store(builder, base, index, value) -> None:
    """Numbers to base[index] and what follows."""
    builder.store(value, at(builder, base, index, value.type), align=_bytes(value.type))


def fused(builder, x, y, z):
    """x y + z, rounded once on any processor."""
    name = f"llvm.fma.v{x.type.count}f{8 * _bytes(x.type)}"
    return builder.call(cgutils.get_or_insert_function(builder.module, ir.FunctionType(x.type, [x.type] * 3), name), [x, y, z])


def bits(builder, flags):
    """Flags of lanes as the bits of a number."""
    return builder.zext(builder.bitcast(flags, ir.IntType(flags.type.count)), _LONG)


def loop(builder, first, after, stride: int, body: Callable, carried: Sequence = ()) -> list:
    """A loop over numbers from `first` below `after`; body(number, *carried) emits a turn and says what is carried on from it.

    Returns values : what is carried after the last turn
    """
    before = builder.block
    head, inside, done = (builder.append_basic_block(name) for name in ("loop", "loop.turn", "loop.done"))
    builder.branch(head)
    builder.position_at_end(head)
    n, values = builder.phi(first.type), [builder.phi(value.type) for value in carried]
    builder.cbranch(builder.icmp_signed("<", n, after), inside, done)
    builder.position_at_end(inside)
    carried_on = body(n, *values) or ()
    for phi, entry, again in zip((n, *values), (first, *carried), (builder.add(n, first.type(stride)), *carried_on), strict=True):
        phi.add_incoming(entry, before)
        phi.add_incoming(again, builder.block)
    builder.branch(head)
    builder.position_at_end(done)
    return values


def _bytes(vector) -> int:
    return 8 if isinstance(vector.element, ir.DoubleType) else 4
