"""Media that no surface of the scene bounds: where they are, and where rays come into them and leave them."""

from typing import NamedTuple

import drjit as dr
import numpy as np

from renderers.mitsuba import shapes, variants
from renderers.transport import solids
from renderers.transport.scattering import Scatterer

import mitsuba as mi  # isort: skip

# of the largest coordinate and of the way so far: a ray that looks for the next boundary begins so far beyond the last one
_BEYOND = 4e-7


class Everywhere(NamedTuple):
    """All that no other medium and no body fills."""


class Box(NamedTuple):
    """lo, hi : (3,) m"""

    lo: np.ndarray
    hi: np.ndarray


class Mesh(NamedTuple):
    """vertices, faces : (V, 3) m, (F, 3), closed, outward"""

    vertices: np.ndarray
    faces: np.ndarray


class Grid(NamedTuple):
    """lo, hi : (3,) m
    density : (X, Y, Z) of the scatterer, trilinear between the middles of voxels and constant in the outer halves
    """

    lo: np.ndarray
    hi: np.ndarray
    density: np.ndarray


class Medium(NamedTuple):
    """region : one of the above;  scatterer : `renderers.transport.scattering.Scatterer`;  name : in messages"""

    region: Everywhere | Box | Mesh | Grid
    scatterer: Scatterer
    name: str = ""


def volume(region):
    """Of a region, m^3."""
    if isinstance(region, Everywhere):
        return np.inf
    if isinstance(region, Mesh):
        return solids.volume(region.vertices, region.faces)
    return float(np.prod(np.asarray(region.hi, float) - region.lo))


class Regions:
    """Regions, a bit each, on rays.

    Nothing is kept from one flight to the next: where a ray begins, and its direction, tell which regions it is in.  So a face of
    a region may lie in a surface of the scene, or in a face of another region.

    always : bits of what is everywhere;  bounded : whether there are others
    """

    def __init__(self, regions, unit):
        """
        regions : list of (bit, region)
        unit : m, length of 1 in the loop
        """
        self.always = sum(bit for bit, region in regions if isinstance(region, Everywhere))
        self._boxes = [(mi.UInt32(bit), *(mi.Point3f((np.asarray(corner, float) / unit).tolist())
                                          for corner in (region.lo, region.hi)))
                       for bit, region in regions if isinstance(region, Box | Grid)]
        self._meshes = [(mi.UInt32(bit), boundary(region.vertices, region.faces, unit))
                        for bit, region in regions if isinstance(region, Mesh)]
        self.bounded = bool(self._boxes or self._meshes)
        dr.make_opaque(self._boxes)

    def around(self, ray, start, active):
        """Regions that rays are in at distances `start`, a bit each, and the distances to the next boundary, inf without one."""
        inside, end = mi.UInt32(self.always), mi.Float(dr.inf)
        for bit, low, high in self._boxes:
            near, far = _slab(ray, low, high)
            crossed = near < far
            inside |= dr.select(crossed & (near <= start) & (start < far), bit, mi.UInt32(0))
            boundary_ahead = dr.select(near > start, near, dr.select(far > start, far, dr.inf))
            end = dr.minimum(end, dr.select(crossed, boundary_ahead, dr.inf))
        for bit, scene in self._meshes:
            point = ray(start)
            start_beyond = start + _BEYOND * dr.maximum(dr.maximum(dr.max(dr.abs(point)), dr.max(dr.abs(ray.o))), start)
            surface = scene.ray_intersect(mi.Ray3f(ray(start_beyond), ray.d), mi.RayFlags.Minimal, False, active)
            reached = active & surface.is_valid()
            inside |= dr.select(reached & (dr.dot(surface.n, ray.d) > 0), bit, mi.UInt32(0))
            end = dr.select(reached, dr.minimum(end, start_beyond + surface.t), end)
        return inside, end

    def span(self, ray, far):
        """Distances on rays between which all regions lie: from 0 to `far` with a mesh or what is everywhere."""
        if self.always or self._meshes:
            return mi.Float(0), far
        first, last = mi.Float(dr.inf), mi.Float(0)
        for _, low, high in self._boxes:
            near, end = _slab(ray, low, high)
            crossed = near < end
            first = dr.minimum(first, dr.select(crossed, near, dr.inf))
            last = dr.maximum(last, dr.select(crossed, end, 0))
        last = dr.minimum(last, far)
        return dr.minimum(dr.maximum(first, 0), last), last


def boundary(vertices, faces, unit):
    """A Mitsuba scene of nothing but a mesh.

    Raises SeveralScenes on a graphics card, where others would silently be missed.
    """
    if variants.on_gpu(mi.variant()):
        raise variants.SeveralScenes(f"variant {mi.variant()}: {variants.SEVERAL_SCENES}; use --variant llvm_ad_rgb")
    return shapes.mesh_scene(vertices, faces, unit)


def _slab(ray, low, high):
    """Distances at which rays come into a box and leave it; they miss it where the first is not the lesser."""
    inverse = dr.rcp(dr.select(dr.abs(ray.d) > 1e-20, ray.d, 1e-20))
    first, second = (low - ray.o) * inverse, (high - ray.o) * inverse
    return dr.max(dr.minimum(first, second)), dr.min(dr.maximum(first, second))
