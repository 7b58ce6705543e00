"""Directions in which light comes to points in bodies through their boundaries, as they were found from voxels.

From points of each voxel ways of all directions are followed to their first light; directions are drawn by what they have found,
so that light by way of glass around a body, of mirrors, of a wide window and of the sky are drawn alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import drjit as dr
import numpy as np

from bakery.kernels import stream_key
from renderers.mitsuba.shading import arrays, single
from renderers.transport import media
from renderers.transport.distances import Cells, Distances

import mitsuba as mi  # isort: skip

# Of the box around all bodies, about; bins of directions, of equal solid angles, 0.1 sr; ways of a voxel and bin.  A glass of
# milk under a wide window, variance of all light: 0.043 by 2048 voxels and 2 ways, 0.035 by 8; variance times time 0.141 by 512
# voxels and 8 ways, 1.3 s of a core before the render, and 0.143 by 1024 and 16, 4 s
_VOXELS, BINS, WAYS = 512, (8, 16), 8
# light is taken to fall off over no less than this share of a voxel: what is deep in thick bodies has to have directions, too
_SHARE = 0.5
_BRIGHT = 0.75  # voxels with more light than this share of all look for it each time that the boundary is near


@dataclass
class Sight:
    """Scatterings from which one more direction is looked in.

    number, inside, order, throughput : of the path there;  event, before, medium : where, the direction there, the body's
    u, v : numbers for a direction
    """

    number: mi.UInt32
    event: mi.Point3f
    before: mi.Vector3f
    medium: mi.UInt32
    inside: mi.UInt32
    order: mi.UInt32
    throughput: list
    u: mi.Float
    v: mi.Float


class Looking:
    """Light samples at scatterings in bodies, which look in one more direction that guides draw.

    KIND : name of their records
    guides : `Guides`;  scene : `scene.Scene`;  sigma : least extinction of each medium, 0 where they do not look
    """

    def looks(self, path, medium, position, active, records):
        """Whether paths that scatter at positions look for light from there; some keep a record."""
        looks = active & (dr.gather(mi.Float, self.sigma, medium) > 0) & records.has_space(path.counts, self.KIND)
        u, v, w = (path.random.next_float32() for _ in range(3))
        sight = Sight(path.number, position, path.direction, medium, path.inside, path.order, path.throughput, u, v)
        records.add(path.counts, self.KIND, sight, looks & (w < self.guides.number(medium, position, looks)))
        return looks

    def density(self, medium, point, direction, active):
        """Of directions of light samples, 1/sr."""
        return self.guides.number(medium, point, active) * self.guides.density(point, direction, active)

    def reaches(self, medium, length, active=True):
        """About the probability that paths go so far in a body."""
        return dr.exp(-dr.gather(mi.Float, self.sigma, medium, active) * length)

    def light(self, records):
        """What records come to: numbers (n,) of paths, orders (n,), emitters, and light (n, 3)."""
        sight = records.kept(self.KIND)
        if sight is None:
            return
        direction = self.guides.drawn(sight.event, sight.u, sight.v)
        density = self.density(sight.medium, sight.event, direction, mi.Bool(True))
        low, high = mi.sample_tea_32(dr.reinterpret_array(mi.UInt32, sight.u), dr.reinterpret_array(mi.UInt32, sight.v))
        for emitter, light in self.followed(sight, direction, density, mi.PCG32(1, mi.UInt64(low), mi.UInt64(high))):
            yield sight.number, sight.order, emitter, light

    def redirected(self, sight, direction, density, length):
        """Throughput of each wavelength in directions, and one over their density, by the phase function and by the guides."""
        weights = media.product(sight.throughput, self.scene.media.albedo(sight.medium))
        phase = self.scene.media.phase(sight.medium, 0.5 * dr.squared_norm(direction - sight.before))
        scale = dr.rcp(media.mean(weights, phase) * self.reaches(sight.medium, length) + density)
        return media.product(weights, phase), scale


class Guides:
    """Directions by voxels of the box around bodies.

    share : of the light of these in the mean square of all that ways find, in which small and bright lights count most
    contrast : of this light: its mean square over the square of its mean, where ways come out of bodies
    """

    def __init__(self, scene, manifold, sigma, follow, bins=BINS, ways=WAYS, blur=0.0):
        """
        scene : `scene.Scene`;  manifold : `manifold.Manifold` of the bodies
        sigma : of each medium, the least extinction if its boundary is one of `manifold`, else 0
        follow : function of points in bodies, directions, media, a PCG32 and which are active -> light of each wavelength that
            comes that way, how far it is in the body, and whether it is looked for
        bins : of the cosine and of the angle;  ways : of a voxel and bin
        blur : share of the light of voxels and bins that neighbours get, on each side along each axis
        """
        self._bins, self._count, self._ways = bins, bins[0] * bins[1], ways
        self._cells, self._sigma = Cells(manifold.box, _VOXELS), mi.Float(sigma)
        light = self._measured(scene, manifold, len(self._cells), follow)
        light = _blurred(light.reshape(*self._cells.shape, *bins), blur).reshape(light.shape) if blur else light
        total = light.sum(axis=1)
        if not (total > 0).any():
            return
        share, solid = light / np.maximum(total, 1e-30)[:, None], 4 * math.pi / self._count
        often = np.minimum(1, total / np.quantile(total[total > 0], _BRIGHT))
        self._density = single((share / solid).ravel())
        self._often = single(often)
        self._cumulated = single(np.cumsum(share, axis=1).ravel())
        self._distances = Distances(scene.scene, manifold, [self._towards])

    def _measured(self, scene, manifold, voxels, follow):
        """Light (voxels, bins) that comes to points of voxels in bodies."""
        index = dr.arange(mi.UInt32, voxels * self._count * self._ways)
        random = mi.PCG32(voxels * self._count * self._ways, initstate=int(stream_key(0, "render.guides")))
        row = index // self._ways
        cell, number = row // self._count, row % self._count
        point = self._cells.point(cell, random)
        direction = self._in_bin(number, random.next_float32(), random.next_float32())
        ray = mi.Ray3f(point, direction)
        hit = scene.scene.ray_intersect_preliminary(ray, coherent=False)
        active = hit.is_valid() & scene.boundaries.is_body(hit.shape) & manifold.begins_within(ray)
        medium = scene.boundaries.medium(hit.shape)
        seen, within, these = follow(point, direction, medium, random, active)
        sigma = dr.minimum(dr.gather(mi.Float, self._sigma, medium, active), 1 / (_SHARE * self._cells.edge))
        light, passed = sum(seen[1:], seen[0]), dr.exp(-sigma * within)
        light = dr.select((light > 0) & dr.isfinite(light), light, 0)
        light, passed, these = arrays(len(index), light, dr.select(active, passed, 0), these)
        light, passed = light.astype(float), passed.astype(float)
        mean, square, of_all = (passed * light * these).sum(), (passed * light**2 * these).sum(), (passed * light**2).sum()
        self.share, self.contrast = square / max(of_all, 1e-30), square * passed.sum() / max(mean**2, 1e-30)
        return (passed * light * these).reshape(voxels, self._count, self._ways).sum(axis=2)

    def number(self, medium, point, active):
        """How many directions points look in, 0 to 1 on average: exp(-s), s mean free paths to where such a way leaves the body,
        and less where less light comes."""
        sigma = dr.gather(mi.Float, self._sigma, medium, active)
        often = dr.gather(mi.Float, self._often, self._cells.at(point), active)
        return often * dr.exp(-sigma * self._distances.of(point, mi.UInt32(0), active))

    def density(self, point, direction, active):
        """Of directions, 1/sr."""
        return dr.gather(mi.Float, self._density, self._cells.at(point) * self._count + self._bin(direction), active)

    def drawn(self, point, u, v):
        """Directions by uniform numbers."""
        row = self._cells.at(point) * self._count
        number = dr.binary_search(0, self._count - 1, lambda index: dr.gather(mi.Float, self._cumulated, row + index) <= u)
        below = dr.select(number > 0, dr.gather(mi.Float, self._cumulated, row + dr.maximum(number, 1) - 1), 0)
        within = (u - below) / dr.maximum(dr.gather(mi.Float, self._cumulated, row + number) - below, 1e-12)
        return self._in_bin(number, dr.clip(within, 0, 1), v)

    def _towards(self, point, u):
        """Directions of distances; none from voxels without light."""
        towards = self.drawn(point, u.x, u.y)
        return dr.select(dr.gather(mi.Float, self._often, self._cells.at(point)) > 0, towards, 0)

    def _in_bin(self, number, u, v):
        """Directions in bins, by uniform numbers."""
        cosines, angles = self._bins
        cosine = 2 * (mi.Float(number // angles) + u) / cosines - 1
        sine = dr.sqrt(dr.maximum(0, 1 - cosine * cosine))
        y, x = dr.sincos(2 * math.pi * (mi.Float(number % angles) + v) / angles)
        return mi.Vector3f(sine * x, sine * y, cosine)

    def _bin(self, direction):
        cosines, angles = self._bins
        row = dr.clip(mi.Int32(dr.floor((direction.z + 1) * (cosines / 2))), 0, cosines - 1)
        turn = dr.atan2(direction.y, direction.x) / (2 * math.pi)
        column = dr.clip(mi.Int32(dr.floor((turn - dr.floor(turn)) * angles)), 0, angles - 1)
        return mi.UInt32(row * angles + column)


def _blurred(light, share):
    """Light (x, y, z, cosines, angles) of which neighbours on each side get a share along each axis; angles go around."""
    from scipy.ndimage import convolve1d

    for axis in range(light.ndim):
        light = convolve1d(light, [share, 1 - 2 * share, share], axis, mode="wrap" if axis == light.ndim - 1 else "nearest")
    return light
