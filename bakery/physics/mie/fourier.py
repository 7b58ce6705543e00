"""Amplitudes at many angles by their Fourier series: a non-uniform fast transform instead of a recurrence at every angle.

In h_n = (2n+1)/(n(n+1)) a_n, and the same of b_n, the angular sums are derivatives of Legendre series: tau_n = -P_n'' and
sin(theta) pi_n = -P_n' (derivatives by theta).  With g_k as in `legendre`,

    sum h_n tau_n = 2 sum k^2 g_k cos(k theta),
    sum h_n pi_n = sum r_k cos(k theta),        r_{k-1} = r_{k+1} + 4k g_k (half of it for r_0).

A cosine transform gives S on a grid at least twice as fine as needed, of coefficients over the Fourier transform of a window.  At
every angle the 16 nearest grid values are added up with that window, exp(beta sqrt(1 - z^2)) (Barnett, Magland & af Klinteberg,
SIAM J. Sci. Comput. 41, C479 (2019)).

The error is the same at all angles: ERROR of the root mean square of S over theta, most of which is the forward peak.  Where that
is more than WORST of |S|, and more than recurrences lose, the angle is summed by them.  At 0 and pi the sums need neither.

Rounding.  As in `series`; the transform in the middle is SciPy's where spheres share one, and that of `cosines` for large ones.
Grids depend on the sphere alone, so that neither other spheres nor other angles change a result.
"""

import math
from functools import cache

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from bakery.physics.mie import angular, coefficients
from bakery.physics.mie.cosines import cosine_sums
from bakery.physics.mie.legendre import (
    APART,
    LEAF,
    LONG,
    LONG_PI,
    NODES,
    STRICT,
    box_tables,
    legendre_to_fourier,
    levels,
    load,
    memories,
    ratios,
    store,
)
from bakery.physics.mie.vector import Registers, Wide, fma, integer
from bakery.system.compiled import njit

WINDOW = 16  # grid points of the window
DEGREE = 18  # of its polynomials between two grid points
FINENESS = 2.0  # grid points over orders, at least
BETA = 0.98 * np.pi * WINDOW * (1.0 - 0.5 / FINENESS)
DAMPING = 26  # degree in k^2 of one over the window's transform
ERROR = 1.5e-15  # of the root mean square of |S1|^2 + |S2|^2 over theta: error of S at any angle
WORST, WORST_X = 4e-12, 4e-16  # largest share of the larger of |S1|, |S2| that this may be, and that times x: recurrences lose it
_INVERSE_PI, _INVERSE_PI_LOW = 0.3183098861837907, -1.9678676675182486e-17  # 1/pi to twice the working precision


@njit(**STRICT)
def weighted_coefficients(work, last, h):
    """h (R, 4, 2, size) of the coefficients work (rows, 4, L): orders 2i + parity of Re a, Im a, Re b, Im b, else zero."""
    h[:, :, 0, 0] = 0.0
    h[:, :, :, last[0] // 2:] = 0.0
    for q in range(last.shape[0]):
        for n in range(1, last[q] + 1):
            f = (2.0 * n + 1.0) / (n * (n + 1.0))
            for part in range(4):
                h[q, part, n % 2, n // 2] = f * work[n - 1, part, q]
    return h


_POINTS = np.cos(LONG_PI * (np.arange(64, dtype=LONG) + LONG(0.5)) / 64)  # where polynomials in -1 .. 1 are fitted


def _polynomial(values, degree):
    """Coefficients, highest first, of the polynomial through values at _POINTS."""
    chebyshev = np.zeros((degree + 1, degree + 1), LONG)
    chebyshev[0, 0] = chebyshev[1, 1] = 1
    for k in range(2, degree + 1):
        chebyshev[k, 1:] = 2 * chebyshev[k - 1, :-1]
        chebyshev[k] -= chebyshev[k - 2]
    coefficients = np.cos(np.outer(np.arange(degree + 1), np.arccos(_POINTS))) @ values * (LONG(2) / 64)
    coefficients[0] /= 2
    return (coefficients @ chebyshev).astype(float)[::-1]


@cache
def window_tables():
    """Polynomials of the window between two grid points (DEGREE + 1, WINDOW), highest first, in y = 2 fraction - 1; and of one
    over its transform in z = 2 (k/grid FINENESS)^2 - 1 (DAMPING + 1,).
    """
    def window(t):
        return np.exp(BETA * (np.sqrt(np.maximum(1 - (2 * t / WINDOW) ** 2, 0)) - 1))

    pieces = [_polynomial(window((_POINTS + 1) / 2 + (WINDOW // 2 - 1 - j)), DEGREE) for j in range(WINDOW)]
    # t = WINDOW/2 sin(angle): periodic, and beyond a right angle below exp(-BETA)
    angle = 2 * LONG_PI * (np.arange(256, dtype=LONG) + LONG(0.5)) / 256
    weight = np.cos(angle) * np.exp(BETA * (np.cos(angle) - 1)) * LONG_PI * WINDOW / 256
    ratio = np.sqrt((_POINTS + 1) / 2) / FINENESS  # k over the grid
    damping = 1 / (np.cos(np.outer(ratio, LONG_PI * WINDOW / 2 * np.sin(angle))) @ weight)
    return np.ascontiguousarray(np.array(pieces).T), _polynomial(damping, DAMPING)


@njit(**STRICT)
def _damping(grid, count, polynomial):
    """One over the window's transform at k = 0 .. count - 1."""
    out, z, value = np.empty(count), np.empty(NODES), np.empty(NODES)
    for first in range(0, count, NODES):
        for c in range(NODES):
            k = (first + c) * (FINENESS / grid)
            z[c], value[c] = 2.0 * k * k - 1.0, polynomial[0]
        for d in range(1, polynomial.shape[0]):
            for c in range(NODES):
                value[c] = value[c] * z[c] + polynomial[d]
        for c in range(min(NODES, count - first)):
            out[first + c] = value[c]
    return out


@intrinsic
def _cosine_rows(typingctx, g, size, count, damping, out, column, pitch, power):
    """Rows k = 2 count - 1 .. 0 of one radius, four columns of out; power (4,) takes half their squares."""

    def codegen(context, builder, signature, args):
        series, factors, rows, sums = memories(context, builder, signature, args, (0, 3, 4, 7))
        zero = load(sums, integer(0), 4)
        swapped = ir.Constant(ir.VectorType(ir.IntType(32), 4), [2, 3, 0, 1])
        state = Registers(builder, even=zero, odd=zero, power=zero)

        def order(i, parity, name, following):
            """Order k = 2i + parity, of which r_k is `name`, and r_{k-1} `following`."""
            start = builder.add(builder.mul(args[1], integer(parity)), i)
            value = zero
            for s in range(4):
                share = series.scalar(builder.add(start, builder.mul(args[1], integer(2 * s))))
                value = Wide(builder, builder.insert_element(value.value, share, ir.Constant(ir.IntType(32), s)))
            row = builder.add(builder.mul(i, integer(2)), integer(parity))
            k = zero.fill(builder.sitofp(row, ir.DoubleType()))
            turned = Wide(builder, builder.shuffle_vector(value.value, value.value, swapped))
            term = turned.times_plus(k * k * 2.0, getattr(state, name))
            state.power = (term * 0.5).times_plus(term, state.power)
            store(rows, builder.add(args[5], builder.mul(args[6], row)), term * 0.5 * zero.fill(factors.scalar(row)))
            setattr(state, following, value.times_plus(k * 4.0, getattr(state, following)))

        with cgutils.for_range(builder, args[2]) as loop:
            i = builder.sub(builder.sub(args[2], loop.index), integer(1))
            order(i, 1, "odd", "even")
            order(i, 0, "even", "odd")
        store(sums, integer(0), state.power)
        return context.get_dummy_value()

    number = types.intp
    return types.void(g, number, number, damping, out, number, number, power), codegen


@njit(**STRICT)
def cosine_coefficients(g, last, polynomial, out):
    """What the transform takes into out (grid, 4 R): Re S1, Im S1, Re S2, Im S2 of each radius; returns the square of ERROR
    times their mean square (R,).
    """
    radii, size = g.shape[0], g.shape[3]
    power, top = np.zeros((radii, 4)), np.max(last)
    damping, rows = _damping(out.shape[0], top + 2, polynomial), out.reshape(-1)
    error = np.empty(radii)
    out[2 * (last[0] // 2 + 1):] = 0.0
    for q in range(radii):
        _cosine_rows(g[q].reshape(-1), size, last[q] // 2 + 1, damping, rows, 4 * q, 4 * radii, power[q])
        error[q] = ERROR * ERROR * (power[q, 0] + power[q, 1] + power[q, 2] + power[q, 3])
    return error


@intrinsic
def _window_weights(typingctx, table, y, out, at):
    """The window's polynomials at y into out[at ..]."""

    def codegen(context, builder, signature, args):
        rows, result = memories(context, builder, signature, args, (0, 2))
        value = load(rows, integer(0), WINDOW)
        for d in range(1, DEGREE + 1):
            value = value.times_plus(args[1], load(rows, integer(d * WINDOW), WINDOW))
        store(result, args[3], value)
        return context.get_dummy_value()

    return types.void(table, types.float64, out, types.intp), codegen


@njit(**STRICT)
def window_weights(theta, grid, table):
    """First grid point (A,) and weights (A, WINDOW) of every angle."""
    scale = grid * _INVERSE_PI
    scale_low = fma(float(grid), _INVERSE_PI, -scale) + grid * _INVERSE_PI_LOW
    first, weights = np.empty(theta.shape[0], np.int64), np.empty((theta.shape[0], WINDOW))
    flat = weights.reshape(-1)
    for t in range(theta.shape[0]):
        u = theta[t] * scale
        low = fma(theta[t], scale, -u) + theta[t] * scale_low
        cell = np.floor(u - 0.5)
        first[t] = int(cell) - (WINDOW // 2 - 1)
        _window_weights(table, 2.0 * (u - 0.5 - cell + low) - 1.0, flat, t * WINDOW)
    return first, weights


def _interpolation(width):
    """Code of a weighted sum of WINDOW rows of `width` columns."""

    @intrinsic
    def rows(typingctx, values, first, pitch, weights, at, out, to):
        def codegen(context, builder, signature, args):
            grid, factors, result = memories(context, builder, signature, args, (0, 3, 5))
            total = None
            for j in range(WINDOW):
                row = load(grid, builder.add(args[1], builder.mul(args[2], integer(j))), width)
                factor = factors.scalar(builder.add(args[4], integer(j)))
                total = row * factor if total is None else row.times_plus(factor, total)
            store(result, args[6], total)
            return context.get_dummy_value()

        number = types.intp
        return types.void(values, number, number, weights, number, out, number), codegen

    return rows


_interpolate_one, _interpolate_four = _interpolation(4), _interpolation(16)


@njit(**STRICT)
def interpolated(values, first, weights, out):
    """out (A, C) from values (grid, C), C a multiple of 4: the series is even about 0 and pi, whose mirror images are copied."""
    grid, columns = values.shape
    flat, factors, result = values.reshape(-1), weights.reshape(-1), out.reshape(-1)
    edge = np.empty((WINDOW, columns))
    for t in range(first.shape[0]):
        inside = first[t] >= 0 and first[t] + WINDOW <= grid
        if not inside:
            for j in range(WINDOW):
                row = first[t] + j
                row = -1 - row if row < 0 else row
                edge[j] = values[2 * grid - 1 - row if row >= grid else row]
        rows, start = (flat, first[t] * columns) if inside else (edge.reshape(-1), 0)
        wide = columns // 16 * 16
        for c in range(0, wide, 16):
            _interpolate_four(rows, start + c, columns, factors, t * WINDOW, result, t * columns + c)
        for c in range(wide, columns, 4):
            _interpolate_one(rows, start + c, columns, factors, t * WINDOW, result, t * columns + c)


@njit(**STRICT)
def _spectrum(m, x, ratio, tables, polynomial, memory):
    """Into values what the transform takes of spheres x (R,); returns the square of the least S that it is good for, and S1 at 0
    and pi (R, 2, 2).

    memory, as it may be: a_n and b_n, h (R, 4, 2, ..), the tree of `legendre_to_fourier` and values (grid, 4 R).
    """
    work, h, tree, values = memory
    tree[:] = 0.0
    last = np.empty(x.shape[0], np.int64)
    for q in range(x.shape[0]):
        last[q] = coefficients.terms(x[q])
    coefficients.coefficients(m, x, work)
    ends = np.empty((x.shape[0], 2, 2))
    for q in range(x.shape[0]):
        _ends(work, q, last[q], ends[q])
    weighted_coefficients(work, last, h)
    legendre_to_fourier(h, last, ratio, tables, tree)
    error = cosine_coefficients(h, last, polynomial, values)
    for q in range(x.shape[0]):
        error[q] /= max(WORST, WORST_X * last[q]) ** 2
    return error, ends


@njit(**STRICT)
def _size(last):
    """Orders of one parity, rounded up to boxes."""
    return (last // 2 // LEAF + 1) * LEAF


@njit(**STRICT)
def _ends(work, q, last, out):
    """S1 at exactly 0 and pi (2, 2), where p_n and q_n are 1 and 0, or 0 and +-1."""
    out[:] = 0.0
    for n in range(1, last + 1):
        k, sign = n + 0.5, (n + 0.5 if n % 2 else -n - 0.5)
        out[0, 0] += k * (work[n - 1, 0, q] + work[n - 1, 2, q])
        out[0, 1] += k * (work[n - 1, 1, q] + work[n - 1, 3, q])
        out[1, 0] += sign * (work[n - 1, 0, q] - work[n - 1, 2, q])
        out[1, 1] += sign * (work[n - 1, 1, q] - work[n - 1, 3, q])


_RATIOS = [np.empty(0)]


def _ratios(last):
    """`legendre.ratios` for orders up to `last`: the longest table asked for, kept, 8 bytes an order."""
    count, kept = int(2 * _size(last) + (APART + 1) * LEAF), _RATIOS[0]
    if kept.size < count:
        _RATIOS[0] = kept = ratios(count + count // 4)
    return kept


@njit(**STRICT)
def _evaluate(spectrum, theta, window, s1, s2):
    """Into s1, s2 (R, A, 2); returns which are doubtful (R, A)."""
    values, error, ends = spectrum
    first, weights = window_weights(theta, values.shape[0], window)
    pairs = np.empty((theta.shape[0], values.shape[1]))
    interpolated(values, first, weights, pairs)
    doubtful = np.zeros((error.shape[0], theta.shape[0]), np.bool_)
    for q in range(error.shape[0]):
        for t in range(theta.shape[0]):
            a, b, c, d = pairs[t, 4 * q], pairs[t, 4 * q + 1], pairs[t, 4 * q + 2], pairs[t, 4 * q + 3]
            s1[q, t, 0], s1[q, t, 1], s2[q, t, 0], s2[q, t, 1] = a, b, c, d
            doubtful[q, t] = error[q] > max(a * a + b * b, c * c + d * d)
    for t in range(theta.shape[0]):
        if theta[t] == 0.0 or theta[t] == np.pi:
            end, sign = (0, 1.0) if theta[t] == 0.0 else (1, -1.0)
            for q in range(error.shape[0]):
                doubtful[q, t] = False
                for part in range(2):
                    s1[q, t, part], s2[q, t, part] = ends[q, end, part], sign * ends[q, end, part]
    return doubtful


@cache
def _grids():
    """Lengths that the transform is fast for, ascending."""
    return np.array(sorted(factor << k for k in range(20) for factor in (16, 20, 25)))


def blocks(x, places):
    """Spheres that share a grid, at most LANES together: (grid, places), of places in ascending order of x."""
    terms = np.ceil(x[places] + 7.5 * np.cbrt(x[places])) + 4.0  # two to spare: this may round otherwise than `terms`
    which = np.searchsorted(_grids(), FINENESS * terms)
    result = []
    for group in np.split(np.arange(places.size), np.flatnonzero(np.diff(which)) + 1):
        width = coefficients.LANES if terms[group[-1]] <= coefficients.WIDE else 1
        result += [(int(_grids()[which[part[0]]]), places[part]) for part in np.split(group, range(width, group.size, width))]
    return result


_KEPT = []  # memory of calls before, at most four times KEPT bytes: at x = 2e5 new memory takes a third of the time
KEPT = 48_000_000


def _memory(last, radii, grid):
    """Of `_spectrum`: the whole and its parts; 200 bytes an order and sphere."""
    size = _size(last)
    shapes = ((last + 2, 4, coefficients.LANES if radii > 1 else 1), (radii, 4, 2, size), (2, radii, levels(size)[-1], 8, NODES),
              (grid, 4 * radii))
    ends = np.cumsum([math.prod(shape) for shape in shapes])
    try:
        whole = _KEPT.pop()  # a thread's own
    except IndexError:
        whole = np.empty(0)
    if whole.size < ends[-1]:
        whole = np.empty(ends[-1])
    return whole, tuple(part.reshape(shape) for part, shape in zip(np.split(whole[:ends[-1]], ends[:-1]), shapes))


def amplitudes_of_block(m, x, theta, grid, s1, s2):
    """S1, S2 (R, A) of one of `blocks` at theta (A,) rad, into contiguous arrays."""
    window, damping = window_tables()
    last = coefficients.terms(x[-1])
    whole, memory = _memory(last, x.size, grid)
    bounds = _spectrum(m, x, _ratios(last), box_tables(), damping, memory)
    if last > coefficients.WIDE:
        values = memory[-1]
        cosine_sums(values, whole[:sum(part.size for part in memory[:-1])])
    else:
        from scipy.fft import dct

        values = dct(memory[-1], type=3, axis=0, overwrite_x=True)
    parts = s1.view(np.float64).reshape(*s1.shape, 2), s2.view(np.float64).reshape(*s2.shape, 2)
    doubtful = _evaluate((values, *bounds), theta, window, *parts)
    if whole.nbytes <= KEPT and len(_KEPT) < 4:
        _KEPT.append(whole)
    if doubtful.any():
        for q in range(x.size):
            again = np.flatnonzero(doubtful[q])
            if again.size:
                exact = np.empty((1, again.size, 4))
                angular.amplitude_block(m, x[q:q + 1], theta[again], exact)
                pair = exact.view(np.complex128)
                s1[q, again], s2[q, again] = pair[0, :, 0], pair[0, :, 1]
