"""Paths over surfaces alone, with no medium around: a turn of `loop.trace` that asks for none."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import drjit as dr

import renderers.mitsuba  # noqa: F401  before mitsuba: it finds LLVM
from renderers.transport import loop, passes, state
from renderers.transport.scene import View

import mitsuba as mi  # isort: skip

_FAR = 256  # bounces after which some paths end: of mirrors that lose nothing there may be no end


@dataclass
class Meeting:
    """What paths have come to.

    meets : a surface;  misses : nothing, but for the environment;  surface : interaction with either
    sample, factor : where they go on, and what of the light
    """

    meets: mi.Bool
    misses: mi.Bool
    surface: mi.SurfaceInteraction3f
    sample: mi.BSDFSample3f
    factor: mi.Color3f


def advance(scene, path, records=None):
    """Paths after a flight to the next surface, and which."""
    ray = mi.Ray3f(path.origin, path.direction)
    hit = scene.scene.ray_intersect_preliminary(ray, coherent=False, active=path.alive)
    meets = path.alive & hit.is_valid()
    surface = hit.compute_surface_interaction(ray, mi.RayFlags.All, path.alive)
    return path, Meeting(meets, path.alive & ~meets, surface, dr.zeros(mi.BSDFSample3f), mi.Color3f(0))


def next_event(scene, path, meeting):
    """Light of light samples by way of surfaces, linear sRGB, and its emitters; draws the next directions of the paths, too."""
    surface, bsdf = meeting.surface, meeting.surface.bsdf()
    active = meeting.meets & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
    u = [path.random.next_float32() for _ in range(5)]
    light, radiance = scene.scene.sample_emitter_direction(surface, mi.Point2f(*u[:2]), True, active)
    active &= (light.pdf > 0) & dr.any(radiance > 0)
    value, by_bsdf = bsdf.eval_pdf(mi.BSDFContext(), surface, surface.to_local(light.d), active)
    meeting.sample, meeting.factor = bsdf.sample(mi.BSDFContext(), surface, u[2], mi.Point2f(*u[3:]), meeting.meets)
    radiance *= value * dr.select(light.delta, 1, loop.balance(light.pdf, by_bsdf))
    return scene.seen(path.throughput, radiance, active), light.emitter


def turned(scene, path, meeting, records=None):
    """Paths with a new direction, from where they have come to, or ended."""
    surface, sample = meeting.surface, meeting.sample
    factor = scene.reflectance(dr.select(dr.all(dr.isfinite(meeting.factor)), meeting.factor, 0))
    path.throughput = [weight * f for weight, f in zip(path.throughput, factor)]
    path.squared_index *= loop.squared_index(sample)
    path.direction = surface.to_world(sample.wo)
    path.origin = scene.from_surface(surface, path.direction)
    path.drawn = mi.Point3f(path.origin)
    path.single, path.density = ~mi.has_flag(sample.sampled_type, mi.BSDFFlags.Smooth), sample.pdf
    path.bounces += mi.UInt32(1)
    path.alive &= meeting.meets
    return loop.roulette(path, path.bounces > _FAR, mi.Float(1), path.random.next_float32())


TURN = state.Turn(lambda scene, path: path, advance, next_event, turned)


def part(name, world, colours, seed):
    """Passes of paths over the surfaces of a world; parameters as those of `passes.part`."""
    scene = cache(lambda: View(world, world.scene, colours))  # with the first pass
    return passes.of_loop(name, world, lambda *arguments: loop.trace(scene(), *arguments, TURN), seed, True)
