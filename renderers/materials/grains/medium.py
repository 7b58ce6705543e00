"""Paths in the continuous medium that stands for grains, in their mesh, whose boundary is none to light."""

from functools import cache, partial

import numpy as np

from bakery import kernels
from renderers.materials.grains import _medium
from renderers.materials.grains._entries import Boundary
from renderers.materials.grains._paths import Event, Walk
from renderers.materials.grains.paths import TOGETHER, less_often, streams_of
from renderers.threads import run
from renderers.transport.scattering import Points, next_event


class Continuous:
    """As `paths.Explicit`, among scatterings of a medium.

    medium : `_medium.Medium`;  occupied, colours : as in `paths.Explicit`
    varied : `bakery.kernels.Varied` of a medium of which there is more in some places than in others
    met_by : the same of all light that its grains meet, if they let some of it pass
    diffuse : whether light far inside, after its second scattering, diffuses (`bakery.physics.granular.diffusion`); in a medium
        that varies it does not
    """

    def __init__(self, medium, occupied, colours, diffuse=False, varied=None, met_by=None):
        self.medium, self.occupied, self.colours, self.boundary = medium, occupied, colours, Boundary.around(medium)
        self.varied = varied or kernels.unvaried_medium()
        self.met_by = met_by or self.varied
        self.diffuse = kernels.never_diffuse(medium.sigma_t)
        if diffuse and not self.varies:
            self.diffuse = kernels.diffuse_in_mesh(medium.aggregate, medium.sigma_t, medium.albedo, medium.v, medium.phase,
                                                   occupied)
        self._with_share = cache(partial(less_often, medium))

    @property
    def varies(self):
        """Whether there is more of the medium in some places than in others."""
        return self.varied.most > 0.0

    def sample_lights(self, share):
        """As `paths.Explicit.sample_lights`."""
        self.medium = self._with_share(share)

    @property
    def content(self):
        """What loops take of it."""
        return _medium.Content(self.medium, self.varied, self.diffuse)

    def advance(self, paths):
        """As `paths.Explicit.advance`; the kinds of events are components that scatter, or `scattering.DIFFUSE`."""
        event = Event.empty(paths.count)
        run(_medium.advance, paths.count, self.content, self.occupied, paths.part(Walk), paths.technique, event, block=TOGETHER)
        return event

    def next_event(self, paths, event, sample, added):
        """What light samples send by way of scatterings, added (n, 3)."""
        n, walk = paths.count, paths.part(Walk)
        chance, passed = np.empty(n), np.empty(paths.throughput.shape)
        towards = np.asarray(sample.direction, float)  # of Mitsuba single: one kernel for these and for `transmittance`
        far = np.where((sample.radiance > 0).any(axis=1), sample.distance, 0.0)  # no random numbers for what brings no light
        run(_medium.chances, n, self.medium, event, paths.origin, chance)
        run(_medium.transmit, n, self.content, paths.states, paths.origin, towards, far, passed)
        run(next_event, n, self.medium, self.colours, walk, Points(event.kind, chance), sample, passed, added)

    def scatter(self, paths, event):
        """Turns paths at scatterings; event.alive becomes whether they go on."""
        paths.single[:] = False
        run(_medium.scatter, paths.count, self.medium, paths.part(Walk), event)

    def transmittance(self, point, direction, distance, share):
        """Share (n, L) of light that gets from points along directions to a distance; the same for the same way."""
        streams = streams_of(point, direction, distance)
        run(_medium.transmit, len(point), self.content, streams, point, direction, distance, share)

    def entry(self, point, direction, far, inside=True):
        """Distances (n,) m to where rays come into the mesh before far (n,) m, inf where they do not; `inside`: 0 for those that
        start in it."""
        return self.boundary.entries(point, direction, far, inside)[0]

    def seen(self, point, direction, far):
        """As `paths.Explicit.seen`, of the mesh."""
        return self.boundary.entries(point, direction, far, True)

    def arrive(self, paths):
        """Makes scatterings of the grains that paths have met: their events, LIGHT, TURNS or PASSES."""
        event = Event.empty(paths.count)
        run(_medium.arrive, paths.count, self.medium, self.met_by, paths.part(Walk), event)
        return event
