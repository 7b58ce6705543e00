"""Packed grains, each by itself: they stick out of their region, and hide light wherever they are seen."""

import numpy as np

from renderers.materials.grains import _paths
from renderers.materials.grains._grains import UNKNOWN
from renderers.materials.grains.paths import NEVER, TOGETHER, Explicit, first_grain, first_surface
from renderers.threads import run
from renderers.transport.paths import ENDED, EVENT, REACHED

AGAIN = -1  # a path is on a grain, and what is ahead of it is not known


class Grains(Explicit):
    """Explicit grains of one mesh, where a scene has several materials.

    number : among the materials;  others : as of `Explicit`
    """

    solid, walks, sampled = True, False, True

    def __init__(self, number, grains, occupied, colours):
        super().__init__(grains, occupied, colours)
        self.number = number

    def light_chance(self, share):
        """The loop over grains itself draws where lights are sampled."""
        self.sample_lights(share)
        return 1.0

    def advance(self, paths, stop):
        """Between grains nothing is in the way."""
        return np.full(paths.count, REACHED), ()

    def transmittance(self, states, origin, direction, distance, left_out, share):
        pass

    def look(self, paths):
        """Distances (n,) m to the next grain before the first surface of the scene, inf where there is none, and whether paths
        are inside of a grain (n,)."""
        on_grain, far = paths.grains == self.number, np.where(np.isnan(paths.far), np.inf, paths.far)
        sphere, triangle = np.where(on_grain[:, None], paths.sphere, UNKNOWN), np.where(on_grain, paths.triangle, -1)
        distance, normal = first_surface(self.grains, paths.origin, paths.direction, far, sphere, triangle)
        return distance, np.einsum("nk,nk->n", paths.direction, normal) > 0.0

    def hides(self, origin, direction, distance, share):
        """Makes shares (n, L) of light 0 where a grain is within distances (n,) m."""
        share[first_grain(self.grains, origin, direction, distance) < np.inf] = 0.0

    def enter(self, paths, far):
        """Takes paths from grain to grain; far (n,) m, to the first surface of the scene of those inside of a grain, else inf.

        Returns what they have come to (n,), EVENT, ENDED, AGAIN, or REACHED a surface in a grain, and normals and types of grain.
        """
        n = paths.count
        elsewhere = paths.grains != self.number
        paths.sphere[elsewhere], paths.triangle[elsewhere], paths.grains[:] = UNKNOWN, -1, self.number
        event, never = _paths.Event.empty(n), _paths.Switching(np.empty((n, 3)), np.full(n, NEVER), np.zeros(n, bool))
        walk = paths.part(_paths.Walk)._replace(far=far)
        run(_paths.advance, n, self.grains, self.occupied, walk, never, event, block=TOGETHER)
        turned = np.isnan(far)
        paths.far[turned], paths.left_out[turned], paths.shaded[turned] = np.nan, np.nan, False
        paths.drawn[turned] = paths.origin[turned]
        status = np.where(event.status == _paths.LIGHT, EVENT, np.where(event.status == _paths.DEAD, ENDED, AGAIN))
        status[(event.status == _paths.LEAVES) & ~turned] = REACHED
        return status, tuple(event)

    def next_event(self, paths, event, sample, passed, clear, added):
        """clear : (n,) m, up to which grains of this region are looked for here"""
        lighted = paths._replace(throughput=paths.throughput * passed)
        super().next_event(lighted, _paths.Event(*event), sample._replace(distance=clear), added)

    def scatter(self, paths, event):
        event = _paths.Event(*event)
        super().scatter(paths, event)
        paths.throughput[~event.alive] = 0.0
