"""Separate particles: discs that stop rays."""

import numpy as np

from bakery.kernels import NO_DISC
from renderers.materials.particles import _transport
from renderers.materials.particles._transport import Guide, Walk, Ways
from renderers.materials.particles.box import absorb
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
        run(_transport.collide, n, self.medium, paths.part(Walk), stop, np.full(n, np.inf), kind, distance, centre)
        stopped = np.flatnonzero(kind != NO_DISC)
        length = np.minimum(stop, FAR)
        length[stopped] = distance[stopped]
        absorb(self.medium, paths, length)
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
        everywhere = np.full(len(share), np.inf)
        run(_transport.transmit, len(share), self.medium, Ways(states, origin, direction, distance, everywhere, left_out), share)

    def next_event(self, paths, event, sample, passed, clear, added):
        walk, scatterer = paths.part(Walk), self.medium.scatterer
        run(_transport.light, paths.count, scatterer, *event, walk, _no_guide(paths), passed, sample, added)

    def scatter(self, paths, event):
        run(_transport.scatter, paths.count, self.medium.scatterer, *event, paths.part(Walk), _no_guide(paths))


def seen_particle(medium, origin, direction, far):
    """Distances (n,) m from points along directions to the first particle before far (n,) m, inf: none, at the first wavelength;
    normals (n, 3) that face the point, as a disc is as bright everywhere, 0 where there is none; radii (n,) m of the discs."""
    n, waves = len(origin), medium.discs.square.shape[1]
    kind, distance, centre = np.empty(n, np.int64), np.empty(n), np.empty((n, 3))
    throughput = np.zeros((n, waves))
    throughput[:, 0] = 1.0  # of one wavelength: no random number says which of them a disc stops
    rays = Walk(origin, direction, throughput, np.zeros(n, np.uint64), np.full((n, 3), np.nan), np.zeros(n))
    run(_transport.collide, n, medium, rays, far, np.full(n, np.inf), kind, distance, centre)
    stopped = kind != NO_DISC
    radius = np.where(stopped, np.sqrt(medium.discs.square[kind, 0]), 0.0)
    return np.where(stopped, distance, np.inf), np.where(stopped[:, None], -direction, 0.0), radius


def _no_guide(paths):
    return Guide(paths.direction, np.zeros(paths.count, bool))
