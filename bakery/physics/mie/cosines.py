"""Cosine series of large spheres on a grid: a fast Fourier transform in vectors of 16 doubles, in pieces that stay in the cache.

Wanted are y_g = c_0 + 2 sum_k c_k cos(pi k (2g + 1)/(2N)), g = 0 .. N-1, of complex c_k with c_k = 0 from k = N/2 on.  With
(Makhoul, IEEE Trans. Acoust. Speech Signal Process. 28, 27 (1980))

    V_k = exp(i pi k/(2N)) (c_k - i c_{N-k}),      v_n = sum_k V_k exp(2 pi i k n/N),      y_{2n} = v_n,   y_{2N-1-2n} = v_n,

one complex transform does both parts of c.  N = N1 N2, both near its root, k = k1 N2 + k2 and n = n1 + N1 n2: transforms over
k1, factors exp(2 pi i k2 (n1 + 1/4)/N), transforms over k2.  A row is S1 and S2 of one k; four rows side by side are a vector.
Passes of radix 4, 5 and 2 go to and fro between two buffers of such vectors (Stockham), in natural order.
"""

from functools import lru_cache

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from bakery.physics.mie.legendre import LONG, LONG_PI, STRICT, load, memories, store
from bakery.physics.mie.vector import Wide, integer
from bakery.system.compiled import njit

SIDE = 4  # rows of a vector
ROW = 4  # doubles of a row: Re S1, Im S1, Re S2, Im S2
VECTOR = SIDE * ROW
PADDING = VECTOR  # doubles between the lines of the intermediate array, which else would share few places of the cache
FINE = 2048  # roots of unity that are multiplied by coarser ones


def _permuted(value, order):
    builder, mask = value.builder, ir.Constant(ir.VectorType(ir.IntType(32), len(order)), list(order))
    return Wide(builder, builder.shuffle_vector(value.value, value.value, mask))


def _times_i(value):
    """i times a vector, but for the sign of its real parts."""
    return _permuted(value, [k ^ 1 for k in range(value.value.type.count)])


def _signs(value):
    """-1 at real, +1 at imaginary parts."""
    kind = value.value.type
    return Wide(value.builder, ir.Constant(kind, [-1.0, 1.0] * (kind.count // 2)))


def _times(value, real, imaginary):
    """Complex product; `imaginary` has the signs of `_signs`."""
    return _times_i(value).times_plus(imaginary, value * real)


def _four(a, signs):
    even, odd, difference = a[0] + a[2], a[1] + a[3], a[0] - a[2]
    turned = _times_i(a[1] - a[3])
    return [even + odd, turned.times_plus(signs, difference), even - odd, turned.times_plus(-signs, difference)]


def _five(a, signs):
    cosines, sines = ([float(f(2 * LONG_PI * k / 5)) for k in (1, 2)] for f in (np.cos, np.sin))
    sums, differences = (a[1] + a[4], a[2] + a[3]), (a[1] - a[4], a[2] - a[3])
    first = sums[1].times_plus(cosines[1], sums[0].times_plus(cosines[0], a[0]))
    second = sums[1].times_plus(cosines[0], sums[0].times_plus(cosines[1], a[0]))
    turned = _times_i(differences[1].times_plus(sines[1], differences[0] * sines[0]))
    twice = _times_i(differences[1].times_plus(-sines[0], differences[0] * sines[1]))
    return [a[0] + (sums[0] + sums[1]), turned.times_plus(signs, first), twice.times_plus(signs, second),
            twice.times_plus(-signs, second), turned.times_plus(-signs, first)]


def _butterfly(radix, formula):
    """Code of one butterfly: target[to + j pitch] = roots[at + j] times the sum over l of source[start + l stride] root^(jl)."""

    @intrinsic
    def code(typingctx, source, start, stride, target, to, pitch, roots, at):
        def codegen(context, builder, signature, args):
            rows, result, factors = memories(context, builder, signature, args, (0, 3, 6))

            def vector(first, step, j):
                return builder.mul(builder.add(first, builder.mul(step, integer(j))), integer(VECTOR))

            values = [load(rows, vector(args[1], args[2], j), VECTOR) for j in range(radix)]
            signs = _signs(values[0])
            for j, value in enumerate(formula(values, signs)):
                if j:
                    root = builder.mul(builder.add(args[7], integer(j)), integer(2))
                    real = value.fill(factors.scalar(root))
                    value = _times(value, real, signs * value.fill(factors.scalar(builder.add(root, integer(1)))))
                store(result, vector(args[4], args[5], j), value)
            return context.get_dummy_value()

        number = types.intp
        return types.void(source, number, number, target, number, number, roots, number), codegen

    return code


_radix_2, _radix_4, _radix_5 = _butterfly(2, lambda a, _: [a[0] + a[1], a[0] - a[1]]), _butterfly(4, _four), _butterfly(5, _five)


@njit(**STRICT)
def _transform(radices, roots, buffers):
    """The transform of buffers[0] (length, VECTOR), into the one of the two that it returns."""
    length = 1
    for radix in radices:
        length *= radix
    stride, at, side = 1, 0, 0
    for radix in radices:
        count = length // radix
        source, target = buffers[side], buffers[1 - side]
        for p in range(count):
            for q in range(stride):
                if radix == 4:
                    _radix_4(source, q + stride * p, stride * count, target, q + stride * 4 * p, stride, roots, at)
                elif radix == 5:
                    _radix_5(source, q + stride * p, stride * count, target, q + stride * 5 * p, stride, roots, at)
                else:
                    _radix_2(source, q + stride * p, stride * count, target, q + stride * 2 * p, stride, roots, at)
            at += radix
        length, stride, side = count, stride * radix, 1 - side
    return side


def _moving(name):
    """Code of one of the ways between rows and vectors."""
    backward = [ROW * (SIDE - 1 - k // ROW) + k % ROW for k in range(VECTOR)]
    real, imaginary = ([2 * (k // ROW) + part for k in range(VECTOR)] for part in (0, 1))

    @intrinsic
    def code(typingctx, source, start, target, to, factors, at):
        def codegen(context, builder, signature, args):
            rows, result, roots = memories(context, builder, signature, args, (0, 2, 4))
            value = load(rows, args[1], VECTOR)
            signs = _signs(value)
            if name == "factors":  # one for each of the rows
                root = load(roots, args[5], 2 * SIDE)
                value = _times(value, _permuted(root, real), signs * _permuted(root, imaginary))
            else:
                if name == "backward":
                    value = _permuted(value, backward)
                root = [value.fill(roots.scalar(builder.add(args[5], integer(part)))) for part in (0, 1)]
                value = _times(value, root[0], signs * root[1])
            store(result, args[3], value)
            return context.get_dummy_value()

        number = types.intp
        return types.void(source, number, target, number, factors, number), codegen

    return code


_forward_rows, _backward_rows, _with_factors = _moving("forward"), _moving("backward"), _moving("factors")


@intrinsic
def _copy_row(typingctx, source, start, target, to):
    """target[to .. to + ROW] = source[start .. start + ROW]."""

    def codegen(context, builder, signature, args):
        rows, result = memories(context, builder, signature, args, (0, 2))
        store(result, args[3], load(rows, args[1], ROW))
        return context.get_dummy_value()

    return types.void(source, types.intp, target, types.intp), codegen


@njit(**STRICT)
def _columns(values, half_turns, plan, factors, between, buffers):
    """The transforms over k1, of eight k2 at a time, with the factors of the next step."""
    first, second = factors.shape[0], factors.shape[1] // 2
    flat, pitch = factors.reshape(-1), second * ROW + PADDING
    for k in range(0, second, 2 * SIDE):
        for k1 in range(first // 2):
            for half in range(2):
                start = (k1 * second + k + half * SIDE) * ROW
                _forward_rows(values, start, buffers[half, 0], k1 * VECTOR, half_turns, 2 * k1)
        for k1 in range(first // 2, first):
            for half in range(2):
                start = ((first - k1) * second - k - (half + 1) * SIDE + 1) * ROW
                _backward_rows(values, start, buffers[half, 0], k1 * VECTOR, half_turns, 2 * k1)
        results = buffers[0, _transform(plan[0], plan[1], buffers[0])], buffers[1, _transform(plan[0], plan[1], buffers[1])]
        for n1 in range(first):
            for half in range(2):
                column = k + half * SIDE
                _with_factors(results[half], n1 * VECTOR, between, n1 * pitch + column * ROW, flat, 2 * (n1 * second + column))


@njit(**STRICT)
def _line_transforms(between, n, second, plan, buffers):
    """The transforms over k2 of n1 = n .. n + SIDE - 1: vectors of these."""
    for j in range(SIDE):
        start = (n + j) * (second * ROW + PADDING)
        for k2 in range(second):
            _copy_row(between, start + k2 * ROW, buffers[0], k2 * VECTOR + j * ROW)
    return buffers[_transform(plan[0], plan[1], buffers)]


@njit(**STRICT)
def _lines(between, plan, first, values, buffers):
    """The transforms over k2, of four n1 and their mirror images N1 - 1 - n1: v_n and v_{N-1-n} come to lie side by side."""
    grid = values.size // ROW
    second = grid // first
    for n in range(0, first // 2, SIDE):
        result = _line_transforms(between, n, second, plan, buffers[0])
        mirrored = _line_transforms(between, first - SIDE - n, second, plan, buffers[1])
        for n2 in range(second // 2):
            low, high = 2 * (n + first * n2) * ROW, 2 * (first - SIDE - n + first * n2) * ROW
            far = (second - 1 - n2) * VECTOR
            for j in range(SIDE):
                back = (SIDE - 1 - j) * ROW
                _copy_row(result, n2 * VECTOR + j * ROW, values, low + 2 * j * ROW)
                _copy_row(mirrored, far + back, values, low + (2 * j + 1) * ROW)
                _copy_row(mirrored, n2 * VECTOR + j * ROW, values, high + 2 * j * ROW)
                _copy_row(result, far + back, values, high + (2 * j + 1) * ROW)


def _roots(count, of):
    """exp(2 pi i k/of), k = 0 .. count - 1, as pairs of doubles."""
    angle = 2 * LONG_PI * np.arange(count, dtype=LONG) / of
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1).astype(float)


@lru_cache(maxsize=16)
def _plan(length):
    """Radices, and the factors of their passes."""
    radices, roots = [], []
    for radix in (5, 4, 2):
        while length % radix == 0:
            powers = np.outer(np.arange(length // radix), np.arange(radix)) % length
            roots.append(_roots(length, length)[powers].reshape(-1))
            radices.append(radix)
            length //= radix
    return np.array(radices), np.concatenate(roots)


@njit(**STRICT)
def _fill_factors(fine, coarse, out):
    """exp(2 pi i k2 (n1 + 1/4)/N) into out (N1, 2 N2), from roots of order 4N."""
    turn = 4 * out.size // 2
    for n1 in range(out.shape[0]):
        e = 0
        for k2 in range(out.shape[1] // 2):
            a, b, c, d = fine[e % FINE, 0], fine[e % FINE, 1], coarse[e // FINE, 0], coarse[e // FINE, 1]
            out[n1, 2 * k2], out[n1, 2 * k2 + 1] = a * c - b * d, a * d + b * c
            e += 4 * n1 + 1
            if e >= turn:
                e -= turn


@lru_cache(maxsize=1)  # 16 bytes a grid point
def _factors(grid):
    first = _divided(grid)
    out = np.empty((first, 2 * (grid // first)))
    fine, coarse = _roots(FINE, 4 * grid), _roots(4 * grid // FINE + 1, 4 * grid / FINE)
    _fill_factors(fine, coarse, out)
    turns = _roots(first, 4 * first)  # exp(i pi k1/(2 N1)); -i times it in the second half
    turns[first // 2:] = np.stack([turns[first // 2:, 1], -turns[first // 2:, 0]], axis=-1)
    return out, turns.reshape(-1)


def _divided(grid):
    """N1 near the root of N: a multiple of 2 SIDE, as N2 is."""
    divisors = [2**a * 5**b for a in range(3, 24) for b in range(3)]
    return min((n for n in divisors if grid % (2 * SIDE * n) == 0), key=lambda n: abs(np.log(n * n / grid)))


def cosine_sums(values, between):
    """values (N, 4), of two complex series the rows k <= N/2, of which the last is zero, become their sums on the grid.

    N = 2^a 5^b, b <= 2, a >= 6; between, at least 4 N + PADDING N1 doubles, is overwritten.
    """
    grid = values.shape[0]
    factors, half_turns = _factors(grid)
    first = factors.shape[0]
    flat = values.reshape(-1)
    buffers = np.empty((2, 2, max(first, grid // first) * VECTOR))
    _columns(flat, half_turns, _plan(first), factors, between, buffers)
    _lines(between, _plan(grid // first), first, flat, buffers)
