"""Light in bodies as straight beams: light that comes in through the boundary, and what walks on from there.

Places on the boundary are drawn; light comes to them from a light sample, and from a direction in which a path looks for light.
Both begin a beam inside.  Light walks on from some of them, and where it meets the boundary after k events it

- begins a beam of negative power outside, as far as the infinite medium of the tables goes: its later events are those of light
  that has left, which the tables of the other beams count and the body does not;
- begins a beam of what is reflected, from which light walks on, as from the first.

What leaves walks on outside, and where it comes into a body again it is light that comes in.
"""

from typing import NamedTuple

import numpy as np

from bakery.kernels import stream_key
from renderers.materials.bodies import _geometry, _light, _walk, gather, shells, surfaces, transport
from renderers.materials.bodies._gather import Beams
from renderers.materials.bodies.paths import UNLIMITED, starting
from renderers.materials.bodies.setup import Sums
from renderers.threads import run
from renderers.transport import steps, wavefront
from renderers.transport.paths import Flying, Paths, joined
from renderers.transport.scattering import turn

_ROUNDS = 3  # that find where light comes in
_GROUPS, _EVEN = 512, 0.25  # of triangles that have one density; share of the places that are spread evenly
LOOK = 1e-5  # of the size of all bodies, from where a ray goes to the boundary which it shall enter


class Entries(NamedTuple):
    """How places on a boundary are drawn where light comes in.

    total : (F,) cumulated probability of each triangle, up to 1;  density : (F,) 1/m^2, of points in each
    """

    total: np.ndarray
    density: np.ndarray


def entries_of(setup, number, places, seed) -> Entries:
    """Places on the boundary of body `number` in proportion to the light that comes in there (root mean square of what it is in
    a group of triangles), as a few rounds of so many places find it."""
    body = setup.bodies[number]
    area = areas(body)
    entries = even = Entries(np.cumsum(area) / area.sum(), np.full(len(area), 1 / area.sum()))
    groups = np.empty(len(area), np.int64)
    order = gather.by_place(body.vertices[body.faces].mean(axis=1), body.vertices)
    groups[order] = np.minimum(np.cumsum(area[order]) / area.sum() * _GROUPS, _GROUPS - 1).astype(np.int64)
    whole = np.maximum(np.bincount(groups, area, _GROUPS), 1e-300)
    for number_of_round in range(_ROUNDS):
        triangle, _, power = _entered(setup, number, entries, places,
                                      stream_key(seed, "render.entries_pilot", number_of_round, number))
        # of W/m^2, over the area
        square = np.bincount(groups[triangle], power.max(axis=1) ** 2 * places * entries.density[triangle], _GROUPS) / whole
        light = np.sqrt(square)[groups] * area
        if not light.sum() > 0:
            return even
        share = (1 - _EVEN) * light / light.sum() + _EVEN * area / area.sum()
        entries = Entries(np.cumsum(share), share / np.maximum(area, 1e-300))
    return entries


def beams(setup, entries, places, walks, boundary, by_events, number, seed) -> list[Beams]:
    """Beams in each body in a pass.

    setup : `setup.Transport`
    entries : `Entries` of each body;  places : of each boundary that are drawn, two beams each
    walks : of the light, from some of those beams
    boundary : whether light that leaves is taken away (negative beams)
    by_events : whether every way between two events is a beam (virtual ray lights); then no beam is negative
    number, seed : of the pass: its random numbers
    """
    collected = [_Made(not body.convex) for body in setup.bodies]
    chosen, scale = started(setup, entries, places, walks, number, seed)
    if chosen.count and (boundary or by_events):
        _walk_on(setup, chosen, scale, collected, by_events)
    elif chosen.count:
        _begun(setup, chosen, np.ones(walks, bool), scale, collected)
    return [part.beams(len(setup.colours.to_waves)) for part in collected]


def started(setup, entries, places, walks, number, seed):
    """Paths on which light walks in a pass, and the power (W) that a weight of 1 stands for; none where none comes in.

    Parameters as those of `beams`.
    """
    parts, powers = [], []
    for body, its in enumerate(entries):
        _, paths, power = _entered(setup, body, its, places, stream_key(seed, "render.entries", number, body))
        inside = surfaces.located(setup.geometry, paths) == body
        parts.append(paths.of(inside))
        powers.append(power[inside])
    for paths, power in _emitted(setup, places, number, seed):
        parts.append(paths)
        powers.append(power)
    power = np.concatenate(powers)
    if not len(power):
        return joined(parts), 0.0
    chosen, scale = _chosen(joined(parts), power, walks)
    wavefront.begin_streams(stream_key(seed, "render.light", number), 0, chosen.states)
    return chosen, scale


class _Made:
    """Beams, as they are made."""

    def __init__(self, real):
        self._real, self._parts = real, []

    def add(self, origin, direction, length, power, before, begun=False, real=True):
        n = len(origin)
        self._parts.append((origin.copy(), direction.copy(), np.broadcast_to(length, n).astype(float), power,
                            np.broadcast_to(before, n).astype(np.int64), np.full(n, begun), np.full(n, real and self._real)))

    def beams(self, waves):
        none = (np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros((0, waves)), np.zeros(0, np.int64), np.zeros(0, bool),
                np.zeros(0, bool))
        collected = [np.concatenate(arrays) for arrays in zip(none, *self._parts, strict=True)]
        # neighbours one after another, as `_choice` wants them
        order = gather.by_place(collected[0], collected[0]) if len(collected[0]) else np.zeros(0, np.int64)
        return Beams(*(np.ascontiguousarray(values[order]) for values in collected))


# ---- light that comes in


def _entered(setup, number, entries, places, key):
    """Triangles (n,) of the boundary where light comes in, paths just inside, and their power (n, L), W."""
    body, waves = setup.bodies[number], len(setup.colours.to_waves)
    states, numbers = drawn(key, places)
    triangle, point, normal, sample, cosine = sampled(setup, body, entries, numbers)
    outside = point + LOOK * setup.geometry.scale * normal
    from_lamps = sample.radiance * (sample.share(cosine / np.pi) * cosine)[:, None] @ setup.colours.to_waves.T
    # light from all other ways that it can come
    direction = _about(normal, numbers[:, 5:7])
    looking = starting(outside, direction, waves, states, np.arange(places))
    looking.density[:] = np.einsum("nk,nk->n", direction, normal) / np.pi
    looking.single[:] = False
    seen = Sums(places)
    while looking.count:
        # what has been in a body comes by walks
        outside = surfaces.located(setup.geometry, looking) == _geometry.OUTSIDE
        looking = surfaces.at_surfaces(setup, looking.of(outside), seen)
    from_paths = seen.by_order.sum(axis=0) @ setup.colours.to_waves.T * np.pi
    towards, power = np.concatenate([sample.direction.astype(float), direction]), np.concatenate([from_lamps, from_paths])
    bright = np.flatnonzero((power > 0).any(axis=1))
    at = bright % places
    power = power[bright] / (places * entries.density[triangle[at]])[:, None]
    goes, paths, power = refracted(setup, body, point[at], towards[bright], power, states[at])
    return triangle[at][goes], paths, power


def drawn(key, places):
    """Random streams (places,) of places on a boundary, and their first numbers (places, 10)."""
    states = wavefront.streams(key, places)
    return states, wavefront.uniforms(states, 10)


def sampled(setup, body, entries, numbers):
    """Triangles (n,) where light comes in, points (n, 3) m and outward normals there, a light sample each, and its cosine."""
    triangle, point, normal = on_boundary(body, entries, numbers)
    sample = setup.world.lights(point + LOOK * setup.geometry.scale * normal, numbers[:, 3:])
    return triangle, point, normal, sample, np.maximum(np.einsum("nk,nk->n", sample.direction, normal), 0.0)


def refracted(setup, body, point, towards, power, states):
    """Which of points on a boundary light from directions goes in at, the paths, and their power."""
    paths = starting(point, -towards, power.shape[1], states, np.arange(len(point)))
    if body.matched or not paths.count:
        paths.origin[:] += setup.off * paths.direction
        return np.arange(paths.count), paths, power
    shading = setup.world.shade(point + LOOK * setup.geometry.scale * towards, -towards, wavefront.uniforms(paths.states, 6),
                                paths.density, paths.single, power=True)
    paths.origin[:], paths.direction[:] = shading.origin, shading.direction
    goes = np.flatnonzero(shading.hit & (shading.weight > 0).any(axis=1))
    return goes, paths.of(goes), (power * shading.weight[:, :1])[goes]


def on_boundary(body, entries, numbers):
    """Triangles (n,) of a boundary, points (n, 3) m on them, and their outward normals."""
    n = len(numbers)
    at = np.searchsorted(entries.total, (np.arange(n) + numbers[:, 0]) / n, side="right")
    at = np.minimum(at, len(body.faces) - 1)
    a, b, c = (body.vertices[body.faces[at, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    root = np.sqrt(numbers[:, 1])
    u, v = 1 - root, numbers[:, 2] * root
    return at, a + u[:, None] * (b - a) + v[:, None] * (c - a), normal / np.linalg.norm(normal, axis=1)[:, None]


def areas(body):
    """(F,) m^2, of triangles."""
    a, b, c = (body.vertices[body.faces[:, k]] for k in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def _about(normal, numbers):
    """Directions (n, 3) in proportion to the cosine to normals."""
    radius, turn = np.sqrt(numbers[:, 0]), 2 * np.pi * numbers[:, 1]
    side = np.cross(normal, np.where(np.abs(normal[:, :1]) < 0.5, [[1.0, 0, 0]], [[0, 1.0, 0]]))
    side /= np.linalg.norm(side, axis=1)[:, None]
    across = np.cross(normal, side)
    directions = (radius * np.cos(turn))[:, None] * side + (radius * np.sin(turn))[:, None] * across \
        + np.sqrt(1 - numbers[:, :1]) * normal
    return directions / np.linalg.norm(directions, axis=1)[:, None]


# ---- light of lamps that stand in bodies


def _emitted(setup, rays, number, seed) -> list[tuple[Paths, np.ndarray]]:
    """Paths on which lamps send light in bodies, and their power (n, L), W; of each lamp that reaches into one.

    rays : of each lamp;  number, seed : of the pass
    """
    beams = []
    boxes = [np.array([body.vertices.min(axis=0), body.vertices.max(axis=0)]) for body in setup.bodies]
    for lamp in setup.world.lights_in(boxes):
        paths, power = sent(setup, lamp, rays, stream_key(seed, "render.lamps", number, lamp))
        inside = surfaces.located(setup.geometry, paths) != _geometry.OUTSIDE
        beams.append((paths.of(inside), power[inside]))
    return beams


def sent(setup, lamp, rays, key) -> tuple[Paths, np.ndarray]:
    """Paths on which a lamp (position in `World.light_names`) sends light, and their power (n, L), W; key : of their streams"""
    states = wavefront.streams(key, rays)
    origin, direction, power = setup.world.light_rays(lamp, wavefront.uniforms(states, 5))
    paths = starting(origin + setup.off * direction, direction, len(setup.colours.to_waves), states, np.arange(rays))
    return paths, power @ setup.colours.to_waves.T / rays


# ---- light that walks on


def _chosen(paths, power, walks):
    """So many paths, drawn in proportion to their power, and the power (n,) W that a weight of 1 stands for."""
    most = power.max(axis=1)
    total = np.cumsum(most)
    first = wavefront.uniforms(paths.states[:1], 1)
    at = np.minimum(np.searchsorted(total, (np.arange(walks) + first[0, 0]) / walks * total[-1], side="right"), len(total) - 1)
    chosen = paths.of(at)
    chosen.throughput[:] = power[at] / most[at][:, None]
    return chosen, total[-1] / walks


def _walk_on(setup, paths, scale, collected, by_events):
    """Adds the beams of light that walks on through bodies and what is between them."""
    fresh = np.ones(paths.count, bool)
    while paths.count:
        within = _begun(setup, paths, fresh, scale, collected)
        parts = [surfaces.at_surfaces(setup, paths.of(within == _geometry.OUTSIDE))]
        kept = [np.ones(parts[0].count, bool)]
        for body in np.unique(within[within >= 0]):
            its = paths.of(within == body)
            for part, still_walks in _ways(setup, body, its) if by_events else _walked(setup, body, its, scale, collected[body]):
                parts.append(part)
                kept.append(np.full(part.count, not still_walks))
        fresh = np.concatenate(kept)
        paths = joined(parts)


def _begun(setup, paths, fresh, scale, collected):
    """Adds beams of paths where they are in bodies and begin one, `fresh` (n,) bool; the bodies (n,)."""
    within = surfaces.located(setup.geometry, paths)
    for body in np.unique(within[within >= 0]):
        begins = paths.of(fresh & (within == body))
        collected[body].add(begins.origin, begins.direction, begins.far, scale * begins.throughput, begins.order,
                            begins.events > 0)
    return within


def _walked(setup, number, paths, scale, collected):
    """Takes walks on in a body: parts of those that go on, and whether the beam of the next way is there."""
    body, n, waves = setup.bodies[number], paths.count, paths.throughput.shape[1]
    leaving, back = (np.empty((n, _light.MEETINGS, columns + waves)) for columns in (7, 8))
    ends = _light.Ends(leaving, back, np.empty(n, np.int64))
    limits = _walk.Limits(shells.none(waves), UNLIMITED, False)
    boundary = _light.Boundary(number, body.index if body.smooth else 0.0)
    run(_light.walk, n, setup.geometry, body.medium, boundary, limits, paths.part(_walk.Walk), ends, block=256)
    leaving, back = leaving[leaving[..., 6] > 0], back[back[..., 7] >= 0]
    collected.add(leaving[:, :3], leaving[:, 3:6], np.inf, -scale * leaving[:, 7:], leaving[:, 6], real=False)
    collected.add(back[:, :3], back[:, 3:6], back[:, 6], scale * back[:, 8:], back[:, 7])
    beyond = paths.of(ends.status == _light.OUTSIDE)
    beyond.origin[:] += setup.off * beyond.direction
    meets = paths.of(ends.status == _light.SURFACE)
    return [(paths.of(ends.status == _light.MORE), True), (beyond, False),
            (surfaces.shaded(setup, meets), False)]


def _ways(setup, number, paths):
    """The same, up to the next event or surface."""
    scattered, meets = turned(setup, number, paths)
    onward = surfaces.at_surfaces(setup, paths.of(meets), traced=False)
    return [(scattered, False), (onward, False)]


def turned(setup, number, paths):
    """Paths in body `number` after their next event, and which (n,) have met a surface before it."""
    status = transport.through(setup, number, paths, UNLIMITED, True)
    turns = paths.of(status == _walk.EVENT)
    run(turn, turns.count, setup.bodies[number].medium, turns.part(Flying))
    turns.single[:] = False
    return steps.survivors(turns), status == _walk.CONTACT
