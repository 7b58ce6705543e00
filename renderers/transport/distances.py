"""About how far it is straight from points in bodies to where ways to lights leave them, looked up in voxels."""

import drjit as dr
import numpy as np

from renderers.mitsuba.shading import single

import mitsuba as mi  # isort: skip

_VOXELS = 1 << 16  # of the box around all bodies, about
_RAYS = 4  # of a voxel and lamp, the shortest of which counts


class Distances:
    """Distances in voxels; 0 in those that no ray shows to be in a body."""

    def __init__(self, scene, manifold, towards):
        """
        scene : of Mitsuba;  manifold : `manifold.Manifold`, the boundaries of the bodies
        towards : functions of points and pairs of uniform numbers: unit directions, 0 where there is none
        """
        low, high = manifold.box
        edge = float((np.prod(high - low) / _VOXELS) ** (1 / 3))
        shape = np.maximum(np.ceil((high - low) / edge), 1).astype(int)
        self._shape, self._low, self._edge = mi.Vector3u(shape.tolist()), mi.Point3f(low.tolist()), mi.Float(edge)
        self._voxels = mi.UInt32(int(np.prod(shape)))
        dr.make_opaque(self._shape, self._low, self._edge, self._voxels)
        shortest = [self._shortest(scene, manifold, each, int(np.prod(shape))) for each in towards]
        self._values = single(np.concatenate(shortest))

    def _shortest(self, scene, manifold, towards, voxels):
        random = mi.PCG32(voxels * _RAYS)
        cell = dr.arange(mi.UInt32, voxels * _RAYS) // _RAYS
        row = cell // self._shape.z
        corner = mi.Point3f(row // self._shape.y, row % self._shape.y, cell % self._shape.z)
        point = self._low + self._edge * (corner + mi.Point3f(*(random.next_float32() for _ in range(3))))
        u = mi.Point2f(random.next_float32(), random.next_float32())
        direction = towards(point, u)
        some = dr.squared_norm(direction) > 0
        ray = mi.Ray3f(point, dr.select(some, direction, mi.Vector3f(0, 0, 1)))
        hit = scene.ray_intersect_preliminary(ray, coherent=False)
        begins = some & hit.is_valid() & manifold.begins_within(ray)
        distance = np.array(dr.select(begins, hit.t, dr.inf)).reshape(-1, _RAYS).min(axis=1)
        return np.where(np.isfinite(distance), distance, 0).astype(np.float32)

    def of(self, point, number, active):
        """From points by one of the functions each, by its place among all."""
        cell = mi.Vector3u(dr.clip(mi.Vector3i(dr.floor((point - self._low) / self._edge)), 0, mi.Vector3i(self._shape) - 1))
        cell = (cell.x * self._shape.y + cell.y) * self._shape.z + cell.z
        return dr.gather(mi.Float, self._values, number * self._voxels + cell, active)
