"""The in-scattered source beside a beam: the point source summed along it, weighted with what the beam has left.

T_S(x; l) = int_0^l exp(-s) T_P(x - s z) ds: power 1 enters the medium at the origin along +z; first collisions between 0 and l.
All in mean free paths.
"""

import math
from functools import cache

import numpy as np
from scipy.ndimage import spline_filter1d
from scipy.special import roots_legendre

from bakery.physics.multiple import _plane
from bakery.physics.multiple import point as points
from bakery.physics.multiple.fourier import Propagator

_PER_ORDER = 0.8  # angles of the point table a radian and order
_MARGIN = 12  # angles beyond 0 and pi: what the end of a spline does has died out
_TURNS = 0.125  # share of an order that the points follow
_GONE = 40.0  # mfp after which nothing is left of the beam
_AXIS = 1e-9  # mfp, closest to the axis


def value(medium: Propagator, rho, z, theta, phi, length):
    """T_S(rho, z, theta, phi; length), mfp^-3 sr^-1.

    medium : from `fourier.propagator`
    rho, z, theta, phi : broadcast; mfp, mfp, rad, rad (phi from the azimuth of the position)
    length : mfp > 0, inf for a pencil of light

    Of the arguments' shape.  On the segment itself the source is infinite (as log rho); there it is the value at rho = 1e-9.
    """
    rho, z, theta, phi = np.broadcast_arrays(*(np.asarray(x, float) for x in (rho, z, theta, phi)))
    shape = rho.shape
    theta, phi = theta.ravel(), phi.ravel()
    places, which = np.unique(np.column_stack([rho.ravel(), z.ravel()]), axis=0, return_inverse=True)
    axis = local_axis(places[:, 0], places[:, 1], length)
    c = coefficients(medium, places[:, 0], places[:, 1], length, axis)
    out = np.empty(len(theta))
    for n in range(len(places)):
        these = which == n
        out[these] = points.evaluate(c[n], medium.order, *points.to_frame(axis[n], theta[these], phi[these]))
    return out.reshape(shape)


def local_axis(rho, z, length):
    """Angle from +z of the direction half way between those from both ends of the segment to the position, rad."""
    length = min(length, _GONE)
    return (np.arctan2(rho, z) + np.arctan2(rho, np.asarray(z) - length)) / 2


def coefficients(medium: Propagator, rho, z, length, axis, *, fine=1.0):
    """Harmonic coefficients of the source at many positions, each in the frame about its axis (`point.to_frame`).

    rho, z : (N,) mfp
    length : mfp
    axis : (N,) rad from +z, of the frames
    fine : scales the number of points along the segment (`_rule`)

    Returns (N, (L + 1)(L + 2)/2), element l (l + 1)/2 + m

    Cubic splines in ln r and the angle of a table of the point source.  Error 1e-5 .. 1e-4 of the lobe (see docs/multiple.md).
    """
    rho, z, axis = (np.atleast_1d(np.asarray(x, float)) for x in (rho, z, axis))
    order = medium.order
    count = math.ceil(math.pi * _PER_ORDER * max(order, 16))
    grid = math.pi / count * (np.arange(count + 2 * _MARGIN + 1) - _MARGIN)
    points_of, owners_angle, rows = _points(medium, grid, _rule(rho, z, length, order, fine), axis)
    harmonics, turns = _waves(order, grid), _plane.quarter_turns(order)
    out = np.empty((len(rho), (order + 1) * (order + 2) // 2))
    for last in range(order, max(order - 2, -1), -1):  # even and odd orders: phases of either at a time
        phases = _plane.phases(owners_angle, last % 2)
        for l in range(last, -1, -2):
            table = _plane.point_table(l, order, medium.by_distance, rows, harmonics, len(grid), turns[l])
            _plane.along(l, table, turns[l], points_of, phases, out)
    return out


def _waves(order, grid):
    """Spline coefficients along the angle of all harmonics, (L + 1, L + 1, H) by m and l, of the first half of a grid (A,).

    A spline is linear in its values: along r and along the angle the factors are turned into coefficients.
    """
    half = (len(grid) + 1) // 2
    waves = spline_filter1d(points.harmonics(order, grid).T, axis=1, mode="mirror")[:, :half]
    out = np.zeros((order + 1, order + 1, half))
    for l in range(order + 1):
        out[:l + 1, l] = waves[l * (l + 1) // 2:(l + 1) * (l + 2) // 2]
    return out


def _points(medium, grid, rule, axis):
    """`_plane.Points` of a rule from `_rule`, their angles from the axes (N,) of the positions, and which rows a table needs."""
    start, r, angle, weight = rule
    row, along_r = _spline(medium.log_r, np.log(r))
    column, along_angle = _spline(grid, angle)
    along_r *= (weight * np.exp(-medium.k0 * r) / r)[:, None]
    owner = np.repeat(np.arange(len(axis)), np.diff(start))
    by_place = np.lexsort((column, row))
    turned = (angle - axis[owner])[by_place]
    owner, row, column = owner[by_place], row[by_place], column[by_place]
    along_r, along_angle = (weights[by_place].astype(np.float32) for weights in (along_r, along_angle))
    weights = (along_r[:, :, None] * along_angle[:, None, :]).reshape(len(owner), -1)
    first = np.flatnonzero(np.append(True, (np.diff(row) != 0) | (np.diff(column) != 0)))
    # distances that no position needs are left out of the table
    lowest = row[0]
    rows = int(lowest), int(row[-1] + _plane.TAPS - lowest)
    return _plane.Points(owner, weights, np.append(first, len(owner)), row[first] - lowest, column[first]), turned, rows


def integral(medium: Propagator, rho, z, length, fine=1.0):
    """Integral of the source over all directions at positions (N,), mfp^-3."""
    rho, z = (np.atleast_1d(np.asarray(x, float)) for x in (rho, z))
    start, r, angle, weight = _rule(rho, z, length, medium.order, fine)
    return np.add.reduceat(weight * points.integral(medium, r, angle), start[:-1])


@cache
def _gauss(count):
    """Nodes and weights, cached: a table needs the same few hundreds of times.  NumPy's take ten times as long."""
    return roots_legendre(count)


def _rule(rho, z, length, order, fine):
    """Points along the segment: Gauss's rule in t + b gd(t), t = asinh((s - z) / rho), b growing with the order.

    In t the source is smooth however close the segment is; the Gudermannian gd(t), the angle under which a point of the segment
    is seen, spreads the points where the harmonics turn.

    Returns
    -------
    start : (N + 1,) first point of each position
    r, angle, weight : (Q,) distance, angle from +z as seen from the point of the segment; weight with exp(-s)
    """
    length = min(length, _GONE)
    close = np.maximum(rho, _AXIS)
    b = _TURNS * order

    def stretched(t):
        return t + 2 * b * np.arctan(np.tanh(t / 2))

    begin, end = np.arcsinh(-z / close), np.arcsinh((length - z) / close)
    first, last = stretched(begin), stretched(end)
    counts = np.ceil(6 + fine * 2 * (last - first)).astype(int)
    start = np.concatenate([[0], np.cumsum(counts)])
    r, angle, weight = np.empty(start[-1]), np.empty(start[-1]), np.empty(start[-1])
    grid = np.linspace(min(begin.min(), -1.0), max(end.max(), 1.0), 4000)
    for count in np.unique(counts):
        these = np.flatnonzero(counts == count)
        places = start[these, None] + np.arange(count)
        x, gauss = _gauss(count)
        half = (last - first)[these, None] / 2
        at = (first + last)[these, None] / 2 + half * x
        t = np.interp(at, stretched(grid), grid)
        for _ in range(2):
            t -= (stretched(t) - at) / (1 + b / np.cosh(t))
        away = close[these, None] * np.sinh(t)  # s - z
        r[places], angle[places] = close[these, None] * np.cosh(t), np.arctan2(close[these, None], -away)
        weight[places] = (half * gauss / (1 + b / np.cosh(t)) * r[places]
                          * np.exp(-np.clip(z[these, None] + away, 0.0, length)))
    return start, r, angle, weight


def _spline(grid, x):
    """First coefficient (X,) and weights (X, 4) of a uniform cubic spline that has one coefficient more than points; held below
    the second point and beyond the last."""
    t = np.clip((x - grid[0]) / (grid[1] - grid[0]), 1, len(grid) - 1)
    index = np.minimum(np.floor(t).astype(int), len(grid) - 2)
    t = t - index
    return index - 1, np.stack([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, 1 + 3 * t + 3 * t**2 - 3 * t**3, t**3], axis=1) / 6
