"""Translucent bodies: a medium inside of a shape of the scene, through which compiled loops take paths up to its boundary."""

from __future__ import annotations

import numpy as np

from renderers.materials.bodies import _walk, shells
from renderers.materials.medium.interactor import Medium
from renderers.threads import run
from renderers.transport.paths import ENDED, EVENT, REACHED

_UNLIMITED = 1 << 40  # events between two surfaces


class Body(Medium):
    """A body in which there is nothing but other such bodies and meshes of the scene; parameters beyond those of a `Medium`:

    geometry : `renderers.materials.bodies._geometry.Geometry` of the bodies, by whose triangles paths go;  blind : of each of
        them, whether light does not see its boundary
    """

    walks = True

    def __init__(self, scatterer, colours, geometry, blind, sampled):
        super().__init__(scatterer, colours, sampled=sampled)
        self._geometry, self._blind = geometry, np.asarray(blind, bool)
        self._shells = shells.none(len(scatterer.sigma_t))

    def walk(self, paths):
        """As `advance`, up to the boundary or a surface in the body: also distances to that (n,) m, and whether it is blind."""
        n, before = paths.count, paths.bounces.copy()
        far, triangle, start, status = np.full(n, np.nan), np.zeros(n, np.int64), np.full(n, -1), np.empty(n, np.int64)
        events, alive = np.zeros(n, np.int64), np.empty(n, bool)
        run(_walk.advance, n, self._geometry, self.scatterer, self._shells, _UNLIMITED, self.sampled, paths.origin,
            paths.direction, paths.throughput, paths.states, far, triangle, start, paths.drawn, paths.density, paths.single,
            events, paths.bounces, status, alive)
        paths.order[:] += paths.bounces - before
        paths.shaded[events > 0], paths.left_out[events > 0] = False, np.nan
        owner = self._geometry.owner[np.maximum(triangle, 0)]  # -1 where paths are lost
        status = np.choose(status, [REACHED, EVENT, ENDED])  # CONTACT, EVENT, DEAD
        return status, (), far, (owner >= 0) & self._blind[np.maximum(owner, 0)]
