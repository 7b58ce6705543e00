"""Paths in the continuous medium that stands for grains, in their mesh, whose boundary is none to light."""

from __future__ import annotations

import numpy as np

from renderers.granular import _medium
from renderers.granular.paths import Seldom
from renderers.threads import run


class Continuous:
    """As `paths.Explicit`, among scatterings of a medium.

    medium : `_medium.Medium`;  occupied, colours : as in `paths.Explicit`
    """

    def __init__(self, medium, occupied, colours):
        self.medium, self.occupied, self.colours = medium, occupied, colours
        self._seldom = Seldom(medium)

    def sample_lights(self, share):
        """As `paths.Explicit.sample_lights`."""
        self.medium = self._seldom.by(share)

    def advance(self, paths):
        """As `paths.Explicit.advance`; nothing is found besides."""
        n = len(paths)
        status, alive = np.empty(n, np.int64), np.empty(n, bool)
        run(_medium.advance, n, self.medium, self.occupied, paths.origin, paths.direction, paths.weight, paths.states, paths.met,
            paths.place, paths.far, paths.density, paths.order, paths.bounces, paths.single, status, alive)
        return status, ()

    def lit(self, paths, found, sample, added):
        """What light samples send by way of scatterings, added (n, 3)."""
        run(_medium.light, len(paths), self.medium, self.colours, paths.origin, paths.direction, paths.weight, *sample[:5], added)

    def scattered(self, paths, found, alive):
        """Turns paths at scatterings; alive (n,) becomes whether they go on."""
        paths.single[:] = False
        run(_medium.scatter, len(paths), self.medium, paths.origin, paths.direction, paths.weight, paths.states, paths.bounces,
            paths.density, alive)

    def open(self, point, direction, distance, share):
        """Share (n, L) of light that gets from points along directions to a distance."""
        run(_medium.open_share, len(point), self.medium, point, direction, distance, share)

    def entry(self, point, direction, far, inside=True):
        """Distances (n,) m to where rays come into the mesh before far (n,) m, inf where they do not; `inside`: 0 for those that
        start in it."""
        t = np.empty(len(point))
        run(_medium.entry, len(point), self.medium, point, direction, far, inside, t)
        return t

    def arrive(self, paths):
        """Makes scatterings of what paths have met: which of them (n,) sample a light there."""
        samples = np.empty(len(paths), bool)
        run(_medium.arrive, len(paths), self.medium, paths.origin, paths.states, paths.met, paths.place, paths.far, paths.order,
            paths.bounces, paths.single, samples)
        return samples
