"""Marching through a grid of densities, cell by cell.

Along a straight line inside one cell the trilinear interpolant is a cubic, so times (z - z')^2 it is of degree five: three Gauss
points integrate every moment without error but rounding.

A grid is `values` (X, Y, Z), which stand at the whole numbers of the coordinates that the kernels take; it is continued by half a
cell on each side and is 0 beyond.
"""

import math

from bakery.system.compiled import njit

_NODES = (0.5 - 0.5 * math.sqrt(0.6), 0.5, 0.5 + 0.5 * math.sqrt(0.6))
_WEIGHTS = (5 / 18, 8 / 18, 5 / 18)


@njit(cache=True, nogil=True, error_model="numpy")
def moments(values, start, step, distance, out):
    """S_0, S_1, S_2 of every ray into `out` (N, 3).

    A ray begins at `start` (N, 3), goes on by `step` (N, 3) per unit of distance, and ends at `distance` (N,), which may be inf.
    """
    nx, ny, nz = values.shape
    for ray in range(len(start)):
        px, py, pz = start[ray]
        vx, vy, vz = step[ray]
        t, end = 0.0, distance[ray]
        t, end = _clipped(px, vx, nx, t, end)
        t, end = _clipped(py, vy, ny, t, end)
        t, end = _clipped(pz, vz, nz, t, end)
        s0 = s1 = s2 = 0.0
        if t < end:
            kx, ky, kz = _plane(px + vx * t, vx, nx), _plane(py + vy * t, vy, ny), _plane(pz + vz * t, vz, nz)
            dx, dy, dz = (1 if vx > 0 else -1), (1 if vy > 0 else -1), (1 if vz > 0 else -1)
            tx, ty, tz = _crossing(kx, px, vx, nx), _crossing(ky, py, vy, ny), _crossing(kz, pz, vz, nz)
        while t < end:
            following = min(end, tx, ty, tz)
            length = following - t
            if length > 0.0:
                s2 += length * (2.0 * s1 + length * s0)
                s1 += length * s0
                middle = t + 0.5 * length
                x, y, z = _low(px + vx * middle, nx), _low(py + vy * middle, ny), _low(pz + vz * middle, nz)
                corners = _corners(values, x, y, z)
                largest = 0.0
                for corner in corners:
                    largest = max(largest, corner)
                if largest > 0.0:
                    for node, weight in zip(_NODES, _WEIGHTS):
                        at = t + node * length
                        rho = _between(corners, px + vx * at - x, py + vy * at - y, pz + vz * at - z)
                        mass, remaining = weight * length * rho, (1.0 - node) * length
                        s0 += mass
                        s1 += mass * remaining
                        s2 += mass * remaining * remaining
                t = following
            if tx <= following:
                kx += dx
                tx = _crossing(kx, px, vx, nx)
            if ty <= following:
                ky += dy
                ty = _crossing(ky, py, vy, ny)
            if tz <= following:
                kz += dz
                tz = _crossing(kz, pz, vz, nz)
        if s0 > 0.0:
            remaining = distance[ray] - t  # inf for a ray without end
            s2 += remaining * (2.0 * s1 + remaining * s0)
            s1 += remaining * s0
        out[ray, 0], out[ray, 1], out[ray, 2] = s0, s1, s2


@njit(cache=True, nogil=True, error_model="numpy")
def _clipped(p, v, count, t, end):
    """The part of a ray between two faces of the grid; empty where t >= end."""
    if v != 0.0:
        enter, leave = (-0.5 - p) / v, (count - 0.5 - p) / v
        return max(t, min(enter, leave)), min(end, max(enter, leave))
    return t, (end if -0.5 <= p <= count - 0.5 else -1.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _plane(p, v, count):
    """The first plane of nodes ahead of p."""
    return max(math.floor(p) + 1, 0) if v > 0.0 else min(math.ceil(p) - 1, count - 1)


@njit(cache=True, nogil=True, error_model="numpy")
def _crossing(plane, p, v, count):
    """Where a ray crosses a plane of nodes: from the plane's number, not from the last crossing, so that no error adds up."""
    return (plane - p) / v if v != 0.0 and 0 <= plane < count else math.inf


@njit(cache=True, nogil=True, error_model="numpy")
def _low(p, count):
    """The node below p; in the half cells at the faces the nearest cell's."""
    return min(max(math.floor(p), 0), max(count - 2, 0))


@njit(cache=True, nogil=True, error_model="numpy")
def _corners(values, x, y, z):
    """The values at the corners of a cell; an axis with one node is constant."""
    nx, ny, nz = values.shape
    x1, y1, z1 = min(x + 1, nx - 1), min(y + 1, ny - 1), min(z + 1, nz - 1)
    return (float(values[x, y, z]), float(values[x, y, z1]), float(values[x, y1, z]), float(values[x, y1, z1]),
            float(values[x1, y, z]), float(values[x1, y, z1]), float(values[x1, y1, z]), float(values[x1, y1, z1]))


@njit(cache=True, nogil=True, error_model="numpy")
def _between(corners, u, v, w):
    """Trilinear in u, v, w, each held within 0 and 1."""
    a, b, c, d, e, f, g, h = corners
    u, v, w = min(max(u, 0.0), 1.0), min(max(v, 0.0), 1.0), min(max(w, 0.0), 1.0)
    near = (a * (1 - w) + b * w) * (1 - v) + (c * (1 - w) + d * w) * v
    far = (e * (1 - w) + f * w) * (1 - v) + (g * (1 - w) + h * w) * v
    return near * (1 - u) + far * u
