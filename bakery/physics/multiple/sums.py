"""One look-up of a table of multiple scattering, and weighted sums of many.

A sum is made of groups of eight: places and weights of all eight first, which compilers do side by side, then the functions of
one after the other.  That takes less than half the time of single look-ups, which wait for their own results.
"""

import math

import numpy as np
from numba import carray, types
from numba.core import cgutils
from numba.extending import intrinsic

from bakery.physics.lent import lent
from bakery.physics.multiple import frame, locate
from bakery.physics.multiple._blend import blend, combine
from bakery.physics.multiple._elementary import exp, log, quadrant, quadrant_of_squares
from bakery.physics.multiple.frame import CORE, SKEW
from bakery.physics.multiple.kinds import POINT, SEGMENT
from bakery.system.compiled import njit

GROUP = 8
_RHO, _Z, _X, _Y, _ALONG, _WEIGHT, _SUM = range(0, 7 * GROUP, GROUP)  # of the numbers of a sum
_COUNT = _SUM + 1  # an int64 where it stands: converting would take a third of an `add`
_M, _FOUND = range(0, 2 * GROUP, GROUP)  # of those of a group
_I, _J, _THERE = range(0, 3 * GROUP, GROUP)  # of its places
_P, _W, _F = range(0, 12 * GROUP, 4 * GROUP)  # of its weights


@njit(nogil=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _mapped(table, rho, z, x, y, along):
    """m, the singular part, and where coefficients and functions stand, in steps of their grids."""
    rho = max(rho, frame.CLOSEST)
    square, above, below, beyond, inverse = locate.distances(table.kind, table.length, rho, z)
    # a constant of a tuple at run time would be a branch
    skew = SKEW[POINT] if table.kind == POINT else SKEW[SEGMENT]
    v = quadrant_of_squares(skew * skew * above, below) * (table.grid.shape[1] - 3)
    singular = inverse if table.kind == POINT else log(1 + 2 * table.length / beyond)
    s, t = directed(table, rho * inverse, z * inverse, x, y, along)
    return math.sqrt(square), singular, _outwards(table, min(square, table.extent * table.extent)), v, s, t


@njit(nogil=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def directed(table, sine, cosine, x, y, along):
    """Where functions stand, in steps of their grid; arguments as of `locate.direction`."""
    above, below, side = locate.turned(sine, cosine, x, y, along)
    s = quadrant(frame.SHARP * above, below) * (table.basis.shape[0] - 1)
    t = 0.5 * quadrant(abs(y), abs(side))
    return s, (t if side > 0 else 1 - t) * (table.basis.shape[1] - 1)


@njit(nogil=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def logarithm(table, a, s, t):
    """a_0 + B_0 + sum over k of a_k B_k in a direction (`directed`), of coefficients (K',) float32."""
    basis, count = table.basis, table.basis.shape[2]
    k, s = _cell(s, basis.shape[0] - 2)
    l, t = _cell(t, basis.shape[1] - 2)
    return np.float64(combine(a, basis, (k * basis.shape[1] + l) * count, basis.shape[1] * count, count, _bilinear(s, t)))


@njit(nogil=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _outwards(table, square):
    """u of m^2 in steps of the grid: arsinh(m / CORE) = ln(1 + 2 (q + sqrt(q (q + 1)))) / 2 with q = (m / CORE)^2."""
    core = CORE[POINT] if table.kind == POINT else CORE[SEGMENT]
    q = square * (1 / (core * core))
    return log(1 + 2 * (q + math.sqrt(q * (q + 1)))) * (0.5 * table.stretch * (table.grid.shape[0] - 3))


@njit(nogil=True, error_model="numpy", forceinline=True)
def _cell(x, last):
    """Index 0 .. last, and what is left."""
    i = max(min(np.int32(x), np.int32(last)), np.int32(0))
    return i, np.float32(x - i)


@njit(nogil=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _catmull_rom(t):
    unit, half = np.float32(1), np.float32(0.5)
    first = -half * t * ((unit - t) * (unit - t))
    third = t * (half + t * (np.float32(2) - np.float32(1.5) * t))
    last = half * (t * t) * (t - unit)
    return first, unit - first - third - last, third, last


@njit(nogil=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _bilinear(s, t):
    product = s * t
    return np.float32(1) - s - t + product, t - product, s - product, product


@njit(nogil=True, error_model="numpy", forceinline=True)
def _blended(table, i, j, p, w, column, f):
    grid, basis = table.grid, table.basis
    count = grid.shape[2]
    row = grid.shape[1] * count
    return np.float64(blend(grid, i * row + j * count, row, basis, column * count, basis.shape[1] * count, count, (p, w, f)))


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _far(table, m, value, j, w, column, f):
    """The sum of a place at distance m beyond the extent, of that at the extent: coefficients go on as 1/m, as they did from
    half the extent on, the light as exp(-k0 m) with them."""
    inside = frame.INSIDE * table.extent
    i, u = _cell(_outwards(table, inside * inside), table.grid.shape[0] - 4)
    within = _blended(table, i, j, _catmull_rom(u), w, column, f) - table.k0 * (table.extent - inside)
    beyond = m - table.extent
    return value + beyond / m * (frame.INSIDE / (1 - frame.INSIDE)) * (value - within) - table.k0 * beyond


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def point_source(table, rho, z, x, y, along):
    """The source at (rho, z) into the direction (x along rho, y across, along z), mfp^-3 sr^-1; mfp; finite everywhere.

    table : `Ready`, of a point, or of a segment of its own length
    """
    table = lent(table)
    m, singular, u, v, s, t = _mapped(table, rho, z, x, y, along)
    i, u = _cell(u, table.grid.shape[0] - 4)
    j, v = _cell(v, table.grid.shape[1] - 4)
    k, s = _cell(s, table.basis.shape[0] - 2)
    l, t = _cell(t, table.basis.shape[1] - 2)
    w, f, column = _catmull_rom(v), _bilinear(s, t), k * table.basis.shape[1] + l
    value = _blended(table, i, j, _catmull_rom(u), w, column, f)
    if m > table.extent:
        value = _far(table, m, value, j, w, column, f)
    return table.power * singular * exp(value)


# ---- weighted sums of look-ups


def _on_stack(kind, count):
    """A compiled function that returns a pointer to so many numbers, which last until the function that calls it returns."""

    @intrinsic
    def pointer(typingctx):
        def code(context, builder, signature, args):
            return cgutils.alloca_once(builder, context.get_data_type(kind), context.get_constant(types.intp, count))

        return types.CPointer(kind)(), code

    return pointer


_sum, _numbers, _places, _shares = (_on_stack(*of) for of in (
    (types.float64, _COUNT + 1), (types.float64, 2 * GROUP), (types.int32, 3 * GROUP), (types.float32, 12 * GROUP)))


# inlined by numba itself: what is on the stack is the caller's
@njit(nogil=True, error_model="numpy", inline="always")
def no_look_ups():
    """A sum of nothing, on the stack of the function that calls: up to `GROUP` look-ups still to be made, and the others' sum."""
    out = carray(_sum(), _COUNT + 1)
    for n in range(_COUNT + 1):
        out[n] = 0.0  # places that are not used have to be some, too
    return out


@njit(nogil=True, error_model="numpy", forceinline=True)
def add_look_up(to, table, rho, z, x, y, along, weight):
    """Adds weight times `point_source` of the table; one table a sum."""
    n = np.float64(to[_COUNT]).view(np.int64)
    to[_RHO + n], to[_Z + n], to[_X + n], to[_Y + n], to[_ALONG + n], to[_WEIGHT + n] = rho, z, x, y, along, weight
    to[_COUNT] = np.int64(n + 1).view(np.float64)
    if n + 1 == GROUP:
        _look(to, table)


@njit(nogil=True, error_model="numpy", forceinline=True)
def sum_of_look_ups(of, table):
    """The sum; it is emptied."""
    if np.float64(of[_COUNT]).view(np.int64) > 0:
        _look(of, table)
    value = of[_SUM]
    of[_SUM] = 0.0
    return table.power * value


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _look(to, table):
    """Makes the look-ups of a sum, up to eight."""
    table = lent(table)
    number, index, share = carray(_numbers(), 2 * GROUP), carray(_places(), 3 * GROUP), carray(_shares(), 12 * GROUP)
    U, V, A, B = table.grid.shape[0], table.grid.shape[1], table.basis.shape[0], table.basis.shape[1]
    for n in range(GROUP):
        m, singular, u, v, s, t = _mapped(table, to[_RHO + n], to[_Z + n], to[_X + n], to[_Y + n], to[_ALONG + n])
        i, u = _cell(u, U - 4)
        j, v = _cell(v, V - 4)
        k, s = _cell(s, A - 2)
        l, t = _cell(t, B - 2)
        number[_M + n] = m
        to[_WEIGHT + n] *= singular
        index[_I + n], index[_J + n], index[_THERE + n] = i, j, k * np.int32(B) + l
        share[_P + n], share[_P + GROUP + n], share[_P + 2 * GROUP + n], share[_P + 3 * GROUP + n] = _catmull_rom(u)
        share[_W + n], share[_W + GROUP + n], share[_W + 2 * GROUP + n], share[_W + 3 * GROUP + n] = _catmull_rom(v)
        share[_F + n], share[_F + GROUP + n], share[_F + 2 * GROUP + n], share[_F + 3 * GROUP + n] = _bilinear(s, t)
    count = np.float64(to[_COUNT]).view(np.int64)
    for n in range(count):
        p, w, f = _four(share, _P + n), _four(share, _W + n), _four(share, _F + n)
        value = _blended(table, index[_I + n], index[_J + n], p, w, index[_THERE + n], f)
        if number[_M + n] > table.extent:
            value = _far(table, number[_M + n], value, index[_J + n], w, index[_THERE + n], f)
        number[_FOUND + n] = value
    for n in range(GROUP):
        number[_FOUND + n] = to[_WEIGHT + n] * exp(number[_FOUND + n])
    for n in range(count):
        to[_SUM] += number[_FOUND + n]
    to[_COUNT] = 0.0


@njit(nogil=True, error_model="numpy", forceinline=True)
def _four(share, n):
    return share[n], share[n + GROUP], share[n + 2 * GROUP], share[n + 3 * GROUP]
