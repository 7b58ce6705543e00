"""How far light gets along a ray: flights to the next scattering or surface, and what media leave of light samples."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr

from renderers.transport import media

import mitsuba as mi  # isort: skip

FAR = 1e30  # length of the way to nothing


@dataclass
class Flight:
    """Where flights end: `scatters` in `medium`, or `meets` a surface at `hit`, or neither; `distance` on the ray.

    stretch : `airlight.Stretch`, where light samples are taken along flights; else None
    """

    scatters: mi.Bool
    medium: mi.UInt32
    meets: mi.Bool
    hit: mi.PreliminaryIntersection3f
    distance: mi.Float
    stretch: object = None


def flight(scene, path, ray):
    """The next flights of paths along their rays; changes the throughput."""
    if scene.regions.bounded:
        return _through_regions(scene, path, ray)
    if not scene.entries:  # surfaces alone
        hit = scene.scene.ray_intersect_preliminary(ray, coherent=False, active=path.alive)
        none = dr.full(mi.Bool, False, dr.width(path.alive))
        return Flight(none, dr.zeros(mi.UInt32, dr.width(path.alive)), path.alive & hit.is_valid(), hit, mi.Float(hit.t))
    within, medium = scene.innermost(path.inside | scene.regions.always)
    sigma_t = [dr.select(within, sigma, 0) for sigma in scene.media.sigma_t(medium)]
    distance = media.flight(path.throughput, sigma_t, path.random.next_float32(), path.random.next_float32())
    straight = within & scene.goes_straight(path, medium)
    distance = dr.select(straight, dr.inf, distance)
    takes = path.alive & within & ~straight & scene.airlight.takes(medium, path.inside) if scene.airlight else False
    ray.maxt = dr.select(takes, dr.inf, distance) if scene.airlight else distance
    hit = scene.scene.ray_intersect_preliminary(ray, coherent=False, active=path.alive)
    meets = path.alive & hit.is_valid()
    stretch = None
    if scene.airlight:
        stretch = scene.airlight.stretch(path, ray, takes, (0, dr.select(meets, hit.t, FAR)))
        meets &= hit.t <= distance
    scatters = path.alive & ~meets & (distance < dr.inf)
    # what neither scatters nor meets a surface is in no medium, unless there is one everywhere, or rounding has lost it in a body
    nowhere = FAR if scene.regions.always else dr.select(straight, mi.Float(FAR), mi.Float(0))
    distance = dr.select(meets, hit.t, dr.select(scatters, distance, nowhere))
    if scene.airlight:
        stretch.chance = media.chance(path.throughput, sigma_t, distance, scatters)
    path.throughput = media.flown(path.throughput, sigma_t, distance, scatters, straight)
    return Flight(scatters, medium, meets, hit, distance, stretch)


def _through_regions(scene, path, ray):
    """As `flight`, from one boundary of a region to the next.

    The surface is that of the whole ray: where a boundary lies in it, no rounding takes a path past it.
    """
    hit = scene.scene.ray_intersect_preliminary(ray, coherent=False, active=path.alive)
    far = dr.select(hit.is_valid(), hit.t, FAR)

    stretch = scene.airlight and scene.airlight.stretch(path, ray, path.alive, scene.regions.span(ray, far))

    def step(random, throughput, distance, medium, flies, scatters, chance):
        inside, end = scene.regions.around(ray, distance, flies)
        end = dr.minimum(end, far)
        within, medium_here = scene.innermost(inside | path.inside)
        sigma_t = [dr.select(within, sigma, 0) for sigma in scene.media.sigma_t(medium_here)]
        column = media.flight(throughput, sigma_t, random.next_float32(), random.next_float32())
        stop, passed = marched(scene, ray, distance, end, medium_here, column, flies, within)
        ends_here = flies & (stop < end)
        flown = media.flown(throughput, sigma_t, passed, ends_here)
        if scene.airlight:
            chance *= dr.select(flies, media.chance(throughput, sigma_t, passed, ends_here), 1)
        throughput = [dr.select(flies, after, before) for after, before in zip(flown, throughput)]
        medium = dr.select(flies, medium_here, medium)
        distance = dr.select(flies, stop, distance)
        return random, throughput, distance, medium, flies & ~ends_here & (end < far), scatters | ends_here, chance

    none = dr.full(mi.Bool, False, dr.width(far))
    start = path.random, path.throughput, dr.zeros(mi.Float, dr.width(far)), dr.zeros(mi.UInt32, dr.width(far)), \
        mi.Bool(path.alive), none, dr.full(mi.Float, 1, dr.width(far)) if scene.airlight else None
    path.random, path.throughput, distance, medium, _, scatters, chance = dr.while_loop(
        start, lambda random, throughput, distance, medium, flies, scatters, chance: flies, step, label="regions")
    meets = path.alive & hit.is_valid() & ~scatters
    if scene.airlight:
        stretch.chance = chance
    return Flight(scatters, medium, meets, hit, distance, stretch)


def marched(scene, ray, start, end, medium, column, active, within):
    """Where rays are that have passed a column of a medium, at most at `end`, and the columns that they have passed."""
    stop = dr.minimum(start + column, end)
    passed = dr.select(stop < end, column, end - start)
    if scene.voxels.any:
        uneven = active & within & scene.voxels.has(medium)
        marched, of_voxels = scene.voxels.march(ray, start, end, medium, column, uneven)
        stop, passed = dr.select(uneven, marched, stop), dr.select(uneven, of_voxels, passed)
    return stop, passed


def of_light(scene, interaction, light, inside, active):
    """What gets, of each wavelength, from light samples to interactions, which are inside of bodies, a bit each.

    The way of a light at infinity has no end: Mitsuba puts its points on a sphere around the surfaces, and media may reach
    further.  The medium that is everywhere leaves nothing of it where it takes something.
    """
    ray, infinite = interaction.spawn_ray_to(light.p), mi.has_flag(light.emitter.flags(), mi.EmitterFlags.Infinite)
    ray.maxt = dr.select(infinite, FAR, ray.maxt)
    passed = transmittance(scene, ray, inside, active)
    if not scene.regions.always:
        return passed
    sigma_t = scene.media.sigma_t(scene.innermost(mi.UInt32(scene.regions.always))[1])
    return media.product(passed, [dr.select(infinite & (sigma > 0), mi.Float(0), mi.Float(1)) for sigma in sigma_t])


def transmittance(scene, ray, inside, active):
    """What media leave of light along rays, of each wavelength; 0 where a surface is in between.

    inside : bodies in which the rays begin
    """
    if not (scene.entries or scene.boundaries.blind):
        return [dr.select(active & ~scene.scene.ray_test(ray, active), mi.Float(1), 0)] * scene.media.count

    def step(ray, inside, depth, active):
        hit, meets, crosses = _ahead(scene, ray, active)
        free = active & (crosses | ~meets)
        depth = _deeper(scene, ray, inside, dr.select(meets, hit.t, ray.maxt), depth, free)
        depth[0] = dr.select(meets & ~crosses, dr.inf, depth[0])
        inside, depth = _across(scene, ray, hit, inside, depth, crosses)
        ray.maxt = dr.select(crosses, ray.maxt - hit.t, ray.maxt)
        return ray, inside, depth, crosses & (ray.maxt > 0)

    depth = [dr.zeros(mi.Float, dr.width(active)) for _ in range(scene.media.count)]
    depth = dr.while_loop((ray, inside, depth, active), lambda ray, inside, depth, active: active, step,
                          label="shadow rays")[2]
    free = depth[0] < dr.inf
    return [dr.select(free, dr.exp(-d), 0) for d in depth]


def _ahead(scene, ray, active):
    """What rays meet, whether they do, and whether that is a boundary to which light is blind."""
    hit = scene.scene.ray_intersect_preliminary(ray, coherent=False, active=active)
    meets = active & hit.is_valid()
    return hit, meets, meets & scene.boundaries.is_blind(hit.shape)


def _across(scene, ray, hit, inside, depth, crosses):
    """Bodies beyond the boundaries that rays cross, and optical depths with those of surfaces that turn some of the light which
    goes into bodies; the rays begin there."""
    surface = hit.compute_surface_interaction(ray, mi.RayFlags.Minimal, crosses)
    if scene.far:
        turned = scene.far.depth(surface, ray.d, crosses)
        depth = [d + turned for d in depth]
    ray.o = dr.select(crosses, scene.boundaries.across(surface, ray.d), ray.o)
    return dr.select(crosses, scene.boundaries.beyond(surface, ray.d, inside, crosses), inside), depth


def _deeper(scene, ray, inside, far, depth, active):
    """Optical depths, and those of rays up to distances `far` besides."""
    if not scene.regions.bounded:
        within, medium = scene.innermost(inside | scene.regions.always)
        length = dr.select(active & within, far, 0)
        return [d + sigma * length for d, sigma in zip(depth, scene.media.sigma_t(medium))]

    def step(depth, distance, active):
        around, end = scene.regions.around(ray, distance, active)
        end = dr.minimum(end, far)
        within, medium = scene.innermost(around | inside)
        _, passed = marched(scene, ray, distance, end, medium, mi.Float(dr.inf), active, within)
        passed = dr.select(active & within, passed, 0)
        depth = [d + sigma * passed for d, sigma in zip(depth, scene.media.sigma_t(medium))]
        return depth, dr.select(active, end, distance), active & (end < far)

    start = depth, dr.zeros(mi.Float, dr.width(far)), active & (far > 0)
    return dr.while_loop(start, lambda depth, distance, active: active, step, label="regions of shadow rays")[0]


def reached(scene, ray, inside, distance, active):
    """Media at distances on rays, and optical depths up to there."""
    depth = [dr.zeros(mi.Float, dr.width(active)) for _ in range(scene.media.count)]
    around = scene.regions.around(ray, distance, active)[0] if scene.regions.bounded else scene.regions.always
    return scene.innermost(around | inside)[1], _deeper(scene, ray, inside, distance, depth, active)


def onward(scene, ray, inside, active):
    """The first surfaces ahead to which light is not blind, what media leave on the way, of each wavelength, and bodies there.

    inside : bodies in which the rays begin
    """
    def step(ray, inside, depth, active):
        hit, meets, crosses = _ahead(scene, ray, active)
        depth = _deeper(scene, ray, inside, dr.select(meets, hit.t, FAR), depth, active)
        inside, depth = _across(scene, ray, hit, inside, depth, crosses)
        return ray, inside, depth, crosses

    depth = [dr.zeros(mi.Float, dr.width(active)) for _ in range(scene.media.count)]
    start = mi.Ray3f(ray), mi.UInt32(inside), depth, mi.Bool(active)
    ray, inside, depth, _ = dr.while_loop(start, lambda ray, inside, depth, active: active, step, label="ways ahead")
    surface = scene.scene.ray_intersect(ray, mi.RayFlags.All, False, active)
    return surface, [dr.exp(-d) for d in depth], inside


def return_share(scene, before, after):
    """Chance, for roulette, that paths in a medium without end go on from one scattering to the next: out there that of coming
    back goes with one over the distance."""
    centre, radius = scene.extent
    return dr.minimum(1, dr.maximum(radius, dr.norm(before - centre)) / dr.maximum(radius, dr.norm(after - centre)))
