"""Separate particles: discs that stop rays."""

from __future__ import annotations

import math

import numpy as np

from bakery.kernels import NO_DISC, lent, mesh_scratch
from bakery.system.compiled import njit
from renderers.discrete import _transport
from renderers.mitsuba.world import FAR
from renderers.threads import run
from renderers.transport.paths import EVENT, REACHED


class Particles:
    """Discs of all classes.

    medium : `renderers.discrete.medium.Medium`
    holds : function of (points (n, 3), directions (n, 3)) -> (n,) whether the particles are the innermost material there; None
        where no material is in theirs
    """

    solid, walks, sampled = False, False, True

    def __init__(self, medium, holds=None):
        self.medium, self._holds = medium, holds

    def light_chance(self, share):
        return share

    def advance(self, paths, stop):
        n = paths.count
        kind, distance, centre = np.empty(n, np.int64), np.empty(n), np.empty((n, 3))
        run(_transport.collide, n, self.medium, paths.origin, paths.direction, stop, np.full(n, np.inf), paths.left_out,
            paths.throughput, paths.states, kind, distance, centre)
        met = np.flatnonzero(kind != NO_DISC)
        length = np.minimum(stop, FAR)
        length[met] = distance[met]
        run(_transport.absorb, n, self.medium, paths.origin, paths.direction, length, paths.throughput)
        place = centre[met]
        if self._holds is not None and len(met):
            # a disc that reaches out of another material stops the ray where the ray is
            apart = np.flatnonzero(~self._holds(place, paths.direction[met]))
            at = met[apart]
            place[apart] = paths.origin[at] + distance[at, None] * paths.direction[at]
        paths.origin[met], paths.left_out[met] = place, centre[met]
        paths.order[met] += 1
        paths.bounces[met] += 1
        return np.where(kind != NO_DISC, EVENT, REACHED), (kind,)

    def transmittance(self, states, origin, direction, distance, left_out, share):
        run(transmit, len(share), self.medium, states, origin, direction, distance, left_out, share)

    def next_event(self, paths, event, sample, passed, clear, added):
        n = paths.count
        # a distance of 0: what is on the way is known already
        run(_transport.light, n, self.medium, *event, paths.origin, paths.direction, paths.throughput, paths.states,
            np.full(n, np.inf), paths.order, paths.direction, np.zeros(n, bool), passed, sample.direction, np.zeros(n),
            *sample[2:], added)

    def scatter(self, paths, event):
        run(_transport.scatter, paths.count, self.medium, *event, paths.direction, paths.throughput, paths.states,
            paths.direction, np.zeros(paths.count, bool), paths.density)


@njit(cache=True, nogil=True, error_model="numpy")
def transmit(medium, states, origin, direction, distance, left_out, share, begin, end):
    """Multiplies share (n, L) by 0 or 1, what discs leave of light on ways (n,) m, and by what their host absorbs."""
    medium = lent(medium)
    room, waves = mesh_scratch(), share.shape[1]
    passed, clear = np.empty(waves), np.empty(waves, np.uint8)
    for i in range(begin, end):
        _transport.transmit(medium, origin[i, 0], origin[i, 1], origin[i, 2], direction[i, 0], direction[i, 1], direction[i, 2],
                            distance[i], math.inf, left_out[i, 0], left_out[i, 1], left_out[i, 2], states, i, passed, clear,
                            room)
        for w in range(waves):
            share[i, w] *= passed[w]
