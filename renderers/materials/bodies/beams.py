"""Beams of light that are joined with lines of sight where they pass close by (photon beams; Jarosz et al. 2011).

Light of lamps that comes in through a boundary which turns it is found by beams of light samples.  Paths find it by chance; the
balance heuristic joins both, by how likely each is to bring it, as among points, beams and paths (Krivanek et al. 2014).  Of a
path that scatters on a line of sight the likelihood is that of the flight and of the phase function; of beams it is how many come
in a square metre and steradian, times the width over which each is spread.  Shares may be those of any function that both
know, so the likelihoods leave out what only one of them would have to look up: how light that comes in varies over the boundary,
the cosine to its normal, what it reflects, and that the width goes down from pass to pass.

The width is that of `half_widths` for the first pass and goes with the number of the pass to the power of -1/5, which makes the
squared error of the mean of n passes as small as may be, n^(-4/5): its variance is as n^(-1) over the width, its bias as the
square of the width (Kaplanyan and Dachsbacher, ACM Trans. Graph. 32, 2013).
"""

from typing import NamedTuple

import numpy as np

from bakery.kernels import stream_key
from renderers.materials.bodies import _beams, _points, light, surfaces
from renderers.materials.bodies._beams import CHANGED, Lit, Spread
from renderers.materials.bodies._cells import Cells, cells_of
from renderers.materials.bodies._walk import Walk
from renderers.materials.bodies.paths import starting, thinned
from renderers.materials.bodies.setup import Sums
from renderers.threads import run
from renderers.transport.paths import Paths

_WIDTH, _FREE = 0.01, 0.2  # half the width over which beams are spread: of a body's size; mfp, of those that begin at events
_CELLS = 48  # along the longest edge of the box around a body


def half_widths(setup):
    """Half the widths (bodies,) m over which beams are spread in the first pass: of those that come in, and that begin at
    events."""
    size = np.array([np.ptp(body.vertices, axis=0).max() for body in setup.bodies])
    return _WIDTH * size, np.minimum(_WIDTH * size, _FREE / setup.sigma_t.max(axis=1))


def narrower(number):
    """Width of beams in a pass over that in the first one."""
    return (1 + number) ** -0.2


def rivals_of(setup, entries, places):
    """(bodies,) m sr, of so many beams in each body: a m^2 of the boundary, times the width over which they are spread."""
    dense = np.array([np.sum(np.diff(drawn.total, prepend=0.0) * drawn.density) for drawn in entries])
    index = np.array([body.index for body in setup.bodies])
    return np.where(setup.matched, 0.0, places * dense * index**2 * 2 * half_widths(setup)[0])


def entering(setup, number, entries, places, pass_number, seed) -> tuple[Lit, Paths]:
    """Beams of light samples that come in through the boundary of body `number` in a pass, and the paths on which they go on;
    none where the boundary does not turn light.

    setup : `setup.Transport`;  entries : `light.Entries`;  places : that are drawn on the boundary
    """
    body, waves = setup.bodies[number], len(setup.colours.to_waves)
    if body.matched:
        none = np.zeros((0, 3))
        return of(none, none, none, np.zeros(0), np.zeros((0, waves)), np.zeros(0), 0), \
            starting(none, none, waves, np.zeros(0, np.uint64), np.arange(0))
    states, numbers = light.drawn(stream_key(seed, "render.beams", pass_number, number), places)
    triangle, point, normal, sample, cosine = light.sampled(setup, body, entries, numbers)
    power = sample.radiance * cosine[:, None] @ setup.colours.to_waves.T / (places * entries.density[triangle])[:, None]
    bright = np.flatnonzero((power > 0).any(axis=1))
    towards = sample.direction[bright].astype(float)
    goes, paths, power = light.refracted(setup, body, point[bright], towards, power[bright], states[bright])
    inside = surfaces.located(setup.geometry, paths) == number
    bright, paths = bright[goes[inside]], paths.of(inside)
    paths.throughput[:] = power[inside]
    first = direct(setup, number, paths, normal[bright], np.where(sample.delta, np.inf, sample.density)[bright])
    return first, paths


def direct(setup, number, paths, normal, density) -> Lit:
    """Beams of paths in body `number` up to the surface ahead, of the power of their throughput."""
    # moved along its boundary a beam may be longer, which matters where nothing else ends it
    longer = paths.far + (2 * half_widths(setup)[0][number] if setup.bodies[number].convex else 0.0)
    return of(paths.origin, paths.direction, normal, longer, paths.throughput.copy(), density, 0)


def of_events(setup, number, paths) -> Lit:
    """Beams that begin at the next events of paths in body `number`."""
    turned = light.turned(setup, number, paths)[0]
    surfaces.located(setup.geometry, turned)
    return begun(turned.origin, turned.direction, turned.far, turned.throughput, np.ones(turned.count, np.int64))


def begun(origin, direction, length, power, before):
    """`Lit` that begins at events."""
    n = len(length)
    return of(origin, direction, np.zeros((n, 3)), length, power, np.full(n, np.inf), before)


def of(origin, direction, normal, length, power, density, before) -> Lit:
    """`Lit` of arrays of any layout."""
    return Lit(*map(np.ascontiguousarray, (np.concatenate([origin, direction], axis=1), normal, length, power,
                                           np.asarray(density, float), np.full(len(length), before, np.int64))))


class Joins(NamedTuple):
    """How lines of sight gather beams and points that pass close by (as `gather.Gather`).

    sets : of tuples of a loop, and of what it joins (`Lit` or `Points`), their cells (`Cells`) and how they are spread
        (`_beams.Spread` or `_points.Disc`), each of every body
    every : whether flights after events gather, too; of `sets` then no beam begins at an event
    changed : `setup.Sums` of what half the width would change, or None
    share : of the lines of sight, by chance, that gather for all
    """

    sets: list
    every: bool = False
    changed: Sums | None = None
    share: float = 1.0

    def __call__(self, setup, paths, number, sums):
        """Adds what beams and points send to lines of sight in body `number`: those that come from a surface, or all."""
        sights = (paths.events == 0) | self.every
        # all of them, also of little weight: near a light inside few are bright
        lines = thinned(paths, sights, self.share)[1] if self.share < 1 else paths.of(sights & (paths.throughput > 0).any(axis=1))
        if not lines.count:
            return
        brought, facing = np.zeros((CHANGED + 1, *lines.throughput.shape)), surfaces.facing(setup, lines)
        for join, *its in self.sets:
            its = (part[number] for part in its)
            run(join, lines.count, setup.bodies[number].medium, *its, lines.part(Walk), facing, brought, block=64)
        for order, values in enumerate(brought[:CHANGED]):
            sums.add_of_beams(lines, values * lines.throughput @ setup.colours.to_rgb.T, order + 1)
        if self.changed:
            self.changed.add_of_beams(lines, brought[CHANGED] * lines.throughput @ setup.colours.to_rgb.T, CHANGED)


def joins(setup, sets, points=(), every=False, changed=None, share=1.0) -> Joins:
    """`Joins` of tuples of lit (`Lit`), `_beams.Spread`, and of tuples of `Points`, `_points.Disc`, each of every body."""
    sets = [(_beams.join, lit, list(map(_cells, setup.bodies, lit, spread)), spread) for lit, spread in sets]
    return Joins(sets + [(_points.join, its, list(map(_cells_of_points, setup.bodies, its, disc)), disc) for its, disc in points],
                 every, changed, share)


def spread(radius, rival=None, against=None):
    """`_beams.Spread` of each body, of radii (m) and of what is 0 where left out."""
    none = np.zeros(len(radius))
    return list(map(Spread, radius, none if rival is None else rival, none if against is None else against))


def _cells(body, beams, spread) -> Cells:
    radius = spread.radius
    low, high = body.vertices.min(axis=0) - radius, body.vertices.max(axis=0) + radius
    # beyond light is left out as on lines of sight; of lengths some have no end
    length = np.minimum(beams.length, np.minimum(_beams.DEEP / body.medium.sigma_t.min(), 2 * np.linalg.norm(high - low)))
    return cells_of(low, high, float((high - low).max()) / _CELLS, _beams.entered, beams.ray, length, 1.000001 * radius)


def _cells_of_points(body, points, disc) -> Cells:
    low, high = body.vertices.min(axis=0) - disc.radius, body.vertices.max(axis=0) + disc.radius
    edge = max(float((high - low).max()) / _CELLS, disc.radius)
    return cells_of(low, high, edge, _points.entered, points.ray, 1.000001 * disc.radius)
