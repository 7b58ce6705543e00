"""Paths through bodies and the surfaces and lights around them, all of a pass together.

A path is followed from surface to surface.  Inside of a body it brings the light of beams (`_gather`), scatters as often as its
method lets it, and goes on to the next surface, where Mitsuba turns it.  Boundaries to which light is blind are crossed here.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bakery.kernels import stream_key
from renderers.materials.bodies import _beams, _choice, _gather, _geometry, _walk, refraction
from renderers.materials.bodies.bodies import Body
from renderers.materials.bodies.paths import Paths
from renderers.mitsuba.shading import LOBE, selected
from renderers.threads import run
from renderers.transport import steps, wavefront
from renderers.transport.paths import Colours, follow, joined, of_camera
from renderers.transport.scattering import mean_cosines, next_event, turn

_ALL = 1 << 17  # paths that go on together; more take more memory, and fewer more calls
_SPLITS, _WORTH = 4, 0.01  # surfaces at which paths go both ways, and the weight above which they do
_FAR = 64  # bounces after which surfaces end paths
_WEAK = 0.1  # weight of lines of sight, below which not all of them gather
_OFF = 1e-6  # of the size of all bodies, that a path is put beyond a boundary which it crosses
_CERTAIN = 1e20  # 1/sr, of a direction that is drawn for sure, as single precision has room for


class Transport(NamedTuple):
    """How light goes.

    world : `renderers.mitsuba.world.World`;  bodies : list of `Body`;  geometry : `_geometry.Geometry`;  colours : `Colours`
    bent : of each body, ways of light through its boundary (`refraction.Bent`) from each light that paths cannot find through it
    rivals : (bodies,) m sr, how many beams bring light of lamps through boundaries, besides paths (`beams.rivals_of`); 0 where
        none do; None: nowhere
    panes : whether other shapes are of smooth glass
    points, enclosed : lights without extent (`renderers.mitsuba.world.IdealLight`) outside of all bodies whose boundary turns
        light, and inside of one
    lamps : numbers of the bodies that lights reach into, or nearly
    """

    world: object
    bodies: list[Body]
    geometry: _geometry.Geometry
    colours: Colours
    bent: list
    rivals: np.ndarray | None = None
    panes: bool = False
    points: tuple = ()
    enclosed: tuple = ()
    lamps: frozenset = frozenset()

    @property
    def chained(self):
        """Whether light of lights without extent comes to events by ways that `chains` has to follow."""
        return bool(self.enclosed) or bool(self.points) and any(body.smooth and not body.matched for body in self.bodies)

    @property
    def matched(self):
        """(bodies,) bool, boundaries to which light is blind."""
        return np.array([body.matched for body in self.bodies])

    @property
    def sigma_t(self):
        """(bodies, L) 1/m"""
        return np.array([body.medium.sigma_t for body in self.bodies])

    @property
    def off(self):
        """m, that a path is put beyond a boundary."""
        return _OFF * self.geometry.scale


class Sums:
    """Light that a pass has brought, linear sRGB.

    by_order : (ORDERS, pixels, 3), without what `gathered` holds
    gathered : (pixels, 3) of beams, by the tables
    by_paths : whether light counts that paths find by themselves; else only that of beams does
    """

    def __init__(self, pixels, by_paths=True):
        self.by_order, self.gathered, self.by_paths = np.zeros((wavefront.ORDERS, pixels, 3)), np.zeros((pixels, 3)), by_paths
        self._no_light = np.zeros((0, pixels, 3))

    def add(self, paths, added, orders=0):
        """What paths bring, added (n, 3), with so many events more."""
        wavefront.accumulate(added, paths.order + orders, np.full(paths.count, -1), paths.pixel, self.by_order, self._no_light)

    def add_gathered(self, paths, added):
        """What the tables bring, added (n, 3)."""
        for c in range(3):
            self.gathered[:, c] += np.bincount(paths.pixel, added[:, c], len(self.gathered))


class Gather(NamedTuple):
    """How lines of sight gather beams.

    beams : of each body, `_gather.Beams`
    later : whether third and later events count;  second : of each body, whether second ones do
    picks : beams for a line of sight;  fewer : of each body, for those that share what they gather
    shares : (pixels,) body of which the camera's lines of sight share it, or -1
    beyond : of each body (L,) m, distance of a mirror outside of its boundary; inf where there is none

    Called as gather(transport, paths, number, sums), it adds to sums what beams bring to lines of sight in body `number`.
    """

    beams: list
    later: bool
    second: list
    picks: int
    fewer: list
    shares: np.ndarray
    beyond: list

    def __call__(self, *args):
        _gathered(*args, self)


def from_eye(transport, most, gather, number, seed, by_paths=True, chosen=None) -> Sums:
    """One path from the eye for each pixel.

    most : of each body, events between two surfaces that a path may have
    gather : `Gather`, or what is called like it, or None
    number, seed : of the pass: its random numbers
    by_paths : as in `Sums`
    chosen : (H, W) bool, which ones have a path; None: all
    """
    pixels = transport.world.size[0] * transport.world.size[1]
    sums = Sums(pixels, by_paths)

    def camera(first, last):
        pixel = np.arange(first, last)
        paths = begin(transport, pixel, number, seed)
        return paths if chosen is None else paths.of(chosen.ravel()[pixel])

    follow(pixels, _ALL, camera, lambda paths: onward(transport, paths, most, sums, gather))
    return sums


def begin(transport, pixel, number, seed, first=None) -> Paths:
    """The camera's paths through pixels (n,) of a pass, from path `first` on; if that is None a path a pixel, ascending without
    gaps."""
    key = stream_key(seed, "render.translucent", number)
    if first is None:
        first = int(pixel[0]) if len(pixel) else 0
    states, origin, direction = of_camera(transport.world, transport.world.size[1], key, first, pixel)
    paths = Paths.begun(origin, direction, np.ones((len(pixel), len(transport.colours.to_waves))), states, pixel)
    paths.seen[:] = True
    return paths


def onward(transport, paths, most, sums, gather=None) -> Paths:
    """Paths after their next surface or event, those that go on."""
    body = located(transport.geometry, paths)
    parts = [at_surfaces(transport, paths.of(body == _geometry.OUTSIDE), sums)]
    for number in np.unique(body[body != _geometry.OUTSIDE]):
        parts += inside(transport, paths.of(body == number), number, most[number], sums, gather)
    return joined(parts)


def located(geometry, paths):
    """Bodies (n,) in which paths are; finds the first triangle ahead of each."""
    body = np.empty(paths.count, np.int64)
    run(_geometry.locate, paths.count, geometry, paths.origin, paths.direction, paths.start, body, paths.far, paths.triangle)
    return body


def facing(transport, paths):
    """Outward normals (n, 3) of the boundary where paths have come into a body."""
    normals = np.empty(paths.origin.shape)
    run(_geometry.boundary_normals, len(normals), transport.geometry, paths.origin, paths.direction, normals)
    return normals


def through(transport, number, paths, most, waits):
    """Takes paths through a body, as `_walk.advance`: how far they have come (n,)."""
    status, body = np.empty(paths.count, np.int64), transport.bodies[number]
    run(_walk.advance, paths.count, transport.geometry, body.medium, _walk.Limits(body.shells, most, waits), paths, status)
    return status


def inside(transport, paths, number, most, sums, gather):
    """Parts of the paths in a body after their next surface or event; most : events between two surfaces."""
    body = transport.bodies[number]
    if gather is not None:
        gather(transport, paths, number, sums)
    paths.rival[paths.events == 0] = 0.0
    parts = []
    if most:
        split = _splits(paths) & (paths.order == 0) & np.isfinite(paths.far) & (paths.triangle >= 0)
        if split.any():
            parts = _both_ways(transport, paths.of(split), number, sums)
            paths = paths.of(~split)
    start = paths.origin.copy()
    status = through(transport, number, paths, most, bool(
        body.matched or sums.by_paths and (transport.bent[number] or transport.chained) or _joins(transport, number, sums)))
    events = status == _walk.EVENT
    parts.append(_at_events(transport, number, paths.of(events), start[events], sums))
    parts.append(at_surfaces(transport, paths.of(status == _walk.CONTACT), sums, traced=not body.matched))
    return parts


def _both_ways(transport, paths, number, sums):
    """Parts of paths in a body that come straight through, and that scatter on the way, both for sure."""
    body, straight, fate = transport.bodies[number], paths.of(slice(None)), paths.of(slice(None))
    run(_walk.straight, paths.count, body.medium, straight)
    wavefront.skip(fate.states, 1 << 41)
    run(_walk.inside, paths.count, body.medium, fate)
    fate.seen[:] = False
    return [at_surfaces(transport, straight, sums, traced=not body.matched),
            _at_events(transport, number, fate, paths.origin, sums)]


def crossed(transport, paths):
    """Paths beyond boundaries to which light is blind."""
    paths.origin[:] += (paths.far + transport.off)[:, None] * paths.direction
    paths.start[:], paths.events[:] = paths.triangle, 0
    # light samples at surfaces end at any boundary, those at events do not
    paths.single[:] |= ~paths.scattered
    return paths


def blind(transport, paths):
    """Whether (n,) the triangle ahead of paths bounds a body, and light crosses it as if there were nothing."""
    owner = np.where(paths.triangle >= 0, transport.geometry.owner[paths.triangle], -1)
    return (owner >= 0) & transport.matched[np.maximum(owner, 0)]


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
    run(turn, paths.count, medium, paths)
    paths.single[:] = False
    if _joins(transport, number, sums):
        flown = np.linalg.norm(paths.origin - start, axis=1)
        run(_beams.rivals, paths.count, medium, transport.rivals[number], flown, before, paths.direction, paths.rival)
        paths.rival[paths.events > 1] = np.inf
    return steps.survivors(paths)


def _add_light(transport, medium, paths, sums):
    """Adds what light samples send by way of events."""
    numbers, added = np.empty((paths.count, 3)), np.empty((paths.count, 3))
    wavefront.draw(paths.states, numbers)
    sample = transport.world.lights(paths.origin, numbers, hidden=False)
    towards, bright = sample.direction.astype(float), (sample.radiance > 0).any(axis=1)
    passed = transmittance(transport, paths.origin, towards, sample.distance, bright)
    run(next_event, paths.count, medium, transport.colours, paths, sample._replace(direction=towards), passed, added)
    sums.add(paths, added)


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
    run(next_event, len(with_light), medium, transport.colours, reached, sample, passed, added)
    sums.add(reached, added)


def at_surfaces(transport, paths, sums, power=False, traced=True):
    """Paths after the surface ahead: beyond boundaries to which light is blind, or turned by Mitsuba, their light added.

    power : as in `World.shade`
    traced : whether something else may stand before the body, as outside of all
    """
    crosses = blind(transport, paths)
    if traced:
        ways = paths.origin[crosses], paths.direction[crosses], paths.far[crosses] * (1 - 1e-4)
        crosses[crosses] = ~(transport.world.trace(*ways) < np.inf)
    if not crosses.any():
        return shaded(transport, paths, sums, power)
    return joined([crossed(transport, paths.of(crosses)), shaded(transport, paths.of(~crosses), sums, power)])


def shaded(transport, paths, sums, power=False):
    """Paths that Mitsuba has turned at surfaces, after their light has been added; `power` as in `World.shade`.

    At smooth dielectrics that the camera sees, directly or through and in others, paths of much weight go both ways.
    """
    if not paths.count:
        return paths
    numbers = np.empty((paths.count, 6))
    wavefront.draw(paths.states, numbers)
    seen = _splits(paths)
    if not seen.any():
        return _turned(transport, paths, _shade(transport, paths, numbers, power), sums)
    parts = [_turned(transport, paths.of(~seen), _shade(transport, paths.of(~seen), numbers[~seen], power), sums)]
    paths, numbers = paths.of(seen), numbers[seen]
    back, on = (_shade(transport, paths, _chosen(numbers, lobe), power) for lobe in (0.0, 1.0))
    sampled = back.hit & back.delta & on.delta & (back.density > 0) & (on.density > 0) \
        & (np.abs(back.density + on.density - 1) < 1e-4)
    parts.append(_turned(transport, paths.of(~sampled), _shade(transport, paths.of(~sampled), numbers[~sampled], power), sums))
    for shading, add in ((back, sums), (on, Sums(0, by_paths=False))):
        part = paths.of(sampled)
        part.throughput[:] *= shading.density[sampled][:, None]
        parts.append(_turned(transport, part, selected(shading, sampled), add))
    wavefront.skip(parts[-1].states, 1 << 40)
    return joined(parts)


def _splits(paths):
    """Which paths (n,) the camera sees as they are, with so much weight that both of two ways are worth going."""
    return paths.seen & (paths.bounces < _SPLITS) & (paths.throughput.max(axis=1) > _WORTH)


def _shade(transport, paths, numbers, power):
    return transport.world.shade(paths.origin, paths.direction, numbers, paths.density, paths.single, paths.drawn, power=power)


def _chosen(numbers, lobe):
    """The same numbers, but for that which chooses a lobe of a BSDF."""
    numbers = numbers.copy()
    numbers[:, LOBE] = lobe
    return numbers


def _turned(transport, paths, shading, sums):
    """Paths that go on from surfaces as Mitsuba says, after their light has been added."""
    if sums.by_paths:
        _emits(transport, paths, shading, sums)
    # from the boundary to the next surface, where `emitted` asks for the density of light samples
    paths.rival[paths.events == 0] = 0.0
    hit = np.flatnonzero(shading.hit)
    paths = paths.of(hit)
    steps.reflected(transport.colours, paths, shading, hit)
    paths.drawn[:] = paths.origin
    paths.bounces[:] += 1
    paths.start[:], paths.events[:], paths.scattered[:] = -1, 0, False
    paths.seen[:] &= paths.single & (paths.order == 0)
    rivals = paths.rival > 0
    paths.density[rivals & paths.single], paths.single[rivals] = _CERTAIN, False
    return steps.thinned(steps.survivors(paths), _FAR)


def _emits(transport, paths, shading, sums):
    """Adds the light that paths meet, and that of light samples at surfaces."""
    added = np.empty((paths.count, 3))
    emitted, from_samples = shading.emitted, shading.light.radiance
    if paths.rival.any():
        leaving = paths.events == 0
        emitted = emitted * _share(np.where(leaving, paths.rival, 0.0), shading.by_light)
        # a rough boundary takes its light sample while the path is still inside
        leaves = np.flatnonzero(~leaving & (paths.rival > 0) & (from_samples > 0).any(axis=1))
        ahead = shading.light.direction[leaves].astype(float)
        ahead = Paths.begun(shading.point[leaves] + transport.off * ahead, ahead, np.ones((len(ahead), 1)), leaves, leaves)
        leaves = leaves[located(transport.geometry, ahead) == _geometry.OUTSIDE]
        density = np.where(shading.light.delta, np.inf, shading.light.density)[leaves]
        from_samples = from_samples.copy()
        from_samples[leaves] *= _share(paths.rival[leaves], density)
    for radiance in (emitted, from_samples):
        wavefront.emitted(transport.colours, paths.throughput, paths.order, radiance, added)
        sums.add(paths, added)


def _share(rival, density):
    """Balance heuristic (n, 1), single precision, of paths that find lights against beams that bring the same.

    rival : (n,) sr, of `Paths`;  density : (n,) 1/sr, of light samples
    """
    joins = (rival > 0) & (density > 0)
    return np.where(joins, 1 / (1 + np.where(joins, rival, 1.0) * density), 1.0).astype(np.float32)[:, None]


def _gathered(transport, paths, number, sums, gather):
    """Adds what beams bring to lines of sight that come from a surface."""
    body, beams = transport.bodies[number], gather.beams[number]
    rows, lines = sights(paths)
    if not len(rows):
        return
    order = by_place(lines.origin, body.vertices)
    rows, lines = rows[order], lines.of(order)
    around, sigma = np.empty(len(rows) + 1, np.int64), body.medium.sigma_t
    groups = _choice.grouped(lines.origin, lines.direction, lines.far, float(sigma.min()), around)
    picks = np.where(lines.seen & (gather.shares[lines.pixel] == number), gather.fewer[number], gather.picks)
    normals = facing(transport, lines) if np.isfinite(gather.beyond[number]).any() else np.empty((0, 3))
    sight = _gather.Lines(lines.origin, lines.direction, lines.far, normals, lines.states, picks, around,
                          np.zeros((3, *lines.throughput.shape)))
    for w, (tables, cosine, beyond) in enumerate(zip(body.tables, mean_cosines(body.medium), gather.beyond[number])):
        wave = _gather.Wave(w, cosine, *tables, gather.later, gather.second[number], beyond)
        clusters = _choice.clusters_of(sigma[w], w, beams)
        run(_gather.gather, groups, transport.geometry, body.medium, wave, beams, clusters, sight, block=16)
    # the numbers with which beams were drawn serve nothing else
    states = paths.states[rows]
    wavefront.skip(states, _gather.DRAWS * gather.picks)
    paths.states[rows] = states
    later, second, beyond = (values * lines.throughput @ transport.colours.to_rgb.T for values in sight.brought)
    sums.add_gathered(lines, later)
    sums.add(lines, second, 2)
    sums.add(lines, beyond, 3)


def sights(paths):
    """Lines of sight of paths that come from a surface, of little weight only some: their numbers (m,) and themselves."""
    rows = np.flatnonzero((paths.events == 0) & (paths.throughput > 0).any(axis=1))
    numbers, chance = np.empty((paths.count, 1)), np.minimum(paths.throughput.max(axis=1) / _WEAK, 1.0)
    wavefront.draw(paths.states, numbers)
    rows = rows[numbers[rows, 0] < chance[rows]]
    lines = paths.of(rows)
    lines.throughput[:] /= chance[rows, None]
    return rows, lines


def by_place(points, vertices):
    """Order (n,) of points (n, 3) in which neighbours are near each other: along a Morton curve through the box of a mesh."""
    low, size = vertices.min(axis=0), np.ptp(vertices, axis=0).max()
    cell = np.clip((points - low) / size * 1024, 0, 1023).astype(np.int64)
    code = np.zeros(len(points), np.int64)
    for bit in range(10):
        for axis in range(3):
            code |= (cell[:, axis] >> bit & 1) << 3 * bit + axis
    return np.argsort(code, kind="stable")
