"""Looks tables of multiple scattering up: values at points, along segments, from sources of any length.

Lengths are in mean free paths.  All positions and directions have an answer: on the axis the azimuth of a direction is taken as
it is given; nearer than `frame.CLOSEST` to the axis the answer is the one there (so the source itself has a large finite value);
beyond the extent coefficients go on as 1/m, and the light as exp(-k0 m) N with them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from bakery.physics.multiple import frame, locate
from bakery.physics.multiple.frame import CORE, SKEW
from bakery.physics.multiple.table import RINGS, Table, margins

UPSAMPLED = 3  # of the basis by splines; between these points linear
_OVERLAP = 8  # points beyond an end that a spline goes through
GAUSS = 5  # points of a piece of an integral
_PIECE = 2.0  # of arsinh(distance along the segment / distance from it), at most
_TURN = 0.125  # share of an order of the directions that the pieces follow
_SHORT = 0.5  # at least, beside the ends of a segment
END, BESIDE = 0.1, 1e-4  # mfp from the ends and from the axis of a tabulated segment within which points are summed instead
GONE = 40.0  # mfp behind a position from which no light comes
X, WEIGHT = (0.5 * (a + b) for a, b in zip(np.polynomial.legendre.leggauss(GAUSS), (1.0, 0.0), strict=True))


class Ready(NamedTuple):
    """A table laid out for look-ups."""

    kind: int
    length: float
    extent: float
    k0: float
    power: float  # 1, or 0 where nothing scatters
    stretch: float  # u of a place = arsinh(m / CORE) stretch
    turn: float  # how fast lobes turn as a beam is passed: 1 as soon as it does
    grid: np.ndarray  # (U + 2, V + 2, K + 1) float32, a_0 .. a_K with margins
    basis: np.ndarray  # (A, B, K + 1) float32, B_0 .. B_K


def ready(table: Table) -> Ready:
    """Lays a table out for look-ups: about 1 MB."""
    stretch = 1 / math.asinh(table.extent / CORE[table.kind])
    if not len(table.corner):
        grid, basis = np.zeros((4, 4, 1)), np.zeros((2, 2, 1))
    else:
        grid, basis = margins(table.coefficients()), _upsampled(table.functions())
    turn = _TURN * max(2 * (table.basis.shape[1] - RINGS), 0)
    return Ready(table.kind, float(table.length), float(table.extent), float(table.k0), float(len(table.corner) > 0), stretch,
                 turn, np.ascontiguousarray(grid, np.float32), np.ascontiguousarray(basis, np.float32))


def _upsampled(functions):
    """Functions (K, A, B) on a finer grid, (A', B', K): even in the azimuth, through the poles to the other side."""
    from scipy.interpolate import CubicSpline  # takes longer to import than all of this package

    A, B = functions.shape[1:]
    over = min(_OVERLAP, A - 1, B - 1)
    other = functions[:, :, ::-1]
    tall = np.concatenate([other[:, over:0:-1], functions, other[:, -2:-2 - over:-1]], axis=1)
    rings = np.arange(-over, A + over)
    tall = CubicSpline(rings, tall, axis=1)(np.arange((A - 1) * UPSAMPLED + 1) / UPSAMPLED)
    wide = np.concatenate([tall[:, :, over:0:-1], tall, tall[:, :, -2:-2 - over:-1]], axis=2)
    wide = CubicSpline(np.arange(-over, B + over), wide, axis=2)(np.arange((B - 1) * UPSAMPLED + 1) / UPSAMPLED)
    return np.moveaxis(wide, 0, -1)


# ---- one look-up


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _catmull_rom(t):
    return (t * (-0.5 + t * (1 - 0.5 * t)), 1 + t * t * (1.5 * t - 2.5), t * (0.5 + t * (2 - 1.5 * t)), t * t * (0.5 * t - 0.5))


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _interpolated(table, m, v, a):
    """a_0 .. a_K at a place, into a."""
    grid = table.grid
    u = m / CORE[table.kind]
    u = math.log(u + math.sqrt(u * u + 1)) * table.stretch * (grid.shape[0] - 3)
    v *= grid.shape[1] - 3
    i, j = min(int(u), grid.shape[0] - 4), min(int(v), grid.shape[1] - 4)
    w0, w1, w2, w3 = _catmull_rom(v - j)
    p = _catmull_rom(u - i)
    a[:] = np.float32(0)
    for n in range(4):
        f0, f1, f2, f3 = np.float32(p[n] * w0), np.float32(p[n] * w1), np.float32(p[n] * w2), np.float32(p[n] * w3)
        for k in range(len(a)):
            a[k] += f0 * grid[i + n, j, k] + f1 * grid[i + n, j + 1, k] + f2 * grid[i + n, j + 2, k] + f3 * grid[i + n, j + 3, k]


@njit(cache=True, nogil=True, error_model="numpy")
def value(table, rho, z, x, y, along, a, b):
    """The source at (rho, z) into the direction (x along rho, y across, along z), mfp^-3 sr^-1; mfp; finite everywhere.

    table : `Ready`, of a point, or of a segment of its own length;  a, b : from `scratch`, overwritten
    """
    rho = max(rho, frame.CLOSEST)
    m, tangent, singular, sine, cosine = locate.place(table.kind, table.length, rho, z)
    s, t = locate.direction(sine, cosine, x, y, along)
    beyond = max(m - table.extent, 0.0)
    m -= beyond
    basis = table.basis
    v = (2 / math.pi) * math.atan(SKEW[table.kind] * tangent)
    _interpolated(table, m, v, a)
    if beyond > 0:
        # coefficients go on as 1/m, as they did from half the extent on
        _interpolated(table, frame.INSIDE * m, v, b)
        b[0] -= np.float32(table.k0 * (1 - frame.INSIDE) * m)
        share = np.float32(beyond / (m + beyond) * frame.INSIDE / (1 - frame.INSIDE))
        for k in range(len(a)):
            a[k] += share * (a[k] - b[k])
    s *= basis.shape[0] - 1
    t *= basis.shape[1] - 1
    i, j = min(int(s), basis.shape[0] - 2), min(int(t), basis.shape[1] - 2)
    s, t = s - i, t - j
    f0, f1, f2, f3 = np.float32((1 - s) * (1 - t)), np.float32((1 - s) * t), np.float32(s * (1 - t)), np.float32(s * t)
    for k in range(len(b)):
        b[k] = f0 * basis[i, j, k] + f1 * basis[i, j + 1, k] + f2 * basis[i + 1, j, k] + f3 * basis[i + 1, j + 1, k]
    total = a[0] + b[0]
    for k in range(1, len(a)):
        total += a[k] * b[k]
    return table.power * singular * math.exp(total - table.k0 * beyond)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def piece(turn, t):
    """Longest piece of t = arsinh(distance along a line / distance from the source) for one Gauss rule.

    The smoother the farther: lobes turn as fast as the source is passed.  At g = 0.9 pieces of 2 were 3.7 % off beside a beam,
    at worst 13 %; these are 0.01 %, at worst 0.05 %.
    """
    return 3.0 / (1 + turn / math.cosh(max(abs(t) - 1.0, 0.0)))


@njit(cache=True, nogil=True, error_model="numpy")
def any_length(points, segments, length, rho, z, x, y, along, a, b, c, d):
    """`value` of a segment of any length >= 0 (mfp): whole tiles of the tabulated one, and the rest as an integral over points.

    So are tiles on whose ends or axis the position nearly lies: there the table of segments is too coarse.

    a, b : scratch of the table of points;  c, d : of segments
    """
    tile = segments.length
    if length == tile and not _touches(rho, z, tile):
        return value(segments, rho, z, x, y, along, c, d)
    length = min(length, max(z, 0.0) + GONE) if length > tile else length
    whole = int(length / tile * (1 + 1e-12))
    total = 0.0
    for n in range(whole):
        start = n * tile
        if _touches(rho, z - start, tile):
            total += _beam(points, start, start + tile, rho, z, x, y, along, a, b)
        else:
            total += math.exp(-start) * value(segments, rho, z - start, x, y, along, c, d)
    start = whole * tile
    if length - start > 1e-12 * tile:
        total += _beam(points, start, length, rho, z, x, y, along, a, b)
    return total


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _touches(rho, z, length):
    """Whether a position lies within END of an end of a segment, or within BESIDE of the segment."""
    away = min(abs(z), abs(z - length))
    return rho * rho + away * away < END * END or (rho < BESIDE and 0 < z < length)


@njit(cache=True, nogil=True, error_model="numpy")
def _beam(points, start, end, rho, z, x, y, along, a, b):
    """Integral of exp(-s) times the table of points over places s from start to end of a beam."""
    # s - z = close sinh(t): the source falls off as 1/cosh(t), however close the segment is; beside an end, where a forward peak
    # is cut off, pieces are short where the angle to the beam turns
    close = max(rho, frame.CLOSEST)
    t, last = math.asinh((start - z) / close), math.asinh((end - z) / close)
    shortest = _SHORT if _touches(rho, z - start, end - start) else _PIECE
    total = 0.0
    while t < last:
        step = min(_PIECE, max(shortest, 0.5 * abs(t)), piece(points.turn, t), last - t)
        for n in range(GAUSS):
            there = t + X[n] * step
            away = close * math.sinh(there)
            from_point = value(points, rho, -away, x, y, along, a, b)
            total += WEIGHT[n] * step * close * math.cosh(there) * math.exp(-(z + away)) * from_point
        t = last if last - t <= step else t + step
    return total


# ---- arrays of look-ups


def point(table: Ready, rho, z, theta, phi):
    """Source of the third and later events around a point where power 1 enters its first collision travelling along +z.

    Parameters
    ----------
    table : `ready` one of a point source
    rho, z : mfp; theta, phi : rad, direction of travel from +z, and from the azimuth of the position; all broadcast

    Returns
    -------
    mfp^-3 sr^-1, finite everywhere; error: `Table.error`
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
    """Lobes (N, A, B) of the table's own source in the frames of positions (N,), at polar (A,) and azimuth (B,)."""
    out = np.empty((len(rho), len(polar), len(azimuth)))
    _lobes(table, *(np.ascontiguousarray(x, float) for x in (rho, z, polar, azimuth)), out)
    return out


def _broadcast(*arrays):
    arrays = np.broadcast_arrays(*(np.asarray(x, float) for x in arrays))
    return [np.ascontiguousarray(x).reshape(-1) for x in arrays], np.empty(arrays[0].shape)


@njit(cache=True, nogil=True, error_model="numpy")
def _points(table, rho, z, theta, phi, out):
    a, b = scratch(table)
    for n in range(len(out)):
        sine = math.sin(theta[n])
        out[n] = value(table, rho[n], z[n], sine * math.cos(phi[n]), sine * math.sin(phi[n]), math.cos(theta[n]), a, b)


@njit(cache=True, nogil=True, error_model="numpy")
def _segments(points, segments, rho, z, theta, phi, length, out):
    a, b = scratch(points)
    c, d = scratch(segments)
    for n in range(len(out)):
        sine = math.sin(theta[n])
        if length[n] == segments.length and not _touches(rho[n], z[n], length[n]):
            out[n] = value(segments, rho[n], z[n], sine * math.cos(phi[n]), sine * math.sin(phi[n]), math.cos(theta[n]), c, d)
            continue
        out[n] = any_length(points, segments, length[n], rho[n], z[n], sine * math.cos(phi[n]), sine * math.sin(phi[n]),
                            math.cos(theta[n]), a, b, c, d)


@njit(cache=True, nogil=True, error_model="numpy")
def _lobes(table, rho, z, polar, azimuth, out):
    a, b = scratch(table)
    for n in range(len(rho)):
        sine, cosine = locate.place(table.kind, table.length, max(rho[n], frame.CLOSEST), z[n])[3:]
        for i in range(len(polar)):
            across, forward = math.sin(polar[i]), math.cos(polar[i])
            for j in range(len(azimuth)):
                side = across * math.cos(azimuth[j])
                out[n, i, j] = value(table, rho[n], z[n], forward * sine - side * cosine, across * math.sin(azimuth[j]),
                                     forward * cosine + side * sine, a, b)


@njit(cache=True, nogil=True, error_model="numpy")
def scratch(table):
    """Memory of one thread for `value` and `any_length` of a table: two arrays (K + 1,) float32."""
    count = table.grid.shape[2]
    return np.empty(count, np.float32), np.empty(count, np.float32)
