"""Translucent bodies: a medium inside of a shape of the scene, through which compiled loops take paths up to its boundary."""

import numpy as np

from renderers.materials.bodies import _walk, shells
from renderers.materials.bodies.paths import UNLIMITED
from renderers.materials.medium.interactor import Medium
from renderers.threads import run
from renderers.transport.paths import ENDED, EVENT, REACHED


class Body(Medium):
    """A body in which there is nothing but other such bodies and meshes of the scene; parameters beyond those of a `Medium`:

    geometry : `renderers.materials.bodies._geometry.Geometry` of the bodies, by whose triangles paths go;  blind : of each of
        them, whether light does not see its boundary
    """

    walks = True

    def __init__(self, scatterer, colours, geometry, blind, sampled):
        super().__init__(scatterer, colours, sampled=sampled)
        self._geometry, self._blind = geometry, np.asarray(blind, bool)
        self._limits = _walk.Limits(shells.none(len(scatterer.sigma_t)), UNLIMITED, sampled)

    def walk(self, paths):
        """As `advance`, up to the boundary or a surface in the body: also distances to that (n,) m, and whether it is blind."""
        n, status = paths.count, np.empty(paths.count, np.int64)
        its = paths._replace(far=np.full(n, np.nan), triangle=np.zeros(n, np.int64), start=np.full(n, -1),
                             events=np.zeros(n, np.int64), scattered=np.zeros(n, bool)).part(_walk.Walk)
        run(_walk.advance, n, self._geometry, self.scatterer, self._limits, its, status)
        paths.shaded[its.scattered], paths.left_out[its.scattered] = not self.sampled, np.nan
        owner = self._geometry.owner[np.maximum(its.triangle, 0)]  # -1 where paths are lost
        status = np.choose(status, [REACHED, EVENT, ENDED])  # CONTACT, EVENT, DEAD
        return status, (), its.far, (owner >= 0) & self._blind[np.maximum(owner, 0)]
