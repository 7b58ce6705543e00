"""About how far it is straight from points in bodies to where ways to lights leave them, looked up in voxels."""

import drjit as dr
import numpy as np

from bakery.kernels import stream_key
from renderers.mitsuba.shading import arrays, single

import mitsuba as mi  # isort: skip

_VOXELS = 1 << 16  # of the box around all bodies, about
_RAYS = 4  # of a voxel and lamp, the shortest of which counts
_STEEP = 0.1  # cosine of rays with planes, below which distances are the same all over the voxel


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
    """Distances to a plane of each voxel, in place of the boundary: in milk a voxel is twenty mean free paths wide, and with one
    distance for all of it most lamps were left to chance.  0 in voxels that no ray shows to be in a body."""

    def __init__(self, scene, manifold, towards):
        """
        scene : of Mitsuba;  manifold : `manifold.Manifold`, the boundaries of the bodies
        towards : functions of points and pairs of uniform numbers: unit directions, 0 where there is none
        """
        self._cells = Cells(manifold.box, _VOXELS)
        self._voxels = dr.opaque(mi.UInt32, len(self._cells))
        self._planes = single(np.concatenate([self._nearest(scene, manifold, each, stream_key(0, "render.distances", number))
                                             for number, each in enumerate(towards)]).ravel())

    def _nearest(self, scene, manifold, towards, key):
        """Of voxels (n, 4), the slope along each axis and the constant of the distance, by the shortest ray."""
        random = mi.PCG32(len(self._cells) * _RAYS, initstate=int(key))
        point = self._cells.point(dr.arange(mi.UInt32, len(self._cells) * _RAYS) // _RAYS, random)
        u = mi.Point2f(random.next_float32(), random.next_float32())
        direction = towards(point, u)
        some = dr.squared_norm(direction) > 0
        ray = mi.Ray3f(point, dr.select(some, direction, mi.Vector3f(0, 0, 1)))
        surface = scene.ray_intersect(ray, mi.RayFlags.Minimal, False, True)
        begins = some & surface.is_valid() & manifold.begins_within(ray)
        cosine = dr.dot(surface.n, ray.d)
        slope = dr.select(begins & (cosine > _STEEP), -surface.n / cosine, 0)
        constant = dr.select(begins, surface.t - dr.dot(slope, point), 0)
        columns = arrays(len(self._cells) * _RAYS, slope.x, slope.y, slope.z, constant, dr.select(begins, surface.t, dr.inf))
        planes, distance = np.stack(columns[:4], axis=-1).reshape(-1, _RAYS, 4), columns[4].reshape(-1, _RAYS)
        return planes[np.arange(len(planes)), distance.argmin(axis=1)]

    def of(self, point, number, active):
        """From points by one of the functions each, by its place among all."""
        x, y, z, constant = dr.gather(mi.Vector4f, self._planes, number * self._voxels + self._cells.at(point), active)
        return dr.maximum(x * point.x + y * point.y + z * point.z + constant, 0)
