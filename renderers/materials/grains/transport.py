"""Camera paths through grains, the media that stand for them, and the surfaces and lights around.

All paths of a pass go on together: compiled loops take each through one body until it needs a light, a surface of the scene,
another body or the other paths; Mitsuba answers for all that do.  A path begins among explicit grains and may switch: the grain
that it meets next is then a scattering of the medium, in which it goes on (`bundles` says when).

Steps of its own beside `renderers.transport.waves`, with those of `renderers.transport.steps`: paths of a bundle wait for
each other before they switch, and what a compiled loop finds ahead of a path need not be found again.  `waves` looks for all
materials ahead in every step: a path took 1.2 (20,000 glass balls, the only entry) and 1.6 times as long (grey stones).
"""

from typing import NamedTuple

import numpy as np

from bakery.kernels import stream_key
from renderers.materials.grains import _paths, bundles, far
from renderers.materials.grains._grains import OFF, UNKNOWN
from renderers.materials.grains._paths import GRAINS, MEDIUM
from renderers.materials.grains.ahead import TURNED, into_next, look_ahead, look_from_the_open
from renderers.materials.grains.paths import NEVER, Explicit, starting
from renderers.materials.surface import lobes
from renderers.transport import regularised, steps, wavefront
from renderers.transport.paths import Colours, follow, joined, of_camera

# Where a share goes on, steps after which paths end with a chance of one over them: a step takes milliseconds for however few
# paths, and the share of light samples that is taken at least: the fewer, the more grains are met in a step.  The light after the
# switch of the snowman, 320 x 240: after 16 steps 0.62 of the time of all paths and 1.08 times the variance; 640 x 480, after 8
# 0.82 of that and 1.39 times; a share of 1/64 in place of `steps.LEAST` 0.93 (without kernels 0.80) and 1.03 times
_STEPS, _LEAST = 8, 1 / 64
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
    switch : `spread` of `bundles.due`, or None where paths do not switch
    surfaces : `far.Surface` of each body; None where no body is one far from the camera
    angle, chord : of `regularised`, by which smooth grains show small lamps wider: at the first sample, of a pass; 0: as they are
    share : of the paths, that goes on after the switch, or, where paths do not, after `late` grains
    """

    bodies: tuple[Body, ...]
    colours: Colours
    technique: int = GRAINS
    switch: float | None = None
    surfaces: tuple[far.Surface, ...] | None = None
    angle: float = 0.0
    chord: float = 0.0
    share: float = 1.0
    late: int = 2

    def interactor(self, body, technique):
        """The loops of a body: those of its grains or those of its medium."""
        return self.bodies[body].grains if technique == GRAINS else self.bodies[body].medium


class Sums(steps.Sums):
    """As `steps.Sums`.

    by_technique : (ORDERS, pixels, 3)
    switched : (pixels, 3) grains met before the switch, and whether there was one
    which : ALL, BEFORE or AFTER
    samples : of each pixel; the arrays are means over those once `one_pass` is over
    """

    def __init__(self, choices, lights, which, samples=1):
        """choices : (pixels,) uniform numbers, far apart where pixels are near, that choose among the lights at first surfaces"""
        pixels = len(choices)
        self.pixels, self.samples, self.which = pixels, samples, which
        super().__init__(pixels, lights, pixels * samples, choices)
        self.by_technique, self.switched = np.zeros((wavefront.ORDERS, pixels, 3)), np.zeros((pixels, 3))

    def add(self, paths, light, added):
        """What paths bring, added (n, 3), from lights (n,)."""
        if self.skips(paths):
            return
        pixel = paths.pixel % self.pixels
        wavefront.accumulate(added, paths.order, light, pixel, self.by_order, self.by_light)
        wavefront.accumulate(added, paths.technique, light, pixel, self.by_technique, self.by_light[:0])

    def light_choices(self, paths):
        """Samples of a pixel share out the lights, and neighbours do where a pass has one: a floor beside a bulb and a weak sky
        has a noise of 60 % a sample where each path draws its own, and of 6 %."""
        sample, pixel = np.divmod(paths.pixel, self.pixels)
        return (self._choices[pixel] + sample / self.samples) % 1

    def average(self):
        """Makes means over the samples of the sums."""
        for sums in (self.by_order, self.by_technique, self.by_light, self.switched):
            sums /= self.samples

    def skips(self, paths):
        """Whether the light of paths, all of one technique, is left to other passes."""
        return self.which == AFTER and paths.count > 0 and bool(paths.technique[0] == GRAINS)


def one_pass(world, transport, camera, size, number, seed, which=ALL, corners=None, samples=1) -> Sums:
    """Camera paths, so many `samples` for each pixel, all together.

    world : `renderers.mitsuba.world.World`
    transport : `Transport`
    camera : `renderers.camera.Camera`
    size : height and width of the picture;  number, seed : of the pass: its random numbers
    which : light it brings: ALL, that BEFORE the switch or that AFTER it
    corners : (H W, 2) x and y of the pixels' upper left corners, in pixels of the camera's film; those of a film of H x W if None
    """
    height, width = size
    order = bundles.by_bundle(height, width, samples)
    key = stream_key(seed, "render.grains", which, number)
    sums = Sums(steps.light_choices(size, int(key) / 2**64), len(world.light_names), which, samples)
    if corners is None:
        corners = np.stack([np.arange(height * width) % width, np.arange(height * width) // width], axis=1)
    taken = 0  # steps since paths were added

    def begin(first, last):
        nonlocal taken
        taken = 0
        new = _begin(transport, camera, corners, order[first:last], key, first)
        if transport.switch is not None:
            return _until_switched(world, transport, new, size, sums)
        if transport.share < 1:
            new.stage[:] = transport.late
        return new

    def step(paths):
        nonlocal taken
        taken += 1
        paths, late = _on(world, transport, paths, sums)
        if late.count:
            late = _thinned(late, transport.share)
            late.stage[:] = NEVER
            paths = joined([paths, late])
        return _thinned(paths, 1 - 1 / taken) if transport.share < 1 and taken > _STEPS else paths

    follow(len(order), steps.ALL, begin, step)
    sums.average()
    return sums


def _begin(transport, camera, corners, pixel, key, first):
    states, origin, direction = of_camera(camera.rays_at, key, first, corners[pixel % len(corners)])
    return starting(origin, direction, len(transport.colours.to_waves), states, pixel, transport.technique)


def _thinned(paths, share):
    """A share of the paths, by chance, each of which counts for others."""
    paths = paths.of(wavefront.uniforms(paths.states, 1)[:, 0] < share)
    paths.throughput[:] /= share
    return paths


def _until_switched(world, transport, paths, size, sums):
    """Takes paths on from grain to grain, all of a bundle together, until they have switched: those that have, and go on."""
    stage, switched = 0, [paths.of(slice(0, 0))]
    while paths.count:
        stage, waiting = stage + 1, []
        paths.stage[:] = stage
        while paths.count:
            paths, waits = _on(world, transport, paths, sums)
            switched.append(paths.of(paths.technique != GRAINS))
            waiting.append(waits)
            paths = paths.of(paths.technique == GRAINS)
        paths = joined(waiting)
        radius = np.array([body.radius for body in transport.bodies])[paths.body]
        paths.switching[:] |= bundles.due(transport.switch, paths.pixel, paths.last, radius, size)
    return joined(switched)


def _on(world, transport, paths, sums):
    """Paths after what each needed next, those that go on, and those that wait."""
    look = look_ahead if transport.surfaces is None else look_from_the_open
    look(world, transport, paths, np.flatnonzero(np.isnan(paths.far) & (paths.sphere[:, 0] <= UNKNOWN)))
    onward, waiting = [], []
    for body, technique in _groups(paths):
        group = paths if technique is None else paths.of(
            (paths.body == body) & ((paths.technique == GRAINS) == (technique == GRAINS)))
        parts, waits = _through(world, transport, group, body, sums)
        onward += parts
        waiting.append(waits)
    return joined(onward), joined(waiting)


def _groups(paths):
    """Bodies and techniques of paths; (body, None) where all are the same."""
    kinds = np.unique(2 * paths.body + (paths.technique != GRAINS))
    return [(kind // 2, kind % 2 if len(kinds) > 1 else None) for kind in kinds]


def _through(world, transport, paths, body, sums):
    """Parts of the paths of one body and technique after what each needed next, and those that wait."""
    if body < -1:
        return [_at_baked_surface(world, transport, paths, TURNED - body, sums)], paths.of(slice(0, 0))
    if body < 0:  # nothing but surfaces of the scene ahead
        return [_at_surfaces(world, transport, paths, sums)], paths.of(slice(0, 0))
    interactor = transport.interactor(body, paths.technique[0])
    interactor.sample_lights(sums.often(paths.count, _LEAST if transport.share < 1 else steps.LEAST))
    event = interactor.advance(paths)
    status = event.status
    near = np.flatnonzero(status == _paths.TRACE)
    look_ahead(world, transport, paths, near)
    leaves, sampled = np.flatnonzero(status == _paths.LEAVES), np.flatnonzero(status == _paths.LIGHT)
    onward = into_next(world, transport, paths, leaves)
    return [paths.of(near), paths.of(leaves[onward]),
            _at_events(world, transport, interactor, paths.of(sampled), event.of(sampled), sums),
            _at_surfaces(world, transport, paths.of(leaves[~onward]), sums),
            *_switched(world, transport, paths.of(status == _paths.SWITCHES), sums)], paths.of(status == _paths.WAITS)


def transmittance(transport, technique, point, direction, distance, apart=-1):
    """Share (n, L) of light that gets through all bodies but one, for paths of a technique."""
    share = np.ones((len(point), len(transport.colours.to_waves)))
    passed = np.empty(share.shape)
    for body in range(len(transport.bodies)):
        if body != apart:
            transport.interactor(body, technique).transmittance(point, direction, distance, passed)
            share *= passed
    return share


def _let_in(transport, technique, point, direction, distance, off=False):
    """Share (n, L) of light on ways through the open that gets through all bodies, for paths of a technique.

    off : ways begin at baked surfaces, whose own grains are not in the way
    """
    if transport.surfaces is None:
        return transmittance(transport, technique, point, direction, distance)
    share, first = far.lets_in(transport.surfaces, point, direction, distance)
    passed = np.repeat(share[:, None], len(transport.colours.to_waves), axis=1)
    ahead = np.flatnonzero((share > 0) & (np.isfinite(first) if off else True))
    start = first[ahead] if off else np.zeros(len(ahead))
    passed[ahead] *= transmittance(transport, technique, point[ahead] + start[:, None] * direction[ahead], direction[ahead],
                                   distance[ahead] - start)
    return passed


# ---- events


def _switched(world, transport, paths, sums):
    """Parts of paths that go on in the medium, with a scattering where they have met a grain."""
    parts, ones = [], np.ones(paths.count, int)
    np.add.at(sums.switched, paths.pixel % sums.pixels, np.stack([paths.order, ones, 0 * ones], axis=1))
    if not paths.count or sums.which == BEFORE:
        return parts
    if sums.which == AFTER and transport.share < 1:
        paths = _thinned(paths, transport.share)
    paths.technique[:], paths.stage[:], paths.switching[:] = MEDIUM, NEVER, False
    for body in np.unique(paths.body):
        group, interactor = paths.of(paths.body == body), transport.interactor(body, MEDIUM)
        interactor.sample_lights(1.0)
        event = interactor.arrive(group)
        sampled, turns = event.status == _paths.LIGHT, event.status == _paths.TURNS
        parts += [_at_events(world, transport, interactor, group.of(sampled), event.of(sampled), sums),
                  _turned(interactor, group.of(turns), event.of(turns)), group.of(event.status == _paths.PASSES)]
    return parts


def _at_events(world, transport, interactor, paths, event, sums):
    """Paths that go on from where light samples are taken, after those have been added."""
    n = paths.count
    if n == 0 or sums.skips(paths):
        return _turned(interactor, paths, event)
    sample, added = world.lights(paths.origin, wavefront.uniforms(paths.states, 3)), np.empty((n, 3))
    lighted = paths
    if len(transport.bodies) > 1:
        passed = transmittance(transport, paths.technique[0], paths.origin, sample.direction, sample.distance, paths.body[0])
        lighted = paths.of(slice(None))._replace(throughput=paths.throughput * passed)
    interactor.next_event(lighted, event, sample, added)
    sums.add(paths, sample.light, added)
    return _turned(interactor, paths, event)


def _turned(interactor, paths, event):
    """Paths that go on in new directions."""
    if not paths.count:
        return paths
    interactor.scatter(paths, event)
    return paths.of(event.alive)


def _at_baked_surface(world, transport, paths, body, sums):
    """Paths that go on from the baked surface of a body, after light samples have been added."""
    surface, n = transport.surfaces[body], paths.count
    distance, normal = surface.boundary.entries(paths.origin, paths.direction, np.full(n, np.inf))
    paths.origin[:] += distance[:, None] * paths.direction
    if n and not sums.skips(paths):
        sample = world.lights(paths.origin, wavefront.uniforms(paths.states, 3))
        rows = np.flatnonzero((sample.radiance > 0).any(axis=1) & (np.sum(sample.direction * normal, axis=1) > 0))
        facing, sample = paths.of(rows), sample.of(rows)
        towards = sample.direction.astype(float)
        passed = _let_in(transport, paths.technique[0], facing.origin, towards, sample.distance, off=True)
        sums.add(facing, sample.light, lobes.next_event(surface.lobes, transport.colours, facing, normal[rows], sample, passed))
    lobes.scatter(surface.lobes, paths, normal)
    paths.bounces[:] += 1
    paths.sphere[:], paths.triangle[:], paths.far[:], paths.body[:], paths.beyond[:] = OFF, -1, np.nan, -1, -1
    # nobody tells grains apart in light that a surface has scattered
    paths.switching[:] |= (transport.switch is not None) & (paths.technique == GRAINS)
    return steps.survivors(paths)


def _at_surfaces(world, transport, paths, sums):
    """Paths that go on from surfaces of the scene, after their light has been added."""
    def let_through(paths, point, sample):
        return _let_in(transport, paths.technique[0], point, sample.direction, sample.distance)

    paths = steps.at_surfaces(world, transport.colours, paths, sums, let_through, wider=regularised.Wider(transport.chord))
    paths.sphere[:], paths.triangle[:], paths.far[:], paths.body[:], paths.beyond[:] = UNKNOWN, -1, np.nan, -1, -1
    # nobody tells grains apart in light that a matt surface has scattered
    paths.switching[:] |= (transport.switch is not None) & (paths.technique == GRAINS) & (paths.order > 0) & ~paths.single
    return steps.survivors(paths)
