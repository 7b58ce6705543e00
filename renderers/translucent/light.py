"""Light in bodies as straight beams: light that comes in through the boundary, and what walks on from there.

Places on the boundary are drawn; light comes to them from a light sample, and from a direction in which a path looks for light.
Both begin a beam inside.  Light walks on from some of them, and where it meets the boundary after k events it

- begins a beam of negative power outside, as far as the infinite medium of the tables goes: its later events are those of light
  that has left, which the tables of the other beams count and the body does not;
- begins a beam of what is reflected, from which light walks on, as from the first.
"""

from __future__ import annotations

import numpy as np

from bakery.kernels import stream_key
from renderers import wavefront
from renderers.threads import run
from renderers.translucent import _light, _walk, transport
from renderers.translucent._gather import Beams
from renderers.translucent.paths import Paths, joined
from renderers.translucent.transport import UNLIMITED, Sums

_APART = 1 << 28  # random streams of bodies are so far apart
_LOOK = 1e-5  # of the size of all bodies, from where a ray goes to the boundary which it shall enter


def beams(how, number, entries, walks, boundary, ways, pass_number, seed) -> Beams:
    """Beams in body `number` of a pass.

    how : `transport.Transport`
    entries : places on the boundary, two beams each
    walks : of the light, from some of those beams
    boundary : whether light that leaves is taken away (negative beams)
    ways : whether every way between two events is a beam (virtual ray lights); then no beam is negative
    """
    body = how.bodies[number]
    paths, power = _entered(how, number, entries, pass_number, seed)
    made = _Made(not body.convex)
    body_of, far, _ = transport.located(how.geometry, paths)
    inside = body_of == number
    paths, power, far = paths.of(inside), power[inside], far[inside]
    if not ways:
        made.add(paths.origin, paths.direction, far, power, 0)
    if (boundary or ways) and len(paths):
        chosen, scale = _chosen(paths, power, walks)
        wavefront.begin_streams(stream_key(seed, "render.light", pass_number), number * _APART, chosen.states)
        (_ways if ways else _walked)(how, number, chosen, scale, made)
    return made.beams(len(how.colours.to_waves))


class _Made:
    """Beams, as they are made."""

    def __init__(self, real):
        self._real, self._parts = real, []

    def add(self, origin, direction, length, power, before, real=True):
        n = len(origin)
        self._parts.append((origin.copy(), direction.copy(), np.broadcast_to(length, n).astype(float), power,
                            np.broadcast_to(before, n).astype(np.int64), np.full(n, real and self._real)))

    def beams(self, waves):
        none = np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros((0, waves)), np.zeros(0, np.int64), np.zeros(0, bool)
        return Beams(*(np.ascontiguousarray(np.concatenate(arrays)) for arrays in zip(none, *self._parts, strict=True)))


# ---- light that comes in


def _entered(how, number, entries, pass_number, seed):
    """Paths just inside of the boundary, and their power (n, L), W."""
    body, world, waves = how.bodies[number], how.world, len(how.colours.to_waves)
    states, numbers = np.empty(entries, np.uint64), np.empty((entries, 10))
    wavefront.begin_streams(stream_key(seed, "render.entries", pass_number), number * _APART, states)
    wavefront.draw(states, numbers)
    point, normal, area = _on_boundary(body, numbers)
    outside = point + _LOOK * how.geometry.scale * normal
    sample = world.lights(outside, numbers[:, 3:])
    cosine = np.maximum(np.einsum("nk,nk->n", sample.direction, normal), 0.0)
    lit = sample.radiance * (sample.share(cosine / np.pi) * cosine)[:, None] @ how.colours.to_waves.T
    # light from all other ways that it can come
    direction = _about(normal, numbers[:, 5:7])
    looking = Paths.begun(outside, direction, np.ones((entries, waves)), states, np.arange(entries))
    looking.density[:] = np.einsum("nk,nk->n", direction, normal) / np.pi
    looking.single[:] = False
    seen = Sums(entries)
    while len(looking):
        looking = transport.onward(how, looking, [UNLIMITED] * len(how.bodies), seen)
    found = seen.by_order.sum(axis=0) @ how.colours.to_waves.T * np.pi
    towards, power = np.concatenate([sample.direction.astype(float), direction]), np.concatenate([lit, found]) * area / entries
    some = np.flatnonzero((power > 0).any(axis=1))
    at = some % entries
    return _refracted(how, body, point[at], towards[some], power[some], states[at] ^ np.uint64(some[0] if len(some) else 0))


def _refracted(how, body, point, towards, power, states):
    """Paths that go in at points of a boundary, of light from directions, and their power."""
    paths = Paths.begun(point, -towards, np.ones_like(power), states, np.arange(len(point)))
    if body.matched or not len(paths):
        paths.origin += how.off * paths.direction
        return paths, power
    numbers = np.empty((len(paths), 6))
    wavefront.draw(paths.states, numbers)
    shading = how.world.shade(point + _LOOK * how.geometry.scale * towards, -towards, numbers, paths.density, paths.single)
    paths.origin, paths.direction = shading.origin, shading.direction.astype(float)
    # Mitsuba's weights are of radiance, which is larger inside by the square of the index; power is not
    goes = shading.hit & (shading.weight > 0).any(axis=1)
    return paths.of(goes), (power * shading.weight[:, :1] * body.index**2)[goes]


def _on_boundary(body, numbers):
    """Points (n, 3) m on a boundary, evenly spread, the outward normals there, and its area, m^2."""
    a, b, c = (body.vertices[body.faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    double = np.linalg.norm(normal, axis=1)
    total = np.cumsum(double)
    n = len(numbers)
    at = np.minimum(np.searchsorted(total, (np.arange(n) + numbers[:, 0]) / n * total[-1], side="right"), len(total) - 1)
    root = np.sqrt(numbers[:, 1])
    u, v = 1 - root, numbers[:, 2] * root
    point = a[at] + u[:, None] * (b[at] - a[at]) + v[:, None] * (c[at] - a[at])
    return point, normal[at] / double[at][:, None], total[-1] / 2


def _about(normal, numbers):
    """Directions (n, 3) in proportion to the cosine to normals."""
    radius, turn = np.sqrt(numbers[:, 0]), 2 * np.pi * numbers[:, 1]
    side = np.cross(normal, np.where(np.abs(normal[:, :1]) < 0.5, [[1.0, 0, 0]], [[0, 1.0, 0]]))
    side /= np.linalg.norm(side, axis=1)[:, None]
    other = np.cross(normal, side)
    made = (radius * np.cos(turn))[:, None] * side + (radius * np.sin(turn))[:, None] * other \
        + np.sqrt(1 - numbers[:, :1]) * normal
    return made / np.linalg.norm(made, axis=1)[:, None]


# ---- light that walks on


def _chosen(paths, power, walks):
    """So many paths, drawn in proportion to their power, and the power (n,) W that a weight of 1 stands for."""
    most = power.max(axis=1)
    total = np.cumsum(most)
    first = np.empty((1, 1))
    wavefront.draw(paths.states[:1], first)
    at = np.minimum(np.searchsorted(total, (np.arange(walks) + first[0, 0]) / walks * total[-1], side="right"), len(total) - 1)
    chosen = paths.of(at)
    chosen.weight = power[at] / most[at][:, None]
    return chosen, total[-1] / walks


def _walked(how, number, paths, scale, made):
    """Adds the beams of light that walks on, but for the first ones."""
    body = how.bodies[number]
    waves = paths.weight.shape[1]
    index = body.index if body.smooth else 0.0
    _, far, place = transport.located(how.geometry, paths)
    while len(paths):
        n = len(paths)
        left, turned = np.empty((n, _light.MEETINGS, 7 + waves)), np.empty((n, _light.MEETINGS, 8 + waves))
        status, alive = np.empty(n, np.int64), np.empty(n, bool)
        run(_light.walk, n, how.geometry, body.medium, number, index, paths.origin, paths.direction, paths.weight, paths.states,
            far, place, paths.start, paths.events, paths.order, paths.bounces, left, turned, status, alive, block=256)
        left, turned = left[left[..., 6] > 0], turned[turned[..., 7] >= 0]
        made.add(left[:, :3], left[:, 3:6], np.inf, -scale * left[:, 7:], left[:, 6], real=False)
        made.add(turned[:, :3], turned[:, 3:6], turned[:, 6], scale * turned[:, 8:], turned[:, 7])
        more, met = status == _light.MORE, status == _light.SURFACE
        back, _, far_back, place_back = _back(how, number, paths.of(met), place[met])
        made.add(back.origin, back.direction, far_back, scale * back.weight, back.order)
        paths = joined([paths.of(more), back])
        far, place = np.concatenate([far[more], far_back]), np.concatenate([place[more], place_back])


def _ways(how, number, paths, scale, made):
    """Adds a beam for every way of light between two events or surfaces."""
    body = how.bodies[number]
    _, far, place = transport.located(how.geometry, paths)
    while len(paths):
        made.add(paths.origin, paths.direction, far, scale * paths.weight, paths.order)
        status = transport.through(how, number, paths, far, place, UNLIMITED, True)
        met, turns = status == _walk.CONTACT, paths.of(status == _walk.EVENT)
        alive = np.empty(len(turns), bool)
        run(_walk.scatter, len(turns), body.medium, turns.origin, turns.direction, turns.weight, turns.states, turns.drawn,
            turns.density, turns.single, turns.bounces, alive)
        paths = joined([turns.of(alive), _back(how, number, paths.of(met), place[met])[0]])
        body_of, far, place = transport.located(how.geometry, paths)
        inside = body_of == number
        paths, far, place = paths.of(inside), far[inside], place[inside]


def _back(how, number, paths, place):
    """Paths that go on in a body from surfaces that they meet, as `transport.located` finds them."""
    if len(paths):
        own = how.geometry.owner[place]
        crosses = (own >= 0) & how.matched[np.maximum(own, 0)]
        paths = transport.shaded(how, paths.of(~crosses), Sums(int(paths.pixel.max(initial=0)) + 1, found=False))
    body, far, place = transport.located(how.geometry, paths)
    inside = body == number
    return paths.of(inside), body[inside], far[inside], place[inside]
