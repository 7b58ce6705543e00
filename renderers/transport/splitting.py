"""What smooth boundaries do with paths that come straight from the camera: reflection is chosen more often than it happens.

A lamp that is mirrored in glass is bright and reflected one time in twenty-five: were reflection drawn as often as it happens,
few paths would show it, each as bright as the lamp.  Reflected paths cost little, as most end at once.
"""

from __future__ import annotations

import drjit as dr
import numpy as np

import renderers.mitsuba  # noqa: F401  before mitsuba: it finds LLVM
from renderers.transport.manifold import refractive_index

import mitsuba as mi  # isort: skip

_BOUNCES = 4  # of paths, up to which they are split
_REFRACTED = 1 - 2.0**-24  # number by which Mitsuba's `dielectric` refracts what it does not reflect totally


class Splitting:
    """Smooth boundaries of a Mitsuba scene."""

    def __init__(self, scene):
        """scene : of Mitsuba"""
        shapes = scene.shapes()
        numbers = [int(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape))[0]) for shape in shapes]
        table = np.zeros(max(numbers, default=0) + 1, np.float32)
        for number, shape in zip(numbers, shapes):
            if shape.bsdf() is not None and shape.bsdf().class_name() == "SmoothDielectric":
                table[number] = refractive_index(shape)
        self.any = bool(table.any())
        self._index = mi.Float(table)

    def chosen(self, path, surface, active, u):
        """Number for Mitsuba's sample of the BSDF, chance of what it makes of it (0: as it draws itself), which paths are split.

        u : uniform number
        """
        index = dr.gather(mi.Float, self._index, dr.reinterpret_array(mi.UInt32, surface.shape), active)
        split = active & (index > 0) & path.single & (path.order == 0) & (path.bounces < _BOUNCES)
        u = dr.select(path.bounces == 0, path.choice, u)
        chance = dr.sqrt(mi.fresnel(surface.wi.z, index)[0])
        reflected = u < chance
        number = dr.select(split, dr.select(reflected, 0, _REFRACTED), u)
        return number, dr.select(split, dr.select(reflected, chance, 1 - chance), 0)
