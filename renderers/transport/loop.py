"""Paths from the eye through bodies and the surfaces and lights around them, as one loop of Dr.Jit: one kernel a pass.

Every turn of the loop takes a path to its next surface or scattering, adds the light that it meets there and that of a light
sample, and gives it a new direction.  A path that has ended makes room for the next one of its lane, which has many pixels, so
that lanes of a packet wait for each other once in hundreds of paths.  Light samples reach events in bodies, and surfaces, through boundaries to which light
is blind, less what the media on the way take; small lamps are sampled through smooth boundaries, too (`lamps`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import drjit as dr

import renderers.mitsuba  # noqa: F401  before mitsuba: it finds LLVM
from renderers.transport import flights, media
from renderers.transport.lamps import Departure
from renderers.transport.strata import Strata
from renderers.transport.wavefront import ORDERS

import mitsuba as mi  # isort: skip

# bounces after which roulette by the throughput begins, and after which surfaces end paths one time in twenty: light that is
# caught in glass loses nothing on its way
_ROULETTE, _FAR, _GOES_ON = 4, 64, 0.95
# paths of a lane, about, and lanes at least: a packet goes on until the last of its lanes has none.  In a glass of milk (64 x 64
# pixels, 16 lanes a packet) TODO
_PATHS, _LANES = 256, 256
# bounces after which one path in a thousand ends; what ends earlier makes the others bright
_ENDLESS, _ALMOST = 100_000, 0.999


@dataclass
class Path:
    """Paths, one a lane.

    random : PCG32;  pixel, sample : which path it is;  alive : whether there is one
    origin, direction : of the next flight;  throughput : of each wavelength
    inside : bodies in which it is, a bit each, the innermost one first
    order, bounces : scatterings in bodies; those and surfaces
    drawn, density : where the direction was drawn, and its density (1/sr);  single : no light sample could have found it
    choice : uniform number, of what the first smooth boundary does
    departure : from the last scattering, where lamps are sampled through smooth boundaries; else None
    """

    random: mi.PCG32
    pixel: mi.UInt32
    sample: mi.UInt32
    alive: mi.Bool
    origin: mi.Point3f
    direction: mi.Vector3f
    throughput: list
    inside: mi.UInt32
    order: mi.UInt32
    bounces: mi.UInt32
    drawn: mi.Point3f
    density: mi.Float
    single: mi.Bool
    choice: mi.Float
    departure: Departure | None


@dataclass
class Event:
    """What paths have come to.

    scatters : a scattering in `medium`, at `position`;  sampled : light samples reach it
    meets : a surface;  misses : nothing, but for the environment;  surface : interaction with either
    crosses : that surface is a boundary to which light is blind
    """

    scatters: mi.Bool
    sampled: mi.Bool
    medium: mi.UInt32
    position: mi.Point3f
    meets: mi.Bool
    misses: mi.Bool
    surface: mi.SurfaceInteraction3f
    crosses: mi.Bool


class Turn(NamedTuple):
    """One turn of the loop, as functions of the scene and the paths.

    begin : the paths of the camera as this kind of turn has them
    advance : paths after a flight, and their events, which have at least meets, misses and surface of an `Event`
    next_event : light of light samples, linear sRGB, and its emitters
    turned : paths that go on
    """

    begin: Callable
    advance: Callable
    next_event: Callable
    turned: Callable


def trace(scene, key, pixels, samples, by_light, turn=None):
    """Light of paths, sums of `samples` of each pixel: (pixels * ORDERS * 3,) of linear sRGB, and the same by lights.

    scene : `scene.Scene`;  key : two numbers of 32 bits, of the random stream of a pass
    by_light : whether the second, (pixels * lights * 3,), is more than empty
    turn : `Turn`; that through media if None
    """
    turn = turn or Turn(lambda scene, path: path, advance, next_event, turned)
    lanes = min(pixels, max(_LANES, pixels * samples // _PATHS))
    strata = Strata(key, samples)
    path = turn.begin(scene, begin(scene, key, strata, dr.arange(mi.UInt32, lanes)))
    by_order, of_lights = (dr.zeros(mi.Float, 3 * pixels * kinds) for kinds in (ORDERS, scene.lights * by_light))
    numbers = [dr.opaque(mi.UInt32, number) for number in (pixels, samples, lanes)]

    def step(path):
        path, event = turn.advance(scene, path)
        lights = brought(scene, turn, path, event)
        _add(by_order, path.pixel * ORDERS + dr.minimum(path.order, ORDERS - 1), total([radiance for radiance, _ in lights]))
        if by_light:
            for radiance, emitter in lights:
                number = scene.light_number(emitter)
                _add(of_lights, path.pixel * scene.lights + mi.UInt32(number), radiance, number >= 0)
        path = turn.turned(scene, path, event)
        return (dr.if_stmt((path,), ~path.alive, lambda path: _next(scene, strata, numbers, path), lambda path: path,
                           label="next paths"),)

    dr.while_loop((path,), lambda path: path.alive, step, label="paths")
    return by_order, of_lights


def _next(scene, strata, numbers, path):
    """The lane's next path, in the place of one that is over; numbers : of pixels, of samples of each, of lanes."""
    pixels, samples, lanes = numbers
    path.sample += 1
    done = path.sample >= samples
    path.sample = dr.select(done, 0, path.sample)
    path.pixel += dr.select(done, lanes, 0)
    path.alive = path.pixel < pixels
    drawn = strata.drawn(path.pixel, path.sample, path.random, path.alive)
    for name, value in vars(camera_paths(scene, path.pixel, drawn, path.random, path.alive, path.sample)).items():
        setattr(path, name, value)
    return path


def brought(scene, turn, path, event):
    """Light that paths meet and that of light samples: pairs of linear sRGB and its emitters."""
    refracted = scene.lamps and scene.lamps.connected(path, event)
    emitted = _emitted(scene, path, event, refracted[2] if refracted else 1)
    return [emitted, turn.next_event(scene, path, event), *([refracted[:2]] if refracted else [])]


def first_media(scene, key, pixels):
    """Media (pixels,) int32 in which a path of each pixel first scatters, -1 for none; parameters as of `trace`."""

    def step(path, number):
        path, event = advance(scene, path)
        path = turned(scene, path, event)
        path.alive &= ~event.scatters
        return path, dr.select(event.scatters, mi.Int32(event.medium), number)

    start = begin(scene, key, Strata(key, 1), dr.arange(mi.UInt32, pixels)), dr.full(mi.Int32, -1, pixels)
    return dr.while_loop(start, lambda path, number: path.alive, step, label="first scatterings")[1]


def begin(scene, key, strata, pixel, sample=None):
    """First paths of lanes, samples of pixels, the first ones if None."""
    # as variables: a number would be part of the kernel, and another one another kernel
    key = [dr.opaque(mi.UInt32, number) for number in key]
    width = dr.width(pixel)
    low, high = mi.sample_tea_32(dr.arange(mi.UInt32, width) ^ key[0], key[1])
    random = mi.PCG32(1, mi.UInt64(low), mi.UInt64(high))
    sample, alive = dr.zeros(mi.UInt32, width) if sample is None else sample, dr.full(mi.Bool, True, width)
    return camera_paths(scene, pixel, strata.drawn(pixel, sample, random, alive), random, alive, sample)


def camera_paths(scene, pixel, drawn, random, alive, sample=None):
    """The camera's paths; drawn : places in pixels, and numbers for choices."""
    offset, choice = drawn
    origin, direction = scene.camera_ray(pixel, offset)
    width = dr.width(pixel)
    zero = dr.zeros(mi.UInt32, width)
    return Path(random, pixel, mi.UInt32(zero) if sample is None else sample, alive, origin, direction,
                [dr.full(mi.Float, 1, width) for _ in range(scene.waves)], scene.around_camera + zero, mi.UInt32(zero),
                mi.UInt32(zero), mi.Point3f(origin), dr.zeros(mi.Float, width), dr.full(mi.Bool, True, width), choice,
                scene.lamps and scene.lamps.none(width))


def total(lights):
    """Sum of lights, each of three colours."""
    return [media.total(values) for values in zip(*lights)]


def _add(sums, number, light, active=True):
    """Adds light to sums, by their numbers; those of a pixel belong to one lane, so that their order is that of its paths."""
    active &= (light[0] != 0) | (light[1] != 0) | (light[2] != 0)
    for c in range(3):
        dr.scatter_reduce(dr.ReduceOp.Add, sums, light[c], 3 * number + c, active, dr.ReduceMode.NoConflicts)


def advance(scene, path):
    """Paths after a flight to the next scattering or surface, and which."""
    ray = mi.Ray3f(path.origin, path.direction)
    end = flights.flight(scene, path, ray)
    path.order += dr.select(end.scatters, mi.UInt32(1), mi.UInt32(0))
    misses = path.alive & ~end.meets & ~end.scatters
    surface = end.hit.compute_surface_interaction(ray, mi.RayFlags.All, end.meets | misses)
    crosses = end.meets & scene.boundaries.is_blind(end.hit.shape)
    return path, Event(end.scatters, end.scatters & scene.takes_samples(end.medium), end.medium, ray.o + end.distance * ray.d,
                       end.meets, misses, surface, crosses)


def _emitted(scene, path, event, refracted):
    """Light of the surfaces and of the environment that paths meet, linear sRGB, and its emitters.

    refracted : share that counts of what paths meet by single directions
    """
    active = event.meets | event.misses
    before = dr.zeros(mi.Interaction3f)
    before.p = path.drawn
    seen = mi.DirectionSample3f(scene.scene, event.surface, before)
    active &= seen.emitter != None  # noqa: E711, compares every lane
    by_light = scene.scene.pdf_emitter_direction(before, seen, active & ~path.single)
    share = dr.select(path.single, refracted, balance(path.density, by_light))
    return scene.seen(path.throughput, seen.emitter.eval(event.surface, active) * share, active), seen.emitter


def next_event(scene, path, event):
    """Light of light samples by way of scatterings and surfaces, linear sRGB, and its emitters."""
    surface, at_event = event.surface, event.sampled
    bsdf = surface.bsdf()
    at_surface = event.meets & ~event.crosses & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
    interaction = mi.Interaction3f(0.0, 0.0, dr.zeros(mi.Color0f), dr.select(event.scatters, event.position, surface.p),
                                   dr.select(event.scatters, 0, surface.n))
    u = mi.Point2f(path.random.next_float32(), path.random.next_float32())
    light, radiance = scene.scene.sample_emitter_direction(interaction, u, False, at_surface | at_event)
    active = (at_surface | at_event) & (light.pdf > 0) & dr.any(radiance > 0)
    at_surface, at_event = at_surface & active, at_event & active

    value, by_bsdf = bsdf.eval_pdf(mi.BSDFContext(), surface, surface.to_local(light.d), at_surface)
    phase = scene.media.phase(event.medium, 0.5 * dr.squared_norm(light.d - path.direction))
    albedo = scene.media.albedo(event.medium)
    by_phase = media.mean(media.product(path.throughput, albedo), phase)
    share = dr.select(light.delta, 1, balance(light.pdf, dr.select(event.scatters, by_phase, by_bsdf)))
    radiance *= share * dr.select(event.scatters, mi.Color3f(1), value)
    inside = dr.select(event.scatters, path.inside, scene.boundaries.beyond(surface, light.d, path.inside, at_surface))
    active &= dr.any(radiance > 0)
    passed = flights.transmittance(scene, interaction.spawn_ray_to(light.p), inside, active)
    if scene.regions.always:
        passed = media.product(passed, flights.from_infinity(scene, light))
    weight = [dr.select(event.scatters, a * p, 1) * w * t
              for a, p, w, t in zip(albedo, phase, path.throughput, passed)]
    return scene.seen(weight, radiance, active), light.emitter


def turned(scene, path, event):
    """Paths with a new direction, from where they have come to, or ended."""
    random, surface = path.random, event.surface
    u = [random.next_float32() for _ in range(3)]
    scattered_direction, density, throughput = media.scattered(scene.media, event.medium, path.direction, path.throughput, u)
    shades = event.meets & ~event.crosses
    number, chance_of_lobe = scene.splitting.chosen(path, surface, shades, u[0]) if scene.splitting else (u[0], None)
    sample, factor = surface.bsdf().sample(mi.BSDFContext(), surface, number, mi.Point2f(u[1], u[2]), shades)
    if chance_of_lobe is not None:
        factor *= dr.select(chance_of_lobe > 0, sample.pdf / chance_of_lobe, 1)
    factor = scene.reflectance(dr.select(dr.all(dr.isfinite(factor)), factor, 0))
    throughput = [dr.select(event.scatters, a, dr.select(event.crosses, w, w * f))
                  for a, w, f in zip(throughput, path.throughput, factor)]
    onward = surface.spawn_ray(surface.to_world(sample.wo))
    direction = dr.select(event.scatters, scattered_direction, dr.select(event.crosses, path.direction, onward.d))
    onward.o = dr.select(event.crosses, scene.boundaries.across(surface, path.direction), onward.o)
    chance = mi.Float(1)
    if scene.regions.always:
        chance = dr.select(event.scatters, flights.return_share(scene, path.origin, event.position), 1)
    before = path.direction
    path.origin = dr.select(event.scatters, event.position, onward.o)
    path.inside = dr.select(event.scatters, path.inside, scene.boundaries.beyond(surface, direction, path.inside, event.meets))
    path.direction = direction
    path.throughput = throughput
    fresh = event.scatters | shades
    if scene.lamps:
        path.departure = scene.lamps.departed(path.departure, event, before, sample, density)
    path.single = dr.select(fresh, dr.select(event.scatters, ~event.sampled,
                                             ~mi.has_flag(sample.sampled_type, mi.BSDFFlags.Smooth)), path.single)
    path.density = dr.select(fresh, dr.select(event.scatters, density, sample.pdf), path.density)
    path.drawn = dr.select(fresh, path.origin, path.drawn)
    path.bounces += dr.select(fresh, mi.UInt32(1), mi.UInt32(0))
    path.alive &= ~event.misses & (~event.scatters | scene.holds(event.medium, event.position))
    return roulette(path, shades & (path.bounces > _FAR), chance, random.next_float32())


def roulette(path, far, return_share, u):
    """Without paths of little throughput, one in twenty of those that have come far, and those that hardly come back."""
    most = media.largest(path.throughput)
    chance = dr.minimum(most, dr.select(path.bounces < _ENDLESS, mi.Float(1), mi.Float(_ALMOST)))
    chance = dr.select((most > 0) & (path.bounces < _ROULETTE), 1, chance)
    chance *= return_share * dr.select(far, mi.Float(_GOES_ON), mi.Float(1))
    path.alive &= u < chance
    scale = dr.select(chance > 0, 1 / chance, 0)
    path.throughput = [weight * scale for weight in path.throughput]
    return path


def balance(mine, rival):
    """Balance heuristic of a sample's density against another's."""
    return dr.select(mine > 0, mine / (mine + rival), 0)
