"""About how far it is straight from points in bodies to where ways towards lamps leave them, looked up in voxels."""

from __future__ import annotations

import drjit as dr
import numpy as np

import renderers.mitsuba  # noqa: F401  before mitsuba: it finds LLVM
from renderers.transport.skies import Sky

import mitsuba as mi  # isort: skip

_VOXELS = 1 << 16  # of the box around all bodies, about
_RAYS = 4  # of a voxel and lamp, the shortest of which counts


class Distances:
    """Distances in voxels; 0 in those that no ray shows to be in a body."""

    def __init__(self, scene, manifold, lamps):
        """
        Parameters
        ----------
        scene : of Mitsuba;  manifold : `manifold.Manifold`, the boundaries of the bodies;  lamps : shapes of the scene,
            and `skies.Sky`
        """
        low, high = manifold.box
        edge = float((np.prod(high - low) / _VOXELS) ** (1 / 3))
        shape = np.maximum(np.ceil((high - low) / edge), 1).astype(int)
        self._shape, self._low, self._edge = mi.Vector3u(shape.tolist()), mi.Point3f(low.tolist()), mi.Float(edge)
        self._voxels = mi.UInt32(int(np.prod(shape)))
        dr.make_opaque(self._shape, self._low, self._edge, self._voxels)
        self._values = mi.Float(np.concatenate([self._shortest(scene, manifold, lamp, int(np.prod(shape))) for lamp in lamps]))

    def _shortest(self, scene, manifold, lamp, voxels):
        random = mi.PCG32(voxels * _RAYS)
        cell = dr.arange(mi.UInt32, voxels * _RAYS) // _RAYS
        row = cell // self._shape.z
        corner = mi.Point3f(row // self._shape.y, row % self._shape.y, cell % self._shape.z)
        point = self._low + self._edge * (corner + mi.Point3f(*(random.next_float32() for _ in range(3))))
        u = mi.Point2f(random.next_float32(), random.next_float32())
        target = lamp.drawn(point, u, True) if isinstance(lamp, Sky) else lamp.sample_position(0.0, u).p
        ray = mi.Ray3f(point, dr.normalize(target - point))
        hit = scene.ray_intersect_preliminary(ray, coherent=False)
        distance = np.array(dr.select(manifold.begins_within(ray, hit), hit.t, dr.inf)).reshape(-1, _RAYS).min(axis=1)
        return np.where(np.isfinite(distance), distance, 0).astype(np.float32)

    def of(self, point, lamp, active):
        """From points towards a lamp each, by its place among all."""
        cell = mi.Vector3u(dr.clip(mi.Vector3i(dr.floor((point - self._low) / self._edge)), 0, mi.Vector3i(self._shape) - 1))
        cell = (cell.x * self._shape.y + cell.y) * self._shape.z + cell.z
        return dr.gather(mi.Float, self._values, lamp * self._voxels + cell, active)
