"""Paths through bodies and the surfaces and lights around them, all of a pass together.

A path is followed from surface to surface (`surfaces`).  Inside of a body it brings the light of beams (`gather`), scatters as
often as its method lets it, and goes on to the next surface.
"""

import numpy as np

from renderers.materials.bodies import _beams, _geometry, _walk, refraction
from renderers.materials.bodies._walk import Walk
from renderers.materials.bodies.paths import starting, thinned
from renderers.materials.bodies.setup import Sums
from renderers.materials.bodies.surfaces import at_surfaces, located, splits
from renderers.threads import run
from renderers.transport import steps, wavefront
from renderers.transport.paths import Flying, Paths, follow, joined, of_camera
from renderers.transport.scattering import next_event, of_one_component, turn

_ALL = 1 << 17  # paths that go on together; more take more memory, and fewer more calls


def from_eye(transport, most, gather, key, by_paths=True, chosen=None) -> Sums:
    """One path from the eye for each pixel.

    most : of each body, events between two surfaces that a path may have
    gather : `Gather`, or what is called like it, or None
    key : uint64, of the pass: its random numbers
    by_paths : as in `Sums`
    chosen : (H, W) bool, which ones have a path; None: all
    """
    pixels = transport.world.size[0] * transport.world.size[1]
    sums = Sums(pixels, by_paths)

    def camera(first, last):
        pixel = np.arange(first, last)
        paths = begin(transport, pixel, key)
        return paths if chosen is None else paths.of(chosen.ravel()[pixel])

    follow(pixels, _ALL, camera, lambda paths: onward(transport, paths, most, sums, gather))
    return sums


def begin(transport, pixel, key, first=None, places=None) -> Paths:
    """The camera's paths through pixels (n,) of a pass, from path `first` on; if that is None a path a pixel, ascending without
    gaps.

    key : uint64, of `bakery.kernels.stream_key`
    places : (n, 2) in their pixels, row and column, 0 to 1; any if None
    """
    if first is None:
        first = int(pixel[0]) if len(pixel) else 0
    world, width = transport.world, transport.world.size[1]
    rays = world.camera_rays if places is None else lambda _, corners: world.camera_rays(places, corners)
    states, origin, direction = of_camera(rays, key, first, np.stack([pixel // width, pixel % width], axis=1))
    paths = starting(origin, direction, len(transport.colours.to_waves), states, pixel)
    paths.seen[:] = True
    return paths


def onward(transport, paths, most, sums, gather=None, fates=1) -> Paths:
    """Paths after their next surface or event, those that go on; fates : as `inside`."""
    body = located(transport.geometry, paths)
    parts = [at_surfaces(transport, paths.of(body == _geometry.OUTSIDE), sums)]
    for number in np.unique(body[body != _geometry.OUTSIDE]):
        parts += inside(transport, paths.of(body == number), number, most[number], sums, gather, fates)
    return joined(parts)


def through(transport, number, paths, most, waits):
    """Takes paths through a body, as `_walk.advance`: how far they have come (n,)."""
    status, body = np.empty(paths.count, np.int64), transport.bodies[number]
    limits = _walk.Limits(body.shells, most, waits)
    run(_walk.advance, paths.count, transport.geometry, body.medium, limits, paths.part(Walk), status)
    return status


def inside(transport, paths, number, most, sums, gather, fates=1):
    """Parts of the paths in a body after their next surface or event.

    most : events between two surfaces;  fates : paths that scatter for each that comes straight through, where the boundary turns
    light back; if several, those of little weight are thinned
    """
    body = transport.bodies[number]
    if gather is not None:
        gather(transport, paths, number, sums)
    paths.rival[paths.events == 0] = 0.0
    parts = []
    if most:
        split = splits(paths) & (paths.order == 0) & np.isfinite(paths.far) & (paths.triangle >= 0)
        if split.any():
            parts = _both_ways(transport, paths.of(split), number, sums, 1 if body.matched else fates)
            paths = paths.of(~split)
    start = paths.origin.copy()
    status = through(transport, number, paths, most, bool(
        body.matched or sums.by_paths and (transport.bent[number] or transport.chained) or _joins(transport, number, sums)))
    events = status == _walk.EVENT
    parts.append(_at_events(transport, number, paths.of(events), start[events], sums))
    meets = paths.of(status == _walk.CONTACT)
    if fates > 1:
        _, meets = thinned(meets, np.ones(meets.count, bool))
    parts.append(at_surfaces(transport, meets, sums, traced=not body.matched))
    return parts


def _both_ways(transport, paths, number, sums, fates):
    """Parts of paths in a body that come straight through, and, so many of each, that scatter on the way, both for sure."""
    body, straight = transport.bodies[number], paths.of(slice(None))
    fate = paths.of(np.tile(np.arange(paths.count), fates))
    run(_walk.straight, paths.count, body.medium, straight.part(Walk))
    wavefront.branch(straight.states)  # too, as nothing is drawn until it parts in the next body
    wavefront.branch(fate.states, np.repeat(np.arange(1, fates + 1), paths.count))
    start = fate.origin.copy()
    fate.throughput[:] /= fates
    run(_walk.inside, fate.count, body.medium, fate.part(Walk))
    fate.seen[:] = False
    return [at_surfaces(transport, straight, sums, traced=not body.matched),
            _at_events(transport, number, fate, start, sums)]


def _joins(transport, number, sums):
    """Whether beams bring light that paths in a body find, too."""
    return sums.by_paths and transport.rivals is not None and transport.rivals[number] > 0


def _at_events(transport, number, paths, start, sums):
    """Paths that go on from events in a body, after light samples have been added; begun (n, 3) m, where their flights began."""
    if not paths.count:
        return paths
    medium = transport.bodies[number].medium
    if sums.by_paths and (transport.bodies[number].matched or number in transport.lamps):
        _add_light(transport, medium, paths, sums)
    for bent in transport.bent[number] if sums.by_paths else []:
        _add_refracted_light(transport, number, bent, paths, sums)
    before = paths.direction.copy()
    run(turn, paths.count, medium, paths.part(Flying))
    paths.single[:] = False
    if _joins(transport, number, sums):
        flown = np.linalg.norm(paths.origin - start, axis=1)
        run(_beams.rivals, paths.count, medium, transport.rivals[number], flown, before, paths.direction, paths.rival)
        paths.rival[paths.events > 1] = np.inf
    return steps.survivors(paths)


def _add_light(transport, medium, paths, sums):
    """Adds what light samples send by way of events."""
    added = np.empty((paths.count, 3))
    sample = transport.world.lights(paths.origin, wavefront.uniforms(paths.states, 3), hidden=False)
    towards, bright = sample.direction.astype(float), (sample.radiance > 0).any(axis=1)
    passed = transmittance(transport, paths.origin, towards, sample.distance, bright)
    sample, points = sample._replace(direction=towards), of_one_component(paths.count)
    run(next_event, paths.count, medium, transport.colours, paths.part(Flying), points, sample, passed, added)
    sums.add(paths, sample.light, added)


def transmittance(transport, origin, towards, distance, bright):
    """What media leave (n, L) of light on ways of lengths (n,) m to lights; 0 where something hides them, or none is `bright`."""
    n, bodies = len(origin), len(transport.bodies)
    inside, last = np.empty((n, bodies)), np.empty(n)
    run(_geometry.lengths, n, transport.geometry, transport.matched, origin, towards, distance * bright, inside, last)
    seen = bright & np.isfinite(inside).all(axis=1)
    bright_rays = np.flatnonzero(seen)
    last, towards_some = last[bright_rays] + transport.off, towards[bright_rays]
    ahead = distance[bright_rays] * (1 - 1e-4) - last
    hidden = transport.world.trace(origin[bright_rays] + last[:, None] * towards_some, towards_some, np.maximum(ahead, 0))
    seen[bright_rays] = ~(hidden < ahead)
    depth = sum(np.where(seen, inside[:, body], 0.0)[:, None] * transport.sigma_t[body] for body in range(bodies))
    return np.where(seen[:, None], np.exp(-depth), 0.0)


def _add_refracted_light(transport, number, bent, paths, sums):
    """Adds what a light without extent sends through the boundary of body `number` to events in it."""
    if transport.searched < 1:
        paths = thinned(paths, np.ones(paths.count, bool), transport.searched)[1]
        wavefront.branch(paths.states)
    ways = refraction.joined(transport, number, bent, paths)
    with_light = np.flatnonzero(ways.share > 0)
    if not len(with_light):
        return
    reached, point, medium = paths.of(with_light), ways.point[with_light], transport.bodies[number].medium
    sample = transport.world.from_light(bent.number, point)
    away, radiance = sample.direction.astype(float), sample.radiance * ways.share[with_light, None]
    passed = transmittance(transport, point + transport.off * away, away, sample.distance, (radiance > 0).any(axis=1))
    passed *= np.exp(-medium.sigma_t * ways.within[with_light, None])
    sample = sample._replace(direction=ways.towards[with_light], radiance=radiance.astype(np.float32),
                             delta=np.ones(len(with_light), bool))
    added = np.empty((len(with_light), 3))
    points = of_one_component(len(with_light))
    run(next_event, len(with_light), medium, transport.colours, reached.part(Flying), points, sample, passed, added)
    sums.add(reached, sample.light, added)
