"""Where rays come into the mesh of grains from outside."""

from typing import NamedTuple

import numpy as np

from bakery.kernels import Mesh, aggregate_scratch, lent, mesh_boundary, triangle_normal
from bakery.system.compiled import njit


class Boundary(NamedTuple):
    """A closed mesh, as `bakery.kernels.mesh_boundary` takes it: its tree, and where that lies.

    tree : of a `bakery.kernels.Mesh` in a ball of radius 1;  middle (3,) m, scale m : of the mesh
    """

    tree: tuple
    middle: np.ndarray
    scale: float

    @classmethod
    def of(cls, vertices, faces):
        """Of vertices (V, 3) m and triangles (F, 3), wound outward."""
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        middle, scale = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
        return cls(Mesh((vertices - middle) / scale, np.array(faces, np.int64, order="C")).tree[:3], middle, scale)


@njit(cache=True, nogil=True, error_model="numpy")
def entries(boundary, origin, direction, far, t, normal, begin, end):
    """Distances t (n,) m along directions to where rays first come in, before far (n,) m, inf where they do not, and the outward
    normals there, (n, 3).  Rays that begin inside come in once they have been outside."""
    boundary = lent(boundary)
    memory, p, d = aggregate_scratch(), np.empty(3), np.empty(3)
    for i in range(begin, end):
        distance, triangle, limit = 0.0, -1, far[i]
        t[i] = np.inf
        for k in range(3):
            d[k] = direction[i, k]
        while distance < limit:
            for k in range(3):
                p[k] = origin[i, k] + distance * d[k]
            ahead, triangle, outward = mesh_boundary(boundary, p, d, triangle, memory)
            distance += ahead
            if triangle < 0 or not distance < limit:
                break
            if not outward:
                t[i] = distance
                normal[i, 0], normal[i, 1], normal[i, 2] = triangle_normal(boundary.tree[2], triangle)
                break
