"""Where a discrete medium is: a box, and in it everything, a grid of relative densities, or the inside of a closed mesh."""

import math
from typing import NamedTuple

import numpy as np

from bakery.physics.grains.bvh import Mesh, mesh_scratch, nearest_triangle, triangle_normal
from bakery.system.compiled import njit

BOX, GRID, MESH = range(3)
_OUT, _IN, _EDGE = 0.0, 1.0, 0.5  # voxels of a mesh
_NO_TREE = np.zeros(1, np.float32), np.zeros(1, np.int32), np.zeros(1)  # of the types of `Mesh.tree`; nobody reads them


class Region(NamedTuple):
    """A region laid out for compiled loops.

    lo, hi : (3,) m, the box
    kind : BOX, GRID or MESH
    values : (X, Y, Z) float32; GRID: relative density 0 to 1 at the middles of the voxels; MESH: 0 outside, 1 inside, 1/2 where
        the surface is near; BOX: one voxel of 1
    nodes, children, blocks : tree of the mesh's triangles (`Mesh.tree`), in units of `scale` about `centre`; empty but for MESH
    """

    lo: np.ndarray
    hi: np.ndarray
    kind: int
    values: np.ndarray
    centre: np.ndarray
    scale: float
    nodes: np.ndarray
    children: np.ndarray
    blocks: np.ndarray


def region_box(lo, hi) -> Region:
    """All of the box from lo (3,) to hi (3,) m."""
    return _region(lo, hi, BOX, np.ones((1, 1, 1), np.float32))


def region_grid(lo, hi, values) -> Region:
    """Relative densities (X, Y, Z), 0 to 1, in a box: trilinear between the middles of voxels, constant in the outer halves."""
    return _region(lo, hi, GRID, values)


def region_mesh(vertices, faces, resolution=64) -> Region:
    """Inside of a closed mesh: vertices (V, 3) m, faces (F, 3), normals outwards.

    `resolution` voxels along the longest edge of the bounding box spare most points the search among the triangles.
    """
    vertices = np.asarray(vertices, float)
    lo, hi = vertices.min(axis=0), vertices.max(axis=0)
    centre, scale = (lo + hi) / 2, float(np.linalg.norm(hi - lo)) / 2
    tree = Mesh((vertices - centre) / scale, np.asarray(faces)).tree
    counts = np.maximum(1, np.ceil(resolution * (hi - lo) / (hi - lo).max())).astype(int)
    whole = _region(lo, hi, MESH, np.full(counts, _EDGE, np.float32), centre, scale, tree)
    # a copy: a kernel for arrays that cannot be written would be compiled besides
    _voxels(whole, np.array(vertices, order="C"), np.ascontiguousarray(faces, np.int64))
    return whole


def _region(lo, hi, kind, values, centre=(0.0, 0.0, 0.0), scale=1.0, tree=None):
    nodes, children, blocks, *_ = tree or _NO_TREE
    lo, hi = np.array(lo, float), np.array(hi, float)
    values = np.require(values, np.float32, "CW")  # one kind of array: kernels are compiled once
    return Region(lo, hi, kind, values, np.array(centre, float), float(scale), nodes, children, blocks)


@njit(cache=True, nogil=True, error_model="numpy")
def relative_density(region, x, y, z, scratch):
    """Relative density, 0 to 1, at a point (m); `room` from `mesh_scratch`."""
    lo, hi, values = region.lo, region.hi, region.values
    if not (lo[0] <= x < hi[0] and lo[1] <= y < hi[1] and lo[2] <= z < hi[2]):
        return 0.0
    if region.kind == BOX:
        return 1.0
    nx, ny, nz = values.shape
    u, v, w = (x - lo[0]) / (hi[0] - lo[0]) * nx, (y - lo[1]) / (hi[1] - lo[1]) * ny, (z - lo[2]) / (hi[2] - lo[2]) * nz
    if region.kind == GRID:
        return _trilinear(values, u - 0.5, v - 0.5, w - 0.5)
    value = values[min(int(u), nx - 1), min(int(v), ny - 1), min(int(w), nz - 1)]
    return value if value != _EDGE else _inside(region, x, y, z, scratch)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _trilinear(values, u, v, w):
    nx, ny, nz = values.shape
    u, v, w = min(max(u, 0.0), nx - 1.0), min(max(v, 0.0), ny - 1.0), min(max(w, 0.0), nz - 1.0)
    i, j, k = min(int(u), max(nx - 2, 0)), min(int(v), max(ny - 2, 0)), min(int(w), max(nz - 2, 0))
    p, q, r = min(i + 1, nx - 1), min(j + 1, ny - 1), min(k + 1, nz - 1)
    u, v, w = u - i, v - j, w - k
    low = (1 - v) * ((1 - w) * values[i, j, k] + w * values[i, j, r]) + v * ((1 - w) * values[i, q, k] + w * values[i, q, r])
    high = (1 - v) * ((1 - w) * values[p, j, k] + w * values[p, j, r]) + v * ((1 - w) * values[p, q, k] + w * values[p, q, r])
    return (1 - u) * low + u * high


@njit(cache=True, nogil=True, error_model="numpy")
def _inside(region, x, y, z, scratch):
    """Whether the first surface along a fixed oblique direction is seen from within."""
    o = (np.array((x, y, z)) - region.centre) / region.scale
    dx, dy, dz = 0.5257311, 0.3568221, 0.7721990  # along no axis and no usual plane
    at, _ = nearest_triangle(region.nodes, region.children, region.blocks, o[0], o[1], o[2], dx, dy, dz, np.int64(-1), scratch)
    if at < 0:
        return 0.0
    nx, ny, nz = triangle_normal(region.blocks, at)
    return 1.0 if nx * dx + ny * dy + nz * dz > 0 else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def region_densities(region, points):
    """Relative density (n,) at points (n, 3) m."""
    out, scratch = np.empty(len(points)), mesh_scratch()
    for i in range(len(points)):
        out[i] = relative_density(region, points[i, 0], points[i, 1], points[i, 2], scratch)
    return out


@njit(cache=True, error_model="numpy")
def _voxels(region, vertices, faces):
    """Marks the voxels that no triangle's bounding box touches as inside or outside, by their middles."""
    values, lo = region.values, region.lo
    n = np.array(values.shape)
    edge = (region.hi - lo) / n
    values[:] = -1.0
    for f in range(len(faces)):
        low, high = np.empty(3, np.int64), np.empty(3, np.int64)
        for axis in range(3):
            a, b, c = vertices[faces[f, 0], axis], vertices[faces[f, 1], axis], vertices[faces[f, 2], axis]
            # a thousandth of a voxel: points on a wall between two
            low[axis] = min(max(math.floor((min(a, b, c) - lo[axis]) / edge[axis] - 1e-3), 0), n[axis] - 1)
            high[axis] = min(max(math.floor((max(a, b, c) - lo[axis]) / edge[axis] + 1e-3), 0), n[axis] - 1)
        values[low[0]:high[0] + 1, low[1]:high[1] + 1, low[2]:high[2] + 1] = _EDGE
    scratch = mesh_scratch()
    for i in range(n[0]):
        for j in range(n[1]):
            for k in range(n[2]):
                if values[i, j, k] < 0:
                    x, y, z = lo[0] + (i + 0.5) * edge[0], lo[1] + (j + 0.5) * edge[1], lo[2] + (k + 0.5) * edge[2]
                    values[i, j, k] = _inside(region, x, y, z, scratch)
