"""Paths in the continuous medium that stands for grains, in their mesh, whose boundary is none to light."""

from __future__ import annotations

import numpy as np

from bakery import kernels
from renderers.granular import _medium
from renderers.granular.paths import Seldom
from renderers.threads import run


class Continuous:
    """As `paths.Explicit`, among scatterings of a medium.

    medium : `_medium.Medium`;  occupied, colours : as in `paths.Explicit`
    diffuse : whether light far inside, after its second scattering, diffuses (`bakery.physics.granular.diffusion`)
    """

    def __init__(self, medium, occupied, colours, diffuse=False):
        self.medium, self.occupied, self.colours = medium, occupied, colours
        self.diffuse = kernels.never_diffuse(medium.sigma_t)
        if diffuse:
            self.diffuse = kernels.diffuse_in_mesh(medium.aggregate, medium.sigma_t, medium.albedo, medium.v, medium.phase,
                                                   occupied)
        self._seldom = Seldom(medium)

    def sample_lights(self, share):
        """As `paths.Explicit.sample_lights`."""
        self.medium = self._seldom.by(share)

    def advance(self, paths):
        """As `paths.Explicit.advance`; found is, of each that needs LIGHT, `_medium.SCATTERED` or `_medium.DIFFUSE`."""
        n = len(paths)
        kind, status, alive = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, bool)
        run(_medium.advance, n, self.medium, self.diffuse, self.occupied, paths.origin, paths.direction, paths.weight,
            paths.states, paths.met, paths.place, paths.far, paths.density, paths.order, paths.bounces, paths.single,
            paths.technique, kind, status, alive)
        return status, (kind,)

    def lit(self, paths, found, sample, added):
        """What light samples send by way of scatterings, added (n, 3)."""
        run(_medium.light, len(paths), self.medium, self.colours, paths.origin, paths.direction, paths.weight, *found,
            *sample[:5], added)

    def scattered(self, paths, found, alive):
        """Turns paths at scatterings; alive (n,) becomes whether they go on."""
        paths.single[:] = False
        run(_medium.scatter, len(paths), self.medium, paths.origin, paths.direction, paths.weight, paths.states, paths.bounces,
            *found, paths.density, alive)

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
        """Makes scatterings of what paths have met: which of them (n,) sample a light there, and what was found."""
        samples = np.empty(len(paths), bool)
        run(_medium.arrive, len(paths), self.medium, paths.origin, paths.states, paths.met, paths.place, paths.far, paths.order,
            paths.bounces, paths.single, samples)
        return samples, (np.full(len(paths), _medium.SCATTERED),)
