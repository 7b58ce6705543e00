"""The first light on ways that leave bodies and turn at smooth surfaces alone: glass around milk, panes, mirrors."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr

import renderers.mitsuba  # noqa: F401  before mitsuba: it finds LLVM

import mitsuba as mi  # isort: skip

MOST = 8  # surfaces that turn a way; in a glass of milk 1 of 100 ways to a light has more than five


@dataclass
class Way:
    """Ways on which a light is looked for.

    origin, direction : of the next ray;  random : PCG32, which chooses between reflection and refraction
    inside : bodies around, a bit each;  within : length of the way in the first one;  turns : surfaces that have turned it
    weight : of each wavelength, of what these leave;  active : whether the way goes on
    surface, meets : of the light, if there is one
    radiance, emitter : of the light, linear sRGB, 0 without one
    """

    origin: mi.Point3f
    direction: mi.Vector3f
    random: mi.PCG32
    inside: mi.UInt32
    within: mi.Float
    turns: mi.UInt32
    weight: list
    active: mi.Bool
    radiance: mi.Color3f
    emitter: mi.EmitterPtr


def followed(scene, origin, direction, inside, random, active):
    """`Way` from points in bodies to the first light.

    scene : `scene.Scene`, without boundaries to which light is blind, and without media that have none
    inside : bodies around the points
    """
    width = dr.width(origin)
    start = Way(mi.Point3f(origin), mi.Vector3f(direction), random, mi.UInt32(inside), dr.zeros(mi.Float, width),
                dr.zeros(mi.UInt32, width), [dr.full(mi.Float, 1, width) for _ in range(scene.waves)], mi.Bool(active),
                dr.zeros(mi.Color3f, width), dr.zeros(mi.EmitterPtr, width))
    return dr.while_loop((start,), lambda way: way.active, lambda way: (_stepped(scene, way),), label="ways to lights")[0]


def _stepped(scene, way):
    surface = scene.scene.ray_intersect(mi.Ray3f(way.origin, way.direction), mi.RayFlags.All, False, way.active)
    first = way.turns == 0
    emitter = surface.emitter(scene.scene, way.active)
    lit = way.active & ~first & (emitter != None)  # noqa: E711, compares every lane
    way.emitter = dr.select(lit, emitter, way.emitter)
    way.radiance = dr.select(lit, emitter.eval(surface, lit), way.radiance)
    meets = way.active & ~lit & surface.is_valid()
    way.within = dr.select(meets & first, surface.t, way.within)
    u = mi.Point2f(way.random.next_float32(), way.random.next_float32())
    sample, factor = surface.bsdf().sample(mi.BSDFContext(), surface, way.random.next_float32(), u, meets)
    factor = scene.reflectance(dr.select(dr.all(dr.isfinite(factor)), factor, 0))
    way.weight = [dr.select(meets, w * f, w) for w, f in zip(way.weight, factor)]
    onward = surface.spawn_ray(surface.to_world(sample.wo))
    way.origin, way.direction = dr.select(meets, onward.o, way.origin), dr.select(meets, onward.d, way.direction)
    inside = scene.boundaries.beyond(surface, onward.d, way.inside, meets)
    way.inside = dr.select(meets, inside, way.inside)
    way.turns += dr.select(meets, mi.UInt32(1), mi.UInt32(0))
    way.active = meets & goes_on(sample, way.inside, way.turns) & (dr.max(factor) > 0)
    return way


def goes_on(sample, inside, turns):
    """Whether ways go on with a sample of a BSDF: it turns them in a single direction, and out of bodies."""
    return ~mi.has_flag(sample.sampled_type, mi.BSDFFlags.Smooth) & (inside == 0) & (turns <= MOST)
