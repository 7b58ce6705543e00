"""Packed grains, each by itself: they stick out of their region, and hide light wherever they are seen."""

from __future__ import annotations

import math

import numpy as np

from bakery.kernels import lent
from bakery.system.compiled import njit
from renderers.materials.grains import _paths
from renderers.materials.grains._grains import UNKNOWN, next_surface, scratch
from renderers.materials.grains.paths import NEVER, Seldom
from renderers.threads import run
from renderers.transport.paths import ENDED, EVENT, REACHED

AGAIN = -1  # a path is on a grain, and what is ahead of it is not known


class Grains:
    """Explicit grains of one mesh.

    number : among the materials
    grains : `renderers.materials.grains._grains.Grains`
    occupied : (X, Y, Z) uint8, its voxels with surfaces of the scene, or where other materials may be; empty where there are none
    colours : to_rgb (3, L), to_waves (L, 3)
    """

    solid, walks, sampled = True, False, True

    def __init__(self, number, grains, occupied, colours):
        self.number, self.grains, self.occupied, self.colours = number, grains, occupied, colours
        self._seldom = Seldom(grains)

    def light_chance(self, share):
        """The loop over grains itself draws where lights are sampled."""
        self.grains = self._seldom.by(share)
        return 1.0

    def advance(self, paths, stop):
        """Between grains nothing is in the way."""
        return np.full(paths.count, REACHED), ()

    def transmittance(self, states, origin, direction, distance, left_out, share):
        pass

    def look(self, paths):
        """Distances (n,) m to the next grain before the first surface of the scene, inf where there is none, and whether paths
        are inside of a grain (n,)."""
        distance, within = np.empty(paths.count), np.empty(paths.count, bool)
        run(look, paths.count, self.grains, self.number, paths, distance, within)
        return distance, within

    def hides(self, origin, direction, distance, share):
        """Makes shares (n, L) of light 0 where a grain is within distances (n,) m."""
        first = np.empty(len(share))
        run(_paths.first_grain, len(share), self.grains, origin, direction, distance, first, np.empty((0, 3)))
        share[first < np.inf] = 0.0

    def enter(self, paths, far):
        """Takes paths from grain to grain; far (n,) m, to the first surface of the scene of those inside of a grain, else inf.

        Returns what they have come to (n,), EVENT, ENDED, AGAIN, or REACHED a surface in a grain, and normals and types of grain.
        """
        n = paths.count
        elsewhere = paths.grains != self.number
        paths.sphere[elsewhere], paths.triangle[elsewhere], paths.grains[:] = UNKNOWN, -1, self.number
        event, never = _paths.Event.empty(n), _paths.Switching(np.empty((n, 3)), np.full(n, NEVER), np.zeros(n, bool))
        run(_paths.advance, n, self.grains, self.occupied, _paths.Walk.of(paths)._replace(far=far), never, event)
        turned = np.isnan(far)
        paths.far[turned], paths.left_out[turned], paths.shaded[turned] = np.nan, np.nan, False
        paths.drawn[turned] = paths.origin[turned]
        status = np.where(event.status == _paths.LIGHT, EVENT, np.where(event.status == _paths.DEAD, ENDED, AGAIN))
        status[(event.status == _paths.LEAVES) & ~turned] = REACHED
        return status, tuple(event)

    def next_event(self, paths, event, sample, passed, clear, added):
        """clear : (n,) m, up to which grains of this region are looked for here"""
        walk, sample = _paths.Walk.of(paths)._replace(throughput=paths.throughput * passed), sample._replace(distance=clear)
        run(_paths.next_event, paths.count, self.grains, self.colours, walk, _paths.Event(*event), sample, added)

    def scatter(self, paths, event):
        event = _paths.Event(*event)
        run(_paths.scatter, paths.count, self.grains, _paths.Walk.of(paths), event)
        paths.throughput[~event.alive] = 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def look(grains, number, paths, distance, within, begin, end):
    """Distances (n,) m to the next grain before the first surface, and whether paths are inside of one; see `Grains.look`."""
    grains, paths = lent(grains), lent(paths)
    memory, p, d, n = scratch(), np.empty(3), np.empty(3), np.empty(3)
    sphere, at = np.empty(4, np.int64), np.empty(2, np.int64)
    for i in range(begin, end):
        for k in range(3):
            p[k], d[k] = paths.origin[i, k] / grains.unit, paths.direction[i, k]
        sphere[0], at[0] = UNKNOWN, -1
        if paths.grains[i] == number:
            for k in range(4):
                sphere[k] = paths.sphere[i, k]
            at[0] = paths.triangle[i]
        far = math.inf if math.isnan(paths.far[i]) else paths.far[i] / grains.unit
        distance[i] = next_surface(grains, p, d, far, sphere, at, n, memory) * grains.unit
        within[i] = at[0] >= 0 and d[0] * n[0] + d[1] * n[1] + d[2] * n[2] > 0.0
