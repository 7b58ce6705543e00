"""What a pixel shows of the scene whatever its light: colour, normal and distance of what paths of the camera meet first.

Smooth glass and mirrors are looked through, as are boundaries of bodies: what counts is the first surface that scatters light, or
the first scattering in a medium.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import numpy as np

import renderers.mitsuba  # noqa: F401  before mitsuba: it finds LLVM
from bakery.kernels import stream_key
from renderers.pictures.denoise import Features
from renderers.transport import loop
from renderers.transport.passes import halves
from renderers.transport.scene import Scene
from renderers.transport.strata import Strata

import mitsuba as mi  # isort: skip

SAMPLES = 8  # paths of a pixel
_TURNS = 64  # surfaces and boundaries that a path goes through at most: what is caught in glass shows nothing
_THROUGH = 1 - 2.0**-24  # of dielectrics, the lobe that is chosen last: light goes through, unless it is reflected totally


@dataclass
class _Shown:
    """Of paths: albedo, normal (0 where there is none) and the way (in units of the scene) to what they met; turns so far."""

    albedo: mi.Color3f
    normal: mi.Vector3f
    way: mi.Float
    turns: mi.UInt32


def first_hits(world, entries, colours, seed, samples=SAMPLES) -> Features:
    """Albedo, normal and distance of what the camera sees.

    world, entries, colours : as of `renderers.transport.passes.part`
    samples : paths of a pixel

    Of a surface the albedo is its diffuse reflectance, of a medium that of a single scattering, of a lamp and of the environment
    its radiance, at most 1.  A medium has the normal of the boundary through which paths came into it, and none where it has no
    boundary.  Distances are medians over paths, along the way through glass: a mean would lie where nothing is.
    """
    scene, (height, width) = Scene(world, entries, colours, drawn=False), world.size
    key = halves(stream_key(seed, "render.features"))
    shown = _first_hits(scene, key, height * width, samples)
    dr.eval(shown.albedo, shown.normal, shown.way)

    def layers(values):
        return np.asarray(values, dtype=float).reshape(height, width, samples)

    albedo, normal = (np.stack([layers(channel).mean(axis=2) for channel in image], axis=-1)
                      for image in (shown.albedo, shown.normal))
    distance = world.unit * np.quantile(layers(shown.way), 0.5, axis=2, method="lower")
    return Features(albedo, normal, distance)


def _first_hits(scene, key, pixels, samples) -> _Shown:
    number, width = dr.arange(mi.UInt32, pixels * samples), pixels * samples
    pixel = number // dr.opaque(mi.UInt32, samples)
    strata = Strata.of(key, samples)
    path = loop.begin(scene, strata.key, strata, pixel, strata.count, number)
    shown = _Shown(dr.zeros(mi.Color3f, width), dr.zeros(mi.Vector3f, width), dr.zeros(mi.Float, width),
                   dr.zeros(mi.UInt32, width))
    return dr.while_loop((path, shown), lambda path, shown: path.alive, lambda path, shown: _turn(scene, path, shown),
                         label="features")[1]


def _turn(scene, path, shown):
    """Paths at what they meet next: there, or on their way through it."""
    origin, towards, alive = mi.Point3f(path.origin), mi.Vector3f(path.direction), mi.Bool(path.alive)
    path, event = loop.advance(scene, path)
    surface, bsdf = event.surface, event.surface.bsdf()
    flags = bsdf.flags()
    clear = ~mi.has_flag(flags, mi.BSDFFlags.Smooth) | mi.has_flag(flags, mi.BSDFFlags.GlossyTransmission)
    through = event.meets & (event.crosses | clear) & (shown.turns < _TURNS)
    stops = event.meets & ~through
    normal = dr.mulsign(mi.Vector3f(surface.sh_frame.n), -dr.dot(surface.sh_frame.n, towards))
    position = dr.select(event.scatters, event.position, surface.p)
    path_length = dr.select(event.misses, dr.inf, shown.way + dr.norm(position - origin))

    medium = scene.seen(scene.media.albedo(event.medium), mi.Color3f(1), event.scatters)
    emitted = surface.emitter(scene.scene, stops | event.misses).eval(surface, stops | event.misses)
    reflected = bsdf.eval_diffuse_reflectance(surface, stops)
    albedo = dr.select(event.scatters, mi.Color3f(*medium), dr.maximum(dr.select(stops, reflected, 0), emitted))
    albedo = dr.select(dr.isfinite(albedo), dr.clip(albedo, 0, 1), 0)

    shown.albedo = dr.select(alive & ~through, albedo, shown.albedo)
    shown.normal = dr.select(event.meets, normal, dr.select(event.misses, 0, shown.normal))
    shown.way = dr.select(alive, path_length, shown.way)
    shown.turns += 1
    onward, _ = bsdf.sample(mi.BSDFContext(), surface, _THROUGH, mi.Point2f(0.5), through & ~event.crosses)
    ray = surface.spawn_ray(surface.to_world(onward.wo))
    path.origin = dr.select(event.crosses, scene.boundaries.across(surface, path.direction), ray.o)
    path.direction = dr.select(event.crosses, path.direction, ray.d)
    path.inside = scene.boundaries.beyond(surface, path.direction, path.inside, event.meets)
    path.alive = alive & through & (dr.squared_norm(path.direction) > 0)
    return path, shown
