"""Where rays come into the mesh of grains from outside."""

from typing import NamedTuple

import numpy as np

from bakery.kernels import Mesh, aggregate_scratch, lent, mesh_boundary, triangle_normal
from bakery.system.compiled import njit
from renderers.threads import run


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

    @classmethod
    def around(cls, packed):
        """Of what fills a mesh: a record with `aggregate`, and its `unit`, m."""
        aggregate, unit = packed.aggregate, packed.unit
        return cls(aggregate.tree, unit * aggregate.middle, unit * aggregate.scale)

    def entries(self, origin, direction, far, inside=False):
        """Distances (n,) m along directions to where rays first come in, before far (n,) m, inf where they do not, and outward
        normals (n, 3) there.

        inside : whether rays that begin inside are in it already, at 0 m and without a normal; else once they have been outside
        """
        t, normal = np.empty(len(origin)), np.zeros((len(origin), 3))
        rays = (np.ascontiguousarray(values, float) for values in (origin, direction, far))
        run(_entries, len(t), self, *rays, inside, t, normal)
        return t, normal


@njit(cache=True, nogil=True, error_model="numpy")
def _entries(boundary, origin, direction, far, inside, t, normal, begin, end):
    """Fills t and normal; parameters as those of `Boundary.entries`."""
    boundary = lent(boundary)
    memory, p, d = aggregate_scratch(), np.empty(3), np.empty(3)
    for i in range(begin, end):
        distance, triangle, first = 0.0, -1, inside
        t[i] = np.inf
        for k in range(3):
            d[k] = direction[i, k]
        while distance < far[i]:
            for k in range(3):
                p[k] = origin[i, k] + distance * d[k]
            ahead, triangle, outward = mesh_boundary(boundary, p, d, triangle, memory)
            if triangle >= 0 and outward and first:
                t[i] = 0.0
                break
            distance, first = distance + ahead, False
            if triangle < 0 or not distance < far[i]:
                break
            if not outward:
                t[i] = distance
                normal[i, 0], normal[i, 1], normal[i, 2] = triangle_normal(boundary.tree[2], triangle)
                break
