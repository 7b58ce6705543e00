"""What renderers ask of the tables: light from a point or a segment source, at a point or gathered along a line of sight.

Positions and lengths are in mean free paths, directions are unit vectors along which light travels, sources have power 1.  All
arguments broadcast; vectors have three components on the last axis.  The medium is infinite: no boundary, no shadow.

A line of sight starts at the eye and looks along `view`; light comes against it.  The integral is taken in
t = arsinh(distance along the line / distance from the source), in which it is smooth however close the line passes; the source
itself is never closer than `frame.CLOSEST`.  There a value on the source is taken (straight beside it, the direction's azimuth
counted from there), and a line of sight through a point source, whose integral grows without limit as a logarithm, is cut off.
"""

import math

import numpy as np

from bakery.physics.lent import lent
from bakery.physics.multiple import frame, lookup
from bakery.physics.multiple._elementary import asinh, exp
from bakery.physics.multiple.lookup import Ready, add_segment_look_up, gauss, piece, segment_source
from bakery.physics.multiple.sums import add_look_up, no_look_ups, point_source, sum_of_look_ups
from bakery.system.compiled import njit

_GAUSS = 4  # points of a piece of a line of sight
X, WEIGHT = gauss(_GAUSS)
PIECE = 1.0  # of arsinh, for one Gauss rule
STRIDE = 3.0  # mfp, the same where the source is far


def point_to_point(points: Ready, vertex, incoming, target, outgoing):
    """In-scattered light of third and later events at `target` into `outgoing`.

    points : `lookup.ready` table of a point source
    vertex, incoming : (..., 3) where power 1 enters its first collision, and its direction before it
    target, outgoing : (..., 3)

    Returns (...) mfp^-3 sr^-1
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

    Returns (...) mfp^-2 sr^-1; the sum over samples is within 1e-4 of the integral over the table
    """
    vectors, (distance,), out = _arrays((vertex, incoming, eye, view), (distance,))
    _to_segment(points, points, False, tuple(vectors), np.zeros_like(distance), distance, out.reshape(-1))
    return out


def segment_to_segment(points: Ready, segments: Ready, origin, direction, length, eye, view, distance):
    """Radiance at the eye from a beam: as `point_to_segment`, with segment_to_point under the integral."""
    vectors, (length, distance), out = _arrays((origin, direction, eye, view), (length, distance))
    _to_segment(points, segments, True, tuple(vectors), length, distance, out.reshape(-1))
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


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
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
        p, q = _vector(target, n), _vector(vertex, n)
        rho, z, x, y, along = _local(p[0] - q[0], p[1] - q[1], p[2] - q[2], _vector(incoming, n), _vector(outgoing, n), 1.0)
        out[n] = point_source(points, rho, z, x, y, along)


@njit(cache=True, nogil=True, error_model="numpy")
def _segment_to_point(points, segments, origin, direction, target, outgoing, length, out):
    for n in range(len(out)):
        p, q = _vector(target, n), _vector(origin, n)
        rho, z, x, y, along = _local(p[0] - q[0], p[1] - q[1], p[2] - q[2], _vector(direction, n), _vector(outgoing, n), 1.0)
        out[n] = segment_source(points, segments, length[n], rho, z, x, y, along)


@njit(cache=True, nogil=True, error_model="numpy")
def _to_segment(points, segments, beam, vectors, length, distance, out):
    origin, direction, eye, view = vectors
    for n in range(len(out)):
        o, e, v, axis = _vector(origin, n), _vector(eye, n), _vector(view, n), _vector(direction, n)
        if beam:
            out[n] = segment_source_seen(points, segments, length[n], o, axis, e, v, distance[n])
        else:
            out[n] = point_source_seen(points, o, axis, e, v, distance[n])


@njit(nogil=True, error_model="numpy", forceinline=True)
def _vector(array, n):
    return array[n, 0], array[n, 1], array[n, 2]


@njit(cache=True, nogil=True, error_model="numpy")
def point_source_seen(points, vertex, incoming, eye, view, distance):
    """`point_to_segment` of one line of sight: vectors are tuples of three floats."""
    points, to = lent(points), no_look_ups()
    middle, close, low, high = _sight(vertex, eye, view, distance)
    while low < high:
        step = _step(points, close, low, high)
        for i in range(_GAUSS):
            t, weight = _sample(middle, close, low, step, i)
            rho, z, x, y, along = _seen_from(vertex, incoming, eye, view, t)
            add_look_up(to, points, rho, z, x, y, along, weight)
        low += step
    return sum_of_look_ups(to, points)


@njit(cache=True, nogil=True, error_model="numpy")
def segment_source_seen(points, segments, length, origin, direction, eye, view, distance):
    """`segment_to_segment` of one line of sight."""
    points, segments = lent(points), lent(segments)
    of_points, of_tiles = no_look_ups(), no_look_ups()
    # the place of the source that the line of sight passes closest
    cosine, s = _dot(direction, view), 0.0
    if cosine * cosine < 1:
        to = origin[0] - eye[0], origin[1] - eye[1], origin[2] - eye[2]
        s = min(max((cosine * _dot(to, view) - _dot(to, direction)) / (1 - cosine * cosine), 0.0), length)
    nearest = origin[0] + s * direction[0], origin[1] + s * direction[1], origin[2] + s * direction[2]
    middle, close, low, high = _sight(nearest, eye, view, distance)
    while low < high:
        step = _step(points, close, low, high)
        for i in range(_GAUSS):
            t, weight = _sample(middle, close, low, step, i)
            rho, z, x, y, along = _seen_from(origin, direction, eye, view, t)
            add_segment_look_up(of_points, of_tiles, points, segments, length, rho, z, x, y, along, weight)
        low += step
    return sum_of_look_ups(of_points, points) + sum_of_look_ups(of_tiles, segments)


@njit(nogil=True, error_model="numpy", forceinline=True)
def _sight(source, eye, view, distance):
    """Where along the line, and how close, it passes the source; arsinh of both ends."""
    to = source[0] - eye[0], source[1] - eye[1], source[2] - eye[2]
    middle = _dot(to, view)
    hx, hy, hz = to[0] - middle * view[0], to[1] - middle * view[1], to[2] - middle * view[2]
    close = max(math.sqrt(hx * hx + hy * hy + hz * hz), frame.CLOSEST)
    far = min(distance, max(middle, 0.0) + lookup.GONE)
    return middle, close, asinh(-middle / close), asinh((far - middle) / close)


@njit(nogil=True, error_model="numpy", forceinline=True)
def _step(points, close, low, high):
    step = min(PIECE, piece(points.turn, low), asinh(math.sinh(low) + STRIDE / close) - low)
    return max(min(step, high - low), 1e-9)


@njit(nogil=True, error_model="numpy", forceinline=True)
def _sample(middle, close, low, step, i):
    """Distance along the line, and the weight of what is scattered there."""
    up = exp(low + X[i] * step)
    t = middle + close * 0.5 * (up - 1 / up)
    return t, WEIGHT[i] * step * close * 0.5 * (up + 1 / up) * exp(-t)


@njit(nogil=True, error_model="numpy", forceinline=True)
def _seen_from(origin, axis, eye, view, t):
    px, py, pz = eye[0] + t * view[0] - origin[0], eye[1] + t * view[1] - origin[1], eye[2] + t * view[2] - origin[2]
    return _local(px, py, pz, axis, view, -1.0)
