"""Looks tables of multiple scattering up: values at points, along segments, from sources of any length.

Lengths are in mean free paths.  All positions and directions have an answer: on the axis the azimuth of a direction is taken as
it is given; nearer than `frame.CLOSEST` to the axis the answer is the one there (so the source itself has a large finite value);
beyond the extent coefficients go on as 1/m, and the light as exp(-k0 m) N with them.
"""

import math
from typing import NamedTuple

import numpy as np

from bakery.physics.lent import lent
from bakery.physics.multiple import frame, locate
from bakery.physics.multiple._blend import LANES
from bakery.physics.multiple._elementary import asinh, exp
from bakery.physics.multiple._products import product
from bakery.physics.multiple.frame import CORE, SKEW
from bakery.physics.multiple.sums import add_look_up, no_look_ups, point_source, sum_of_look_ups
from bakery.physics.multiple.table import RINGS, Table, margins
from bakery.system.compiled import njit

UPSAMPLED = 3  # of the basis by splines; between these points linear
_LINE = 64  # bytes that memory is read in
_OVERLAP = 8  # points beyond an end that a spline goes through
GAUSS = 5  # points of a piece of an integral
PIECE = 2.0  # of arsinh(distance along the segment / distance from it), at most
_TURN = 0.125  # share of an order of the directions that the pieces follow
LONGEST = 3.0  # of the same, where lobes turn: see `piece`
SHORT = 0.5  # at least, beside the ends of a segment
END, BESIDE = 0.1, 1e-4  # mfp from the ends and from the axis of a tabulated segment within which points are summed instead
GONE = 10.0  # mfp behind a position from which no light comes: what is left out is 3e-6 of the light, exp(-10) at most
DEEP = 20.0  # of (1 - k0) s: light of the place s of a beam has fallen by exp(-20) beside that which diffused from its beginning


def gauss(count):
    """Points and weights of Gauss's rule on 0 .. 1."""
    x, weight = np.polynomial.legendre.leggauss(count)
    return (1 + x) / 2, weight / 2


X, WEIGHT = gauss(GAUSS)


class Ready(NamedTuple):
    """A table laid out for look-ups."""

    kind: int
    length: float
    extent: float
    k0: float
    power: float  # 1, or 0 where nothing scatters
    stretch: float  # u of a place = arsinh(m / CORE) stretch
    turn: float  # how fast lobes turn as a beam is passed: 1 as soon as it does
    grid: np.ndarray  # (U + 2, V + 2, K') float32, a_0 .. a_K with margins, then zeros
    basis: np.ndarray  # (A, B, K') float32, B_0 .. B_K, then zeros


def ready(table: Table) -> Ready:
    """Lays a table out for look-ups: about 1 MB."""
    stretch = 1 / math.asinh(table.extent / CORE[table.kind])
    if not len(table.corner):
        grid, basis = np.zeros((4, 4, 1)), np.zeros((2, 2, 1))
    else:
        grid, basis = margins(table.coefficients()), _upsampled(table.functions())
    turn = _TURN * max(2 * (table.basis.shape[1] - RINGS), 0)
    return Ready(table.kind, float(table.length), float(table.extent), float(table.k0), float(len(table.corner) > 0), stretch,
                 turn, padded(grid), padded(basis))


def padded(array):
    """An array (…, K + 1) as float32 with zeros up to a multiple of `LANES`, beginning where a line of the cache does."""
    *shape, count = array.shape
    shape += [-(-count // LANES) * LANES]
    memory = np.zeros(math.prod(shape) * 4 + _LINE, np.uint8)
    skipped = -memory.ctypes.data % _LINE
    out = memory[skipped:skipped + math.prod(shape) * 4].view(np.float32).reshape(shape)
    out[..., :count] = array
    return out


def _upsampled(functions):
    """Functions (K, A, B) on a finer grid, (A', B', K): even in the azimuth, through the poles to the other side."""
    A, B = functions.shape[1:]
    over = min(_OVERLAP, A - 1, B - 1)
    values, mirrored = np.moveaxis(functions, 0, -1), np.moveaxis(functions[:, :, ::-1], 0, -1)
    tall = _finer(np.concatenate([mirrored[over:0:-1], values, mirrored[-2:-2 - over:-1]]), over)
    rings = np.moveaxis(tall, 1, 0)
    return np.moveaxis(_finer(np.concatenate([rings[over:0:-1], rings, rings[-2:-2 - over:-1]]), over), 0, 1)


def _finer(y, over):
    """Cubic spline without knots next to the ends ("not a knot") through y (N >= 4, ...) one apart, read `UPSAMPLED` times as
    densely from y[over] to y[-1 - over].

    Its slopes by elimination (de Boor 1978, chapter IV).  SciPy's takes 0.15 s and 20 MB to import.
    """
    slope = np.empty_like(y)
    slope[1:-1] = 3 * (y[2:] - y[:-2])
    slope[0], slope[-1] = (-5 * y[0] + 4 * y[1] + y[2]) / 2, (5 * y[-1] - 4 * y[-2] - y[-3]) / 2
    above = np.full(len(y), 2.0)  # the equation of each slope less those before it: that slope, and so many times the next
    for n in range(1, len(y)):
        below, diagonal = (2.0, 1.0) if n == len(y) - 1 else (1.0, 4.0)
        pivot = diagonal - below * above[n - 1]
        slope[n] = (slope[n] - below * slope[n - 1]) / pivot
        above[n] = 1 / pivot
    for n in range(len(y) - 2, -1, -1):
        slope[n] -= above[n] * slope[n + 1]
    low, high = slice(over, len(y) - 1 - over), slice(over + 1, len(y) - over)
    out = np.empty((UPSAMPLED * (len(y) - 1 - 2 * over) + 1, *y.shape[1:]))
    out[::UPSAMPLED] = y[over:len(y) - over]
    for n in range(1, UPSAMPLED):
        t = n / UPSAMPLED
        out[n::UPSAMPLED] = ((1 + 2 * t) * (1 - t) ** 2 * y[low] + t**2 * (3 - 2 * t) * y[high]
                             + t * (1 - t) ** 2 * slope[low] - t**2 * (1 - t) * slope[high])
    return out


# ---- segments of any length


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def piece(turn, t):
    """Longest piece of t = arsinh(distance along a line / distance from the source) for one Gauss rule.

    The smoother the farther: lobes turn as fast as the source is passed.  At g = 0.9 pieces of 2 were 3.7 % off beside a beam,
    at worst 13 %; these are 0.01 %, at worst 0.05 %.
    """
    up = exp(max(abs(t) - 1.0, 0.0))
    return LONGEST / (1 + 2 * turn / (up + 1 / up))  # 1 / cosh


@njit(cache=True, nogil=True, error_model="numpy")
def segment_source(points, segments, length, rho, z, x, y, along):
    """`point_source` of a segment of any length >= 0 (mfp): whole tiles of the tabulated one, the rest an integral over points.

    So are tiles on whose ends or axis the position nearly lies: there the table of segments is too coarse.
    """
    points, segments = lent(points), lent(segments)
    if length == segments.length and not _touches(rho, z, length):
        return point_source(segments, rho, z, x, y, along)
    of_points, of_tiles = no_look_ups(), no_look_ups()
    add_segment_look_up(of_points, of_tiles, points, segments, length, rho, z, x, y, along, 1.0)
    return sum_of_look_ups(of_points, points) + sum_of_look_ups(of_tiles, segments)


@njit(cache=True, nogil=True, error_model="numpy")
def add_segment_look_up(of_points, of_tiles, points, segments, length, rho, z, x, y, along, weight):
    """Adds weight * `segment_source` to a sum (`sums.no_look_ups`) of the table of points and one of the table of segments."""
    points, segments = lent(points), lent(segments)
    tile = segments.length
    # whole tiles: nothing is left
    end = (math.floor(min(max(z, 0.0) + GONE, DEEP / (1 - segments.k0)) / tile) + 1) * tile
    length = min(length, end)
    whole = int(length / tile * (1 + 1e-12))
    near, reaching, decay = rho < END, weight, exp(-tile)
    for n in range(whole):
        start = n * tile
        if near and _touches(rho, z - start, tile):
            _add_integral(of_points, points, (start, start + tile), rho, z, x, y, along, weight)
        else:
            add_look_up(of_tiles, segments, rho, z - start, x, y, along, reaching)
        reaching *= decay
    start = whole * tile
    if length - start > 1e-12 * tile:
        _add_integral(of_points, points, (start, length), rho, z, x, y, along, weight)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _touches(rho, z, length):
    """Whether a position lies within END of an end of a segment, or within BESIDE of the segment."""
    away = min(abs(z), abs(z - length))
    return rho * rho + away * away < END * END or (rho < BESIDE and 0 < z < length)


@njit(cache=True, nogil=True, error_model="numpy")
def _add_integral(to, points, ends, rho, z, x, y, along, weight):
    """Adds weight times the integral of exp(-s) times the table of points over places s between two ends of a piece of a beam."""
    # s - z = close sinh(t): the source falls off as 1/cosh(t), however close the segment is; beside an end, where a forward peak
    # is cut off, pieces are short where the angle to the beam turns
    points, (start, end) = lent(points), ends
    close = max(rho, frame.CLOSEST)
    t, last = asinh((start - z) / close), asinh((end - z) / close)
    shortest = SHORT if _touches(rho, z - start, end - start) else PIECE
    while t < last:
        step = min(PIECE, max(shortest, 0.5 * abs(t)), piece(points.turn, t), last - t)
        for n in range(GAUSS):
            up = exp(t + X[n] * step)
            away, cosh = close * 0.5 * (up - 1 / up), 0.5 * (up + 1 / up)
            add_look_up(to, points, rho, -away, x, y, along, weight * WEIGHT[n] * step * close * cosh * exp(-(z + away)))
        t = last if last - t <= step else t + step


# ---- arrays of look-ups


def point(table: Ready, rho, z, theta, phi):
    """Source of the third and later events around a point where power 1 enters its first collision travelling along +z.

    table : `ready` one of a point source
    rho, z : mfp; theta, phi : rad, direction of travel from +z, and from the azimuth of the position; all broadcast

    Returns mfp^-3 sr^-1, finite everywhere; error: `Table.error`
    """
    arrays, out = _broadcast(rho, z, theta, phi)
    _points(table, *arrays, out.reshape(-1))
    return out


def segment(points: Ready, segments: Ready, rho, z, theta, phi, length=None):
    """The same for a beam of power 1 along z from 0 to `length` (mfp, broadcast; that of the table if not given; inf will do).

    Exact in the length but for the tables: whole tiles of the tabulated segment, attenuated by what lies before each, and the
    rest as an integral of the point table (within 2e-4, at worst 1e-3 of a value close to the beam).
    """
    length = segments.length if length is None else length
    arrays, out = _broadcast(rho, z, theta, phi, length)
    _segments(points, segments, *arrays, out.reshape(-1))
    return out


def lobes(table: Ready, rho, z, polar, azimuth):
    """Lobes (N, A, B) of the table's own source in the frames of positions (N,), at polar (A,) and azimuth (B,).

    As directions are in the frame of each position, functions are interpolated once for all positions: `point_source` to 1e-6.
    """
    a, singular = _coefficients(table, *(np.ascontiguousarray(x, float) for x in (rho, z)))
    functions = _functions(table.basis, np.asarray(polar, float), np.asarray(azimuth, float))
    offset = a[:, 0].copy()
    a[:, 0] = 1.0
    value = product(a, functions)
    value += offset[:, None]
    np.exp(value, out=value)
    value *= singular[:, None]
    return value.reshape(len(a), len(polar), len(azimuth))


def _functions(basis, polar, azimuth):
    """B_0 .. at all pairs of directions, (K', A B)."""
    s = (2 / math.pi) * np.arctan2(frame.SHARP * np.sin(polar / 2), np.cos(polar / 2)) * (basis.shape[0] - 1)
    t = np.arccos(np.clip(np.cos(azimuth), -1, 1)) / math.pi * (basis.shape[1] - 1)
    k, l = (np.clip(x.astype(int), 0, n - 2) for x, n in zip((s, t), basis.shape[:2], strict=True))
    s, t = (s - k)[:, None, None], (t - l)[:, None]
    rows = basis[k].astype(float) * (1 - s) + basis[k + 1] * s
    values = rows[:, l] * (1 - t) + rows[:, l + 1] * t
    return np.ascontiguousarray(values.reshape(-1, basis.shape[2]).T)


def _broadcast(*arrays):
    arrays = np.broadcast_arrays(*(np.asarray(x, float) for x in arrays))
    return [np.ascontiguousarray(x).reshape(-1) for x in arrays], np.empty(arrays[0].shape)


@njit(cache=True, nogil=True, error_model="numpy")
def _points(table, rho, z, theta, phi, out):
    for n in range(len(out)):
        sine = math.sin(theta[n])
        out[n] = point_source(table, rho[n], z[n], sine * math.cos(phi[n]), sine * math.sin(phi[n]), math.cos(theta[n]))


@njit(cache=True, nogil=True, error_model="numpy")
def _segments(points, segments, rho, z, theta, phi, length, out):
    for n in range(len(out)):
        sine = math.sin(theta[n])
        out[n] = segment_source(points, segments, length[n], rho[n], z[n], sine * math.cos(phi[n]), sine * math.sin(phi[n]),
                                math.cos(theta[n]))


@njit(cache=True, nogil=True, error_model="numpy")
def _coefficients(table, rho, z):
    """a_0 .. (N, K') at positions, and what their lobes are to be multiplied with (N,)."""
    out, factor = np.empty((len(rho), table.grid.shape[2])), np.empty(len(rho))
    for n in range(len(rho)):
        factor[n] = coefficients(table, rho[n], z[n], out[n])
    return out, factor


@njit(cache=True, nogil=True, error_model="numpy")
def coefficients(table, rho, z, out):
    """a_0 .. (K',) at a position, and what its lobe is to be multiplied with."""
    m, tangent, singular = locate.place(table.kind, table.length, max(rho, frame.CLOSEST), z)[:3]
    v = 2 / math.pi * math.atan(SKEW[table.kind] * tangent) * (table.grid.shape[1] - 3)
    out[:] = 0.0
    if m <= table.extent:
        _add_coefficients(table, m, v, 1.0, out)
    else:  # as `sums.point_source` goes on
        beyond = m - table.extent
        share = beyond / m * (frame.INSIDE / (1 - frame.INSIDE))
        _add_coefficients(table, table.extent, v, 1 + share, out)
        _add_coefficients(table, frame.INSIDE * table.extent, v, -share, out)
        out[0] += table.k0 * (share * (1 - frame.INSIDE) * table.extent - beyond)
    return table.power * singular


@njit(cache=True, nogil=True, error_model="numpy")
def _add_coefficients(table, m, v, share, out):
    """Adds a share of the coefficients at (m, v), v in steps of the grid."""
    grid = table.grid
    u = math.asinh(m / CORE[table.kind]) * table.stretch * (grid.shape[0] - 3)
    i, j = max(min(int(u), grid.shape[0] - 4), 0), max(min(int(v), grid.shape[1] - 4), 0)
    p, w = _catmull_rom(u - i), _catmull_rom(v - j)
    for row in range(4):
        for column in range(4):
            weight, corner = share * p[row] * w[column], grid[i + row, j + column]
            for k in range(len(out)):
                out[k] += weight * corner[k]


@njit(cache=True, nogil=True, error_model="numpy")
def _catmull_rom(t):
    first, last = -0.5 * t * (1 - t) * (1 - t), 0.5 * t * t * (t - 1)
    third = t * (0.5 + t * (2 - 1.5 * t))
    return first, 1 - first - third - last, third, last
