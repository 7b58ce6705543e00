"""Paths from the eye through bodies and the surfaces and lights around them, as one loop of Dr.Jit: one kernel a pass.

Every turn of the loop takes a path to its next surface or scattering, adds the light that it meets there and that of a light
sample, and gives it a new direction.  A path that has ended makes room for the next sample of its pixel, so that paths of a
packet wait for each other once in several.  Light samples reach events in bodies, and surfaces, through boundaries to which light
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
from renderers.transport.strata import Counts, Strata
from renderers.transport.wavefront import ORDERS

import mitsuba as mi  # isort: skip

# bounces after which roulette by the throughput begins, and after which surfaces end paths one time in twenty: light that is
# caught in glass loses nothing on its way
_ROULETTE, _FAR, _GOES_ON = 4, 64, 0.95
# bounces after which one path in a thousand ends; what ends earlier makes the others bright
_ENDLESS, _ALMOST = 100_000, 0.999


@dataclass
class Path:
    """Paths, one a lane.

    random : PCG32;  samples : paths of the lane that are over;  alive : whether there is one
    origin, direction : of the next flight;  throughput : of each wavelength
    inside : bodies in which it is, a bit each, the innermost one first
    order, bounces : scatterings in bodies; those and surfaces
    drawn, density : where the direction was drawn, and its density (1/sr);  single : no light sample could have found it
    choice : uniform number, of what the first smooth boundary does
    departure : from the last scattering, where lamps are sampled through smooth boundaries; else None
    """

    random: mi.PCG32
    samples: mi.UInt32
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


class Numbers(NamedTuple):
    """Numbers of a pass as variables: they would be part of the kernel, and others another kernel.

    key : two of 32 bits, of the random stream;  lanes, samples : of a pixel, and of each of its lanes;  counts : `strata.Counts`
    """

    key: list
    lanes: mi.UInt32
    samples: mi.UInt32
    counts: Counts

    @classmethod
    def of(cls, key, lanes, samples) -> Numbers:
        """Of a key, lanes of a pixel, and samples of a lane."""
        *halves, together, each = (dr.opaque(mi.UInt32, number) for number in (*key, lanes, samples))
        return cls(halves, together, each, Counts.of(lanes, samples))

    @classmethod
    def from_list(cls, numbers) -> Numbers:
        """Of what `to_list` gives: recordings take lists."""
        first, second, lanes, samples, *counts = numbers
        return cls([first, second], lanes, samples, Counts(*counts))

    def to_list(self) -> list:
        """All of its variables."""
        return [*self.key, self.lanes, self.samples, *self.counts]


def trace(scene, key, pixels, lanes, samples, by_light, turn=None, numbers=None):
    """Light of paths: 3 ORDERS arrays (pixels * lanes) of linear sRGB, sums of `samples` paths a lane, and the same by lights.

    scene : `scene.Scene`;  key : two numbers of 32 bits, of the random stream of a pass
    by_light : whether the second, (pixels * lanes * lights * 3,), is more than empty
    turn : `Turn`; that through media if None
    numbers : `Numbers` of key, lanes and samples, where they are known
    """
    turn = turn or Turn(lambda scene, path: path, advance, next_event, turned)
    numbers = numbers or Numbers.of(key, lanes, samples)
    lane, pixel, strata, path = _begin(scene, numbers, pixels * lanes)
    path = turn.begin(scene, path)
    sums = [dr.zeros(mi.Float, dr.width(lane)) for _ in range(3 * ORDERS)]
    of_lights = dr.zeros(mi.Float, 3 * pixels * lanes * scene.lights * by_light)

    def step(path, sums):
        path, event = turn.advance(scene, path)
        lights = brought(scene, turn, path, event)
        add(sums, path.order, *(radiance for radiance, _ in lights))
        if by_light:
            for radiance, source in lights:
                _add_by_light(scene, of_lights, lane, radiance, source)
        return _renewed(scene, pixel, strata, numbers.samples, turn.turned(scene, path, event)), sums

    return dr.while_loop((path, sums), lambda path, sums: path.alive, step, label="paths")[1], of_lights


def brought(scene, turn, path, event):
    """Light that paths meet and that of light samples: pairs of linear sRGB and its emitters."""
    refracted = scene.lamps and scene.lamps.connected(path, event)
    emitted = _emitted(scene, path, event, refracted[2] if refracted else 1)
    return [emitted, turn.next_event(scene, path, event), *([refracted[:2]] if refracted else [])]


def first_media(scene, key, pixels, lanes):
    """Media (pixels * lanes,) int32 in which a path of each lane first scatters, -1 for none; parameters as of `trace`."""
    *_, path = begin(scene, key, pixels, lanes)

    def step(path, number):
        path, event = advance(scene, path)
        path = turned(scene, path, event)
        path.alive &= ~event.scatters
        return path, dr.select(event.scatters, mi.Int32(event.medium), number)

    start = path, dr.full(mi.Int32, -1, dr.width(path.alive))
    return dr.while_loop(start, lambda path, number: path.alive, step, label="first scatterings")[1]


def begin(scene, key, pixels, lanes, samples=1):
    """Lanes, their pixels, the strata of their samples, and their first paths."""
    return _begin(scene, Numbers.of(key, lanes, samples), pixels * lanes)


def _begin(scene, numbers, width):
    key, lane = numbers.key, dr.arange(mi.UInt32, width)
    pixel = lane // numbers.lanes
    strata = Strata(lane, pixel, key, numbers.counts)
    low, high = mi.sample_tea_32(lane ^ key[0], key[1])
    random = mi.PCG32(1, mi.UInt64(low), mi.UInt64(high))
    first, alive = dr.zeros(mi.UInt32, dr.width(lane)), dr.full(mi.Bool, True, dr.width(lane))
    path = camera_paths(scene, pixel, strata.drawn(first, random, alive), random, first, alive)
    return lane, pixel, strata, path


def camera_paths(scene, pixel, drawn, random, samples, alive):
    """The camera's paths; drawn : places in pixels, and numbers for choices."""
    offset, choice = drawn
    origin, direction = scene.camera_ray(pixel, offset)
    width = dr.width(pixel)
    zero = dr.zeros(mi.UInt32, width)
    return Path(random, samples, alive, origin, direction, [dr.full(mi.Float, 1, width) for _ in range(scene.waves)],
                scene.around_camera + zero, mi.UInt32(zero), mi.UInt32(zero),
                mi.Point3f(origin), dr.zeros(mi.Float, width), dr.full(mi.Bool, True, width), choice,
                scene.lamps and scene.lamps.none(width))


def _renewed(scene, pixel, strata, samples, path):
    """Paths, and new ones of the camera where they are over."""
    over = ~path.alive
    count = path.samples + dr.select(over, mi.UInt32(1), mi.UInt32(0))
    alive = count < samples
    new = camera_paths(scene, pixel, strata.drawn(count, path.random, alive), path.random, count, alive)
    for name in ("alive", "origin", "direction", "inside", "order", "bounces", "drawn", "density", "single", "choice"):
        setattr(path, name, dr.select(over, getattr(new, name), getattr(path, name)))
    path.throughput = [dr.select(over, mi.Float(1), weight) for weight in path.throughput]
    path.samples = count
    if scene.lamps:
        path.departure.density = dr.select(over, 0, path.departure.density)
    return path


def add(sums, order, *lights):
    """Adds light to the sums of its order."""
    for k in range(ORDERS):
        of_order = order == k if k < ORDERS - 1 else order >= k
        for c in range(3):
            sums[3 * k + c] = sums[3 * k + c] + dr.select(of_order, media.total([light[c] for light in lights]), 0)


def _add_by_light(scene, sums, lane, radiance, emitter):
    """Adds light to the sums of its emitter; those of a lane are its own, so that their order is that of the paths."""
    number = scene.light_number(emitter)
    active = (number >= 0) & ((radiance[0] != 0) | (radiance[1] != 0) | (radiance[2] != 0))
    for c in range(3):
        slot = (lane * scene.lights + mi.UInt32(number)) * 3 + c
        dr.scatter_reduce(dr.ReduceOp.Add, sums, radiance[c], slot, active, dr.ReduceMode.NoConflicts)


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
