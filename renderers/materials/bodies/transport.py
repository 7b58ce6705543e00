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
from renderers.materials.bodies.paths import Paths, joined
from renderers.mitsuba.world import LOBE
from renderers.threads import run
from renderers.transport import wavefront
from renderers.transport.scattering import mean_cosines

_ALL = 1 << 17  # paths that go on together; more take more memory, and fewer more calls
_SPLITS, _WORTH = 4, 0.01  # surfaces at which paths go both ways, and the weight above which they do
_FAR, _GOES_ON = 64, 0.95  # bounces after which surfaces end paths, and the share that goes on
_WEAK = 0.1  # weight of lines of sight, below which not all of them gather
_OFF = 1e-6  # of the size of all bodies, that a path is put beyond a boundary which it crosses
_CERTAIN = 1e20  # 1/sr, of a direction that is drawn for sure, as single precision has room for
UNLIMITED = 1 << 40  # events between two surfaces


class Colours(NamedTuple):
    """to_rgb : (3, L) linear sRGB from radiances;  to_waves : (L, 3) radiances from linear sRGB"""

    to_rgb: np.ndarray
    to_waves: np.ndarray


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
        wavefront.accumulate(added, paths.order + orders, np.full(len(paths), -1), paths.pixel, self.by_order, self._no_light)

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

    Called as gather(transport, paths, number, far, sums), it adds to sums what beams bring to lines of sight in body `number`.
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
    height, width = transport.world.size
    sums, started, paths = Sums(height * width, by_paths), 0, None
    while started < height * width or paths:
        if started < height * width and (not paths or len(paths) < _ALL // 2):
            pixel = np.arange(started, min(started + _ALL, height * width))
            new, started = begin(transport, pixel, number, seed), started + len(pixel)
            new = new if chosen is None else new.of(chosen.ravel()[pixel])
            paths = joined([paths, new]) if paths else new
        paths = onward(transport, paths, most, sums, gather)
    return sums


def begin(transport, pixel, number, seed) -> Paths:
    """The camera's path through each pixel (n,), ascending without gaps, of a pass."""
    n, width = len(pixel), transport.world.size[1]
    states, offset = np.empty(n, np.uint64), np.empty((n, 2))
    wavefront.begin_streams(stream_key(seed, "render.translucent", number), int(pixel[0]), states)
    wavefront.draw(states, offset)
    origin, direction = transport.world.camera_rays(offset, np.stack([pixel // width, pixel % width], axis=1))
    paths = Paths.begun(origin, direction, np.ones((n, len(transport.colours.to_waves))), states, pixel)
    paths.seen[:] = True
    return paths


def onward(transport, paths, most, sums, gather=None) -> Paths:
    """Paths after their next surface or event, those that go on."""
    body, far, triangle = located(transport.geometry, paths)
    outside = body == _geometry.OUTSIDE
    parts = [at_surfaces(transport, paths.of(outside), sums, far[outside], triangle[outside])]
    for number in np.unique(body[~outside]):
        at_number = body == number
        parts += inside(transport, paths.of(at_number), number, far[at_number], triangle[at_number], most, sums, gather)
    return joined(parts)


def located(geometry, paths):
    """Bodies (n,) in which paths are, and distance (m) and place of the first triangle ahead of each."""
    n = len(paths)
    body, far, triangle = np.empty(n, np.int64), np.empty(n), np.empty(n, np.int64)
    run(_geometry.locate, n, geometry, paths.origin, paths.direction, paths.start, body, far, triangle)
    return body, far, triangle


def through(transport, number, paths, far, triangle, most, waits):
    """Takes paths through a body: how far they have come (`_walk`), and distance and place of what they meet."""
    n, before = len(paths), paths.events.copy()
    status, alive = np.empty(n, np.int64), np.empty(n, bool)
    body = transport.bodies[number]
    run(_walk.advance, n, transport.geometry, body.medium, body.shells, most, waits, paths.origin, paths.direction, paths.weight,
        paths.states, far, triangle, paths.start, paths.drawn, paths.density, paths.single, paths.events, paths.bounces, status,
        alive)
    paths.order += paths.events - before
    paths.scattered |= paths.events > before
    return status


def inside(transport, paths, number, far, triangle, most, sums, gather):
    """Parts of the paths in a body after their next surface or event."""
    body = transport.bodies[number]
    if gather is not None:
        gather(transport, paths, number, far, sums)
    paths.rival[paths.events == 0] = 0.0
    split = np.flatnonzero(_splits(paths) & (paths.order == 0) & np.isfinite(far) & (triangle >= 0)) if most[number] else []
    parts = []
    if len(split):
        # what comes straight through, and what scatters on the way, both for sure
        straight = paths.of(split)
        run(_walk.straight, len(split), body.medium, straight.weight, far[split])
        parts += _met(transport, number, straight, far[split], triangle[split], sums)
        fate = paths.of(split)
        wavefront.skip(fate.states, 1 << 41)
        run(_walk.inside, len(split), body.medium, fate.origin, fate.direction, fate.weight, fate.states, fate.start, fate.events,
            fate.order, fate.bounces, far[split])
        fate.scattered[:], fate.seen[:] = True, False
        parts.append(_at_events(transport, number, fate, paths.origin[split], sums))
        whole = np.ones(len(paths), bool)
        whole[split] = False
        paths, far, triangle = paths.of(whole), far[whole], triangle[whole]
    start = paths.origin.copy()
    status = through(transport, number, paths, far, triangle, most[number],
                     body.matched or sums.by_paths and (bool(transport.bent[number]) or transport.chained)
                     or _joins(transport, number, sums))
    touching, events = status == _walk.CONTACT, status == _walk.EVENT
    parts.append(_at_events(transport, number, paths.of(events), start[events], sums))
    return parts + _met(transport, number, paths.of(touching), far[touching], triangle[touching], sums)


def _met(transport, number, paths, far, triangle, sums):
    """Parts of paths in a body after the surface that they have come to."""
    if not transport.bodies[number].matched:
        return [at_surfaces(transport, paths, sums, far, triangle)]
    owner = transport.geometry.owner[triangle]
    crosses = (owner >= 0) & transport.matched[np.maximum(owner, 0)]
    return [crossed(transport, paths.of(crosses), far[crosses], triangle[crosses]), shaded(transport, paths.of(~crosses), sums)]


def crossed(transport, paths, far, triangle):
    """Paths beyond boundaries to which light is blind."""
    paths.origin += (far + transport.off)[:, None] * paths.direction
    paths.start[:], paths.events[:] = triangle, 0
    # light samples at surfaces end at any boundary, those at events do not
    paths.single |= ~paths.scattered
    return paths


def _joins(transport, number, sums):
    """Whether beams bring light that paths in a body find, too."""
    return sums.by_paths and transport.rivals is not None and transport.rivals[number] > 0


def _at_events(transport, number, paths, start, sums):
    """Paths that go on from events in a body, after light samples have been added; begun (n, 3) m, where their flights began."""
    n = len(paths)
    if n == 0:
        return paths
    medium = transport.bodies[number].medium
    if sums.by_paths and (transport.bodies[number].matched or number in transport.lamps):
        _lit(transport, medium, paths, sums)
    for bent in transport.bent[number] if sums.by_paths else []:
        _lit_through(transport, number, bent, paths, sums)
    alive, before = np.empty(n, bool), paths.direction.copy()
    run(_walk.scatter, n, medium, paths.origin, paths.direction, paths.weight, paths.states, paths.drawn, paths.density,
        paths.single, paths.bounces, alive)
    if _joins(transport, number, sums):
        flown = np.linalg.norm(paths.origin - start, axis=1)
        run(_beams.rivals, n, medium, transport.rivals[number], flown, before, paths.direction, paths.rival)
        paths.rival[paths.events > 1] = np.inf
    return paths.of(alive)


def _lit(transport, medium, paths, sums):
    """Adds what light samples send by way of events."""
    n = len(paths)
    numbers, added = np.empty((n, 3)), np.empty((n, 3))
    wavefront.draw(paths.states, numbers)
    sample = transport.world.lights(paths.origin, numbers, hidden=False)
    towards = sample.direction.astype(float)
    inside, seen = in_between(transport, paths.origin, towards, sample.distance, (sample.radiance > 0).any(axis=1))
    run(_walk.lit, n, medium, transport.colours, transport.sigma_t, inside, seen, paths.direction, paths.weight, towards,
        sample.radiance, sample.density, sample.delta, added)
    sums.add(paths, added)


def in_between(transport, origin, towards, distance, bright):
    """Lengths (n, bodies) m of ways to lights in each body, and whether a light that is `bright` (n,) is seen."""
    n = len(origin)
    inside, last = np.empty((n, len(transport.bodies))), np.empty(n)
    run(_geometry.lengths, n, transport.geometry, transport.matched, origin, towards, distance * bright, inside, last)
    seen = bright & np.isfinite(inside).all(axis=1)
    bright_rays = np.flatnonzero(seen)
    last, towards_some = last[bright_rays] + transport.off, towards[bright_rays]
    ahead = distance[bright_rays] * (1 - 1e-4) - last
    hidden = transport.world.trace(origin[bright_rays] + last[:, None] * towards_some, towards_some, np.maximum(ahead, 0))
    seen[bright_rays] = ~(hidden < ahead)
    return inside, seen


def _lit_through(transport, number, bent, paths, sums):
    """Adds what a light without extent sends through the boundary of body `number` to events in it."""
    point, towards, within, share = refraction.joined(transport, number, bent, paths)
    with_light = np.flatnonzero(share > 0)
    if not len(with_light):
        return
    reached, point, towards, added = paths.of(with_light), point[with_light], towards[with_light], np.empty((len(with_light), 3))
    sample = transport.world.from_light(bent.number, point)
    away = sample.direction.astype(float)
    radiance = sample.radiance * share[with_light, None]
    inside, seen = in_between(transport, point + transport.off * away, away, sample.distance, (radiance > 0).any(axis=1))
    inside[:, number] += within[with_light]
    run(_walk.lit, len(with_light), transport.bodies[number].medium, transport.colours, transport.sigma_t, inside, seen,
        reached.direction, reached.weight, towards, radiance.astype(np.float32), sample.density, np.ones(len(with_light), bool),
        added)
    sums.add(reached, added)


def at_surfaces(transport, paths, sums, far, triangle):
    """Paths outside of bodies, or at a boundary that turns light, after their next surface."""
    if not len(paths):
        return paths
    matched = np.flatnonzero(triangle >= 0)
    owner = transport.geometry.owner[triangle[matched]]
    matched = matched[(owner >= 0) & transport.matched[np.maximum(owner, 0)]]
    if not len(matched):
        return shaded(transport, paths, sums)
    # nothing else may stand before the body
    free = ~(transport.world.trace(paths.origin[matched], paths.direction[matched], far[matched] * (1 - 1e-4)) < np.inf)
    crosses = np.zeros(len(paths), bool)
    crosses[matched[free]] = True
    return joined([crossed(transport, paths.of(crosses), far[crosses], triangle[crosses]),
                   shaded(transport, paths.of(~crosses), sums)])


def shaded(transport, paths, sums, power=False):
    """Paths that Mitsuba has turned at surfaces, after their light has been added; `power` as in `World.shade`.

    At smooth dielectrics that the camera sees, directly or through and in others, paths of much weight go both ways.
    """
    n = len(paths)
    if n == 0:
        return paths
    numbers = np.empty((n, 6))
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
        part.weight *= shading.density[sampled][:, None]
        parts.append(_turned(transport, part, _rows(shading, sampled), add))
    wavefront.skip(parts[-1].states, 1 << 40)
    return joined(parts)


def _splits(paths):
    """Which paths (n,) the camera sees as they are, with so much weight that both of two ways are worth going."""
    return paths.seen & (paths.bounces < _SPLITS) & (paths.weight.max(axis=1) > _WORTH)


def _shade(transport, paths, numbers, power):
    return transport.world.shade(paths.origin, paths.direction, numbers, paths.density, paths.single, paths.drawn, power=power)


def _chosen(numbers, lobe):
    """The same numbers, but for that which chooses a lobe of a BSDF."""
    numbers = numbers.copy()
    numbers[:, LOBE] = lobe
    return numbers


def _rows(shading, chosen):
    """Some of the rows of what Mitsuba has answered."""
    return type(shading)(*(_rows(values, chosen) if isinstance(values, tuple) else values[chosen] for values in shading))


def _turned(transport, paths, shading, sums):
    """Paths that go on from surfaces as Mitsuba says, after their light has been added."""
    if sums.by_paths:
        _emits(transport, paths, shading, sums)
    # from the boundary to the next surface, where `emitted` asks for the density of light samples
    paths.rival[paths.events == 0] = 0.0
    hit = np.flatnonzero(shading.hit)
    paths = paths.of(hit)
    m = len(hit)
    if m == 0:
        return paths
    run(wavefront.reflect, m, transport.colours, paths.weight, shading.weight[hit])
    paths.origin, paths.direction = shading.origin[hit], shading.direction[hit].astype(float)
    paths.drawn, paths.density, paths.single = paths.origin.copy(), shading.density[hit].astype(float), shading.delta[hit]
    paths.start[:], paths.events[:], paths.scattered[:] = -1, 0, False
    paths.seen &= paths.single & (paths.order == 0)
    rivals = paths.rival > 0
    paths.single[rivals], paths.density[rivals] = False, np.where(shading.delta[hit], _CERTAIN, paths.density)[rivals]
    paths.bounces += 1
    alive = np.empty(m, bool)
    run(wavefront.roulette, m, paths.weight, paths.states, paths.bounces, alive)
    return _ended(paths.of(alive))


def _ended(paths):
    """Without some of the paths that have come far: light that is caught in glass, as of a tumbler, loses nothing on its way."""
    far = np.flatnonzero(paths.bounces > _FAR)
    if not len(far):
        return paths
    numbers, states, goes = np.empty((len(far), 1)), paths.states[far], np.ones(len(paths), bool)
    wavefront.draw(states, numbers)
    paths.states[far] = states
    paths.weight[far] /= _GOES_ON
    goes[far] = numbers[:, 0] < _GOES_ON
    return paths.of(goes)


def _emits(transport, paths, shading, sums):
    """Adds the light that paths meet, and that of light samples at surfaces."""
    added = np.empty((len(paths), 3))
    emitted, from_samples = shading.emitted, shading.light.radiance
    if paths.rival.any():
        leaving = paths.events == 0
        emitted = emitted * _share(np.where(leaving, paths.rival, 0.0), shading.by_light)
        # a rough boundary takes its light sample while the path is still inside
        leaves = np.flatnonzero(~leaving & (paths.rival > 0) & (from_samples > 0).any(axis=1))
        ahead = shading.light.direction[leaves].astype(float)
        ahead = Paths.begun(shading.point[leaves] + transport.off * ahead, ahead, np.ones((len(ahead), 1)), leaves, leaves)
        leaves = leaves[located(transport.geometry, ahead)[0] == _geometry.OUTSIDE]
        density = np.where(shading.light.delta, np.inf, shading.light.density)[leaves]
        from_samples = from_samples.copy()
        from_samples[leaves] *= _share(paths.rival[leaves], density)
    for radiance in (emitted, from_samples):
        wavefront.emitted(transport.colours, paths.weight, paths.order, radiance, added)
        sums.add(paths, added)


def _share(rival, density):
    """Balance heuristic (n, 1), single precision, of paths that find lights against beams that bring the same.

    rival : (n,) sr, of `Paths`;  density : (n,) 1/sr, of light samples
    """
    joins = (rival > 0) & (density > 0)
    return np.where(joins, 1 / (1 + np.where(joins, rival, 1.0) * density), 1.0).astype(np.float32)[:, None]


def _gathered(transport, paths, number, far, sums, gather):
    """Adds what beams bring to lines of sight that come from a surface."""
    rows = np.flatnonzero((paths.events == 0) & (paths.weight > 0).any(axis=1))
    body, beams = transport.bodies[number], gather.beams[number]
    numbers, chance = np.empty((len(paths), 1)), np.minimum(paths.weight.max(axis=1) / _WEAK, 1.0)
    wavefront.draw(paths.states, numbers)
    rows = rows[numbers[rows, 0] < chance[rows]]
    if not len(rows):
        return
    rows = rows[by_place(paths.origin[rows], body.vertices)]
    lines, lengths = paths.of(rows), far[rows]
    lines.weight /= chance[rows, None]
    around = np.empty(len(rows) + 1, np.int64)
    groups = _choice.grouped(lines.origin, lines.direction, lengths, float(body.medium.sigma_t.min()), around)
    picks = np.where(lines.seen & (gather.shares[lines.pixel] == number), gather.fewer[number], gather.picks)
    brought, cosines = np.zeros((3, *lines.weight.shape)), mean_cosines(body.medium)
    for w, (points, segments) in enumerate(body.tables):
        clusters = _choice.clusters_of(body.medium.sigma_t[w], w, beams)
        run(_gather.gather, groups, transport.geometry, body.medium, points, segments, w, cosines[w], beams, clusters,
            picks, gather.later, gather.second[number], gather.beyond[number][w], around, lines.origin,
            lines.direction, lengths, lines.states, brought, block=16)
    # the numbers with which beams were drawn serve nothing else
    states = paths.states[rows]
    wavefront.skip(states, _gather.DRAWS * gather.picks)
    paths.states[rows] = states
    later, second, beyond = (values * lines.weight @ transport.colours.to_rgb.T for values in brought)
    sums.add_gathered(lines, later)
    sums.add(lines, second, 2)
    sums.add(lines, beyond, 3)


def by_place(points, vertices):
    """Order (n,) of points (n, 3) in which neighbours are near each other: along a Morton curve through the box of a mesh."""
    low, size = vertices.min(axis=0), np.ptp(vertices, axis=0).max()
    cell = np.clip((points - low) / size * 1024, 0, 1023).astype(np.int64)
    code = np.zeros(len(points), np.int64)
    for bit in range(10):
        for axis in range(3):
            code |= (cell[:, axis] >> bit & 1) << 3 * bit + axis
    return np.argsort(code, kind="stable")
