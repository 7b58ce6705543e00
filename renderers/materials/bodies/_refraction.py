"""Loops that find where light of a light without extent is refracted towards a point in a body."""

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import fresnel, lent, mesh_scratch
from bakery.system.compiled import njit
from renderers.materials.bodies._cells import enter, reach
from renderers.materials.bodies._geometry import first
from renderers.transport.scattering import mean_phase
from renderers.transport.wavefront import uniform

_WIDER = 2.0  # times what refracted directions are off a linear law in the middles of a triangle: at most in it
_OUTSIDE = 0.25  # of a triangle, within which places begin that Newton's method may bring into it
_STEPS, _CLOSE = 16, 1e-10  # of Newton's method; what it leaves, of the distance
_STEP = 1e-6  # of a triangle, over which differences are taken
_HALVINGS = 10  # of an interval around a root, from which Newton's method begins
_NEAR = 2e-6  # of the size of all bodies, by which a boundary may seem nearer than the place on it


class Front(NamedTuple):
    """Where light of one light comes in.

    corners, normals, ahead : (F, 3, 3) m, unit, unit, of triangles, and directions of refracted light at their corners
    off_mean : (F, 2) m, 1, at most: how far corners are off the mean of them, and these directions off theirs
    light : (3,) m, place of the light, or, of a `distant` one, unit, direction towards it
    index : refractive index inside over that outside
    """

    corners: np.ndarray
    normals: np.ndarray
    ahead: np.ndarray
    off_mean: np.ndarray
    light: np.ndarray
    distant: bool
    index: float


class Joined(NamedTuple):
    """One way each from events to a light, as `refraction.joined` says."""

    point: np.ndarray
    towards: np.ndarray
    within: np.ndarray
    share: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _plus(a, s, b):
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _times(s, a):
    return s * a[0], s * a[1], s * a[2]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _unit(a):
    return _times(1 / math.sqrt(_dot(a, a)), a)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _row(array, f, k):
    return array[f, k, 0], array[f, k, 1], array[f, k, 2]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _at(array, f, u, v):
    """Linear over triangle f: (1 - u - v) of corner 0, u of 1, v of 2."""
    return _plus(_plus(_times(1 - u - v, _row(array, f, 0)), u, _row(array, f, 1)), v, _row(array, f, 2))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _side(corners, f):
    """Normal of triangle f, of twice its area's length."""
    a = _row(corners, f, 0)
    return _cross(_plus(_row(corners, f, 1), -1.0, a), _plus(_row(corners, f, 2), -1.0, a))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _refracted(front, f, u, v):
    """Place, normal, direction to the light and of refracted light, at (u, v) of triangle f."""
    point, normal = _at(front.corners, f, u, v), _unit(_at(front.normals, f, u, v))
    light = front.light[0], front.light[1], front.light[2]
    towards = light if front.distant else _unit(_plus(light, -1.0, point))
    cosine, index = _dot(normal, towards), front.index
    beyond = math.sqrt(max(1 - (1 - cosine * cosine) / (index * index), 0.0))
    return point, normal, towards, _plus(_times(cosine / index - beyond, normal), -1 / index, towards)


@njit(cache=True, nogil=True, error_model="numpy")
def directions(front, spread, begin, end):
    """Makes `ahead` and `off_mean` of triangles, and spread (F,), how far light refracted in them is off a linear law; negative
    of those that face away from the light."""
    front = lent(front)
    light = front.light[0], front.light[1], front.light[2]
    for f in range(begin, end):
        towards = light if front.distant else _plus(light, -1.0, _row(front.corners, f, 0))
        for k in range(3):
            u, v = 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0
            d = _refracted(front, f, u, v)[3]
            front.ahead[f, k, 0], front.ahead[f, k, 1], front.ahead[f, k, 2] = d
        for column, array in enumerate((front.corners, front.ahead)):
            front.off_mean[f, column] = 0.0
            for k in range(3):
                off = _plus(_row(array, f, k), -1.0, _at(array, f, 1 / 3, 1 / 3))
                front.off_mean[f, column] = max(front.off_mean[f, column], math.sqrt(_dot(off, off)))
        most = 0.0
        for u, v in ((0.5, 0.0), (0.0, 0.5), (0.5, 0.5), (1 / 3, 1 / 3)):
            off = _plus(_refracted(front, f, u, v)[3], -1.0, _at(front.ahead, f, u, v))
            most = max(most, _dot(off, off))
        spread[f] = _WIDER * math.sqrt(most) if _dot(_side(front.corners, f), towards) > 0.0 else -1.0


@njit(cache=True, nogil=True, error_model="numpy")
def entered(front, spread, cells, latest):
    """Enters triangles in the cells that their light may reach; spread (F,) of `directions`."""
    front, cells = lent(front), lent(cells)
    corners, ahead, edge, shape = front.corners, front.ahead, cells.edge, cells.shape
    length = edge * math.sqrt(float(shape[0] ** 2 + shape[1] ** 2 + shape[2] ** 2))
    box, least, most = np.empty((2, 3)), np.empty(3, np.int64), np.empty(3, np.int64)
    for f in range(len(corners)):
        if spread[f] < 0.0:
            continue
        for step in range(math.ceil(length / edge)):
            pad = spread[f] * (step + 1) * edge + 1e-6 * length
            box[0], box[1] = np.inf, -np.inf
            for k in range(3):
                for axis in range(3):
                    for s in range(step, step + 2):
                        value = corners[f, k, axis] + s * edge * ahead[f, k, axis]
                        box[0, axis], box[1, axis] = min(box[0, axis], value - pad), max(box[1, axis], value + pad)
            for axis in range(3):
                least[axis], most[axis] = reach(cells, axis, box[0, axis], box[1, axis])
            enter(cells, least, most, f, latest)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _cubic(c, s):
    return c[0] + s * (c[1] + s * (c[2] + s * c[3]))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _near(front, f, y, longest):
    """From which distance to which, up to the longest, point y may be in a front of light of triangle f or `_OUTSIDE` of it."""
    d, wider = _at(front.ahead, f, 1 / 3, 1 / 3), 1 + 3 * _OUTSIDE
    r = _plus(y, -1.0, _at(front.corners, f, 1 / 3, 1 / 3))
    radius, turns = wider * front.off_mean[f, 0], wider * front.off_mean[f, 1]
    # |r - s d| is at most radius + s turns
    a, b = _dot(d, d) - turns * turns, _dot(r, d) + radius * turns
    square = b * b - a * (_dot(r, r) - radius * radius)
    if not a > 0.0:
        return 0.0, longest
    if not square > 0.0:
        return 0.0, 0.0
    root = math.sqrt(square)
    return max((b - root) / a, 0.0), min((b + root) / a, longest)


@njit(cache=True, nogil=True, error_model="numpy")
def _distances(front, f, y, longest, c, ends, roots):
    """Distances at which a front of light of triangle f, linear between its corners, passes point y: how many; roots (3,) m
    become these.

    The front is a triangle that moves on, and the point is in its plane where a polynomial of third degree is 0.  Only distances
    count at which it is in the sphere around that part of the plane from which Newton's method begins: behind bumpy_ball_point 41
    of 92 for an event.
    """
    ends[0], longest = _near(front, f, y, longest)
    if not ends[0] < longest:
        return 0
    a, d = _row(front.corners, f, 0), _row(front.ahead, f, 0)
    a1, b1 = _plus(_row(front.corners, f, 1), -1.0, a), _plus(_row(front.ahead, f, 1), -1.0, d)
    a2, b2 = _plus(_row(front.corners, f, 2), -1.0, a), _plus(_row(front.ahead, f, 2), -1.0, d)
    r = _plus(y, -1.0, a)
    still, turns, bends = _cross(a1, a2), _plus(_cross(a1, b2), 1.0, _cross(b1, a2)), _cross(b1, b2)
    c[0], c[1] = _dot(still, r), _dot(turns, r) - _dot(still, d)
    c[2], c[3] = _dot(bends, r) - _dot(turns, d), -_dot(bends, d)
    count = 1
    square = c[2] * c[2] - 3 * c[3] * c[1]
    if square > 0.0:
        q = -(c[2] + math.copysign(math.sqrt(square), c[2]))
        first, second = q / (3 * c[3]), c[1] / q
        for s in (min(first, second), max(first, second)):
            if ends[0] < s < longest:
                ends[count] = s
                count += 1
    ends[count], many = longest, 0
    for k in range(count):
        low, high = ends[k], ends[k + 1]
        rises = _cubic(c, high) > 0.0
        if (_cubic(c, low) > 0.0) == rises:
            continue
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if (_cubic(c, middle) > 0.0) == rises:
                high = middle
            else:
                low = middle
        roots[many] = 0.5 * (low + high)
        many += 1
    return many


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _within(front, f, y, s):
    """Where in the front of triangle f at distance s a point of its plane is: u, v."""
    q = _plus(_row(front.corners, f, 0), s, _row(front.ahead, f, 0))
    e1 = _plus(_plus(_row(front.corners, f, 1), s, _row(front.ahead, f, 1)), -1.0, q)
    e2 = _plus(_plus(_row(front.corners, f, 2), s, _row(front.ahead, f, 2)), -1.0, q)
    r, normal = _plus(y, -1.0, q), _cross(e1, e2)
    square = _dot(normal, normal)
    return _dot(_cross(r, e2), normal) / square, _dot(_cross(e1, r), normal) / square


@njit(cache=True, nogil=True, error_model="numpy")
def _place(front, f, y, u, v):
    """The place in triangle f from which light is refracted to y, by Newton's method from (u, v): u, v, or nan where that is not
    in it; and how wide light is there: area (m^2) across it at y over that of u and v."""
    for _ in range(_STEPS):
        p, _, _, d = _refracted(front, f, u, v)
        r = _plus(y, -1.0, p)
        s = _dot(r, d)
        off = _plus(r, -s, d)
        side = _unit(_cross(d, (1.0, 0.0, 0.0) if abs(d[0]) < 0.7 else (0.0, 1.0, 0.0)))
        upward = _cross(d, side)
        p1, _, _, d1 = _refracted(front, f, u + _STEP, v)
        p2, _, _, d2 = _refracted(front, f, u, v + _STEP)
        e1 = _times(1 / _STEP, _plus(_plus(p1, -1.0, p), s, _plus(d1, -1.0, d)))
        e2 = _times(1 / _STEP, _plus(_plus(p2, -1.0, p), s, _plus(d2, -1.0, d)))
        m11, m21, m12, m22 = _dot(e1, side), _dot(e1, upward), _dot(e2, side), _dot(e2, upward)
        area = m11 * m22 - m12 * m21
        if _dot(off, off) <= _CLOSE * _CLOSE * _dot(r, r):
            if u >= 0.0 and v >= 0.0 and u + v <= 1.0 and s > 0.0:
                return u, v, abs(area)
            break
        x1, x2 = _dot(off, side), _dot(off, upward)
        u, v = u + (x1 * m22 - x2 * m12) / area, v + (x2 * m11 - x1 * m21) / area
        if not (abs(u) < 4.0 and abs(v) < 4.0):
            break
    return np.nan, np.nan, 0.0


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _brought(front, f, u, v, area):
    """Irradiance across light that comes in at (u, v) of triangle f over that outside, per area across it at the event.

    Of light to the eye: where normals are not the triangle's, that towards the light differs (Veach 1997, section 5.3).
    """
    side = _side(front.corners, f)
    _, normal, towards, d = _refracted(front, f, u, v)
    cosine = _dot(normal, towards)
    if not (cosine > 0.0 and _dot(side, towards) > 0.0 and _dot(side, d) < 0.0 and _dot(normal, d) < 0.0 and area > 0.0):
        return 0.0
    share, _ = fresnel(min(cosine, 1.0), front.index)
    return (1 - share) * cosine * _dot(side, d) / _dot(normal, d) / area


@njit(cache=True, nogil=True, error_model="numpy")
def join(geometry, medium, front, cells, paths, joined, begin, end):
    """Draws one way each to the light from events begin to end, as `refraction.joined` says.

    medium : `Scatterer`;  front : `Front`;  cells : `Cells`, of its triangles;  paths : `Flying`, of events;  joined : `Joined`
    """
    geometry, medium, front, cells = lent(geometry), lent(medium), lent(front), lent(cells)
    paths, joined = lent(paths), lent(joined)
    scratch, values, d = mesh_scratch(), np.empty(paths.throughput.shape[1]), np.empty((1, 3))
    c, ends, roots, solutions, shape = np.empty(4), np.empty(4), np.empty(3), np.empty((3, 2)), cells.shape
    longest = cells.edge * math.sqrt(float(shape[0] ** 2 + shape[1] ** 2 + shape[2] ** 2))
    for i in range(begin, end):
        joined.share[i] = 0.0
        total, chosen, cell = 0.0, 0.0, np.int64(0)
        y = paths.origin[i, 0], paths.origin[i, 1], paths.origin[i, 2]
        for axis in range(3):
            at = min(max(int((y[axis] - cells.low[axis]) / cells.edge), 0), shape[axis] - 1)
            cell = cell * shape[axis] + at
        for name in range(cells.begin[cell], cells.begin[cell + 1]):
            f, many = np.int64(cells.names[name]), 0
            for k in range(_distances(front, f, y, longest, c, ends, roots)):
                u, v, area = _solved(front, f, y, roots[k], solutions[:many])
                if math.isnan(u):
                    continue
                solutions[many, 0], solutions[many, 1] = u, v
                many += 1
                brought = _brought(front, f, u, v, area)
                x = _at(front.corners, f, u, v)
                ahead = _plus(x, -1.0, y)
                distance = math.sqrt(_dot(ahead, ahead))
                if not brought > 0.0:
                    continue
                d[0, 0], d[0, 1], d[0, 2] = ahead[0] / distance, ahead[1] / distance, ahead[2] / distance
                _, wall = first(geometry, paths.origin[i : i + 1], d, 0, np.int64(-1), scratch)
                if wall < distance * (1 - 1e-9) - _NEAR * geometry.scale:
                    continue
                guess = brought * _likely(medium, paths, i, d, distance, values)
                total += guess
                if guess > 0.0 and uniform(paths.states, i) * total < guess:
                    chosen, joined.share[i], joined.within[i] = guess, brought, distance
                    for axis in range(3):
                        joined.point[i, axis], joined.towards[i, axis] = x[axis], d[0, axis]
        if chosen > 0.0:
            joined.share[i] *= total / chosen


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _solved(front, f, y, s, earlier):
    """The place in triangle f from which light is refracted to y, u and v, near that of the front at distance s, and `_place`'s
    area; nan where there is none, or it is one of earlier ones (n, 2)."""
    u, v = _within(front, f, y, s)
    if not (u > -_OUTSIDE and v > -_OUTSIDE and u + v < 1 + _OUTSIDE):
        return np.nan, np.nan, 0.0
    u, v, area = _place(front, f, y, u, v)
    for solution in range(len(earlier)):
        if abs(earlier[solution, 0] - u) + abs(earlier[solution, 1] - v) < 1e-6:
            return np.nan, np.nan, 0.0
    return u, v, area


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _likely(medium, paths, i, d, distance, values):
    """Guess of what the light that comes to event i against d (1, 3) from a distance is to the path."""
    weight, guess = paths.throughput, 0.0
    cosine = paths.direction[i, 0] * d[0, 0] + paths.direction[i, 1] * d[0, 1] + paths.direction[i, 2] * d[0, 2]
    mean_phase(medium, 0, weight, i, min(max(1 - cosine, 0.0), 2.0), values)
    for w in range(len(values)):
        guess += weight[i, w] * medium.albedo[w] * values[w] * math.exp(-medium.sigma_t[w] * distance)
    return guess
