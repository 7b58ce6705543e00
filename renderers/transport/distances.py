"""About how far it is straight from points in bodies to where ways to lights leave them, looked up in voxels."""

import drjit as dr
import numpy as np

from bakery.kernels import stream_key
from renderers.mitsuba.shading import single

import mitsuba as mi  # isort: skip

_VOXELS = 1 << 16  # of the box around all bodies, about
_RAYS = 4  # of a voxel and lamp, the shortest of which counts


class Cells:
    """A box in cubes of an `edge`, about `count` of them; `shape` : how many along each axis, z fastest."""

    def __init__(self, box, count):
        low, high = box
        edge = float((np.prod(high - low) / count) ** (1 / 3))
        self.shape = np.maximum(np.ceil((high - low) / edge), 1).astype(int)
        self._shape, self._low, self.edge = mi.Vector3u(self.shape.tolist()), mi.Point3f(low.tolist()), mi.Float(edge)
        dr.make_opaque(self._shape, self._low, self.edge)

    def __len__(self):
        return int(np.prod(self.shape))

    def point(self, cell, random):
        """Points anywhere in cubes."""
        row = cell // self._shape.z
        corner = mi.Point3f(row // self._shape.y, row % self._shape.y, cell % self._shape.z)
        return self._low + self.edge * (corner + mi.Point3f(*(random.next_float32() for _ in range(3))))

    def at(self, point):
        """Numbers of the cubes in which points are."""
        cell = mi.Vector3u(dr.clip(mi.Vector3i(dr.floor((point - self._low) / self.edge)), 0, mi.Vector3i(self._shape) - 1))
        return (cell.x * self._shape.y + cell.y) * self._shape.z + cell.z


class Distances:
    """Distances in voxels; 0 in those that no ray shows to be in a body."""

    def __init__(self, scene, manifold, towards):
        """
        scene : of Mitsuba;  manifold : `manifold.Manifold`, the boundaries of the bodies
        towards : functions of points and pairs of uniform numbers: unit directions, 0 where there is none
        """
        self._cells = Cells(manifold.box, _VOXELS)
        self._voxels = dr.opaque(mi.UInt32, len(self._cells))
        self._values = single(np.concatenate([self._shortest(scene, manifold, each, stream_key(0, "render.distances", number))
                                             for number, each in enumerate(towards)]))

    def _shortest(self, scene, manifold, towards, key):
        random = mi.PCG32(len(self._cells) * _RAYS, initstate=int(key))
        point = self._cells.point(dr.arange(mi.UInt32, len(self._cells) * _RAYS) // _RAYS, random)
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
        return dr.gather(mi.Float, self._values, number * self._voxels + self._cells.at(point), active)
