"""Lights all around a scene as lamps that are drawn: points of a sphere far away, around each point that they shine on."""

import drjit as dr

import renderers.mitsuba  # noqa: F401  before mitsuba: it finds LLVM

import mitsuba as mi  # isort: skip

_FAR = 1e3  # of the size of the scene, the radius of the sphere


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

    def reached(self, x, origin, direction):
        """Points on the spheres around x on rays that begin near there."""
        along = dr.dot(origin - x, direction)
        return origin + direction * (dr.sqrt(dr.square(self._far) - dr.squared_norm(origin - x) + dr.square(along)) - along)

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
        """Of rays that go there."""
        surface = dr.zeros(mi.SurfaceInteraction3f, dr.width(direction))
        surface.wi = -direction
        return self.emitter.eval(surface, active)
