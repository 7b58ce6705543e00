"""Eight boxes or four triangles against one ray, in vector instructions."""

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from bakery.physics.vectors import bits, load, splat, store

BOXES, TRIANGLES = 8, 4
NODE = 8 * BOXES  # float32 of a node: [lower x, y, z, upper x, y, z, child as int32, nothing][box]
BLOCK = 9 * TRIANGLES  # float64 of a block of triangles: [axis x, y, z][corner 0, 1, 2][triangle]


class _Lanes:
    """Loads, broadcasts and stores of vectors of one type while code is being generated."""

    def __init__(self, context, builder, scalar, width):
        self.context, self.builder, self.width = context, builder, width
        self.vector = ir.VectorType(scalar, width)

    def _data(self, kind, array):
        return self.context.make_array(kind)(self.context, self.builder, array).data

    def load(self, kind, array, index):
        return load(self.builder, self._data(kind, array), index, self.vector)

    def store(self, kind, array, index, value):
        store(self.builder, self._data(kind, array), index, value)

    def fill(self, scalar):
        return splat(self.builder, scalar, self.width)

    def number(self, value):
        return ir.Constant(self.vector, [float(value)] * self.width)

    def larger(self, a, b):
        return self.builder.select(self.builder.fcmp_ordered(">", a, b), a, b)

    def smaller(self, a, b):
        return self.builder.select(self.builder.fcmp_ordered("<", a, b), a, b)


_I8 = types.int64
_AXES, _SINGLE, _DOUBLE = (types.UniTuple(kind, 3) for kind in (types.int64, types.float32, types.float64))


def _three(builder, values):
    return [builder.extract_value(values, k) for k in range(3)]


@intrinsic
def boxes_hit(typingctx, nodes, at, near, start, over, limit, enter):
    """Bits of the node's boxes that the ray meets before `limit`; writes where it enters each to `enter` (8,).

    at : of the node in `nodes`;  near : of each axis 0 or 24, of the plane that comes first;  over : 1/direction
    """

    def codegen(context, builder, signature, args):
        kind, out_kind = signature.args[0], signature.args[-1]
        nodes, at, near, start, over, limit, enter = args
        near, start, over = (_three(builder, values) for values in (near, start, over))
        lanes = _Lanes(context, builder, ir.FloatType(), BOXES)
        first, last = lanes.number(0.0), lanes.fill(limit)
        opposite = ir.Constant(ir.IntType(64), 3 * BOXES)
        for axis in range(3):
            base = builder.add(at, ir.Constant(ir.IntType(64), BOXES * axis))
            o, r = lanes.fill(start[axis]), lanes.fill(over[axis])
            low = lanes.load(kind, nodes, builder.add(base, near[axis]))
            high = lanes.load(kind, nodes, builder.add(base, builder.sub(opposite, near[axis])))
            first = lanes.larger(builder.fmul(builder.fsub(low, o), r), first)
            last = lanes.smaller(builder.fmul(builder.fsub(high, o), r), last)
        lanes.store(out_kind, enter, ir.Constant(ir.IntType(64), 0), first)
        return bits(builder, builder.fcmp_ordered("<=", first, last))

    return _I8(nodes, _I8, _AXES, _SINGLE, _SINGLE, types.float32, enter), codegen


@intrinsic
def triangles_hit(typingctx, blocks, at, axes, start, shear, limit, distance):
    """Bits of the block's triangles that the ray meets at 0 < t < limit; writes t to `distance` (4,) if there is any.

    axes : the last one is that along which the ray runs fastest;  start : in that order;  shear : makes the ray the last axis.
    Watertight: a corner is projected alike for all its triangles, and rounding may make an edge function zero but never
    gives it the wrong sign; zero counts as inside.  Source: Woop, Benthin & Wald, J. Comput. Graph. Tech. 2 (2013), section 3.
    """

    def codegen(context, builder, signature, args):
        kind, out_kind = signature.args[0], signature.args[-1]
        blocks, at, axes, start, shear, limit, distance = args
        axes, start, shear = (_three(builder, values) for values in (axes, start, shear))
        lanes = _Lanes(context, builder, ir.DoubleType(), TRIANGLES)
        o, s = [lanes.fill(v) for v in start], [lanes.fill(v) for v in shear]
        corner = []
        for number in range(3):
            x, y, z = (builder.fsub(lanes.load(kind, blocks, builder.add(at, builder.add(
                builder.mul(axes[k], ir.Constant(ir.IntType(64), 3 * TRIANGLES)),
                ir.Constant(ir.IntType(64), number * TRIANGLES)))), o[k]) for k in range(3))
            corner.append((builder.fsub(x, builder.fmul(s[0], z)), builder.fsub(y, builder.fmul(s[1], z)), z))

        def edge(p, q):
            return builder.fsub(builder.fmul(p[0], q[1]), builder.fmul(p[1], q[0]))

        a, b, c = corner
        u, v, w = edge(c, b), edge(a, c), edge(b, a)
        zero = lanes.number(0.0)

        def all_of(sign):
            return builder.and_(builder.and_(builder.fcmp_ordered(sign, u, zero), builder.fcmp_ordered(sign, v, zero)),
                                builder.fcmp_ordered(sign, w, zero))

        inside = builder.or_(all_of(">="), all_of("<="))
        result = cgutils.alloca_once_value(builder, ir.Constant(ir.IntType(64), 0))
        with builder.if_then(builder.icmp_unsigned("!=", bits(builder, inside), ir.Constant(ir.IntType(64), 0)), likely=False):
            det = builder.fadd(builder.fadd(u, v), w)
            along = builder.fadd(builder.fadd(builder.fmul(u, a[2]), builder.fmul(v, b[2])), builder.fmul(w, c[2]))
            t = builder.fdiv(builder.fmul(s[2], along), det)  # 0/0 of a triangle without area compares as false below
            good = builder.and_(builder.fcmp_ordered(">", t, zero), builder.fcmp_ordered("<", t, lanes.fill(limit)))
            lanes.store(out_kind, distance, ir.Constant(ir.IntType(64), 0), t)
            builder.store(bits(builder, builder.and_(good, inside)), result)
        return builder.load(result)

    return _I8(blocks, _I8, _AXES, _DOUBLE, _DOUBLE, types.float64, distance), codegen


@intrinsic
def fetch(typingctx, array, at, lines):
    """Ask for `lines` cache lines of 64 bytes from array[at] on, without waiting; lines is a constant."""
    count = lines.literal_value if isinstance(lines, types.IntegerLiteral) else None
    if count is None:
        return None

    def codegen(context, builder, signature, args):
        kind = signature.args[0]
        data = context.make_array(kind)(context, builder, args[0]).data
        byte = builder.bitcast(builder.gep(data, [args[1]]), ir.IntType(8).as_pointer())
        flags, name = [ir.IntType(32)] * 3, "llvm.prefetch.p0i8"
        function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(ir.VoidType(), [byte.type, *flags]), name)
        for line in range(count):
            address = builder.gep(byte, [ir.Constant(ir.IntType(64), 64 * line)])
            builder.call(function, [address, *(ir.Constant(ir.IntType(32), flag) for flag in (0, 3, 1))])
        return context.get_dummy_value()

    return types.void(array, _I8, lines), codegen
