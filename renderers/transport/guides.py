"""Directions in which light comes to points in bodies through smooth boundaries, as they were found from voxels.

From points of each voxel ways of all directions are followed to their first light; directions are drawn by what they have found,
so that light by way of glass around a body, of mirrors, of a wide window and of the sky are drawn alike.
"""

from __future__ import annotations

import math

import drjit as dr
import numpy as np

import renderers.mitsuba  # noqa: F401  before mitsuba: it finds LLVM
from renderers.mitsuba.shading import single
from renderers.transport import specular
from renderers.transport.distances import Distances

import mitsuba as mi  # isort: skip

# Of the box around all bodies, about; bins of directions, of equal solid angles, 0.1 sr; ways of a voxel and bin.  A glass of
# milk under a wide window, variance of all light: 0.043 by 2048 voxels and 2 ways, 0.035 by 8; variance times time 0.141 by 512
# voxels and 8 ways, 1.3 s of a core before the render, and 0.143 by 1024 and 16, 4 s
_VOXELS, _COSINES, _ANGLES, _WAYS = 512, 8, 16, 8
_BINS = _COSINES * _ANGLES
# light is taken to fall off over no less than this share of a voxel: what is deep in thick bodies has to have directions, too
_SHARE = 0.5
_BRIGHT = 0.75  # voxels with more light than this share of all look for it each time that the boundary is near
_SEED = 0x9E3779B9


class Guides:
    """Directions by voxels of the box around bodies.

    share : of the light of these in the mean square of all that ways find, in which small and bright lights count most
    contrast : of this light: its mean square over the square of its mean, where ways come out of bodies
    """

    def __init__(self, scene, manifold, sigma, counts):
        """
        Parameters
        ----------
        scene : `scene.Scene`;  manifold : `manifold.Manifold` of the bodies
        sigma : of each medium, the least extinction if its boundary is one of `manifold`, else 0
        counts : function of emitters: whether their light is looked for
        """
        low, high = manifold.box
        edge = float((np.prod(high - low) / _VOXELS) ** (1 / 3))
        shape = np.maximum(np.ceil((high - low) / edge), 1).astype(int)
        self._shape, self._low, self._edge = mi.Vector3u(shape.tolist()), mi.Point3f(low.tolist()), mi.Float(edge)
        self._sigma = mi.Float(sigma)
        dr.make_opaque(self._shape, self._low, self._edge)
        light = self._measured(scene, manifold, int(np.prod(shape)), counts)
        total = light.sum(axis=1)
        if not (total > 0).any():
            return
        share, solid = light / np.maximum(total, 1e-30)[:, None], 4 * math.pi / _BINS
        often = np.minimum(1, total / np.quantile(total[total > 0], _BRIGHT))
        self._density = single(mi, (share / solid).ravel())
        self._often = single(mi, often)
        self._cumulated = single(mi, np.cumsum(share, axis=1).ravel())
        self._distances = Distances(scene.scene, manifold, [self._towards])

    def _measured(self, scene, manifold, voxels, counts):
        """Light (voxels, bins) that comes to points of voxels in bodies."""
        index = dr.arange(mi.UInt32, voxels * _BINS * _WAYS)
        random = mi.PCG32(voxels * _BINS * _WAYS, initstate=_SEED)
        row = index // _WAYS
        cell, number = row // _BINS, row % _BINS
        corner = self._corner(cell)
        point = self._low + self._edge * (corner + mi.Point3f(*(random.next_float32() for _ in range(3))))
        direction = _in_bin(number, random.next_float32(), random.next_float32())
        ray = mi.Ray3f(point, direction)
        hit = scene.scene.ray_intersect_preliminary(ray, coherent=False)
        active = manifold.begins_within(ray, hit) & scene.boundaries.is_body(hit.shape)
        medium = scene.boundaries.medium(hit.shape)
        chain = specular.followed(scene, point, direction, mi.UInt32(1) << medium, random, active)
        sigma = dr.minimum(dr.gather(mi.Float, self._sigma, medium, active), 1 / (_SHARE * self._edge))
        seen = scene.seen(chain.weight, chain.radiance, active)
        light, passed = sum(seen[1:], seen[0]), dr.exp(-sigma * chain.within)
        light = dr.select((light > 0) & dr.isfinite(light), light, 0)
        light, passed, these = (np.array(values) for values in (light, dr.select(active, passed, 0), counts(chain.emitter)))
        light, passed = light.astype(float), passed.astype(float)
        mean, square, of_all = (passed * light * these).sum(), (passed * light**2 * these).sum(), (passed * light**2).sum()
        self.share, self.contrast = square / max(of_all, 1e-30), square * passed.sum() / max(mean**2, 1e-30)
        return (passed * light * these).reshape(voxels, _BINS, _WAYS).sum(axis=2)

    def _corner(self, cell):
        row = cell // self._shape.z
        return mi.Point3f(row // self._shape.y, row % self._shape.y, cell % self._shape.z)

    def _cell(self, point):
        cell = mi.Vector3u(dr.clip(mi.Vector3i(dr.floor((point - self._low) / self._edge)), 0, mi.Vector3i(self._shape) - 1))
        return (cell.x * self._shape.y + cell.y) * self._shape.z + cell.z

    def number(self, medium, point, active):
        """How many directions points look in, 0 to 1 on average: exp(-s), s mean free paths to where such a way leaves the body,
        and less where less light comes."""
        sigma = dr.gather(mi.Float, self._sigma, medium, active)
        often = dr.gather(mi.Float, self._often, self._cell(point), active)
        return often * dr.exp(-sigma * self._distances.of(point, mi.UInt32(0), active))

    def density(self, point, direction, active):
        """Of directions, 1/sr."""
        return dr.gather(mi.Float, self._density, self._cell(point) * _BINS + _bin(direction), active)

    def drawn(self, point, u, v):
        """Directions by uniform numbers."""
        row = self._cell(point) * _BINS
        number = dr.binary_search(0, _BINS - 1, lambda index: dr.gather(mi.Float, self._cumulated, row + index) <= u)
        below = dr.select(number > 0, dr.gather(mi.Float, self._cumulated, row + dr.maximum(number, 1) - 1), 0)
        within = (u - below) / dr.maximum(dr.gather(mi.Float, self._cumulated, row + number) - below, 1e-12)
        return _in_bin(number, dr.clip(within, 0, 1), v)

    def _towards(self, point, u):
        """Directions of distances; none from voxels without light."""
        towards = self.drawn(point, u.x, u.y)
        return dr.select(dr.gather(mi.Float, self._often, self._cell(point)) > 0, towards, 0)


def _in_bin(number, u, v):
    """Directions in bins, by uniform numbers."""
    cosine = 2 * (mi.Float(number // _ANGLES) + u) / _COSINES - 1
    sine = dr.sqrt(dr.maximum(0, 1 - cosine * cosine))
    y, x = dr.sincos(2 * math.pi * (mi.Float(number % _ANGLES) + v) / _ANGLES)
    return mi.Vector3f(sine * x, sine * y, cosine)


def _bin(direction):
    row = dr.clip(mi.Int32(dr.floor((direction.z + 1) * (_COSINES / 2))), 0, _COSINES - 1)
    turn = dr.atan2(direction.y, direction.x) / (2 * math.pi)
    column = dr.clip(mi.Int32(dr.floor((turn - dr.floor(turn)) * _ANGLES)), 0, _ANGLES - 1)
    return mi.UInt32(row * _ANGLES + column)
