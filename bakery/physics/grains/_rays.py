"""Sixteen rays on their way through a grid of cells, and one ray against eight triangles, in vector instructions.

The state of the rays is one float32 array (FIELDS, rays), some rows of which hold int32: a row below is that of the first of
three where it belongs to the axes.
"""

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from bakery.physics.vectors import bits, splat

RAYS, TRIANGLES = 16, 8
# float32, lengths in cells: where a ray starts, its direction and 1/direction, how far it goes at most, where it starts as seen
# from the middle of its cell, the shear that makes it the z axis, the nearest hit so far
ORIGIN, DIRECTION, INVERSE, LIMIT, SEEN, SHEAR, NEAREST = 0, 3, 6, 9, 10, 13, 15
# int32: cell, its number, where the leaps of the ray's octant begin, cells to leap over, what to do, axes in the order in which
# the shear takes them, the triangle that the ray starts on
CELL, INDEX, OCTANT, LEAP, STATE, AXES, SKIP = 16, 19, 20, 21, 22, 23, 26
FIELDS = 27
AT, MOVES, OUT, IDLE = range(4)  # a cell with triangles; empty ones; the grid's end or the hit; no ray

# Bytes of a block of triangles: int8 corners [axis][corner][triangle] as seen from the middle of the cell, then int32 names, -1
# where there is none, float32 units of the corners in a cell, float32 slack, int32 number of the cell's blocks that follow.
BLOCK, NAMES, UNITS, SLACK, MORE = 128, 72, 104, 108, 112
FULL = 128  # this bit of an entry of the leaps: the cell has triangles

_F4, _I8, _32, _64 = types.float32, types.int64, ir.IntType(32), ir.IntType(64)


def _data(context, builder, kind, array):
    return context.make_array(kind)(context, builder, array).data


class _Vectors:
    """Rows of the state for `width` rays from `at` on, and arithmetic, while code is being generated."""

    def __init__(self, builder, width, rows=None, stride=None, at=None):
        self.builder, self.width, self.rows, self.stride, self.first = builder, width, rows, stride, at
        self.float, self.int = ir.VectorType(ir.FloatType(), width), ir.VectorType(_32, width)

    def at(self, row, kind):
        index = self.builder.add(self.first, self.builder.mul(self.stride, ir.Constant(_64, row)))
        return self.builder.bitcast(self.builder.gep(self.rows, [index]), kind.as_pointer())

    def floats(self, row):
        return self.builder.load(self.at(row, self.float), align=4)

    def ints(self, row):
        return self.builder.load(self.at(row, self.int), align=4)

    def store(self, row, value):
        self.builder.store(value, self.at(row, value.type), align=4)

    def fill(self, scalar):
        return splat(self.builder, scalar, self.width)

    def number(self, value):
        kind = self.int if isinstance(value, int) else self.float
        return ir.Constant(kind, [value] * self.width)

    def _less(self, a, b):
        return self.builder.icmp_signed("<", a, b) if a.type == self.int else self.builder.fcmp_ordered("<", a, b)

    def smaller(self, a, b):
        return self.builder.select(self._less(a, b), a, b)

    def larger(self, a, b):
        return self.builder.select(self._less(b, a), a, b)


@intrinsic
def leap(typingctx, state, stride, at, leaps, nx, ny, nz):
    """One leap of those rays at ... at + 15 that move, from their cell to the first one that need not be empty.

    stride : rays in `state`;  leaps : (8 cells,) of each octant;  n* : cells along the axes
    """

    def codegen(context, builder, signature, args):
        b, kinds = builder, signature.args
        v = _Vectors(b, RAYS, _data(context, b, kinds[0], args[0]), args[1], args[2])
        table, count = _data(context, b, kinds[3], args[3]), [v.fill(b.trunc(n, _32)) for n in args[4:7]]
        zero, unit = v.number(0), v.number(1)
        before, far = v.ints(STATE), v.ints(LEAP)
        moves = b.icmp_signed("==", before, v.number(MOVES))
        origin, direction, over, cell, up, ahead, behind, time = [], [], [], [], [], [], [], []
        for axis in range(3):
            o, r, c = v.floats(ORIGIN + axis), v.floats(INVERSE + axis), v.ints(CELL + axis)
            positive, plus, minus = b.fcmp_ordered(">", r, v.number(0.0)), b.add(c, far), b.sub(c, far)
            wall = b.sitofp(b.select(positive, plus, b.add(minus, unit)), v.float)
            for row, value in zip((origin, direction, over, cell, up, ahead, behind, time), (
                    o, v.floats(DIRECTION + axis), r, c, positive, plus, minus, b.fmul(b.fsub(wall, o), r))):
                row.append(value)
        exit_ = v.smaller(v.smaller(time[0], time[1]), time[2])
        out = b.fcmp_unordered(">=", exit_, v.floats(LIMIT))
        moved = b.and_(moves, b.not_(out))
        through_x = b.fcmp_ordered("==", exit_, time[0])
        through_y = b.and_(b.fcmp_ordered("==", exit_, time[1]), b.not_(through_x))
        through = through_x, through_y, b.not_(b.or_(through_x, through_y))
        new = []
        for k in range(3):
            # rounding takes nobody out of the cells leapt over, nor out of the grid
            reached = b.fptosi(b.fadd(origin[k], b.fmul(exit_, direction[k])), v.int)
            low = b.select(up[k], cell[k], b.add(behind[k], unit))
            high = v.smaller(b.select(up[k], b.sub(ahead[k], unit), cell[k]), b.sub(count[k], unit))
            reached = v.smaller(v.larger(v.larger(reached, low), zero), high)
            reached = b.select(through[k], b.select(up[k], ahead[k], behind[k]), reached)
            new.append(b.select(moved, reached, cell[k]))
            v.store(CELL + k, new[k])
            v.store(SEEN + k, b.fsub(origin[k], b.fadd(b.sitofp(new[k], v.float), v.number(0.5))))
        index = b.add(b.mul(b.add(b.mul(new[2], count[1]), new[1]), count[0]), new[0])
        index = b.select(moved, index, v.ints(INDEX))  # rays that are not there stay inside the table
        v.store(INDEX, index)
        entry, reach = b.add(index, v.ints(OCTANT)), ir.Constant(ir.VectorType(ir.IntType(8), RAYS), [0] * RAYS)
        for k in range(RAYS):
            lane = ir.Constant(_32, k)
            reach = b.insert_element(reach, b.load(b.gep(table, [b.zext(b.extract_element(entry, lane), _64)])), lane)
        reach = b.zext(reach, v.int)
        v.store(LEAP, b.and_(reach, v.number(FULL - 1)))
        after = b.select(b.icmp_signed("<", reach, v.number(FULL)), v.number(MOVES), v.number(AT))
        v.store(STATE, b.select(moves, b.select(out, v.number(OUT), after), before))
        return context.get_dummy_value()

    return types.void(state, _I8, _I8, leaps, _I8, _I8, _I8), codegen


@intrinsic
def confirm(typingctx, state, stride, at, margin):
    """After the tests of a cell: rays whose nearest hit lies inside it are OUT, the others at a cell move on."""

    def codegen(context, builder, signature, args):
        b = builder
        v = _Vectors(b, RAYS, _data(context, b, signature.args[0], args[0]), args[1], args[2])
        before, nearest, margin, off = v.ints(STATE), v.floats(NEAREST), v.fill(args[3]), v.number(0.0)
        for axis in range(3):
            within = b.fadd(v.floats(SEEN + axis), b.fmul(nearest, v.floats(DIRECTION + axis)))
            off = v.larger(off, v.larger(within, b.fsub(v.number(0.0), within)))
        inside = b.fcmp_ordered("<", off, b.fsub(v.number(0.5), margin))
        at_cell = b.icmp_signed("==", before, v.number(AT))
        v.store(STATE, b.select(at_cell, b.select(inside, v.number(OUT), v.number(MOVES)), before))
        v.store(LIMIT, v.smaller(v.floats(LIMIT), b.fadd(nearest, margin)))
        return context.get_dummy_value()

    return types.void(state, _I8, _I8, _F4), codegen


@intrinsic
def those(typingctx, state, stride, at, action):
    """Bits of the rays at ... at + 15 whose STATE is `what`."""

    def codegen(context, builder, signature, args):
        b = builder
        v = _Vectors(b, RAYS, _data(context, b, signature.args[0], args[0]), args[1], args[2])
        return bits(b, b.icmp_signed("==", v.ints(STATE), v.fill(b.trunc(args[3], _32))))

    return _I8(state, _I8, _I8, _I8), codegen


@intrinsic
def passed(typingctx, state, stride, ray, blocks, block):
    """Bits of the block's triangles that the line of the ray may meet, the one that it starts on left out.

    No triangle that it does meet is missing: SLACK is more than what the rounding of corners to int8 moves an edge function.
    """

    def codegen(context, builder, signature, args):
        b, kinds = builder, signature.args
        base = b.gep(_data(context, b, kinds[3], args[3]), [b.mul(args[4], ir.Constant(_64, BLOCK))])
        ray = _Vectors(b, 1, _data(context, b, kinds[0], args[0]), args[1], args[2])
        v = _Vectors(b, TRIANGLES)

        def number(row, kind):
            return b.load(ray.at(row, kind))

        def of(at, kind):
            return b.load(b.bitcast(b.gep(base, [at]), kind.as_pointer()), align=1)

        axes = [b.sext(number(AXES + k, _32), _64) for k in range(3)]
        units = of(ir.Constant(_64, UNITS), ir.FloatType())
        slack = v.fill(of(ir.Constant(_64, SLACK), ir.FloatType()))
        shear = [v.fill(number(SHEAR + k, ir.FloatType())) for k in range(2)]
        start = []
        for axis in axes:
            index = b.add(args[2], b.mul(args[1], b.add(axis, ir.Constant(_64, SEEN))))
            start.append(v.fill(b.fmul(b.load(b.gep(ray.rows, [index])), units)))
        corner = []
        for k in range(3):
            x, y, z = (b.fsub(b.sitofp(b.sext(of(b.add(b.mul(axis, ir.Constant(_64, 3 * TRIANGLES)), ir.Constant(
                _64, k * TRIANGLES)), ir.VectorType(ir.IntType(8), TRIANGLES)), v.int), v.float), o)
                for axis, o in zip(axes, start))
            corner.append((b.fsub(x, b.fmul(shear[0], z)), b.fsub(y, b.fmul(shear[1], z))))

        def edge(p, q):
            return b.fsub(b.fmul(p[0], q[1]), b.fmul(p[1], q[0]))

        u, w, t = edge(corner[2], corner[1]), edge(corner[0], corner[2]), edge(corner[1], corner[0])
        low, high = v.smaller(v.smaller(u, w), t), v.larger(v.larger(u, w), t)
        inside = b.or_(b.fcmp_ordered(">=", low, b.fsub(v.number(0.0), slack)), b.fcmp_ordered("<=", high, slack))
        names = of(ir.Constant(_64, NAMES), v.int)
        exists = b.and_(b.icmp_signed(">=", names, v.number(0)), b.icmp_signed("!=", names, v.fill(number(SKIP, _32))))
        return bits(b, b.and_(inside, exists))

    return _I8(state, _I8, _I8, blocks, _I8), codegen
