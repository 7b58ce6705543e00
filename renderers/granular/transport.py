"""Camera paths through grains, the media that stand for them, and the surfaces and lights around.

All paths of a pass go on together: compiled loops take each through one body until it needs a light, a surface of the scene,
another body or the other paths; Mitsuba answers for all that do.  A path begins among explicit grains and may switch: the grain
that it meets next is then a scattering of the medium, in which it goes on (`bundles` says when).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import stream_key
from renderers import wavefront
from renderers.granular import _paths, bundles
from renderers.granular._grains import UNKNOWN
from renderers.granular._paths import GRAINS, MEDIUM
from renderers.granular.paths import NEVER, Colours, Explicit, Paths, joined
from renderers.mitsuba.world import LightSample
from renderers.threads import run

_ALL = 1 << 16  # paths that go on together; more take more memory, and fewer more calls
_MANY, _SHARE = 4096, 1 / 16  # where fewer paths than that, and than that share of them, are left, lights are sampled less often
ALL, BEFORE, AFTER = range(3)  # which light a pass brings: all, that before the switch, that after it


class Body(NamedTuple):
    """Grains that fill a mesh, and the medium that stands for them; None where no path goes through it.

    radius : m, of the largest sphere
    """

    grains: Explicit | None
    medium: object
    radius: float


class Transport(NamedTuple):
    """How light goes.

    bodies : tuple of `Body`;  colours : `Colours`
    technique : with which paths begin, GRAINS or MEDIUM
    switch : `bundles.Switch`, or None where paths do not switch
    """

    bodies: tuple[Body, ...]
    colours: Colours
    technique: int = GRAINS
    switch: bundles.Switch | None = None

    def way(self, body, technique):
        """The loops of a body: those of its grains or those of its medium."""
        return self.bodies[body].grains if technique == GRAINS else self.bodies[body].medium

    def entry(self, origin, direction, far):
        """Distances (n,) m along rays to the first grain before far (n,) m, or to the mesh where paths begin in the medium; inf
        where there is none."""
        ways = (self.way(body, self.technique) for body in range(len(self.bodies)))
        return np.min([way.entry(origin, direction, far) for way in ways], axis=0)


class Sums:
    """Light that a pass has brought, linear sRGB.

    by_order, by_technique : (ORDERS, pixels, 3);  by_light : (lights, pixels, 3)
    switched : (pixels, 3) grains met before the switch, and whether there was one
    which : ALL, BEFORE or AFTER;  many : paths for which a call of Mitsuba's is worth its time
    pixels, samples : of the picture, and paths of each; the arrays are means over those once `one_pass` is over
    """

    def __init__(self, pixels, lights, which, samples=1):
        self.pixels, self.samples = pixels, samples
        self.which, self.many = which, min(_MANY, _SHARE * min(pixels * samples, _ALL))
        self.by_order, self.by_technique = np.zeros((wavefront.ORDERS, pixels, 3)), np.zeros((wavefront.ORDERS, pixels, 3))
        self.by_light, self.switched = np.zeros((lights, pixels, 3)), np.zeros((pixels, 3))

    def add(self, paths, light, added):
        """What paths bring, added (n, 3), from lights (n,)."""
        if self.skips(paths):
            return
        pixel = paths.pixel % self.pixels
        wavefront.accumulate(added, paths.order, light, pixel, self.by_order, self.by_light)
        wavefront.accumulate(added, paths.technique, light, pixel, self.by_technique, self.by_light[:0])

    def add_switches(self, paths):
        """Of paths that switch: grains met, and that they do."""
        np.add.at(self.switched, paths.pixel % self.pixels, np.stack([paths.order, paths.order > -1, 0 * paths.order], axis=1))

    def average(self):
        """Makes means over the samples of the sums."""
        for sums in (self.by_order, self.by_technique, self.by_light, self.switched):
            sums /= self.samples

    def skips(self, paths):
        """Whether the light of paths, all of one technique, is left to other passes."""
        return self.which == AFTER and len(paths) > 0 and bool(paths.technique[0] == GRAINS)


def one_pass(world, transport, camera, height, width, number, seed, which=ALL, corners=None, samples=1) -> Sums:
    """Camera paths, so many `samples` for each pixel, all together.

    Parameters
    ----------
    world : `renderers.mitsuba.world.World`
    transport : `Transport`
    camera : `renderers.camera.Camera`
    number, seed : of the pass: its random numbers
    which : light it brings: ALL, that BEFORE the switch or that AFTER it
    corners : (H W, 2) x and y of the pixels' upper left corners, in pixels of the camera's film; those of a film of H x W if None
    """
    order = bundles.by_bundle(height, width, samples)
    sums = Sums(height * width, len(world.light_names), which, samples)
    if corners is None:
        corners = np.stack([np.arange(height * width) % width, np.arange(height * width) // width], axis=1)
    begun, paths = 0, _begin(transport, camera, corners, order[:0], number, seed, 0)
    while begun < len(order) or len(paths):
        if begun < len(order) and len(paths) < _ALL // 2:
            new = _begin(transport, camera, corners, order[begun : begun + _ALL], number, seed, begun)
            begun += len(new)
            ready = new if transport.switch is None else _until_switched(world, transport, new, (height, width), sums)
            paths = joined([paths, ready])
        if len(paths):
            paths, _ = _on(world, transport, paths, sums)
    sums.average()
    return sums


def _begin(transport, camera, corners, pixel, number, seed, first):
    n = len(pixel)
    states, offset = np.empty(n, np.uint64), np.empty((n, 2))
    wavefront.begin_streams(stream_key(seed, "render.grains", number), first, states)
    wavefront.draw(states, offset)
    x, y = (corners[pixel % len(corners)] + offset).T
    direction = camera.corner + x[:, None] * camera.right + y[:, None] * camera.down
    direction /= np.sqrt((direction**2).sum(axis=1))[:, None]
    return Paths.begun(np.tile(camera.origin, (n, 1)), direction, len(transport.colours.to_waves), states, pixel,
                       transport.technique)


def _until_switched(world, transport, paths, size, sums):
    """Takes paths on from grain to grain, all of a bundle together, until they have switched: those that have, and go on."""
    stage, switched = 0, [paths.of(slice(0, 0))]
    while len(paths):
        stage, waiting = stage + 1, []
        paths.stage[:] = stage
        while len(paths):
            paths, waits = _on(world, transport, paths, sums)
            switched.append(paths.of(paths.technique != GRAINS))
            waiting.append(waits)
            paths = paths.of(paths.technique == GRAINS)
        paths = joined(waiting)
        radius = np.array([body.radius for body in transport.bodies])[paths.body]
        paths.switching |= transport.switch.due(paths.pixel, paths.last, radius, size)
    return joined(switched)


def _on(world, transport, paths, sums):
    """Paths after what each needed next, those that go on, and those that wait."""
    _look_ahead(world, transport, paths, np.flatnonzero(np.isnan(paths.far) & (paths.met[:, 0] == UNKNOWN)))
    going, waiting = [], []
    for body, technique in _groups(paths):
        group = paths if technique is None else paths.of(
            (paths.body == body) & ((paths.technique == GRAINS) == (technique == GRAINS)))
        one, wait = _through(world, transport, group, body, sums)
        going += one
        waiting.append(wait)
    return joined(going), joined(waiting)


def _groups(paths):
    """Bodies and techniques of paths; (body, None) where all are the same."""
    kinds = np.unique(2 * paths.body + (paths.technique != GRAINS))
    return [(kind // 2, kind % 2 if len(kinds) > 1 else None) for kind in kinds]


def _through(world, transport, paths, body, sums):
    """Parts of the paths of one body and technique after what each needed next, and those that wait."""
    if body < 0:  # nothing but surfaces of the scene ahead
        return [_at_surfaces(world, transport, paths, sums)], paths.of(slice(0, 0))
    way = transport.way(body, paths.technique[0])
    way.sample_lights(min(1.0, 2.0 ** math.floor(math.log2(max(len(paths) / sums.many, 1e-9)))))
    status, found = way.advance(paths)
    near = np.flatnonzero(status == _paths.TRACE)
    _look_ahead(world, transport, paths, near)
    leaves = np.flatnonzero(status == _paths.LEAVES)
    onward = _into_next(world, transport, paths, leaves)
    lit = status == _paths.LIGHT
    return [paths.of(near), paths.of(leaves[onward]),
            _at_grains(world, transport, way, paths.of(lit), [one[lit] for one in found], sums),
            _at_surfaces(world, transport, paths.of(leaves[~onward]), sums),
            *_switched(world, transport, paths.of(status == _paths.SWITCHES), sums)], paths.of(status == _paths.WAITS)


# ---- what is ahead


def _look_ahead(world, transport, paths, at):
    """Finds how far it is for paths `at` (m,) to the first surface of the scene or to what is of another body than theirs, and
    the body of those that have none."""
    if not len(at):
        return
    surface = world.trace(paths.origin[at], paths.direction[at], np.inf)
    if len(transport.bodies) == 1:
        paths.far[at], paths.body[at] = surface, 0
        return
    _choose(paths, at, surface, _entries(transport, paths, at, surface), paths.body[at] < 0)


def _entries(transport, paths, at, limit):
    """(m, bodies) m, to where paths come into each body before a limit (m,); of their own body, into its mesh again."""
    t = np.full((len(at), len(transport.bodies)), np.inf)
    grains, own = paths.technique[at] == GRAINS, paths.body[at]
    for body in range(len(transport.bodies)):
        for technique, mine in ((GRAINS, grains), (MEDIUM, ~grains)):
            for inside in (True, False):
                here = np.flatnonzero(mine & ((own != body) == inside))
                if len(here):
                    t[here, body] = transport.way(body, technique).entry(paths.origin[at[here]], paths.direction[at[here]],
                                                                         limit[here], inside)
    return t


def _choose(paths, at, surface, entries, anew):
    """Puts paths `at` that choose anew (m,) into the body that comes first; far and beyond are what comes next."""
    rows = np.arange(len(at))
    first = np.argmin(entries, axis=1)
    some = anew & np.isfinite(entries[rows, first])
    paths.body[at[anew]] = np.where(some, first, -1)[anew]
    entries[rows[some], first[some]] = np.inf
    following = np.argmin(entries, axis=1)
    t = entries[rows, following]
    paths.far[at], paths.beyond[at] = np.minimum(t, surface), np.where(t < surface, following, -1)


def _into_next(world, transport, paths, at):
    """Which of the paths `at` that leave their body go on into another one, and puts them there."""
    onward = np.zeros(len(at), bool)
    if len(transport.bodies) == 1 or not len(at):
        return onward
    ask = np.isnan(paths.far[at]) | (paths.beyond[at] >= 0)
    asked = at[ask]
    surface = world.trace(paths.origin[asked], paths.direction[asked], np.inf)
    entries = _entries(transport, paths, asked, surface)
    onward[ask] = np.isfinite(entries).any(axis=1)
    _choose(paths, asked, surface, entries, np.ones(len(asked), bool))
    moved = at[onward]
    paths.met[moved], paths.place[moved] = UNKNOWN, -1
    return onward


def _open(transport, technique, point, direction, distance, apart=-1):
    """Share (n, L) of light that gets through all bodies but one, for paths of a technique."""
    share = np.ones((len(point), len(transport.colours.to_waves)))
    one = np.empty(share.shape)
    for body in range(len(transport.bodies)):
        if body != apart:
            transport.way(body, technique).open(point, direction, distance, one)
            share *= one
    return share


# ---- events


def _switched(world, transport, paths, sums):
    """Parts of paths that go on in the medium, with a scattering where they have met a grain."""
    sums.add_switches(paths)
    parts = []
    if not len(paths) or sums.which == BEFORE:
        return parts
    paths.technique[:], paths.stage[:], paths.switching[:] = MEDIUM, NEVER, False
    for body in np.unique(paths.body):
        here, way = paths.of(paths.body == body), transport.way(body, MEDIUM)
        way.sample_lights(1.0)
        status, found = way.arrive(here)
        sampled, turned = status == _paths.LIGHT, status == _paths.TURNS
        parts += [_at_grains(world, transport, way, here.of(sampled), [one[sampled] for one in found], sums),
                  _turned(way, here.of(turned), [one[turned] for one in found]), here.of(status == _paths.PASSES)]
    return parts


def _at_grains(world, transport, way, paths, found, sums):
    """Paths that go on from where light samples are taken, after those have been added."""
    n = len(paths)
    if n == 0 or sums.skips(paths):
        return _turned(way, paths, found)
    numbers, added = np.empty((n, 3)), np.empty((n, 3))
    wavefront.draw(paths.states, numbers)
    sample = world.lights(paths.origin, numbers)
    lit = paths
    if len(transport.bodies) > 1:
        lit = paths.of(slice(None))
        lit.weight = paths.weight * _open(transport, paths.technique[0], paths.origin, sample.direction, sample.distance,
                                          paths.body[0])
    way.lit(lit, found, sample, added)
    sums.add(paths, sample.light, added)
    return _turned(way, paths, found)


def _turned(way, paths, found):
    """Paths that go on in new directions."""
    if not len(paths):
        return paths
    alive = np.empty(len(paths), bool)
    way.scattered(paths, found, alive)
    return paths.of(alive)


def _at_surfaces(world, transport, paths, sums):
    """Paths that go on from surfaces of the scene, after their light has been added."""
    n, colours = len(paths), transport.colours
    if n == 0:
        return paths
    numbers, added = np.empty((n, 6)), np.empty((n, 3))
    wavefront.draw(paths.states, numbers)
    shading = world.shade(paths.origin, paths.direction, numbers, paths.density, paths.single)
    wavefront.emitted(colours, paths.weight, paths.order, shading.emitted, added)
    sums.add(paths, shading.source, added)
    hit = np.flatnonzero(shading.hit)
    m, paths = len(hit), paths.of(hit)
    if m == 0:
        return paths
    paths.bounces += 1
    _lit_surfaces(transport, paths, shading.point[hit], LightSample(*(values[hit] for values in shading.light)), sums)
    run(wavefront.reflect, m, colours, paths.weight, shading.weight[hit])
    paths.origin, paths.direction = shading.origin[hit], shading.direction[hit].astype(float)
    paths.met[:], paths.place[:], paths.far[:], paths.body[:], paths.beyond[:] = UNKNOWN, -1, np.nan, -1, -1
    paths.density, paths.single = shading.density[hit].astype(float), shading.delta[hit]
    # nobody tells grains apart in light that a matt surface has scattered
    paths.switching |= (transport.switch is not None) & (paths.technique == GRAINS) & (paths.order > 0) & ~paths.single
    alive = np.empty(m, bool)
    run(wavefront.roulette, m, paths.weight, paths.states, paths.bounces, alive)
    return paths.of(alive)


def _lit_surfaces(transport, paths, point, sample, sums):
    """Adds what light samples send by way of surfaces of the scene, through what is between the grains."""
    if sums.skips(paths):
        return
    bright = (sample.radiance > 0).any(axis=1)
    for technique in np.unique(paths.technique[bright]):
        here = np.flatnonzero(bright & (paths.technique == technique))
        some, lit = paths.of(here), LightSample(*(values[here] for values in sample))
        share, added = _open(transport, technique, point[here], lit.direction, lit.distance), np.empty((len(here), 3))
        wavefront.emitted(transport.colours, some.weight * share, some.order, lit.radiance, added)
        sums.add(some, lit.light, added)
