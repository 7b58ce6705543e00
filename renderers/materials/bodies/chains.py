"""Light of lights without extent that comes to its first event by several smooth surfaces: turned back inside of glass, or from
one body to another.

No path finds such a light behind a smooth surface, and `refraction` looks for it through one boundary alone.  So all other ways
are followed from the light: at smooth surfaces both ways, through bodies without an event, with what the medium leaves.  Each
straight way in a body is a beam, and lines of sight gather beams that pass close by, as in `beams`.  Which lines do says which
light is whose: every light that has had its first event by such a way is brought by one line of sight and no other.

What is left out stands in `left_out`: light whose first smooth surface bounds no body, or that surfaces beside bodies get.
"""

import numpy as np

from bakery.kernels import stream_key
from renderers.materials.bodies import _geometry, _walk, beams, light, surfaces, transport
from renderers.materials.bodies.paths import starting
from renderers.threads import run
from renderers.transport import wavefront
from renderers.transport.paths import joined

_FIRST = 8192  # places that tell where light comes into a body, where only what is left out is looked for
_RAYS = 4096  # of light in a pass: places on each boundary, and rays of each light inside of a body


def gathering(setup, entries, number, seed, every, events, changed, share=1.0) -> beams.Joins:
    """What gathers the beams of a pass.

    setup : `setup.Transport`;  entries : `light.Entries` of each body
    every : whether all flights gather them; else those that come from surfaces alone
    events : whether beams count that begin at the first events of these
    changed : `setup.Sums` of what half the width would change;  share : of the lines of sight, by chance, that gather for all
    number, seed : of the pass: its random numbers
    """
    beams_of_bodies = _Collected(setup, events)
    paths, power, joined_directly = _arriving(setup, entries, number, seed)
    _follow(setup, paths, power, joined_directly, beams_of_bodies)
    sets = zip(beams_of_bodies.concatenated(), beams.half_widths(setup), strict=True)
    return beams.joins(setup, [(lit, beams.spread(width * beams.narrower(number))) for lit, width in sets], every=every,
                       changed=changed, share=share)


def left_out(setup, seed) -> tuple[np.ndarray | None, list[str]]:
    """Light of lights without extent that no method brings: what it would add to the mean of the picture, (3,) linear sRGB, None
    where that is not known; and sentences."""
    if sentences := setup.world.left_out({body.name for body in setup.bodies}):
        return None, sentences
    if not setup.chained:
        return np.zeros(3), []
    missing = caustics(setup, [light.entries_of(setup, body, _FIRST, seed) for body in range(len(setup.bodies))], seed)
    return missing, ["light of lamps without extent that smooth glass of bodies focuses on surfaces (caustics) is left out, "
                     "and counts as bias; a small sphere that shines in its place is found"] if missing.any() else []


# ---- light up to its first smooth surface


def _arriving(setup, entries, number, seed):
    """Light behind its first smooth surface: paths, the power (n,) W that a weight of 1 stands for by their `pixel`, and whether
    (n,) events are joined with the light through that surface."""
    parts, powers, refracted, offset = [], [], [], 0
    for body, places in zip(range(len(setup.bodies)), entries, strict=True):
        if setup.points and setup.bodies[body].smooth and not setup.bodies[body].matched:
            parts.append(_to_boundary(setup, body, places, number, seed))
    parts += [_from_inside(setup, source, number, seed) for source in setup.enclosed]
    behind = []
    for paths, power in parts:
        before = surfaces.located(setup.geometry, paths)
        owner = np.where(paths.triangle >= 0, setup.geometry.owner[paths.triangle], -1)
        paths.seen[:], paths.pixel[:] = True, np.arange(paths.count)
        beyond = surfaces.shaded(setup, paths)
        beyond = beyond.of(beyond.single)  # from rough surfaces a light sample finds the light
        within, rays = surfaces.located(setup.geometry, beyond), beyond.pixel
        refracted.append((within >= 0) & (within == owner[rays]) & (before[rays] != within))
        beyond.pixel[:] += offset
        offset += len(power)
        behind.append(beyond)
        powers.append(power)
    none = starting(*np.zeros((2, 0, 3)), len(setup.colours.to_waves), np.zeros(0, np.uint64), np.arange(0))
    return joined([*behind, none]), np.concatenate([*powers, np.zeros(0)]), np.concatenate([*refracted, np.zeros(0, bool)])


def _to_boundary(setup, number, entries, pass_number, seed):
    """Paths on which light meets the boundary of body `number` straight from lights outside, and their power (n,) W."""
    body = setup.bodies[number]
    states, numbers = light.drawn(stream_key(seed, "render.chains_entries", pass_number, number), _RAYS)
    triangle, point, normal = light.on_boundary(body, entries, numbers)
    power, towards = np.zeros((_RAYS, len(setup.colours.to_waves))), normal.copy()
    chosen = (numbers[:, 3] * len(setup.points)).astype(int)
    for which, source in enumerate(setup.points):
        rows = np.flatnonzero(chosen == which)
        sample = setup.world.from_light(source.number, point[rows])
        towards[rows] = sample.direction
        cosine = np.einsum("nk,nk->n", towards[rows], normal[rows])
        start = point[rows] + setup.off * towards[rows]
        bright = (sample.radiance > 0).any(axis=1) & (cosine > 0)
        passed = transport.transmittance(setup, start, towards[rows], sample.distance, bright)
        arrives = cosine * len(setup.points) / (_RAYS * entries.density[triangle[rows]])
        power[rows] = (sample.radiance @ setup.colours.to_waves.T) * passed * arrives[:, None]
    outside = point + light.LOOK * setup.geometry.scale * towards
    paths = starting(outside, -towards, power.shape[1], states, np.arange(_RAYS))
    return _scaled(paths._replace(throughput=power))


def _from_inside(setup, source, pass_number, seed):
    """Paths on which a light that stands in a body sends light to its first surface, and their power (n,) W."""
    paths, power = light.sent(setup, source.number, _RAYS, stream_key(seed, "render.chains", pass_number, source.number))
    paths.throughput[:] = power
    arrived = [paths.of(slice(0))]
    while paths.count:
        paths, turns = _ahead(setup, paths)
        # what leaves no body meets no smooth surface of one first
        arrived.append(paths.of(turns))
        paths = surfaces.crossed(setup, paths.of(~turns))
    return _scaled(joined(arrived))


def _ahead(setup, paths):
    """Paths in bodies that have a surface ahead, with what the medium leaves of them there, and whether (n,) it turns light."""
    within = surfaces.located(setup.geometry, paths)
    goes = np.flatnonzero((within >= 0) & np.isfinite(paths.far))
    paths, within = paths.of(goes), within[goes]
    for number in np.unique(within):
        rows = np.flatnonzero(within == number)
        its = paths.of(rows)
        run(_walk.straight, len(rows), setup.bodies[number].medium, its.part(_walk.Walk))
        paths.throughput[rows] = its.throughput
    return paths, ~surfaces.blind(setup, paths)


def _scaled(paths):
    """Those that carry light, with weights of at most 1, and the power (n,) W that a weight of 1 stands for."""
    paths = paths.of((paths.throughput > 0).any(axis=1))
    power = paths.throughput.max(axis=1)
    paths.throughput[:] /= power[:, None]
    return paths, power


# ---- beams behind it


class _Collected:
    """Beams of all bodies, as they are made."""

    def __init__(self, setup, events):
        waves = len(setup.colours.to_waves)
        none = beams.of(*np.zeros((3, 0, 3)), np.zeros(0), np.zeros((0, waves)), np.zeros(0), 0)
        self._setup, self._events = setup, events
        self._parts = [([none], [none]) for _ in setup.bodies]

    def add(self, number, paths, power):
        """Straight ways of paths in body `number`;  power (n,) W, of a weight of 1."""
        if not paths.count:
            return
        setup, (direct, events) = self._setup, self._parts[number]
        paths.throughput[:] *= power[:, None]
        direct.append(beams.direct(setup, number, paths, surfaces.facing(setup, paths), np.full(paths.count, np.inf)))
        if self._events:
            wavefront.branch(paths.states, np.full(paths.count, number))
            events.append(beams.of_events(setup, number, paths))

    def concatenated(self):
        """`Lit` of each body, of the ways themselves and of their first events."""
        return [[type(parts[kind][0])(*map(np.concatenate, zip(*parts[kind], strict=True))) for parts in self._parts]
                for kind in range(2)]


def _follow(setup, paths, power, joined_directly, collected):
    """Adds the beams of paths, but for those whose events are joined with the light itself, up to their end."""
    while paths.count:
        within = surfaces.located(setup.geometry, paths)
        for number in np.unique(within[within >= 0]):
            its = paths.of((within == number) & ~joined_directly)
            collected.add(number, its, power[its.pixel])
        paths = joined(_onward(setup, paths, within))
        joined_directly = np.zeros(paths.count, bool)


def _onward(setup, paths, within):
    """Parts of paths beyond the next surface: those that were outside of bodies; and in them, across boundaries to which light is
    blind, and turned."""
    outside = surfaces.at_surfaces(setup, paths.of(within == _geometry.OUTSIDE))
    paths, turns = _ahead(setup, paths.of(within >= 0))
    turned = surfaces.shaded(setup, paths.of(turns))
    return outside, surfaces.crossed(setup, paths.of(~turns)), turned


# ---- what no method brings


def caustics(setup, entries, seed) -> np.ndarray:
    """What light that smooth boundaries send on to other surfaces would add to the mean of the picture, (3,) linear sRGB.

    No method brings it.  Measured from the light: as seen by the camera directly, from surfaces that reflect it evenly; what they
    send on to others is left out.
    """
    paths, power, _ = _arriving(setup, entries, 0, seed)
    mean = np.zeros(3)
    while paths.count:
        outside, crossed, turned = _onward(setup, paths, surfaces.located(setup.geometry, paths))
        paths = joined([outside, turned])
        spread = paths.of(~paths.single)
        mean += _seen(setup.world, spread.origin) @ (spread.throughput * power[spread.pixel, None]) @ setup.colours.to_rgb.T
        paths = joined([paths.of(paths.single), crossed])
    return mean


def _seen(world, points):
    """Mean of the picture for each watt that surfaces at points (n, 3) m reflect evenly, 1/(m^2 sr)."""
    camera, (height, width) = world.camera, world.size
    axis = np.cross(camera.right, camera.down)
    pixel = np.linalg.norm(axis)
    away = points - camera.origin
    distance = np.linalg.norm(away, axis=1)
    depth = away @ axis / pixel
    with np.errstate(divide="ignore", invalid="ignore"):
        on_film = away / depth[:, None] - camera.corner
    column, row = (on_film @ side / (side @ side) for side in (camera.right, camera.down))
    shown = np.flatnonzero((depth > 0) & (column >= 0) & (column < width) & (row >= 0) & (row < height))
    first, cosine = world.first_surface(np.broadcast_to(camera.origin, (len(shown), 3)), away[shown] / distance[shown, None])
    brightness = np.zeros(len(points))
    # a pixel's solid angle is its area on the image plane times the third power of the cosine to the axis
    brightness[shown] = np.where(first < distance[shown] * (1 - 1e-4), 0.0, cosine * distance[shown] / depth[shown] ** 3) \
        / (np.pi * pixel * height * width)
    return brightness
