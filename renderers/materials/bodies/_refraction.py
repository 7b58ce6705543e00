"""Loops that find where light of a light without extent is refracted towards a point in a body."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import fresnel, lent, mesh_scratch
from bakery.system.compiled import njit
from renderers.materials.bodies._geometry import first
from renderers.transport.scattering import mean_phase
from renderers.transport.wavefront import uniform

_WIDER = 2.0  # times what refracted directions are off a linear law in the middles of a triangle: at most in it
_OUTSIDE = 0.25  # of a triangle, within which places begin that Newton's method may bring into it
_STEPS, _CLOSE = 16, 1e-10  # of Newton's method; what it leaves, of the distance
_STEP = 1e-6  # of a triangle, over which differences are taken
_HALVINGS = 30  # of an interval around a root
_NEAR = 2e-6  # of the size of all bodies, by which a boundary may seem nearer than the place on it


class Ways(NamedTuple):
    """Where light of one light comes in, and which voxels light of each triangle may reach.

    corners, normals, ahead : (F, 3, 3) m, unit, unit, of triangles, and directions of refracted light at their corners
    light : (3,) m, place of the light, or, of a `distant` one, unit, direction towards it
    index : refractive index inside over that outside
    low, edge, shape : (3,) m, m, (3,), of voxels
    begin : (voxels + 1,) where the triangles of each begin in `names`
    """

    corners: np.ndarray
    normals: np.ndarray
    ahead: np.ndarray
    light: np.ndarray
    distant: bool
    index: float
    low: np.ndarray
    edge: float
    shape: np.ndarray
    begin: np.ndarray
    names: np.ndarray


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
def _refracted(corners, normals, light, distant, index, f, u, v):
    """Place, normal, direction to the light and of refracted light, at (u, v) of triangle f."""
    point, normal = _at(corners, f, u, v), _unit(_at(normals, f, u, v))
    here = light[0], light[1], light[2]
    towards = here if distant else _unit(_plus(here, -1.0, point))
    cosine = _dot(normal, towards)
    beyond = math.sqrt(max(1 - (1 - cosine * cosine) / (index * index), 0.0))
    return point, normal, towards, _plus(_times(cosine / index - beyond, normal), -1 / index, towards)


@njit(cache=True, nogil=True, error_model="numpy")
def directions(corners, normals, light, distant, index, ahead, spread, begin, end):
    """Directions ahead (F, 3, 3) of light refracted at corners, and spread (F,), how far they are off a linear law in between;
    negative of triangles that face away from the light."""
    for f in range(begin, end):
        here = light[0], light[1], light[2]
        towards_light = _dot(_side(corners, f), here if distant else _plus(here, -1.0, _row(corners, f, 0))) > 0.0
        for k in range(3):
            u, v = 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0
            d = _refracted(corners, normals, light, distant, index, f, u, v)[3]
            ahead[f, k, 0], ahead[f, k, 1], ahead[f, k, 2] = d
        most = 0.0
        for u, v in ((0.5, 0.0), (0.0, 0.5), (0.5, 0.5), (1 / 3, 1 / 3)):
            off = _plus(_refracted(corners, normals, light, distant, index, f, u, v)[3], -1.0, _at(ahead, f, u, v))
            most = max(most, _dot(off, off))
        spread[f] = _WIDER * math.sqrt(most) if towards_light else -1.0


@njit(cache=True, nogil=True, error_model="numpy")
def entered(corners, ahead, spread, low, edge, shape, begin, names):
    """Counts triangles whose light may reach each voxel, in begin (voxels + 1,); or, where there are names, enters them there,
    beginning at `begin`, which is moved on."""
    count = np.int64(shape[0] * shape[1] * shape[2])
    last = np.full(count, -1, np.int32)
    length = edge * math.sqrt(float(shape[0] ** 2 + shape[1] ** 2 + shape[2] ** 2))
    box, first_cell, last_cell = np.empty((2, 3)), np.empty(3, np.int64), np.empty(3, np.int64)
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
                first_cell[axis] = max(math.floor((box[0, axis] - low[axis]) / edge), 0)
                last_cell[axis] = min(math.floor((box[1, axis] - low[axis]) / edge), shape[axis] - 1)
            for x in range(first_cell[0], last_cell[0] + 1):
                for y in range(first_cell[1], last_cell[1] + 1):
                    for z in range(first_cell[2], last_cell[2] + 1):
                        cell = (x * shape[1] + y) * shape[2] + z
                        if last[cell] != f:
                            last[cell] = f
                            if len(names):
                                names[begin[cell]] = f
                            begin[cell] += 1


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _cubic(c, s):
    return c[0] + s * (c[1] + s * (c[2] + s * c[3]))


@njit(cache=True, nogil=True, error_model="numpy")
def _distances(bent, f, y, longest, c, ends, roots):
    """Distances at which a front of light of triangle f, linear between its corners, passes point y: found (3,) m, how many.

    The front is a triangle that moves on, and the point is in its plane where a polynomial of third degree is 0.
    """
    a, d = _row(bent.corners, f, 0), _row(bent.ahead, f, 0)
    a1, b1 = _plus(_row(bent.corners, f, 1), -1.0, a), _plus(_row(bent.ahead, f, 1), -1.0, d)
    a2, b2 = _plus(_row(bent.corners, f, 2), -1.0, a), _plus(_row(bent.ahead, f, 2), -1.0, d)
    r = _plus(y, -1.0, a)
    still, turns, bends = _cross(a1, a2), _plus(_cross(a1, b2), 1.0, _cross(b1, a2)), _cross(b1, b2)
    c[0], c[1] = _dot(still, r), _dot(turns, r) - _dot(still, d)
    c[2], c[3] = _dot(bends, r) - _dot(turns, d), -_dot(bends, d)
    ends[0], count = 0.0, 1
    square = c[2] * c[2] - 3 * c[3] * c[1]
    if square > 0.0:
        q = -(c[2] + math.copysign(math.sqrt(square), c[2]))
        first, second = q / (3 * c[3]), c[1] / q
        for s in (min(first, second), max(first, second)):
            if 0.0 < s < longest:
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
def _within(bent, f, y, s):
    """Where in the front of triangle f at distance s a point of its plane is: u, v."""
    q = _plus(_row(bent.corners, f, 0), s, _row(bent.ahead, f, 0))
    e1 = _plus(_plus(_row(bent.corners, f, 1), s, _row(bent.ahead, f, 1)), -1.0, q)
    e2 = _plus(_plus(_row(bent.corners, f, 2), s, _row(bent.ahead, f, 2)), -1.0, q)
    r, normal = _plus(y, -1.0, q), _cross(e1, e2)
    square = _dot(normal, normal)
    return _dot(_cross(r, e2), normal) / square, _dot(_cross(e1, r), normal) / square


@njit(cache=True, nogil=True, error_model="numpy")
def _place(bent, f, y, u, v):
    """The place in triangle f from which light is refracted to y, by Newton's method from (u, v): u, v, or nan where that is not
    in it; and how wide light is there: area (m^2) across it at y over that of u and v."""
    for _ in range(_STEPS):
        p, _, _, d = _refracted(bent.corners, bent.normals, bent.light, bent.distant, bent.index, f, u, v)
        r = _plus(y, -1.0, p)
        s = _dot(r, d)
        off = _plus(r, -s, d)
        side = _unit(_cross(d, (1.0, 0.0, 0.0) if abs(d[0]) < 0.7 else (0.0, 1.0, 0.0)))
        upward = _cross(d, side)
        p1, _, _, d1 = _refracted(bent.corners, bent.normals, bent.light, bent.distant, bent.index, f, u + _STEP, v)
        p2, _, _, d2 = _refracted(bent.corners, bent.normals, bent.light, bent.distant, bent.index, f, u, v + _STEP)
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
def _brought(bent, f, u, v, area):
    """Irradiance across light that comes in at (u, v) of triangle f over that outside, per area across it at the event.

    Of light to the eye: where normals are not the triangle's, that towards the light differs (Veach 1997, section 5.3).
    """
    side = _side(bent.corners, f)
    _, normal, towards, d = _refracted(bent.corners, bent.normals, bent.light, bent.distant, bent.index, f, u, v)
    cosine = _dot(normal, towards)
    if not (cosine > 0.0 and _dot(side, towards) > 0.0 and _dot(side, d) < 0.0 and _dot(normal, d) < 0.0 and area > 0.0):
        return 0.0
    share, _ = fresnel(min(cosine, 1.0), bent.index)
    return (1 - share) * cosine * _dot(side, d) / _dot(normal, d) / area


@njit(cache=True, nogil=True, error_model="numpy")
def join(geometry, medium, bent, origin, direction, weight, states, point, towards, within, share, begin, end):
    """Draws one way each to the light from events begin to end, as `refraction.joined` says.

    medium : `Scatterer`;  bent : `Ways`
    origin, direction, weight, states : (n, 3) m, unit, (n, L), (n,), of paths that scatter there
    """
    geometry, medium, bent = lent(geometry), lent(medium), lent(bent)
    scratch, values, d = mesh_scratch(), np.empty(weight.shape[1]), np.empty((1, 3))
    c, ends, roots, solutions = np.empty(4), np.empty(4), np.empty(3), np.empty((3, 2))
    shape, longest = bent.shape, bent.edge * math.sqrt(float(bent.shape[0] ** 2 + bent.shape[1] ** 2 + bent.shape[2] ** 2))
    for i in range(begin, end):
        share[i] = 0.0
        total, chosen, cell = 0.0, 0.0, np.int64(0)
        y = origin[i, 0], origin[i, 1], origin[i, 2]
        for axis in range(3):
            at = min(max(int((y[axis] - bent.low[axis]) / bent.edge), 0), shape[axis] - 1)
            cell = cell * shape[axis] + at
        for name in range(bent.begin[cell], bent.begin[cell + 1]):
            f, many = np.int64(bent.names[name]), 0
            for k in range(_distances(bent, f, y, longest, c, ends, roots)):
                u, v = _within(bent, f, y, roots[k])
                if not (u > -_OUTSIDE and v > -_OUTSIDE and u + v < 1 + _OUTSIDE):
                    continue
                u, v, area = _place(bent, f, y, u, v)
                again = math.isnan(u)
                for solution in range(many):
                    again |= abs(solutions[solution, 0] - u) + abs(solutions[solution, 1] - v) < 1e-6
                if again:
                    continue
                solutions[many, 0], solutions[many, 1] = u, v
                many += 1
                brought = _brought(bent, f, u, v, area)
                x = _at(bent.corners, f, u, v)
                ahead = _plus(x, -1.0, y)
                distance = math.sqrt(_dot(ahead, ahead))
                if not brought > 0.0:
                    continue
                for k2 in range(3):
                    d[0, k2] = ahead[k2] / distance
                _, wall = first(geometry, origin[i : i + 1], d, 0, np.int64(-1), scratch)
                if wall < distance * (1 - 1e-9) - _NEAR * geometry.scale:
                    continue
                cosine = direction[i, 0] * d[0, 0] + direction[i, 1] * d[0, 1] + direction[i, 2] * d[0, 2]
                mean_phase(medium, 0, weight, i, min(max(1 - cosine, 0.0), 2.0), values)
                guess = 0.0
                for w in range(len(values)):
                    guess += weight[i, w] * medium.albedo[w] * values[w] * math.exp(-medium.sigma_t[w] * distance)
                guess *= brought
                total += guess
                if guess > 0.0 and uniform(states, i) * total < guess:
                    chosen, share[i], within[i] = guess, brought, distance
                    for axis in range(3):
                        point[i, axis], towards[i, axis] = x[axis], d[0, axis]
        if chosen > 0.0:
            share[i] *= total / chosen
