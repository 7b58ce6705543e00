"""Camera paths through every material of a scene and over its surfaces, all of a pass together.

A step takes each path to where its flight ends: an event in the innermost material, the next boundary of a region, a grain or a
surface.  Materials (`renderers.materials`) fly and scatter in compiled loops; Mitsuba answers once a step for all surfaces, and
once for the light samples of all events.
"""

from typing import NamedTuple

import numpy as np

from bakery.kernels import stream_key
from renderers.mitsuba.shading import FAR, selected
from renderers.transport import regularised, steps, wavefront
from renderers.transport.paths import ELSEWHERE, EVENT, REACHED, UNKNOWN, Colours, Paths, follow, joined, of_camera
from renderers.transport.places import NOWHERE, Places

_BESIDE = 9e-5  # of the largest coordinate: as far as Mitsuba's own rays begin beside surfaces, where these are looked for
_ALMOST = 1 - 1e-4  # of the way to a surface that may be the blind boundary itself, or the light's
# Bounces after which surfaces end paths, and those after which grains do so that are looked for anew at each.
# Glass keeps light without loss, as a ball does into which light has come out of a body that reaches into it.  In heaps of clear
# grains many paths are as long as some hundred grains: what ends them earlier makes the others bright
_FAR, _FAR_IN_GRAINS = 64, 1024
SURFACE, BOUNDARY, BLIND, GRAIN = range(4)  # what ends a flight


class Scene(NamedTuple):
    """What paths go through.

    world : `renderers.mitsuba.world.World`
    materials : interactors (`renderers.materials`), by their entries;  places : `Places` of their regions
    colours : `Colours`
    crossed : whether light samples go through boundaries to which light is blind
    angle, chord : of `regularised`, by which smooth grains show small lamps wider: at the first sample, of a pass; 0: as they are
    """

    world: object
    materials: tuple
    places: Places
    colours: Colours
    crossed: bool = False
    angle: float = 0.0
    chord: float = 0.0

    @property
    def solids(self):
        """Numbers of materials that are grains."""
        return [number for number, material in enumerate(self.materials) if material.solid]


class Ahead(NamedTuple):
    """What is ahead of n paths.

    material : (n,) number of the innermost one, or NOWHERE
    stop : (n,) m, to what ends the flight;  cause : (n,) which of SURFACE, BOUNDARY, BLIND, GRAIN it is
    grains : (n,) the material of that grain, or -1;  within : (n,) whether paths are inside of it
    """

    material: np.ndarray
    stop: np.ndarray
    cause: np.ndarray
    grains: np.ndarray
    within: np.ndarray

    of = selected


class Sums(steps.Sums):
    """As `steps.Sums`.

    first : (materials, pixels) paths that each material was the first to scatter
    """

    def __init__(self, pixels, scene, paths, choices):
        super().__init__(pixels, len(scene.world.light_names), paths, choices)
        self.first = np.zeros((len(scene.materials), pixels))

    def scattered_by(self, paths, number):
        """Counts paths that have scattered for the first time."""
        new = np.flatnonzero((paths.first < 0) & (paths.order > 0))
        paths.first[new] = number
        np.add.at(self.first[number], paths.pixel[new], 1.0)


def one_pass(scene, size, number, seed, samples=1) -> Sums:
    """`samples` camera paths for each pixel of a picture of size (height, width).

    number, seed : of the pass: its random numbers
    """
    height, width = size
    key, total = stream_key(seed, "render.mixed", number), samples * height * width
    # several samples of a pixel draw their own: they do not know which ones they are
    choices = steps.shared_choices(size, seed, number) if samples == 1 else None
    sums = Sums(height * width, scene, total, choices)

    def begin(first, last):
        which = np.arange(first, last)
        pixel, places = which % (height * width), steps.places(seed, number, which, height * width, samples)
        rows = np.stack([pixel // width, pixel % width], axis=1)
        states, origin, direction = of_camera(scene.world.camera_rays, key, first, rows, places)
        return starting(np.array(origin, float), np.array(direction, float), len(scene.colours.to_waves), states, pixel)

    follow(total, steps.ALL, begin, lambda paths: step(scene, paths, sums))
    return sums


def starting(origin, direction, waves, states, pixel) -> Paths:
    """Paths of the camera."""
    n = len(pixel)
    return Paths.begun(origin, direction, waves, states, pixel, drawn=origin.copy(), shaded=True, far=np.nan, grains=-1,
                       sphere=np.full((n, 4), UNKNOWN), triangle=-1, left_out=np.full((n, 3), np.nan), first=-1)


def step(scene, paths, sums) -> Paths:
    """Paths after the ends of their flights, those that go on."""
    ahead = look(scene, paths)
    events, reached, elsewhere = [], [], []
    for number in np.unique(ahead.material):
        inside = ahead.material == number
        group, its = paths.of(inside), ahead.of(inside)
        if number == NOWHERE:
            reached.append((group, its))
            continue
        material = scene.materials[number]
        chance = material.light_chance(sums.often(group.count))
        status, event = _advance(material, group, its)
        sums.scattered_by(group, number)
        meets = np.flatnonzero(status == EVENT)
        events.append((material, group.of(meets), tuple(values[meets] for values in event), chance))
        arrives = np.flatnonzero(status == REACHED)
        reached.append((group.of(arrives), its.of(arrives)))
        elsewhere.append(group.of(status == ELSEWHERE))
    paths = joined([group for group, _ in reached])
    ahead = Ahead(*map(np.concatenate, zip(*(its for _, its in reached))))
    onward, meets, at_surface = _into_grains(scene, paths, ahead, sums)
    crossing = (ahead.cause == BOUNDARY) | (ahead.cause == BLIND)
    return joined([*onward, *elsewhere, _across(scene, paths.of(crossing), ahead.of(crossing)),
                   at_events(scene, paths, events + meets, sums),
                   at_surfaces(scene, joined([paths.of(ahead.cause == SURFACE), *at_surface]), sums)])


def _advance(material, paths, ahead):
    """As `advance` of a material; what is ahead changes where a body's own loop has found it."""
    if not material.walks:
        return material.advance(paths, ahead.stop)
    status, event, far, blind = material.walk(paths)
    arrives = status == REACHED
    ahead.stop[arrives], ahead.cause[arrives] = far[arrives], np.where(blind, BLIND, SURFACE)[arrives]
    return status, event


# ---- what is ahead


def look(scene, paths) -> Ahead:
    """What is ahead of paths."""
    n = paths.count
    material, stop, blind = scene.places.find(paths.origin, paths.direction)
    walks = np.array([*(material.walks for material in scene.materials), False])  # the last one is NOWHERE
    unknown = np.flatnonzero(np.isnan(paths.far) & ~walks[material])
    paths.far[unknown] = scene.world.trace(paths.origin[unknown], paths.direction[unknown], np.inf)
    # surfaces that lie in boundaries come first, but for those that are blind ones
    limit = np.where(blind, stop * _ALMOST, stop + 2 * scene.places.off)
    surface = ~(limit < paths.far)
    cause = np.where(surface, SURFACE, np.where(blind, BLIND, BOUNDARY))
    ahead = Ahead(material, np.where(surface, paths.far, stop), cause, np.full(n, -1), np.zeros(n, bool))
    for number in scene.solids:
        _look_for_grains(scene, paths, ahead, number)
    return ahead


def _look_for_grains(scene, paths, ahead, number):
    """Changes what is ahead of paths where a grain comes first, or is around them; there is none inside of inner materials."""
    rank = scene.places.rank
    seen = np.flatnonzero((rank[ahead.material] >= rank[number]) & ~ahead.within)
    distance, within = scene.materials[number].look(paths.of(seen))
    nearer = np.flatnonzero(within | (distance < ahead.stop[seen]))
    at, within = seen[nearer], within[nearer]
    ahead.stop[at], ahead.cause[at], ahead.grains[at], ahead.within[at] = distance[nearer], GRAIN, number, within
    ahead.material[at[within]] = NOWHERE


def _across(scene, paths, ahead):
    """Paths beyond the boundaries of regions."""
    length, blind = ahead.stop + scene.places.off, ahead.cause == BLIND
    paths.origin[:] += length[:, None] * paths.direction
    paths.far[:] = np.where(blind, np.nan, paths.far - length)
    paths.off_grains()
    return paths


def _into_grains(scene, paths, ahead, sums):
    """Of paths that come to grains: those that go on, events, and those that come to surfaces inside of grains."""
    onward, events, at_surface = [], [], []
    for number in np.unique(ahead.grains[ahead.cause == GRAIN]):
        material, rows = scene.materials[number], np.flatnonzero((ahead.cause == GRAIN) & (ahead.grains == number))
        group = paths.of(rows)
        material.light_chance(sums.often(group.count))
        status, event = material.enter(group, np.where(ahead.within[rows], group.far, np.inf))
        sums.scattered_by(group, number)
        meets = np.flatnonzero(status == EVENT)
        events.append((material, group.of(meets), tuple(values[meets] for values in event), 1.0))
        onward.append(steps.thinned(group.of(status < 0), _FAR_IN_GRAINS))
        at_surface.append(group.of(status == REACHED))
    return onward, events, at_surface


# ---- light


def transmittance(scene, paths, origin, direction, distance, departed=None, traced=False):
    """What of light gets through from origins (n, 3) along directions to distances (n,) m: (n, L), and (n,) m to the first
    boundary, up to where grains of `departed` have not been looked for.

    departed : (n,) material of the grain at which each way begins, or -1
    traced : surfaces of the scene hide light, but for blind boundaries
    """
    n, places = len(origin), scene.places
    passed, clear, states = np.ones((n, len(scene.colours.to_waves))), np.empty(n), paths.states.copy()
    remaining, point = np.array(distance, float), np.array(origin, float)
    departed = np.full(n, -1) if departed is None else departed
    active, at_start = np.arange(n), True
    while len(active):
        origins, ways = point[active], direction[active]
        material, stop, blind = places.find(origins, ways)
        length = np.minimum(stop, remaining[active])
        share, streams = passed[active], states[active]
        if traced:
            free = np.where(blind | (remaining[active] <= stop), length * _ALMOST, length + places.off)
            share[scene.world.trace(origins, ways, free) < np.inf] = 0.0
        for number in np.unique(material):
            _taken(scene, number, material == number, (streams, origins, ways, length, paths.left_out[active]), share)
        for number in scene.solids:
            open_to = places.rank[material] >= places.rank[number]
            if at_start:
                open_to &= departed[active] != number
            rows, values = np.flatnonzero(open_to), share[open_to]
            scene.materials[number].hides(origins[rows], ways[rows], length[rows], values)
            share[rows] = values
        if at_start:
            clear[:], at_start = length, False
        passed[active], states[active] = share, streams
        point[active] += (length + places.off)[:, None] * ways
        remaining[active] -= length + places.off
        active = active[(remaining[active] > 0) & share.any(axis=1)]
    paths.states[:] = states
    return passed, clear


def _taken(scene, number, chosen, ways, share):
    """Multiplies share (n, L) of those chosen (n,) by what a material leaves of light on its ways; changes their streams."""
    if number == NOWHERE:
        return
    taken, values = [values[chosen] for values in ways], share[chosen]
    scene.materials[number].transmittance(*taken, values)
    ways[0][chosen], share[chosen] = taken[0], values


def at_events(scene, reached, events, sums) -> Paths:
    """Paths that go on from events, quadruples of (material, paths, what it needs, chance of a light sample)."""
    events = [event for event in events if event[1].count]
    if not events:
        return reached.of(slice(0, 0))
    paths, firsts = joined([event[1] for event in events]), np.cumsum([0, *(event[1].count for event in events)])
    chance = np.concatenate([np.full(event[1].count, event[3]) for event in events])
    numbers = wavefront.uniforms(paths.states, 4)
    drawn = np.flatnonzero(numbers[:, 3] < chance)
    sample, bright = _samples(scene, paths, drawn, numbers, chance)
    bright_paths = paths.of(bright)
    departed = np.where(np.repeat([event[0].solid for event in events], np.diff(firsts))[bright], bright_paths.grains, -1)
    passed, clear = transmittance(scene, bright_paths, bright_paths.origin, sample.direction.astype(float), sample.distance,
                                  departed, traced=scene.crossed)
    paths.states[bright] = bright_paths.states
    onward = []
    for (material, _, event, share), first, last in zip(events, firsts[:-1], firsts[1:]):
        group, rows = paths.of(slice(first, last)), np.flatnonzero((bright >= first) & (bright < last))
        at, added = bright[rows] - first, np.empty((len(rows), 3))
        sampled = sample.of(rows)
        material.next_event(group.of(at), tuple(values[at] for values in event), sampled, passed[rows], clear[rows], added)
        sums.add(group.of(at), sampled.light, added)
        group.single[:], group.shaded[:] = share == 0.0, share == 0.0
        material.scatter(group, event)
        if share > 0.0:
            group.density[:] /= share
        if not material.solid:
            group.away_from_surfaces()
        onward.append(steps.survivors(group))
    return joined(onward)


def _samples(scene, paths, drawn, numbers, chance):
    """Light samples from events `drawn`, over their chances, of those that are bright, and which paths these are."""
    options = {"hidden": False} if scene.crossed else {}
    sample = scene.world.lights(paths.origin[drawn], numbers[drawn], **options)
    bright = np.flatnonzero((sample.radiance > 0).any(axis=1))
    sample = sample.of(bright)
    over = chance[drawn[bright]].astype(np.float32)
    density = np.where(sample.delta, sample.density, sample.density * over)
    return sample._replace(radiance=sample.radiance / over[:, None], density=density), drawn[bright]


def at_surfaces(scene, paths, sums) -> Paths:
    """Paths that go on from surfaces of the scene, after their light has been added."""
    def let_through(paths, point, sample):
        towards = sample.direction.astype(float)
        beside = _BESIDE * (scene.world.unit + abs(point).max(axis=1)) if scene.crossed else 0.0
        off = np.maximum(scene.places.off, beside)
        distance = np.maximum(sample.distance - off, 0.0)
        return transmittance(scene, paths, point + np.reshape(off, (-1, 1)) * towards, towards, distance, traced=scene.crossed)[0]

    def behind(paths, point, length):
        """Nothing hides what paths have come past."""
        return transmittance(scene, paths, point, paths.direction, np.minimum(length, FAR))[0]

    paths = steps.at_surfaces(scene.world, scene.colours, paths, sums, let_through,
                              wider=regularised.Wider(scene.chord, behind), hidden=not scene.crossed)
    paths.shaded[:] = True
    paths.away_from_surfaces()
    return steps.thinned(steps.survivors(paths), _FAR)
