"""What renderers ask of the tables: light from a point or a segment source, at a point or gathered along a line of sight.

Positions and lengths are in mean free paths, directions are unit vectors along which light travels, sources have power 1.  All
arguments broadcast; vectors have three components on the last axis.  The medium is infinite: no boundary, no shadow.

A line of sight starts at the eye and looks along `view`; light comes against it.  The integral is taken in
t = arsinh(distance along the line / distance from the source), in which it is smooth however close the line passes; the source
itself is never closer than `frame.CLOSEST`.  There a value on the source is taken (straight beside it, the direction's azimuth
counted from there), and a line of sight through a point source, whose integral grows without limit as a logarithm, is cut off.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from bakery.physics.multiple import frame, lookup
from bakery.physics.multiple._elementary import exp
from bakery.physics.multiple._look import add, emptied, total, value
from bakery.physics.multiple.lookup import Ready, add_beam, any_length, gauss, piece

_GAUSS = 4  # points of a piece of a line of sight
X, WEIGHT = gauss(_GAUSS)
PIECE = 1.0  # of arsinh, for one Gauss rule
STRIDE = 3.0  # mfp, the same where the source is far


def point_to_point(points: Ready, vertex, incoming, target, outgoing):
    """In-scattered light of third and later events at `target` into `outgoing`.

    Parameters
    ----------
    points : `lookup.ready` table of a point source
    vertex, incoming : (..., 3) where power 1 enters its first collision, and its direction before it
    target, outgoing : (..., 3)

    Returns
    -------
    (...) mfp^-3 sr^-1
    """
    vectors, _, out = _arrays((vertex, incoming, target, outgoing), ())
    _point_to_point(points, *vectors, out.reshape(-1))
    return out


def segment_to_point(points: Ready, segments: Ready, origin, direction, length, target, outgoing):
    """The same for a beam of power 1 from `origin` along `direction`, whose first events within `length` (...) count."""
    vectors, (length,), out = _arrays((origin, direction, target, outgoing), (length,))
    _segment_to_point(points, segments, *vectors, length, out.reshape(-1))
    return out


def point_to_segment(points: Ready, vertex, incoming, eye, view, distance):
    """Radiance at the eye: integral of exp(-t) point_to_point(eye + t view, -view) over t from 0 to `distance`.

    Returns
    -------
    (...) mfp^-2 sr^-1; the sum over samples is within 1e-4 of the integral over the table
    """
    vectors, (distance,), out = _arrays((vertex, incoming, eye, view), (distance,))
    _to_segment(points, points, False, *vectors, np.zeros_like(distance), distance, out.reshape(-1))
    return out


def segment_to_segment(points: Ready, segments: Ready, origin, direction, length, eye, view, distance):
    """Radiance at the eye from a beam: as `point_to_segment`, with segment_to_point under the integral."""
    vectors, (length, distance), out = _arrays((origin, direction, eye, view), (length, distance))
    _to_segment(points, segments, True, *vectors, length, distance, out.reshape(-1))
    return out


def _arrays(vectors, scalars):
    vectors = [np.asarray(v, float) for v in vectors]
    for v in vectors:
        if v.shape[-1:] != (3,):
            raise ValueError(f"a position or direction has shape {v.shape}; its last axis must hold three components")
    scalars = [np.asarray(s, float) for s in scalars]
    shape = np.broadcast_shapes(*(v.shape[:-1] for v in vectors), *(s.shape for s in scalars))
    # copies, which can be written to: one kind of array is compiled for
    return ([np.array(np.broadcast_to(v, (*shape, 3)), order="C").reshape(-1, 3) for v in vectors],
            [np.array(np.broadcast_to(s, shape), order="C").reshape(-1) for s in scalars], np.empty(shape))


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, nogil=True, error_model="numpy")
def _local(px, py, pz, axis, outgoing, turn):
    """rho, z of a place relative to the source, and a direction (times turn) along rho, across, along z."""
    z = px * axis[0] + py * axis[1] + pz * axis[2]
    qx, qy, qz = px - z * axis[0], py - z * axis[1], pz - z * axis[2]
    rho = math.sqrt(qx * qx + qy * qy + qz * qz)
    along = turn * _dot(outgoing, axis)
    flat = math.sqrt(max(1 - along * along, 0.0))
    # on the axis the azimuth means nothing
    side = turn * (outgoing[0] * qx + outgoing[1] * qy + outgoing[2] * qz) / rho if rho > 0 else flat
    return rho, z, side, math.sqrt(max(flat * flat - side * side, 0.0)), along


@njit(cache=True, nogil=True, error_model="numpy")
def _point_to_point(points, vertex, incoming, target, outgoing, out):
    for n in range(len(out)):
        p, q = target[n], vertex[n]
        rho, z, x, y, along = _local(p[0] - q[0], p[1] - q[1], p[2] - q[2], incoming[n], outgoing[n], 1.0)
        out[n] = value(points, rho, z, x, y, along)


@njit(cache=True, nogil=True, error_model="numpy")
def _segment_to_point(points, segments, origin, direction, target, outgoing, length, out):
    for n in range(len(out)):
        p, q = target[n], origin[n]
        rho, z, x, y, along = _local(p[0] - q[0], p[1] - q[1], p[2] - q[2], direction[n], outgoing[n], 1.0)
        out[n] = any_length(points, segments, length[n], rho, z, x, y, along)


@njit(cache=True, nogil=True, error_model="numpy")
def _to_segment(points, segments, beam, origin, direction, eye, view, length, distance, out):
    of_points, of_tiles = emptied(), emptied()
    for n in range(len(out)):
        o, e, v, axis = origin[n], eye[n], view[n], direction[n]
        ox, oy, oz = o[0] - e[0], o[1] - e[1], o[2] - e[2]
        # the place of the source that the line of sight passes closest
        cosine, s = _dot(axis, v), 0.0
        if beam and cosine * cosine < 1:
            ahead = ox * v[0] + oy * v[1] + oz * v[2]
            s = (cosine * ahead - (ox * axis[0] + oy * axis[1] + oz * axis[2])) / (1 - cosine * cosine)
            s = min(max(s, 0.0), length[n])
        ox, oy, oz = ox + s * axis[0], oy + s * axis[1], oz + s * axis[2]
        middle = ox * v[0] + oy * v[1] + oz * v[2]
        hx, hy, hz = ox - middle * v[0], oy - middle * v[1], oz - middle * v[2]
        close = max(math.sqrt(hx * hx + hy * hy + hz * hz), frame.CLOSEST)
        far = min(distance[n], max(middle, 0.0) + lookup.GONE)
        low, high = math.asinh(-middle / close), math.asinh((far - middle) / close)
        while low < high:
            step = min(PIECE, piece(points.turn, low), math.asinh(math.sinh(low) + STRIDE / close) - low)
            step = max(min(step, high - low), 1e-9)
            for i in range(_GAUSS):
                up = exp(low + X[i] * step)
                t = middle + close * 0.5 * (up - 1 / up)
                weight = WEIGHT[i] * step * close * 0.5 * (up + 1 / up) * exp(-t)
                px, py, pz = e[0] + t * v[0] - o[0], e[1] + t * v[1] - o[1], e[2] + t * v[2] - o[2]
                rho, z, x, y, along = _local(px, py, pz, axis, v, -1.0)
                if beam:
                    add_beam(of_points, of_tiles, points, segments, length[n], rho, z, x, y, along, weight)
                else:
                    add(of_points, points, rho, z, x, y, along, weight)
            low += step
        out[n] = total(of_points, points) + total(of_tiles, segments)
