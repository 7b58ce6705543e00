"""The first light on ways that leave bodies and turn at smooth surfaces alone: glass around milk, panes, mirrors."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr

import renderers.mitsuba  # noqa: F401  before mitsuba: it finds LLVM

import mitsuba as mi  # isort: skip

MOST = 8  # surfaces that turn a way


@dataclass
class Chain:
    """Ways on which a light is looked for.

    origin, direction : of the next ray;  random : PCG32, which chooses between reflection and refraction
    inside : bodies around, a bit each;  within : length of the way in the first one;  turns : surfaces that have turned it
    weight : of each wavelength, of what these leave;  active : whether the way goes on
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
    """`Chain` from points in bodies to the first light.

    scene : `scene.Scene`, without boundaries to which light is blind, and without media that have none
    inside : bodies around the points
    """
    width = dr.width(origin)
    start = Chain(mi.Point3f(origin), mi.Vector3f(direction), random, mi.UInt32(inside), dr.zeros(mi.Float, width),
                dr.zeros(mi.UInt32, width), [dr.full(mi.Float, 1, width) for _ in range(scene.waves)], mi.Bool(active),
                dr.zeros(mi.Color3f, width), dr.zeros(mi.EmitterPtr, width))
    return dr.while_loop((start,), lambda chain: chain.active, lambda chain: (_stepped(scene, chain),), label="ways to lights")[0]


def _stepped(scene, chain):
    surface = scene.scene.ray_intersect(mi.Ray3f(chain.origin, chain.direction), mi.RayFlags.All, False, chain.active)
    first = chain.turns == 0
    emitter = surface.emitter(scene.scene, chain.active)
    shines = chain.active & ~first & (emitter != None)  # noqa: E711, compares every lane
    chain.emitter = dr.select(shines, emitter, chain.emitter)
    chain.radiance = dr.select(shines, emitter.eval(surface, shines), chain.radiance)
    meets = chain.active & ~shines & surface.is_valid()
    chain.within = dr.select(meets & first, surface.t, chain.within)
    u = mi.Point2f(chain.random.next_float32(), chain.random.next_float32())
    sample, factor = surface.bsdf().sample(mi.BSDFContext(), surface, chain.random.next_float32(), u, meets)
    factor = scene.reflectance(dr.select(dr.all(dr.isfinite(factor)), factor, 0))
    chain.weight = [dr.select(meets, w * f, w) for w, f in zip(chain.weight, factor)]
    onward = surface.spawn_ray(surface.to_world(sample.wo))
    chain.origin, chain.direction = dr.select(meets, onward.o, chain.origin), dr.select(meets, onward.d, chain.direction)
    inside = scene.boundaries.beyond(surface, onward.d, chain.inside, meets)
    chain.inside = dr.select(meets, inside, chain.inside)
    chain.turns += dr.select(meets, mi.UInt32(1), mi.UInt32(0))
    chain.active = meets & goes_on(sample, chain.inside, chain.turns) & (dr.max(factor) > 0)
    return chain


def goes_on(sample, inside, turns):
    """Whether ways go on with a sample of a BSDF: it turns them in a single direction, and out of bodies."""
    return ~mi.has_flag(sample.sampled_type, mi.BSDFFlags.Smooth) & (inside == 0) & (turns <= MOST)
