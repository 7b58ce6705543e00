"""The in-scattered source around a point where light enters its first collision: values at positions and directions.

Position (rho, z), direction of travel (theta from +z, phi from the azimuth of the position).  All in mean free paths.
"""

import math
from typing import NamedTuple

import numpy as np

from bakery.physics.multiple import _kernels
from bakery.physics.multiple._products import multiply
from bakery.physics.multiple._tiles import LANES
from bakery.physics.multiple.fourier import Propagator, stencil
from bakery.system.compiled import njit

_LOBES = 4  # at a time: as many as a tile has rows

def value(medium: Propagator, rho, z, theta, phi):
    """T_P(rho, z, theta, phi): light that the events of `medium` scatter into a direction, per unit volume.

    Parameters
    ----------
    medium : from `fourier.propagator`
    rho, z, theta, phi : broadcast; mfp, mfp, rad, rad

    Returns
    -------
    mfp^-3 sr^-1 for power 1 that enters its first collision at the origin travelling along +z.  At the source the value at
    r = 0.01 continues as 1/r; at r = 0 itself it is infinite.
    """
    rho, z, theta, phi = np.broadcast_arrays(*(np.asarray(x, float) for x in (rho, z, theta, phi)))
    shape = rho.shape
    rho, z, theta, phi = (np.ravel(x) for x in (rho, z, theta, phi))
    out = np.full(len(rho), np.inf if medium.albedo > 0 else 0.0)
    # positions are dear, directions cheap: each position once
    places, which = np.unique(np.column_stack([rho, z]), axis=0, return_inverse=True)
    by_place = np.argsort(which, kind="stable")
    ends = np.searchsorted(which[by_place], np.arange(len(places) + 1))
    for n, (x, y) in enumerate(places):
        r = math.hypot(x, y)
        if r > 0:
            these = by_place[ends[n]:ends[n + 1]]
            c = coefficients(medium, r, math.atan2(x, y))
            polar, azimuth = to_frame(math.atan2(x, y), theta[these], phi[these])
            out[these] = evaluate(c, medium.order, polar, azimuth)
    return out.reshape(shape)


def coefficients(medium: Propagator, r, angle):
    """Harmonic coefficients of the source at distance r and angle from the axis, in the frame of `to_frame`.

    r, angle : (...,) broadcast; mfp > 0, rad from +z

    Returns (..., (L + 1)(L + 2)/2) coefficient l (l + 1)/2 + m of Y_lm for m >= 0; -m has the same times (-1)^m
    """
    r, angle = np.broadcast_arrays(np.asarray(r, float), np.asarray(angle, float))
    shape = r.shape
    r, which = np.unique(r.ravel(), return_inverse=True)
    index, weight = stencil(medium.log_r, np.log(r))
    weight = weight * (np.exp(-medium.k0 * r) / r)
    by_r = np.argsort(which, kind="stable")
    ends = np.searchsorted(which[by_r], np.arange(len(r) + 1))
    out = np.empty((len(which), (medium.order + 1) * (medium.order + 2) // 2))
    angles, seen = np.unique(angle.ravel(), return_inverse=True)  # places on a grid have few
    _coefficients(medium.by_distance, index, np.ascontiguousarray(weight.T), by_r, ends, seen,
                  harmonics(medium.order, angles), medium.order, out)
    return out.reshape(*shape, -1)


def integral(medium: Propagator, r, angle):
    """Integral of the source over all directions, mfp^-3, at r, angle as for `coefficients`."""
    r, angle = np.broadcast_arrays(np.asarray(r, float), np.asarray(angle, float))
    first = np.array([_kernels.packed(j, 0, 0) for j in range(medium.order + 1)])
    of_r, which = np.unique(r.ravel(), return_inverse=True)
    column = medium.at(of_r, first)
    zonal = np.array([j * (j + 1) // 2 for j in range(medium.order + 1)])
    source = harmonics(medium.order, angle.ravel())[:, zonal]
    return math.sqrt(4 * math.pi) * np.einsum("jn,nj->n", column[:, which], source).reshape(r.shape)


def to_frame(angle, theta, phi):
    """Direction (theta, phi) in the frame whose axis points from the source to the position, source direction at azimuth 0.

    angle : of the position from +z, rad;  theta, phi : of the direction, rad; all broadcast

    Returns polar, azimuth : rad
    """
    x, y, z = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)
    sine, cosine = np.sin(angle), np.cos(angle)
    forward, side = x * sine + z * cosine, z * sine - x * cosine
    return np.arctan2(np.hypot(side, y), forward), np.arctan2(y, side)


def evaluate(c, order, polar, azimuth):
    """Sum of harmonics with coefficients c (P,) at directions (N,), (N,)."""
    return _evaluate(np.ascontiguousarray(c, float), harmonics(order, polar), np.ascontiguousarray(azimuth, float), order)


class Directions(NamedTuple):
    """A grid of directions at which many lobes are wanted.

    harmonics : ((L + 1)(L + 2)/2, A), for m = 0, 1, .. those of l = m .. L
    turns : (L + 1, B), cos(m azimuth), twice that for m > 0
    """

    harmonics: np.ndarray
    turns: np.ndarray


def directions(order, polar, azimuth) -> Directions:
    """The grid of polar (A,) and azimuth (B,), rad."""
    m = np.arange(order + 1)[:, None]
    by_m = np.concatenate([l * (l + 1) // 2 + n for n in range(order + 1) for l in [np.arange(n, order + 1)]])
    turns = np.cos(m * np.asarray(azimuth, float)) * np.where(m == 0, 1.0, 2.0)
    return Directions(np.ascontiguousarray(harmonics(order, polar).T[by_m]), turns)


def lobes(c, order, polar, azimuth):
    """Many lobes on one grid of directions.

    c : (N, (L + 1)(L + 2)/2) coefficients
    polar, azimuth : (A,), (B,) rad, in the frame of the coefficients

    Returns (N, A, B)
    """
    return lobes_at(c, directions(order, polar, azimuth))


def lobes_at(c, grid: Directions):
    """`lobes` in `directions` that are known already."""
    return _lobes(np.ascontiguousarray(c, float), *grid)


def harmonics(order, theta):
    """Y_lm(theta, 0), orthonormal with the Condon-Shortley phase, (N, (L + 1)(L + 2)/2), element l (l + 1)/2 + m."""
    theta = np.atleast_1d(np.asarray(theta, float))
    return _harmonics(order, np.cos(theta), np.sin(theta))


@njit(cache=True, nogil=True, error_model="numpy")
def _harmonics(order, cosine, sine):
    out = np.empty((len(cosine), (order + 1) * (order + 2) // 2))
    for n in range(len(cosine)):
        x = cosine[n]
        diagonal = math.sqrt(1 / (4 * math.pi))
        for m in range(order + 1):
            if m > 0:
                diagonal *= -math.sqrt((2 * m + 1) / (2.0 * m)) * sine[n]
            out[n, m * (m + 1) // 2 + m] = diagonal
            before, value = 0.0, diagonal
            for l in range(m + 1, order + 1):
                # x Y_(l-1) = b_l Y_l + b_(l-1) Y_(l-2), b the coupling of neighbouring orders
                after = (x * value - math.sqrt(_kernels.coupling(l - 1.0, m)) * before if l > m + 1 else x * value)
                before, value = value, after / math.sqrt(_kernels.coupling(float(l), m))
                out[n, l * (l + 1) // 2 + m] = value
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _coefficients(scaled, index, weight, by_r, ends, seen, source, order, out):
    """Positions by_r[ends[i]:ends[i + 1]] lie at distance i; scaled (R, P), index (U,) and weight (U, 8) of its interpolation;
    position n sees the source as source[seen[n]]."""
    of = np.empty(scaled.shape[1])
    for i in range(len(index)):
        of[:] = 0.0
        for tap in range(weight.shape[1]):
            share, row = weight[i, tap], scaled[index[i] + tap]
            if share != 0:
                for n in range(len(of)):
                    of[n] += share * row[n]
        together = by_r[ends[i]:ends[i + 1]]
        if len(together) == 1:
            _spread(of, source[seen[together[0]]], order, out[together[0]])
        else:
            _spread_many(of, together, seen, source, order, out)


@njit(cache=True, nogil=True, error_model="numpy")
def _spread(of, y, order, c):
    """c of one source y, from the elements of T at its distance."""
    c[:] = 0.0
    for j in range(order + 1):
        column = j * (j + 1) // 2
        for l in range(j):
            at, row_l = _kernels.packed(j, l, 0), l * (l + 1) // 2
            for m in range(l + 1):
                c[row_l + m] += of[at + m] * y[column + m]
                c[column + m] += of[at + m] * y[row_l + m]
        at = _kernels.packed(j, j, 0)
        for m in range(j + 1):
            c[column + m] += of[at + m] * y[column + m]


@njit(cache=True, nogil=True, error_model="numpy")
def _spread_many(of, together, seen, source, order, out):
    """`_spread` of several sources at one distance: a product of matrices for each m."""
    count = len(together)
    columns = -(-count // LANES) * LANES
    square, y, c = np.empty((order + 1, order + 1)), np.zeros((order + 1, columns)), np.empty((order + 1, columns))
    for m in range(order + 1):
        size = order + 1 - m
        for j in range(size):
            for n in range(count):
                y[j, n] = source[seen[together[n]], (j + m) * (j + m + 1) // 2 + m]
            for l in range(j + 1):
                element = of[_kernels.packed(j + m, l + m, m)]
                square[j, l], square[l, j] = element, element
        multiply((square, 0, order + 1, 1), (y, 0, columns), (c, 0, columns), size, columns, size)
        for j in range(size):
            for n in range(count):
                out[together[n], (j + m) * (j + m + 1) // 2 + m] = c[j, n]


@njit(cache=True, nogil=True, error_model="numpy")
def _evaluate(c, y, azimuth, order):
    out = np.zeros(len(azimuth))
    for n in range(len(azimuth)):
        turn = math.cos(azimuth[n])
        before, now = turn, 1.0  # cos((m - 1) phi), cos(m phi)
        for m in range(order + 1):
            total = 0.0
            for l in range(m, order + 1):
                at = l * (l + 1) // 2 + m
                total += c[at] * y[n, at]
            out[n] += total * (1.0 if m == 0 else 2 * now)
            before, now = now, 2 * turn * now - before
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _lobes(c, y, turns):
    A, (M, B) = y.shape[1], turns.shape
    out = np.empty((len(c), A, B))
    by_m, rings = np.empty((_LOBES, len(y))), np.empty((_LOBES, M, A))
    for first in range(0, len(c), _LOBES):
        height = min(_LOBES, len(c) - first)
        at = 0
        for m in range(M):
            count = M - m
            for i in range(height):
                for l in range(m, M):
                    by_m[i, at + l - m] = c[first + i, l * (l + 1) // 2 + m]
            multiply((by_m, at, len(y), 1), (y, at * A, A), (rings, m * A, M * A), height, A, count)
            at += count
        for i in range(height):
            multiply((rings, i * M * A, 1, A), (turns, 0, B), (out, (first + i) * A * B, B), A, B, M)
    return out
