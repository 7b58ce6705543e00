"""Events of light in bodies: the points themselves, and the beams that begin there.

Both are joined with lines of sight (`beams`), and share what they bring by the balance heuristic, by how likely each is to bring
it (Krivanek et al. 2014): a point where its flight ends, over the area over which it is spread; a beam for sure, over its width,
the likelier the more it crosses the line of sight.  So points bring what comes nearly along lines of sight, where single beams
are bright, and beams what crosses them.  A point takes far less time than a beam: all events of many walks are points, and beams
begin at those of a few.
"""

from typing import NamedTuple

import numpy as np

from bakery.kernels import stream_key
from renderers.materials.bodies import _events, _geometry, _light, _walk, beams, light, shells, surfaces
from renderers.materials.bodies._events import EVENTS, Record
from renderers.materials.bodies._points import Disc, Points
from renderers.materials.bodies.bodies import holds
from renderers.materials.bodies.paths import UNLIMITED
from renderers.threads import run
from renderers.transport import wavefront
from renderers.transport.paths import joined

APART = 4  # of so many walks, beams begin at the events of one
_EVENTS, _WALKS = 1 << 20, (8192, 32768)  # of a pass: of light that walks, and least and most walks
_FEW = 512  # walks that tell how many events each has
_NEAR = 4.0  # mean free paths from all surfaces, beyond which some events stand for all; lines of sight begin at surfaces


def discs(half_width):
    """`_points.Disc` of each body, beside beams of half a width (bodies,) m at the events of one walk in `APART`; and
    `_beams.Spread.points` of these (bodies,) m.

    A disc of radius r blurs by r^2/4 times the Laplacian across, a strip of half a width r by r^2/6: their errors are the same.
    """
    radius = np.sqrt(2 / 3) * half_width
    against = APART * np.pi * radius**2 / (2 * half_width)
    return list(map(Disc, radius, against)), against


def walks_of(setup, entries, seed) -> int:
    """Walks of light in a pass: as many as have `_EVENTS` events, as a few of them say, within bounds."""
    count = of_walks(setup, entries, _FEW, _FEW, 0, stream_key(seed, "render.walks_pilot")).count
    return int(np.clip(_EVENTS * _FEW / max(count, 1), *_WALKS))


class Walked(NamedTuple):
    """What walks of light leave in each body.

    beams : `_beams.Lit` that begin at events of some;  points : `_points.Points` at the ends of all flights between two events
    count : of events in all
    """

    beams: list
    points: list
    count: int


def of_walks(setup, entries, places, walks, number, seed) -> Walked:
    """Events of a pass; parameters as those of `light.beams`."""
    paths, scale = light.started(setup, entries, places, walks, number, seed)
    paths.pixel[:] = _some(paths)
    none = np.zeros((0, 11)), np.zeros(0, np.int64), *np.zeros((2, 0, len(setup.colours.to_waves)))
    collected = [[none] for _ in setup.bodies]
    count = 0
    while paths.count:
        within = surfaces.located(setup.geometry, paths)
        parts = [surfaces.at_surfaces(setup, paths.of(within == _geometry.OUTSIDE))]
        for body in np.unique(within[within >= 0]):
            its = paths.of(within == body)
            count -= int(its.order.sum())
            parts += _walked(setup, body, its, scale, collected[body])
            count += int(its.order.sum())
        paths = joined(parts)
    return Walked(*zip(*(_parted(*map(np.concatenate, zip(*rows, strict=True))) for rows in collected), strict=True), count)


def _some(paths):
    """(n,) bool, one of `APART` paths; which, is drawn, as their places are spread evenly."""
    first = wavefront.uniforms(paths.states[:1], 1)
    return np.arange(paths.count) % APART == (first * APART).astype(np.int64).sum()


def _walked(setup, number, paths, scale, collected):
    """Takes walks on in a body, and adds their events: parts of those that go on."""
    body, n, waves = setup.bodies[number], paths.count, paths.throughput.shape[1]
    arrived, turned = np.zeros((2, n, EVENTS, waves))
    record = Record(np.empty((n, EVENTS, 11)), np.empty((n, EVENTS), np.int64), arrived, turned, np.empty(n, np.int64))
    limits = _walk.Limits(shells.none(waves), UNLIMITED, True)
    boundary = _light.Boundary(number, body.index if body.smooth else 0.0)
    near = np.inf if holds(body, setup.world.camera.origin) else _NEAR
    run(_events.walk, n, setup.geometry, body.medium, boundary, limits, near, paths.part(_walk.Walk), record,
        block=256)
    noted = record.before >= 0
    collected.append((record.at[noted], record.before[noted], scale * arrived[noted], scale * APART * turned[noted]))
    paths.single[:] = False
    beyond, meets = (paths.of(record.status == status) for status in (_light.OUTSIDE, _light.SURFACE))
    beyond.origin[:] += setup.off * beyond.direction
    return [paths.of(record.status == _light.MORE), beyond,
            surfaces.at_surfaces(setup, meets, traced=False)]


def _parted(at, before, arrived, turned):
    """`Lit` and `Points` of events, rows of `Record`."""
    begin, ends = ~np.isnan(at[:, 10]), np.isfinite(at[:, 9])
    lit = beams.begun(at[begin, :3], at[begin, 6:9], at[begin, 10], turned[begin], before[begin] + 1)
    return lit, Points(*map(np.ascontiguousarray, (at[ends, :6], at[ends, 9], arrived[ends], before[ends])))
