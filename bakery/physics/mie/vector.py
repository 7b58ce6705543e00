"""Vector instructions for numba kernels, written as formulas.

numba leaves the choice of vector instructions to the compiler, which gives up on loops over many arrays (it cannot see that
they are distinct).  Inside an `@intrinsic`, a formula over `Wide` values becomes exactly one instruction an operator, for any
number of lanes, and the fused multiply-add is the correctly rounded one on every machine: hardware where there is one, the
C library elsewhere.  So the bits do not depend on the kind of processor.
"""

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from bakery.physics.vectors import fused, splat


@intrinsic
def fma(typingctx, a, b, c):
    """a*b + c, rounded once."""

    def codegen(context, builder, signature, args):
        return builder.fma(*args)

    return types.float64(types.float64, types.float64, types.float64), codegen


class Wide:
    """A vector of doubles while code is being generated: each operator emits one instruction for all lanes."""

    def __init__(self, builder, value):
        self.builder, self.value = builder, value

    def like(self, value):
        """A number, or a scalar instruction's value, in every lane."""
        if isinstance(value, Wide):
            return value.value
        width = self.value.type.count
        if not isinstance(value, ir.Value):
            return ir.Constant(self.value.type, [float(value)] * width)
        return splat(self.builder, value, width)

    def fill(self, value):
        return Wide(self.builder, self.like(value))

    def __add__(self, value):
        return Wide(self.builder, self.builder.fadd(self.value, self.like(value)))

    def __sub__(self, value):
        return Wide(self.builder, self.builder.fsub(self.value, self.like(value)))

    def __mul__(self, value):
        return Wide(self.builder, self.builder.fmul(self.value, self.like(value)))

    def __truediv__(self, value):
        return Wide(self.builder, self.builder.fdiv(self.value, self.like(value)))

    def __neg__(self):
        return Wide(self.builder, self.builder.fneg(self.value))

    def inverse(self):
        return Wide(self.builder, self.builder.fdiv(self.like(1.0), self.value))

    def sqrt(self):
        kind = self.value.type
        root = cgutils.get_or_insert_function(self.builder.module, ir.FunctionType(kind, [kind]), f"llvm.sqrt.v{kind.count}f64")
        return Wide(self.builder, self.builder.call(root, [self.value]))

    def times_plus(self, factor, term):
        """self * factor + term, rounded once."""
        return Wide(self.builder, fused(self.builder, self.value, self.like(factor), self.like(term)))

    def where(self, sign, bound, value):
        """Lanes of self where `bound[0] sign bound[1]` holds, of other elsewhere."""
        condition = self.builder.fcmp_ordered(sign, self.like(bound[0]), self.like(bound[1]))
        return Wide(self.builder, self.builder.select(condition, self.value, self.like(value)))


class Memory:
    """Rows of `width` doubles behind a numba array; of `columns` (first, count) of them, where given."""

    def __init__(self, context, builder, kind, array, width, columns=None):
        self.builder, self.width = builder, width
        self.first, count = columns or (0, width)
        self.vector = ir.VectorType(ir.DoubleType(), count)
        self.data = context.make_array(kind)(context, builder, array).data

    def _at(self, row):
        index = row if isinstance(row, ir.Value) else ir.Constant(ir.IntType(64), row)
        first = self.builder.mul(index, ir.Constant(ir.IntType(64), self.width))
        if self.first:
            first = self.builder.add(first, ir.Constant(ir.IntType(64), self.first))
        return self.builder.bitcast(self.builder.gep(self.data, [first]), self.vector.as_pointer())

    def __getitem__(self, row):
        return Wide(self.builder, self.builder.load(self._at(row), align=8))

    def scalar(self, row):
        """The first double of a row, which `Wide.fill` takes."""
        return self.builder.extract_element(self[row].value, ir.Constant(ir.IntType(32), 0))

    def __setitem__(self, row, value):
        self.builder.store(value.like(value), self._at(row), align=8)


class Registers:
    """Named vectors that live through a loop."""

    def __init__(self, builder, **start):
        self.__dict__["builder"] = builder
        self.__dict__["slots"] = {name: cgutils.alloca_once_value(builder, value.value) for name, value in start.items()}

    def __getattr__(self, name):
        return Wide(self.builder, self.builder.load(self.slots[name]))

    def __setattr__(self, name, value):
        self.builder.store(value.value, self.slots[name])


def integer(value):
    """An index constant."""
    return ir.Constant(ir.IntType(64), value)


def align_stack(builder):
    """Have the stack of a function begin at a line of the cache.

    The compiler knows no better than 16 bytes, and vectors of 64 that it keeps there for want of registers then cross two lines:
    reading what was just written waits for both.
    """
    line = cgutils.alloca_once(builder, ir.ArrayType(ir.DoubleType(), 8))
    line.align = 64
    builder.asm(ir.FunctionType(ir.VoidType(), [line.type]), "", "r", [line], True)
