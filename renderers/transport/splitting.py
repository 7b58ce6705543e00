"""What smooth boundaries do with paths that come straight from the camera: reflection is chosen more often than it happens.

A lamp that is mirrored in glass is bright and reflected one time in twenty-five: were reflection drawn as often as it happens,
few paths would show it, each as bright as the lamp.  Reflected paths cost little, as most end at once.
"""

import drjit as dr
import numpy as np

from renderers.transport.manifold import numbered, refractive_index

import mitsuba as mi  # isort: skip

_BOUNCES = 4  # of paths, up to which they are split
_REFRACTED = 1 - 2.0**-24  # number by which Mitsuba's `dielectric` refracts what it does not reflect totally


def smooth(scene):
    """Shapes of a Mitsuba scene with a `dielectric`."""
    return [shape for shape in scene.shapes() if shape.bsdf() is not None and shape.bsdf().class_name() == "SmoothDielectric"]


class Splitting:
    """Smooth boundaries of a Mitsuba scene."""

    def __init__(self, scene):
        """scene : of Mitsuba"""
        shapes = smooth(scene)
        self._index = numbered(scene, shapes, [refractive_index(shape) for shape in shapes], np.float32)

    def chosen(self, path, surface, active, u):
        """Numbers for Mitsuba's samples of BSDFs, and the chances of what it then does; 0 of paths that are not split.

        u : uniform numbers; of the first bounce `path.choice` takes their place
        """
        index = dr.gather(mi.Float, self._index, dr.reinterpret_array(mi.UInt32, surface.shape), active)
        split = active & (index > 0) & path.single & (path.order == 0) & (path.bounces < _BOUNCES)
        u = dr.select(path.bounces == 0, path.choice, u)
        chance = dr.sqrt(mi.fresnel(surface.wi.z, index)[0])
        reflected = u < chance
        number = dr.select(split, dr.select(reflected, 0, _REFRACTED), u)
        return number, dr.select(split, dr.select(reflected, chance, 1 - chance), 0)
