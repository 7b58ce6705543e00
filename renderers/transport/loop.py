"""Paths from the eye through bodies and the surfaces and lights around them, as one loop of Dr.Jit: one kernel a pass.

Every turn of the loop takes a path to its next surface or scattering, adds the light that it meets there and that of a light
sample, and gives it a new direction.  A path that has ended makes room for the next one of its lane, which has many pixels, so
that lanes of a packet wait for each other once in hundreds of paths.  Light samples reach events in bodies, and surfaces,
through boundaries to which light is blind, less what the media on the way take; lights are sampled through smooth boundaries,
too (`samples`).
"""

import drjit as dr
import numpy as np

from renderers.mitsuba import variants
from renderers.transport import flights, media
from renderers.transport.samples import Before
from renderers.transport.state import Event, Numbers, Path, Turn
from renderers.transport.strata import Strata
from renderers.transport.wavefront import ORDERS

import mitsuba as mi  # isort: skip

# bounces after which roulette by the throughput begins, and after which surfaces end some paths: light that is caught in glass
# loses nothing on its way.  A glass of milk, variance times time with 64, 256, 1024 bounces: 0.463, 0.458, 0.461
_ROULETTE, _FAR = 4, 256
# paths of a lane, about, and lanes at least: a packet goes on until the last of its lanes has none.  In a glass of milk packets
# of 16 lanes are busy to 25 % with 4 paths a lane, to some 70 % with 256.  A graphics card wants a hundred thousand lanes: each
# pixel has one
_PATHS, _LANES = 256, 256
# scatterings in bodies until all paths of a packet are looked at together
_SCATTERINGS = 8
# bounces n after which any of them ends some 4 / n; what ends earlier, or more of them, makes the others bright
_ENDLESS = 100_000


def trace(scene, key, pixels, samples, by_light, turn=None, sums=None):
    """Light of paths, sums of `samples` of each pixel: (pixels, ORDERS, 3) of linear sRGB, and (pixels, lights, 3) by lights.

    scene : `scene.Scene`;  key : two numbers of 32 bits, of the random stream of a pass
    by_light : whether the second is more than empty
    turn : `Turn`; `THROUGH_MEDIA` if None
    sums : function of arguments as of `summed` that gives the same; None: that itself
    """
    turn = turn or THROUGH_MEDIA
    lanes = pixels if variants.on_gpu(mi.variant()) else min(pixels, max(_LANES, pixels * samples // _PATHS))
    lamps = scene.lamps.records(lanes, pixels * samples / lanes) if scene.lamps else (None, None)
    by_order, of_lights = (sums or summed)(scene, Numbers.of(key, pixels, lanes, samples), (pixels, lanes), by_light, turn, lamps)
    dr.eval(by_order, of_lights)  # both by one kernel
    by_order, of_lights = (np.asarray(light, dtype=float).reshape(-1, 3) for light in (by_order, of_lights))
    for number, order, emitter, light in scene.lamps.light(lamps[0]) if scene.lamps else ():
        pixel = number // samples
        add(by_order, pixel * ORDERS + np.minimum(order, ORDERS - 1), light)
        if by_light:
            add(of_lights, (pixel * scene.lights + emitter)[emitter >= 0], light[emitter >= 0])
    return by_order.reshape(pixels, ORDERS, 3), of_lights.reshape(pixels, -1, 3) if by_light else of_lights


def summed(scene, numbers, size, by_light, turn, lamps=(None, None)):
    """The loop itself: light by pixel and order, and by pixel and light, as arrays of Dr.Jit.

    numbers : `Numbers`;  size : pixels and lanes;  lamps : records of small lamps, and the counts of each lane
    """
    (pixels, lanes), (records, counts), strata = size, lamps, numbers.strata
    path = turn.begin(scene, begin(scene, numbers.key, strata, dr.arange(mi.UInt32, lanes), numbers.samples))
    path.counts = counts
    by_order, of_lights = (dr.zeros(mi.Float, 3 * pixels * kinds) for kinds in (ORDERS, scene.lights * by_light))

    def step(path):
        path, event = turn.advance(scene, path, records)
        for radiance, emitter, order in brought(scene, turn, path, event, records):
            _add(by_order, path.pixel * ORDERS + dr.minimum(order, ORDERS - 1), radiance)
            if by_light:
                number = scene.light_number(emitter)
                _add(of_lights, path.pixel * scene.lights + mi.UInt32(number), radiance, number >= 0)
        path = turn.turned(scene, path, event, records)
        return (dr.if_stmt((path,), ~path.alive, lambda path: _next(scene, strata, numbers, path), lambda path: path,
                           label="next paths"),)

    dr.while_loop((path,), lambda path: path.alive, step, label="paths")
    return by_order, of_lights


def add(sums, number, light):
    """Adds light (n, 3) to sums (m, 3), by their numbers (n,)."""
    for c in range(3):
        sums[:, c] += np.bincount(number, light[:, c], len(sums))


def _next(scene, strata, numbers, path):
    """The lane's next path, in the place of one that is over."""
    number, lanes = path.number + 1, numbers.lanes
    done = number == (path.pixel + 1) * numbers.samples
    # the next pixels of all lanes in another order: columns of a picture would be lanes, of which some have all of the long paths
    row = path.pixel // lanes
    pixel = dr.select(done, (row + 1) * lanes + (path.pixel - row * lanes + numbers.turn) % lanes, path.pixel)
    path.number, path.alive = dr.select(done, pixel * numbers.samples, number), pixel < numbers.pixels
    drawn = strata.drawn(pixel, path.number - pixel * numbers.samples, path.random, path.alive)
    vars(path).update(vars(camera_paths(scene, pixel, drawn, path.random, path.alive, path.number)) | {"counts": path.counts})
    return path


def brought(scene, turn, path, event, records=None):
    """Light that paths meet and that of light samples: linear sRGB, its emitters and its orders."""
    light, emitter = _emitted(scene, path, event)
    if scene.lamps:
        light = scene.lamps.meets(path, event, emitter, light, records)
    sampled, lamp = turn.next_event(scene, path, event)
    if scene.lamps:
        sampled = scene.lamps.sampled(path, event, sampled)
    light = [(light, emitter, path.order), (sampled, lamp, path.order)]
    if scene.airlight:
        light.append((*scene.airlight.sampled(path, event.stretch), event.stretch.order + 1))
    return light


def first_media(scene, key, pixels):
    """Media (pixels,) int32 in which a path of each pixel first scatters, -1 for none; parameters as of `trace`."""

    def step(path, number):
        path, event = advance(scene, path)
        path = turned(scene, path, event)
        path.alive &= ~event.scatters
        return path, dr.select(event.scatters, mi.Int32(event.medium), number)

    strata = Strata.of(key, 1)
    start = begin(scene, strata.key, strata, dr.arange(mi.UInt32, pixels)), dr.full(mi.Int32, -1, pixels)
    return dr.while_loop(start, lambda path, number: path.alive, step, label="first scatterings")[1]


def begin(scene, key, strata, pixel, samples=1, number=None):
    """First paths of lanes, so many samples of pixels; number : of the paths, None for those of the first samples."""
    number, alive = pixel * samples if number is None else number, dr.full(mi.Bool, True, dr.width(pixel))
    low, high = mi.sample_tea_32(dr.arange(mi.UInt32, dr.width(pixel)) ^ key[0], key[1])
    random = mi.PCG32(1, mi.UInt64(low), mi.UInt64(high))
    return camera_paths(scene, pixel, strata.drawn(pixel, number - pixel * samples, random, alive), random, alive, number)


def camera_paths(scene, pixel, drawn, random, alive, number):
    """The camera's paths, by their numbers; drawn : places in pixels, and numbers for choices."""
    offset, choice = drawn
    origin, direction = scene.camera_ray(pixel, offset)
    width = dr.width(pixel)
    zero = dr.zeros(mi.UInt32, width)
    looked_for = scene.lamps.none(width) if scene.lamps else {"departure": None, "chance": None, "entry": None}
    return Path(random=random, pixel=pixel, number=number, alive=alive, origin=origin, direction=direction,
                throughput=[dr.full(mi.Float, 1, width) for _ in range(scene.waves)], squared_index=dr.full(mi.Float, 1, width),
                inside=scene.around_camera + zero, order=mi.UInt32(zero), bounces=mi.UInt32(zero),
                since=None if scene.most is None else mi.UInt32(zero), drawn=mi.Point3f(origin),
                density=dr.zeros(mi.Float, width), single=dr.full(mi.Bool, True, width), choice=choice, counts=None,
                before=scene.airlight and scene.airlight.none(width), **looked_for)


def _add(sums, number, light, active=True):
    """Adds light to sums, by their numbers; those of a pixel belong to one lane, so that their order is that of its paths."""
    active &= (light[0] != 0) | (light[1] != 0) | (light[2] != 0)
    for c in range(3):
        dr.scatter_reduce(dr.ReduceOp.Add, sums, light[c], 3 * number + c, active, dr.ReduceMode.NoConflicts)


def advance(scene, path, records=None):
    """Paths after a flight to the next scattering or surface, and which."""
    ray = mi.Ray3f(path.origin, path.direction)
    return path, event(scene, path, ray, flights.flight(scene, path, ray), path.alive)


def wandered(scene, path, records=None):
    """The same, after scatterings in bodies that light samples do not reach, at most `_SCATTERINGS`; then there may be no event.

    What the loop does at surfaces takes several times as long as a scattering, and does so for all paths of a packet.
    """
    if not scene.hides:
        return advance(scene, path)
    width = dr.width(path.alive)
    none = dr.full(mi.Bool, False, width)
    end = flights.Flight(none, dr.zeros(mi.UInt32, width), mi.Bool(none), dr.zeros(mi.PreliminaryIntersection3f, width),
                         dr.zeros(mi.Float, width), scene.airlight and scene.airlight.no_stretch(path))
    most = dr.opaque(mi.UInt32, _SCATTERINGS)

    def step(path, end, active, count):
        ray = mi.Ray3f(path.origin, path.direction)
        end = flights.flight(scene, path, ray)
        hidden = end.scatters & ~scene.takes_samples(end.medium)
        path.order += dr.select(hidden, mi.UInt32(1), mi.UInt32(0))
        path = scattered(scene, path, end.medium, ray.o + end.distance * ray.d, hidden, records)
        return path, end, hidden & path.alive & (count < most), count + 1

    start = path, end, mi.Bool(path.alive), dr.full(mi.UInt32, 1, width)
    path, end, *_ = dr.while_loop(start, lambda path, end, active, count: active, step, label="scatterings")
    hidden = end.scatters & ~scene.takes_samples(end.medium)
    end.scatters &= ~hidden
    return path, event(scene, path, mi.Ray3f(path.origin, path.direction), end, path.alive & ~hidden)


def event(scene, path, ray, end, active):
    """`Event` at the ends of flights, which counts as a scattering before light samples are drawn there."""
    path.order += dr.select(end.scatters, mi.UInt32(1), mi.UInt32(0))
    misses = active & ~end.meets & ~end.scatters
    surface = end.hit.compute_surface_interaction(ray, mi.RayFlags.All, end.meets | misses)
    crosses, opaque = end.meets & scene.boundaries.is_blind(end.hit.shape), None
    if scene.far:
        opaque = path.random.next_float32() < scene.far.chance(surface, ray.d, end.meets)
        crosses &= ~opaque
    return Event(end.scatters, end.medium, ray.o + end.distance * ray.d, end.meets, misses, surface, crosses, opaque, end.stretch)


def _emitted(scene, path, event):
    """Light of the surfaces and of the environment that paths meet, linear sRGB, and its emitters."""
    active = event.meets | event.misses
    before = dr.zeros(mi.Interaction3f)
    before.p = path.drawn
    seen = mi.DirectionSample3f(scene.scene, event.surface, before)
    active &= seen.emitter != None  # noqa: E711, compares every lane
    by_light = scene.scene.pdf_emitter_direction(before, seen, active & ~path.single)
    if scene.airlight:
        by_light *= scene.airlight.rival(path, seen.emitter, active)
    share = dr.select(path.single, 1, balance(path.density, by_light))
    return scene.seen(path.throughput, seen.emitter.eval(event.surface, active) * share, active), seen.emitter


def next_event(scene, path, event):
    """Light of light samples by way of scatterings and surfaces, linear sRGB, and its emitters."""
    surface, at_event = event.surface, event.scatters
    if scene.airlight:  # of those flights light samples are taken elsewhere
        at_event = at_event & ~scene.airlight.takes(event.medium, path.inside)
    bsdf = scene.bsdf(event)
    at_surface = event.meets & ~event.crosses & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
    interaction = mi.Interaction3f(0.0, 0.0, dr.zeros(mi.Color0f), dr.select(event.scatters, event.position, surface.p),
                                   dr.select(event.scatters, 0, surface.n))
    u = mi.Point2f(for_light(path), path.random.next_float32())
    light, radiance = scene.scene.sample_emitter_direction(interaction, u, False, at_surface | at_event)
    active = (at_surface | at_event) & (light.pdf > 0) & dr.any(radiance > 0)
    at_surface, at_event = at_surface & active, at_event & active

    value, by_bsdf = bsdf.eval_pdf(mi.BSDFContext(), surface, surface.to_local(light.d), at_surface)
    value = scene.far.outside(event, light.d, value) if scene.far else value
    inside, weights, density = scene.boundaries.beyond(surface, light.d, path.inside, at_surface), path.throughput, by_bsdf
    if scene.samples:
        phase = scene.media.phase(event.medium, 0.5 * dr.squared_norm(light.d - path.direction))
        scatters = media.product(path.throughput, scene.media.albedo(event.medium))
        density = dr.select(event.scatters, media.mean(scatters, phase), by_bsdf)
        weights = [dr.select(event.scatters, s * p, w) for s, p, w in zip(scatters, phase, weights)]
        inside, value = dr.select(event.scatters, path.inside, inside), dr.select(event.scatters, mi.Color3f(1), value)
    radiance *= dr.select(light.delta, 1, balance(light.pdf, density)) * value
    active &= dr.any(radiance > 0)
    passed = flights.of_light(scene, interaction, light, inside, active)
    return scene.seen(media.product(weights, passed), radiance, active), light.emitter


def for_light(path):
    """Uniform numbers that choose among lights: those of the first bounce share out the lights among the samples of a pixel.

    Each light is chosen as often as any other, so that a lamp beside a weak sky counts nothing or twice as much: a matt floor had
    a noise of 77 % a sample by that alone.
    """
    u = path.random.next_float32()
    return dr.select(path.bounces == 0, path.choice, u)


def scattered(scene, path, medium, position, active, records=None):
    """Paths after scatterings at positions in media, which their orders have counted."""
    u = [path.random.next_float32() for _ in range(3)]
    after = media.scattered(scene.media, medium, path.direction, path.throughput, u)
    if scene.aureoles:
        before = path.direction, media.product(path.throughput, scene.media.albedo(medium))
        after = scene.aureoles.scattered(path, scene.media, medium, position, before, after,
                                         active & scene.airlight.takes(medium, path.inside))
    direction, density, throughput = after
    if scene.lamps:
        scene.lamps.departs(path, medium, position, density, active, records)
    share = flights.return_share(scene, path.origin, position) if scene.regions.always else mi.Float(1)
    path.throughput = [dr.select(active, after, before) for after, before in zip(throughput, path.throughput)]
    path.direction, path.origin, path.drawn = (dr.select(active, after, before) for after, before in (
        (direction, path.direction), (position, path.origin), (position, path.drawn)))
    path.density = dr.select(active, density, path.density)
    path.single = dr.select(active, ~scene.takes_samples(medium), path.single)
    path.bounces += dr.select(active, mi.UInt32(1), mi.UInt32(0))
    if scene.most is not None:
        path.since += dr.select(active, mi.UInt32(1), mi.UInt32(0))
    path.alive &= ~active | scene.holds(medium, position)
    return roulette(path, False, share, path.random.next_float32(), active)


def turned(scene, path, event, records=None):
    """Paths with a new direction, from where they have come to, or ended."""
    random, surface = path.random, event.surface
    u = [random.next_float32() for _ in range(3)]
    shades = event.meets & ~event.crosses
    splits = shades & ~event.opaque if scene.far else shades
    number, chance_of_lobe = scene.splitting.chosen(path, surface, splits, u[0]) if scene.splitting else (u[0], None)
    sample, factor = scene.bsdf(event).sample(mi.BSDFContext(), surface, number, mi.Point2f(u[1], u[2]), shades)
    if chance_of_lobe is not None:
        factor *= dr.select(chance_of_lobe > 0, sample.pdf / chance_of_lobe, 1)
    if scene.far:
        factor = scene.far.outside(event, surface.to_world(sample.wo), factor)
    if scene.aureoles:
        sample, factor = scene.aureoles.turned(path, surface, scene.bsdf(event), sample, factor, shades & event.stretch.active)
    factor = scene.reflectance(dr.select(dr.all(dr.isfinite(factor)), factor, 0))
    path.throughput = [dr.select(shades, w * f, w) for w, f in zip(path.throughput, factor)]
    path.squared_index *= dr.select(shades, squared_index(sample), 1)
    before, onward = Before(path.direction, path.inside), surface.to_world(sample.wo)
    origin = dr.select(event.crosses, scene.boundaries.across(surface, path.direction), scene.from_surface(surface, onward))
    path.direction = dr.select(shades, onward, path.direction)
    path.origin = dr.select(event.meets, origin, path.origin)
    path.inside = dr.select(event.meets, scene.boundaries.beyond(surface, path.direction, path.inside, event.meets), path.inside)
    if scene.lamps:
        scene.lamps.turned(path, before, sample, shades)
    path.single = dr.select(shades, ~mi.has_flag(sample.sampled_type, mi.BSDFFlags.Smooth), path.single)
    path.density = dr.select(shades, sample.pdf, path.density)
    path.drawn = dr.select(shades, path.origin, path.drawn)
    path.bounces += dr.select(shades, mi.UInt32(1), mi.UInt32(0))
    if scene.most is not None:
        path.since = dr.select(event.meets, 0, path.since)
    path.alive &= ~event.misses
    path = roulette(path, shades & (path.bounces > _FAR), mi.Float(1), random.next_float32(), event.meets)
    if scene.samples:
        path = scattered(scene, path, event.medium, event.position, event.scatters, records)
    if scene.airlight:
        scene.airlight.scattered(path, event)
    return path


def squared_index(sample):
    """By which refraction divides the throughput, of a sample of a BSDF."""
    return dr.select(sample.eta > 0, dr.square(sample.eta), 1)  # 0 of what met nothing


def roulette(path, far, return_share, u, active=True):
    """Without paths of little throughput, some of those that have come far, and those that hardly come back.

    far : which do so with the chance of one over their bounces;  active : which may end

    Light that is caught in glass leaves it after n bounces with a chance p(n), and goes on so far with a chance q(n), after which
    it counts 1 / q(n).  The mean square of that, the sum of p / q, has a bound where q falls as 1 / n: it is about the mean of n,
    which is the ratio of two areas.  Where q falls as 0.95^n there is none if light is caught for more than twenty bounces.
    """
    # refraction changes radiance, and back again where the path leaves: it makes no path less worth
    most = media.largest(path.throughput) * path.squared_index
    once = 1 - 1 / mi.Float(dr.maximum(path.bounces, 1))
    chance = dr.minimum(most, dr.select(path.bounces < _ENDLESS, mi.Float(1), once**4))
    chance = dr.select((most > 0) & (path.bounces < _ROULETTE), 1, chance)
    chance *= return_share * dr.select(far, once, mi.Float(1))
    chance = dr.select(active, chance, 1)
    path.alive &= u < chance
    scale = dr.select(chance > 0, 1 / chance, 0)
    path.throughput = [weight * scale for weight in path.throughput]
    return path


def balance(mine, rival):
    """Balance heuristic of a sample's density against another's."""
    return dr.select(mine > 0, mine / (mine + rival), 0)


THROUGH_MEDIA = Turn(lambda scene, path: path, wandered, next_event, turned)
