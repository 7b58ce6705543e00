"""From a Legendre series to the Fourier series of the same function of theta, in a time that grows like the number of orders.

With sum h_n P_n(cos theta) = sum_k e_k g_k cos(k theta), e_0 = 1 and else 2,

    g_k = sum_{n >= k, n - k even} h_n l((n-k)/2) l((n+k)/2),      l(s) = Gamma(s + 1/2)/(sqrt(pi) Gamma(s + 1)).

Orders of one parity, n = 2i + parity, lie in boxes of LEAF.  Boxes fewer than APART apart are summed as they stand.  Otherwise
the product of the two l is a polynomial in n and in k: a tree of boxes with NODES Chebyshev nodes each, the fast multipole
method in one dimension (Alpert & Rokhlin, SIAM J. Sci. Stat. Comput. 12, 158 (1991)).  The nodes, in n/2, are those of both
parities.  Sums are those written here, in this order, and what a radius adds does not depend on those beside it.
"""

from functools import cache

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from bakery.physics.mie.vector import Memory, Wide, integer
from bakery.system.compiled import njit

STRICT = dict(cache=True, nogil=True, error_model="numpy")
NODES = 16  # Chebyshev nodes of a box, and targets side by side; boxes APART leave 9.9^-16
LEAF = 32  # orders of one parity in a smallest box: the direct sums then take as long as the tree
APART = 3
SERIES = 4 * NODES  # values of one parity at the nodes of a box: Re a, Im a, Re b, Im b
REMOTE = 32  # boxes from the origin to a pair, from where on l is its Taylor series of degree TAYLOR: 1e-16
TAYLOR = 10
LONG = np.longdouble  # 64 bits of mantissa on x86, else a double: tables good to 1e-16 or to 1e-15
LONG_PI = LONG(np.pi) + LONG(1.2246467991473532e-16)


def _at(memory, row, width):
    """Vector of `width` doubles that begins at a double of a `Memory` of width 1."""
    return memory.builder.bitcast(memory.builder.gep(memory.data, [row]), ir.VectorType(ir.DoubleType(), width).as_pointer())


def load(memory, row, width=NODES):
    """`width` doubles from any double on."""
    return Wide(memory.builder, memory.builder.load(_at(memory, row, width), align=8))


def store(memory, row, value):
    """As `load`."""
    memory.builder.store(value.value, _at(memory, row, value.value.type.count), align=8)


def memories(context, builder, signature, args, arrays):
    """Those arguments of an intrinsic that are `arrays`, as doubles."""
    return [Memory(context, builder, signature.args[k], args[k], 1) for k in arrays]


@intrinsic
def _accumulate(typingctx, kernel, rows, source, first, stride, out, at, pitch):
    """out[at + s pitch + c] += sum_r kernel[r, c] source[first + s stride + r] for s = 0 .. 3, c < NODES."""

    def codegen(context, builder, signature, args):
        matrix, values, sums = memories(context, builder, signature, args, (0, 2, 5))
        starts = [builder.add(args[3], builder.mul(args[4], integer(s))) for s in range(4)]
        ends = [builder.add(args[6], builder.mul(args[7], integer(s))) for s in range(4)]
        slots = [cgutils.alloca_once_value(builder, load(sums, end).value) for end in ends]
        with cgutils.for_range(builder, args[1]) as loop:
            row = load(matrix, builder.mul(loop.index, integer(NODES)))
            for slot, start in zip(slots, starts):
                value = values.scalar(builder.add(start, loop.index))
                builder.store(row.times_plus(value, Wide(builder, builder.load(slot))).value, slot)
        for slot, end in zip(slots, ends):
            store(sums, end, Wide(builder, builder.load(slot)))
        return context.get_dummy_value()

    number = types.intp
    return types.void(kernel, number, source, number, number, out, number, number), codegen


@intrinsic
def _near_kernel(typingctx, toeplitz, table, first, rows, out):
    """out[r, c] = toeplitz[r, c] table[first + r + c]."""

    def codegen(context, builder, signature, args):
        fixed, values, result = memories(context, builder, signature, args, (0, 1, 4))
        with cgutils.for_range(builder, args[3]) as loop:
            row = builder.mul(loop.index, integer(NODES))
            store(result, row, load(fixed, row) * load(values, builder.add(args[2], loop.index)))
        return context.get_dummy_value()

    return types.void(toeplitz, table, types.intp, types.intp, out), codegen


def _replacement(kept):
    """Code of series[at + s pitch + c] = sum_r toeplitz[r, c] table[first + r + c] series[at + s pitch + r]; of the product of
    the first two if it is `kept` by `_near_kernel` for several radii.
    """
    @intrinsic
    def replace(typingctx, toeplitz, table, first, rows, series, at, pitch):
        def codegen(context, builder, signature, args):
            fixed, values, flat = memories(context, builder, signature, args, (0, 1, 4))
            starts = [builder.add(args[5], builder.mul(args[6], integer(s))) for s in range(4)]
            zero = load(flat, starts[0]).fill(0.0)
            slots = [cgutils.alloca_once_value(builder, zero.value) for _ in starts]
            with cgutils.for_range(builder, args[3]) as loop:
                row = load(fixed, builder.mul(loop.index, integer(NODES)))
                if not kept:
                    row = row * load(values, builder.add(args[2], loop.index))
                for slot, start in zip(slots, starts):
                    value = flat.scalar(builder.add(start, loop.index))
                    builder.store(row.times_plus(value, Wide(builder, builder.load(slot))).value, slot)
            for slot, start in zip(slots, starts):
                store(flat, start, Wide(builder, builder.load(slot)))
            return context.get_dummy_value()

        number = types.intp
        return types.void(toeplitz, table, number, number, series, number, number), codegen

    return replace


_replace, _replace_by_kept = _replacement(False), _replacement(True)


def _wide_ratio(s):
    """l(s) of s >= 24, see `_ratio`."""
    inverse = (s + 0.25).inverse()
    y = inverse * inverse
    series = y.times_plus(_SERIES[4], y.fill(_SERIES[3]))
    for factor in (_SERIES[2], _SERIES[1], _SERIES[0]):
        series = y.times_plus(series, y.fill(factor))
    return inverse.sqrt() * series


_SERIES = tuple(np.array([1.0, -1 / 64, 21 / 8192, -671 / 524288, 180323 / 134217728]) / np.sqrt(np.pi))


@intrinsic
def _far_kernel(typingctx, toeplitz, nodes, centre, half, out):
    """out[b, a] = toeplitz[b, a] l(centre + half (nodes[a] + nodes[b]))."""

    def codegen(context, builder, signature, args):
        fixed, points, result = memories(context, builder, signature, args, (0, 1, 4))
        of_targets = load(points, integer(0)) * args[3] + args[2]
        with cgutils.for_range(builder, integer(NODES)) as loop:
            row = builder.mul(loop.index, integer(NODES))
            shift = of_targets.fill(points.scalar(loop.index)) * args[3]
            store(result, row, load(fixed, row) * _wide_ratio(of_targets + shift))
        return context.get_dummy_value()

    return types.void(toeplitz, nodes, types.float64, types.float64, out), codegen


@intrinsic
def _remote_kernel(typingctx, toeplitz, nodes, taylor, step, out):
    """As `_far_kernel`, from the Taylor series of l in step (nodes[a] + nodes[b])."""

    def codegen(context, builder, signature, args):
        fixed, points, factors, result = memories(context, builder, signature, args, (0, 1, 2, 4))
        of_targets = load(points, integer(0)) * args[3]
        values = [of_targets.fill(factors.scalar(integer(k))) for k in range(TAYLOR + 1)]
        with cgutils.for_range(builder, integer(NODES)) as loop:
            row = builder.mul(loop.index, integer(NODES))
            z = of_targets + of_targets.fill(points.scalar(loop.index)) * args[3]
            value = z.times_plus(values[TAYLOR], values[TAYLOR - 1])
            for k in range(TAYLOR - 2, -1, -1):
                value = z.times_plus(value, values[k])
            store(result, row, load(fixed, row) * value)
        return context.get_dummy_value()

    return types.void(toeplitz, nodes, taylor, types.float64, out), codegen


@njit(**STRICT)
def _taylor(centre, out):
    """Series in z of l at s + 1/4 = (1 + z) (centre + 1/4), which it returns."""
    u = centre + 0.25
    y = 1.0 / (u * u)
    a = np.sqrt(1.0 / u)
    b, c = a * y * _SERIES[1], a * y * y * _SERIES[2]
    a *= _SERIES[0]
    for k in range(TAYLOR + 1):
        out[k] = a + (b + c)
        a *= -(0.5 + k) / (k + 1.0)
        b *= -(2.5 + k) / (k + 1.0)
        c *= -(4.5 + k) / (k + 1.0)
    return u


@njit(**STRICT)
def _ratio(s):
    """l(s) of s >= 24: its series in 1/(s + 1/4)^2 is good to 1e-16 there."""
    y = 1.0 / (s + 0.25)
    w = y * y
    return np.sqrt(y) * (_SERIES[0] + w * (_SERIES[1] + w * (_SERIES[2] + w * (_SERIES[3] + w * _SERIES[4]))))


@njit(**STRICT)
def ratios(count):
    """l(s) of s = 0 .. count - 1."""
    table = np.empty(count)
    value = 1.0
    for s in range(min(24, count)):
        table[s] = value
        value *= (s + 0.5) / (s + 1.0)
    for s in range(24, count):
        table[s] = _ratio(float(s))
    return table


@cache
def box_tables():
    """Of one box: Chebyshev nodes; Lagrange polynomials at its points of either parity (2, LEAF, NODES) and, turned, by NODES
    targets (2, LEAF/NODES, NODES, NODES); at the nodes of its two halves (2, NODES, NODES), and turned.
    """
    order = np.arange(NODES)
    angle = LONG_PI * (order + LONG(0.5)) / NODES
    nodes = np.cos(angle)

    def lagrange(t):
        terms = np.cos(np.outer(np.arccos(t), order))
        terms[:, 0] /= 2
        return (terms @ np.cos(np.outer(order, angle)) * 2 / NODES).astype(float)

    # in units of i the box is -1/4 .. LEAF - 1/4: even orders stand at i, odd ones at i + 1/2
    points = np.stack([lagrange((np.arange(LEAF) + LONG(offset)) * 2 / LEAF - 1) for offset in (0.25, 0.75)])
    halves = np.stack([lagrange((nodes - 1) / 2), lagrange((nodes + 1) / 2)])
    turned = np.ascontiguousarray(points.reshape(2, -1, NODES, NODES).transpose(0, 1, 3, 2))
    return nodes.astype(float), points, turned, halves, np.ascontiguousarray(halves.transpose(0, 2, 1))


@njit(**STRICT)
def _near(h, parity, table, last):
    """Boxes fewer than APART apart, in place: targets ascend, and take sources from their own order on."""
    radii, size = h.shape[0], h.shape[3]
    series = h.reshape(-1)
    toeplitz, kernel = np.zeros((APART * LEAF, NODES)), np.empty((APART * LEAF, NODES))
    for r in range(APART * LEAF):
        for c in range(min(r + 1, NODES)):
            toeplitz[r, c] = table[r - c]
    for j in range(0, size, NODES):
        end = min((j // LEAF + APART) * LEAF, size)
        if radii > 1:
            _near_kernel(toeplitz, table, 2 * j + parity, end - j, kernel)
        for q in range(radii):
            rows, at = min(end, last[q] // 2 + 1) - j, (8 * q + parity) * size + j
            if rows > 0 and radii > 1:
                _replace_by_kept(kernel, table, 0, rows, series, at, 2 * size)
            elif rows > 0:
                _replace(toeplitz, table, 2 * j + parity, rows, series, at, 2 * size)


@njit(**STRICT)
def _gather_moments(h, tables, starts, moments):
    """Sources of every box, moved to its nodes."""
    _, points, _, halves, _ = tables
    radii, size, total = h.shape[0], h.shape[3], moments.shape[1]
    source, flat = h.reshape(-1), moments.reshape(-1)
    for q in range(radii):
        for box in range(starts[1]):
            for parity in range(2):
                _accumulate(points[parity], LEAF, source, (8 * q + parity) * size + box * LEAF, 2 * size,
                            flat, ((q * total + box) * 2 + parity) * SERIES, NODES)
        for level in range(1, starts.shape[0] - 1):
            for box in range(starts[level] - starts[level - 1]):
                child, parent = starts[level - 1] + box, starts[level] + box // 2
                _move(halves[box % 2], flat, q * total + child, flat, q * total + parent)


@njit(**STRICT)
def _move(kernel, source, source_box, target, target_box):
    """From the nodes of a box to those of another, both parities."""
    for parity in range(2):
        _accumulate(kernel, NODES, source, (2 * source_box + parity) * SERIES, NODES,
                    target, (2 * target_box + parity) * SERIES, NODES)


@njit(**STRICT)
def _exchange(nodes, starts, moments, fields):
    """From the nodes of every box to those of boxes at least APART away that their parents have not served."""
    radii, total = moments.shape[0], moments.shape[1]
    source, target = moments.reshape(-1), fields.reshape(-1)
    toeplitz, kernel, taylor = np.empty((APART, NODES, NODES)), np.empty((NODES, NODES)), np.empty(TAYLOR + 1)
    for level in range(starts.shape[0] - 1):
        width, count = float(LEAF << level), starts[level + 1] - starts[level]
        for o in range(APART):
            for b in range(NODES):
                for a in range(NODES):
                    toeplitz[o, b, a] = _ratio(width * (o + APART + 0.5 * (nodes[b] - nodes[a])))
        for box in range(count):
            for source_box in range(box + APART, min(2 * (box // 2) + 2 * APART, count)):
                centre, fixed = width * (box + source_box + 1.0) - 0.5, toeplitz[source_box - box - APART]
                if box + source_box >= REMOTE:
                    _remote_kernel(fixed, nodes, taylor, 0.5 * width / _taylor(centre, taylor), kernel)
                else:
                    _far_kernel(fixed, nodes, centre, 0.5 * width, kernel)
                for q in range(radii):
                    _move(kernel, source, q * total + starts[level] + source_box, target, q * total + starts[level] + box)


@njit(**STRICT)
def _scatter_fields(g, tables, starts, fields):
    """From the nodes of every box to its targets."""
    _, _, turned, _, halves = tables
    radii, size, total = g.shape[0], g.shape[3], fields.shape[1]
    flat, target = fields.reshape(-1), g.reshape(-1)
    for q in range(radii):
        for level in range(starts.shape[0] - 3, -1, -1):
            for box in range(starts[level + 1] - starts[level]):
                child, parent = starts[level] + box, starts[level + 1] + box // 2
                _move(halves[box % 2], flat, q * total + parent, flat, q * total + child)
        for parity in range(2):
            for j in range(0, size, NODES):
                box = q * total + j // LEAF
                _accumulate(turned[parity, j % LEAF // NODES], NODES, flat, (2 * box + parity) * SERIES, NODES, target,
                            (8 * q + parity) * size + j, 2 * size)


@njit(**STRICT)
def levels(size):
    """Where the boxes of each level begin, LEAF orders of one parity at first, and the number of all."""
    starts, count = [0], size // LEAF
    while count > APART:
        starts.append(starts[-1] + count)
        count = (count + 1) // 2
    return np.array(starts)


@njit(**STRICT)
def legendre_to_fourier(h, last, table, tables, tree):
    """h (R, 4, 2, size), of R radii four series of two parities, becomes g_j = sum_{i >= j} h_i l(i - j) l(i + j + parity).

    size is a multiple of LEAF; last (R,) the largest order of each radius; table at least `ratios` (2 size + (APART + 1) LEAF);
    tree (2, R, levels(size)[-1], 8, NODES) is zero.
    """
    starts = levels(h.shape[3])
    if starts.shape[0] > 1:
        _gather_moments(h, tables, starts, tree[0])
    for parity in range(2):
        _near(h, parity, table, last)
    if starts.shape[0] > 1:
        _exchange(tables[0], starts, tree[0], tree[1])
        _scatter_fields(h, tables, starts, tree[1])
