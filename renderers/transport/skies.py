"""Lights all around a scene as lamps that are drawn: points of a sphere far away, around each point that they shine on.

A point of the sphere around x stands for the direction from x to it, in all that asks for radiance or density, also where light
arrives there from elsewhere in the scene: at the rim of a sun of half a degree the two would else be of different places, bright
light that is hardly ever drawn.
"""

import drjit as dr

import renderers.mitsuba  # noqa: F401  before mitsuba: it finds LLVM

import mitsuba as mi  # isort: skip

_FAR = 1e5  # of the size of the scene, the radius of the sphere: directions from anywhere in it are the same within 1e-5


class Sky:
    """The environment of a Mitsuba scene.

    emitter : of Mitsuba
    """

    def __init__(self, scene):
        """scene : `scene.Scene`, with an environment"""
        self.emitter = scene.scene.environment()
        self._far = _FAR * scene.extent[1]

    def drawn(self, x, u, active):
        """Points on the spheres around points x."""
        at = mi.Interaction3f(0.0, 0.0, dr.zeros(mi.Color0f), x, dr.zeros(mi.Normal3f))
        return x + self._far * self.emitter.sample_direction(at, u, active)[0].d

    def reached(self, x, direction):
        """Points on the spheres around x that stand for directions."""
        return x + self._far * direction

    def density(self, x, y, active):
        """Of points y, one over the area."""
        return self.solid_density(x, y, active) / dr.square(self._far)

    def solid_density(self, x, y, active=True):
        """Of directions towards points y, 1/sr."""
        at = mi.Interaction3f(0.0, 0.0, dr.zeros(mi.Color0f), x, dr.zeros(mi.Normal3f))
        sample = dr.zeros(mi.DirectionSample3f, dr.width(x))
        sample.d, sample.n, sample.dist = dr.normalize(y - x), dr.normalize(x - y), mi.Float(self._far)
        return self.emitter.pdf_direction(at, sample, active)

    def radiance(self, direction, active):
        """From directions."""
        surface = dr.zeros(mi.SurfaceInteraction3f, dr.width(direction))
        surface.wi = -direction
        return self.emitter.eval(surface, active)
