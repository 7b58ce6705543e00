"""Paths in the continuous medium that stands for grains, in their mesh, whose boundary is none to light."""

from __future__ import annotations

import numpy as np

from bakery import kernels
from renderers.granular import _medium
from renderers.granular.paths import Seldom, streams_of
from renderers.threads import run


class Continuous:
    """As `paths.Explicit`, among scatterings of a medium.

    medium : `_medium.Medium`;  occupied, colours : as in `paths.Explicit`
    varied : `bakery.kernels.Varied` of a medium of which there is more in some places than in others
    met_by : the same of all light that its grains meet, if they let some of it pass
    diffuse : whether light far inside, after its second scattering, diffuses (`bakery.physics.granular.diffusion`); in a medium
        that varies it does not
    """

    def __init__(self, medium, occupied, colours, diffuse=False, varied=None, met_by=None):
        self.medium, self.occupied, self.colours = medium, occupied, colours
        self.varied = varied or kernels.unvaried_medium()
        self.met_by = met_by or self.varied
        self.diffuse = kernels.never_diffuse(medium.sigma_t)
        if diffuse and not self.varies:
            self.diffuse = kernels.diffuse_in_mesh(medium.aggregate, medium.sigma_t, medium.albedo, medium.v, medium.phase,
                                                   occupied)
        self._seldom = Seldom(medium)

    @property
    def varies(self):
        """Whether there is more of the medium in some places than in others."""
        return self.varied.most > 0.0

    def sample_lights(self, share):
        """As `paths.Explicit.sample_lights`."""
        self.medium = self._seldom.by(share)

    def advance(self, paths):
        """As `paths.Explicit.advance`; found is, of each that needs LIGHT, the component that scatters, or `_medium.DIFFUSE`."""
        n = len(paths)
        kind, status, alive = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, bool)
        run(_medium.advance, n, self.medium, self.varied, self.diffuse, self.occupied, paths.origin, paths.direction,
            paths.weight, paths.states, paths.met, paths.place, paths.far, paths.density, paths.order, paths.bounces,
            paths.single, paths.technique, kind, status, alive)
        return status, (kind,)

    def lit(self, paths, found, sample, added):
        """What light samples send by way of scatterings, added (n, 3)."""
        run(_medium.light, len(paths), self.medium, self.varied, self.colours, paths.origin, paths.direction, paths.weight,
            paths.states, *found, *sample[:5], added)

    def scattered(self, paths, found, alive):
        """Turns paths at scatterings; alive (n,) becomes whether they go on."""
        paths.single[:] = False
        run(_medium.scatter, len(paths), self.medium, paths.origin, paths.direction, paths.weight, paths.states, paths.bounces,
            *found, paths.density, alive)

    def open(self, point, direction, distance, share):
        """Share (n, L) of light that gets from points along directions to a distance; the same for the same way."""
        streams = streams_of(point, direction, distance)
        run(_medium.open_share, len(point), self.medium, self.varied, streams, point, direction, distance, share)

    def entry(self, point, direction, far, inside=True):
        """Distances (n,) m to where rays come into the mesh before far (n,) m, inf where they do not; `inside`: 0 for those that
        start in it."""
        t = np.empty(len(point))
        run(_medium.entry, len(point), self.medium, point, direction, far, inside, t)
        return t

    def arrive(self, paths):
        """Makes scatterings of the grains that paths have met: what they do (n,), LIGHT, TURNS or PASSES, and what was found."""
        status, kind = np.empty(len(paths), np.int64), np.empty(len(paths), np.int64)
        run(_medium.arrive, len(paths), self.medium, self.met_by, paths.origin, paths.weight, paths.states, paths.met,
            paths.place, paths.far, paths.order, paths.bounces, paths.single, kind, status)
        return status, (kind,)
