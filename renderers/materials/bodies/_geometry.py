"""Where rays inside of bodies go: the triangles of the bodies and of what is in them, and how far it is to them at least."""

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import distance_to_triangles, lent, mesh_scratch, nearest_triangle, triangle_normal
from bakery.system.compiled import njit

OUTSIDE = -1  # of all bodies
_ALMOST = 1 - 1e-4  # of the way to a light: its own surface is none in between
_BACK = 1e-4  # of the size of all bodies, from where a ray looks back at the boundary
_CROSSED = 64  # surfaces that a ray crosses, at most, until it is known which body it starts in


class Geometry(NamedTuple):
    """Triangles of all bodies and of the surfaces that reach into their boxes.

    nodes, children, blocks : of `bakery.kernels.Mesh.tree`, in units of `scale` (m) about `centre` (3,) m
    owner : number of the body whose boundary each place of the tree is, -1 of other surfaces
    low, edge : (3,) m, corner and edges of voxels
    clear : (X, Y, Z) float32 m, no triangle is nearer to the middle of a voxel
    """

    nodes: np.ndarray
    children: np.ndarray
    blocks: np.ndarray
    centre: np.ndarray
    scale: float
    owner: np.ndarray
    low: np.ndarray
    edge: np.ndarray
    clear: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def first(geometry, p, d, i, skip, scratch):
    """Place and distance (m) of the first triangle ahead of ray i of p, d (n, 3) m, unit; -1 and inf where there is none."""
    c, s = geometry.centre, geometry.scale
    triangle, t = nearest_triangle(geometry.nodes, geometry.children, geometry.blocks, (p[i, 0] - c[0]) / s, (p[i, 1] - c[1]) / s,
                                (p[i, 2] - c[2]) / s, d[i, 0], d[i, 1], d[i, 2], skip, scratch)
    return triangle, t * s


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def outward(geometry, triangle, d, i):
    """Whether ray i along d (n, 3) crosses a triangle to its outer side."""
    x, y, z = triangle_normal(geometry.blocks, triangle)
    return x * d[i, 0] + y * d[i, 1] + z * d[i, 2] > 0.0


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def clearance(geometry, p, i):
    """Distance (m) within which no triangle is of point i of p (n, 3) m; 0 where that is not known."""
    low, edge = geometry.low, geometry.edge
    x, y, z = (p[i, 0] - low[0]) / edge[0], (p[i, 1] - low[1]) / edge[1], (p[i, 2] - low[2]) / edge[2]
    u, v, w = geometry.clear.shape
    if not (0 <= x < u and 0 <= y < v and 0 <= z < w):
        return 0.0
    a, b, c = int(x), int(y), int(z)
    dx, dy, dz = (x - a - 0.5) * edge[0], (y - b - 0.5) * edge[1], (z - c - 0.5) * edge[2]
    return max(geometry.clear[a, b, c] - math.sqrt(dx * dx + dy * dy + dz * dz), 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def measure(geometry, begin, end):
    """Makes `clear` of voxels begin to end, in the order of the array."""
    geometry = lent(geometry)
    tree, scratch, p = (geometry.nodes, geometry.children, geometry.blocks), mesh_scratch(), np.empty(3)
    _, v, w = geometry.clear.shape
    for i in range(begin, end):
        a, b, c = i // (v * w), i // w % v, i % w
        p[0] = geometry.low[0] + (a + 0.5) * geometry.edge[0]
        p[1] = geometry.low[1] + (b + 0.5) * geometry.edge[1]
        p[2] = geometry.low[2] + (c + 0.5) * geometry.edge[2]
        # less what single precision rounds
        geometry.clear[a, b, c] = max(distance_to_triangles(tree, geometry.centre, geometry.scale, p, np.inf, scratch)
                                      - 1e-6 * geometry.scale, 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def locate(geometry, origin, direction, start, body, far, triangle, begin, end):
    """In which body rays begin to end start, the innermost one, and what is ahead.

    origin, direction : (n, 3) m, unit;  start : (n,) place of the triangle that each starts on, or -1
    body : (n,) becomes the number of the body, or OUTSIDE;  far, triangle : (n,) distance (m) and place of the first triangle
        ahead
    """
    geometry = lent(geometry)
    scratch, q, inside = mesh_scratch(), np.empty((1, 3)), np.empty(256, np.int64)
    for i in range(begin, end):
        body[i] = OUTSIDE
        triangle[i], far[i] = first(geometry, origin, direction, i, start[i], scratch)
        at = triangle[i]
        for k in range(3):
            q[0, k] = origin[i, k] + far[i] * direction[i, k] if at >= 0 else 0.0
        inside[:] = 0
        for _ in range(_CROSSED):
            if at < 0:
                break
            owner = geometry.owner[at]
            if owner >= 0:
                if not outward(geometry, at, direction, i):
                    inside[owner] += 1
                elif inside[owner] > 0:
                    inside[owner] -= 1
                else:
                    body[i] = owner
                    break
            at, t = first(geometry, q, direction[i : i + 1], 0, at, scratch)
            if at >= 0:
                for k in range(3):
                    q[0, k] += t * direction[i, k]


@njit(cache=True, nogil=True, error_model="numpy")
def lengths(geometry, matched, origin, direction, distance, inside, last, begin, end):
    """Lengths (m) of straight ways in each body, inside (n, bodies); inf where another surface, of those that rays in bodies may
    meet, is in between.

    matched : (bodies,) bool, light crosses the boundary of each as if there were none
    last : (n,) becomes the distance (m) to the last boundary on the way
    """
    geometry = lent(geometry)
    q = np.empty((1, 3))
    body, far, triangle = np.empty(1, np.int64), np.empty(1), np.empty(1, np.int64)
    start = np.empty(1, np.int64)
    for i in range(begin, end):
        inside[i], last[i], start[0] = 0.0, 0.0, -1
        for k in range(3):
            q[0, k] = origin[i, k]
        remaining = distance[i] * _ALMOST
        for _ in range(_CROSSED):
            locate(geometry, q, direction[i : i + 1], start, body, far, triangle, 0, 1)
            if body[0] >= 0:
                inside[i, body[0]] += min(far[0], remaining)
            remaining -= far[0]
            if triangle[0] < 0 or not remaining > 0.0:
                break
            owner = geometry.owner[triangle[0]]
            if owner < 0 or not matched[owner]:
                inside[i] = np.inf
                break
            last[i] += far[0]
            for k in range(3):
                q[0, k] += far[0] * direction[i, k]
            start[0] = triangle[0]


@njit(cache=True, nogil=True, error_model="numpy")
def normals(geometry, triangle, normal, begin, end):
    """Outward unit normals (n, 3) of triangles at places (n,); as they were where the place is -1."""
    for i in range(begin, end):
        if triangle[i] >= 0:
            normal[i, 0], normal[i, 1], normal[i, 2] = triangle_normal(geometry.blocks, triangle[i])


@njit(cache=True, nogil=True, error_model="numpy")
def boundary_normals(geometry, origin, direction, normal, begin, end):
    """Outward normals (n, 3) of the boundary where rays, origin (n, 3) m, direction (n, 3), have come into a body."""
    geometry = lent(geometry)
    p, d, scratch = np.empty((1, 3)), np.empty((1, 3)), mesh_scratch()
    for i in range(begin, end):
        for k in range(3):
            p[0, k], d[0, k] = origin[i, k] + _BACK * geometry.scale * direction[i, k], -direction[i, k]
        triangle, _ = first(geometry, p, d, 0, np.int64(-1), scratch)
        normal[i, 0], normal[i, 1], normal[i, 2] = triangle_normal(geometry.blocks, triangle) if triangle >= 0 else (
            d[0, 0], d[0, 1], d[0, 2])
