"""Voxels of a closed mesh: which are outside of it, which inside, which its surface passes through, which lie near it; rays
from one to the next."""

import math

import numpy as np

from bakery.physics.grains.bvh import mesh_scratch, nearest_triangle, triangle_normal
from bakery.system.compiled import njit

OUTSIDE, PARTIAL, INSIDE, CLASS = 0, 1, 2, 3  # class of a voxel, and the bits that hold it
NEAR = 4  # bit: a point of the voxel may lie within `reach` of the solid
_SLACK = 1e-9  # edges of a voxel: rounding of corners
_WAY = 0.5257311, 0.3568221, 0.7721990  # unit, along no axis and no usual plane


@njit(cache=True, nogil=True, error_model="numpy")
def inside(tree, middle, scale, x, y, z, scratch):
    """Whether a point is inside: the first triangle along a fixed direction is seen from behind.  No viewing ray decides on it.

    tree : nodes, children, blocks of the mesh in units of `scale` about `middle`
    """
    nodes, children, blocks = tree
    dx, dy, dz = _WAY
    at, _ = nearest_triangle(nodes, children, blocks, (x - middle[0]) / scale, (y - middle[1]) / scale, (z - middle[2]) / scale,
                             dx, dy, dz, -1, scratch)
    if at < 0:
        return False
    nx, ny, nz = triangle_normal(blocks, at)
    return nx * dx + ny * dy + nz * dz > 0


@njit(cache=True, nogil=True, error_model="numpy")
def meets(a, b, c, half):
    """Whether the triangle a, b, c (3,) meets the box of half edges `half` (3,) about the origin, by all 13 separating axes.

    Source: Akenine-Moller, Fast 3D triangle-box overlap testing, J. Graphics Tools 6(1), 2001.
    """
    for axis in range(3):
        if min(a[axis], b[axis], c[axis]) > half[axis] or max(a[axis], b[axis], c[axis]) < -half[axis]:
            return False
    for edge in range(3):
        p, q = (a, b) if edge == 0 else (b, c) if edge == 1 else (c, a)
        third = c if edge == 0 else a if edge == 1 else b
        for axis in range(3):
            i, j = (axis + 1) % 3, (axis + 2) % 3
            u, v = q[i] - p[i], q[j] - p[j]
            low_end, high_end = u * p[j] - v * p[i], u * third[j] - v * third[i]
            reach = abs(u) * half[j] + abs(v) * half[i]
            if min(low_end, high_end) > reach or max(low_end, high_end) < -reach:
                return False
    nx = (b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1])
    ny = (b[2] - a[2]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[2] - a[2])
    nz = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    return abs(nx * a[0] + ny * a[1] + nz * a[2]) <= abs(nx) * half[0] + abs(ny) * half[1] + abs(nz) * half[2]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def voxel_at(low, edge, shape, x, y, z):
    """The voxel (three numbers) that holds a point, or the nearest to it."""
    return (min(max(math.floor((x - low[0]) / edge[0]), 0), shape[0] - 1),
            min(max(math.floor((y - low[1]) / edge[1]), 0), shape[1] - 1),
            min(max(math.floor((z - low[2]) / edge[2]), 0), shape[2] - 1))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def ways_out(low, edge, voxel, p, d):
    """Distances at which the ray from p (3,) along d (3,) leaves a voxel along each axis; inf where it goes across it."""
    a, b, c = voxel
    return ((low[0] + (a + (d[0] > 0)) * edge[0] - p[0]) / d[0] if d[0] != 0 else np.inf,
            (low[1] + (b + (d[1] > 0)) * edge[1] - p[1]) / d[1] if d[1] != 0 else np.inf,
            (low[2] + (c + (d[2] > 0)) * edge[2] - p[2]) / d[2] if d[2] != 0 else np.inf)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def next_voxel(edge, voxel, out, d):
    """The voxel, maybe beyond the last, that a ray enters where it leaves one (`out`: `ways_out`), and the ways out of it."""
    (a, b, c), (x, y, z) = voxel, out
    if x <= y and x <= z:
        return (a + (1 if d[0] > 0 else -1), b, c), (x + edge[0] / abs(d[0]), y, z)
    if y <= z:
        return (a, b + (1 if d[1] > 0 else -1), c), (x, y + edge[1] / abs(d[1]), z)
    return (a, b, c + (1 if d[2] > 0 else -1)), (x, y, z + edge[2] / abs(d[2]))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def among(voxel, shape):
    """Whether there is such a voxel."""
    return 0 <= voxel[0] < shape[0] and 0 <= voxel[1] < shape[1] and 0 <= voxel[2] < shape[2]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def within_box(low, edge, shape, p, d, begin, end):
    """Distances at which the ray from p (3,) along d (3,), from `begin` to `end`, is among the voxels: the second below the first
    if nowhere."""
    for axis in range(3):
        high = low[axis] + shape[axis] * edge[axis]
        if d[axis] == 0.0:
            if not low[axis] <= p[axis] < high:
                return np.inf, -np.inf
        else:
            u, v = (low[axis] - p[axis]) / d[axis], (high - p[axis]) / d[axis]
            begin, end = max(begin, min(u, v)), min(end, max(u, v))
    return begin, end


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def passes_marked(low, edge, marks, p, d, t):
    """Whether a ray of length t from p (3,) along d (3,), both ends among the voxels, passes one that is marked.

    low, edge : (3,) corner and edges of the first voxel;  marks : (X, Y, Z)
    """
    voxel = voxel_at(low, edge, marks.shape, p[0], p[1], p[2])
    out = ways_out(low, edge, voxel, p, d)
    while among(voxel, marks.shape):
        if marks[voxel]:
            return True
        if min(out[0], min(out[1], out[2])) > t:
            return False
        voxel, out = next_voxel(edge, voxel, out, d)
    return False


@njit(cache=True, nogil=True, error_model="numpy")
def mark_voxels(voxels, low, edge, vertices, faces, reach, bits):
    """Sets `bits` (uint8) in voxels (X, Y, Z) whose box, `reach` larger on all sides, a triangle meets.

    low, edge : (3,) corner of the first voxel, edges of each;  vertices (V, 3), faces (F, 3) int64
    """
    half, first, last = np.empty(3), np.empty(3, np.int64), np.empty(3, np.int64)
    a, b, c, middle = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for axis in range(3):
        half[axis] = (0.5 + _SLACK) * edge[axis] + reach
    for f in range(len(faces)):
        for axis in range(3):
            p, q, r = vertices[faces[f, 0], axis], vertices[faces[f, 1], axis], vertices[faces[f, 2], axis]
            spread = reach + _SLACK * edge[axis]
            first[axis] = max(math.floor((min(p, q, r) - spread - low[axis]) / edge[axis]), 0)
            last[axis] = min(math.floor((max(p, q, r) + spread - low[axis]) / edge[axis]), voxels.shape[axis] - 1)
        for i in range(first[0], last[0] + 1):
            for j in range(first[1], last[1] + 1):
                for k in range(first[2], last[2] + 1):
                    if voxels[i, j, k] & bits == bits:
                        continue
                    middle[0], middle[1], middle[2] = i + 0.5, j + 0.5, k + 0.5
                    for axis in range(3):
                        at = low[axis] + middle[axis] * edge[axis]
                        a[axis] = vertices[faces[f, 0], axis] - at
                        b[axis] = vertices[faces[f, 1], axis] - at
                        c[axis] = vertices[faces[f, 2], axis] - at
                    if meets(a, b, c, half):
                        voxels[i, j, k] |= bits


@njit(cache=True, nogil=True, error_model="numpy")
def classified(shape, low, edge, vertices, faces, tree, middle, scale, reach):
    """Voxels (X, Y, Z) uint8: class, and NEAR where something of the voxel may be within `reach` of the solid.

    Between partial voxels of a column the class stays, so that few middles are looked at.
    """
    voxels = np.zeros(shape, np.uint8)
    mark_voxels(voxels, low, edge, vertices, faces, reach, np.uint8(NEAR))
    mark_voxels(voxels, low, edge, vertices, faces, 0.0, np.uint8(PARTIAL | NEAR))
    scratch = mesh_scratch()
    for i in range(shape[0]):
        for j in range(shape[1]):
            decided = False
            now = OUTSIDE
            for k in range(shape[2]):
                if voxels[i, j, k] & CLASS == PARTIAL:
                    decided = False
                    continue
                if not decided:
                    x, y, z = low[0] + (i + 0.5) * edge[0], low[1] + (j + 0.5) * edge[1], low[2] + (k + 0.5) * edge[2]
                    now = INSIDE if inside(tree, middle, scale, x, y, z, scratch) else OUTSIDE
                    decided = True
                if now == INSIDE:
                    voxels[i, j, k] |= np.uint8(INSIDE | NEAR)
    return voxels
