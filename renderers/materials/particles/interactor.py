"""Separate particles: discs that stop rays."""

from __future__ import annotations

import math

import numpy as np

from bakery.kernels import NO_DISC, lent, mesh_scratch
from bakery.system.compiled import njit
from renderers.materials.particles import _transport
from renderers.materials.particles._transport import Events, Guide
from renderers.mitsuba.world import FAR
from renderers.threads import run
from renderers.transport.paths import EVENT, REACHED


class Particles:
    """Discs of all classes.

    medium : `renderers.materials.particles.medium.Medium`
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
        run(_transport.collide, n, self.medium, paths, stop, np.full(n, np.inf), kind, distance, centre)
        stopped = np.flatnonzero(kind != NO_DISC)
        length = np.minimum(stop, FAR)
        length[stopped] = distance[stopped]
        run(_transport.absorb, n, self.medium, paths, length)
        point = centre[stopped]
        if self._holds is not None and len(stopped):
            # a disc that reaches out of another material stops the ray where the ray is
            apart = np.flatnonzero(~self._holds(point, paths.direction[stopped]))
            at = stopped[apart]
            point[apart] = paths.origin[at] + distance[at, None] * paths.direction[at]
        paths.origin[stopped], paths.left_out[stopped] = point, centre[stopped]
        paths.order[stopped] += 1
        paths.bounces[stopped] += 1
        return np.where(kind != NO_DISC, EVENT, REACHED), (kind,)

    def transmittance(self, states, origin, direction, distance, left_out, share):
        run(transmit, len(share), self.medium, states, origin, direction, distance, left_out, share)

    def next_event(self, paths, event, sample, passed, clear, added):
        n = paths.count
        # a distance of 0: what is on the way is known already
        run(_transport.light, n, self.medium, Events(*event, paths.origin, np.full(n, np.inf)), paths, _no_guide(paths), passed,
            sample._replace(distance=np.zeros(n)), added)

    def scatter(self, paths, event):
        run(_transport.scatter, paths.count, self.medium, *event, paths, _no_guide(paths))


def _no_guide(paths):
    return Guide(paths.direction, np.zeros(paths.count, bool))


@njit(cache=True, nogil=True, error_model="numpy")
def transmit(medium, states, origin, direction, distance, left_out, share, begin, end):
    """Multiplies share (n, L) by 0 or 1, what discs leave of light on ways (n,) m, and by what their host absorbs."""
    medium = lent(medium)
    mesh_room, waves = mesh_scratch(), share.shape[1]
    passed, scratch = np.empty(waves), (np.empty(waves, np.uint8), mesh_room)
    for i in range(begin, end):
        ray, particle = _transport.ray_of(origin, direction, i), (left_out[i, 0], left_out[i, 1], left_out[i, 2])
        _transport.transmit(medium, ray, distance[i], math.inf, particle, states, i, passed, scratch)
        for w in range(waves):
            share[i, w] *= passed[w]
