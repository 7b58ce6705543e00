"""Bodies whose boundary is a surface far from the camera: paths that come from outside are turned there, and do not go in.

At each meeting from outside a path is turned by the surface's BSDF with a chance that the distance of that point to the camera
alone gives, 0 up to `near` and 1 from twice that on, and else goes on as without the surface.  So the radiance that leaves a
point is that of the surface times this chance and that of the body times the rest.  Inside of the body there are no surfaces:
light that came in near may leave far off, through a boundary that lets it out everywhere.  In even light nothing is lost or
gained.  Rays towards lights that go into a body are let in by the same chance.

Were the boundary opaque from inside, too, light would be caught in there that leaves the body itself.
"""

from typing import NamedTuple

import drjit as dr

import renderers.mitsuba  # noqa: F401  before mitsuba: it finds LLVM

import mitsuba as mi  # isort: skip

_NEVER = 1e30  # distance that no point has
_LEAST = 1e-30


class Far(NamedTuple):
    """A body far from the camera.

    bsdf : of Mitsuba, which lets nothing through
    near : m, distance to the camera up to which paths go into the body; from twice that on none does
    """

    bsdf: object
    near: float


def chance(distance, near, library=dr):
    """Of points at a distance to the camera: that a path is turned by the surface; smooth in the logarithm of the distance.

    library : `drjit`, or `numpy` for its arrays
    """
    step = library.clip(library.log2(distance / near), 0, 1)
    return step * step * (3 - 2 * step)


class FarSurfaces:
    """The surfaces of bodies far from the camera."""

    def __init__(self, boundaries, bodies, camera, unit):
        """
        boundaries : `boundaries.Boundaries`
        bodies : `Far` of each medium, None of those without
        camera : where it stands
        unit : m, length of 1 in the Mitsuba scene
        """
        self._boundaries, self._camera = boundaries, camera
        self._kept = [body.bsdf for body in bodies if body is not None]  # as long as pointers to them
        self._near = mi.Float([_NEVER if body is None else max(body.near / unit, _LEAST) for body in bodies])
        self._bsdf = mi.BSDFPtr([self._kept[0] if body is None else body.bsdf for body in bodies])

    def chance(self, surface, direction, active):
        """That rays of directions which meet surfaces are turned there; 0 of those that leave bodies, and of other surfaces."""
        enters = active & self._boundaries.is_body(surface.shape) & (dr.dot(surface.n, direction) < 0)
        near = dr.gather(mi.Float, self._near, self._boundaries.medium(surface.shape), enters)
        return dr.select(enters, chance(dr.norm(surface.p - self._camera), near), 0)

    def depth(self, surface, direction, active):
        """What surfaces leave of light along rays that go into what they meet, as optical depth."""
        return -dr.log(1 - self.chance(surface, direction, active))

    @staticmethod
    def outside(event, direction, value):
        """Values of surfaces, without those of directions that would go into the body: shading normals are not the triangles'."""
        return dr.select(event.opaque & (dr.dot(event.surface.n, direction) <= 0), 0, value)

    def bsdf(self, event):
        """Of what paths have come to, `state.Event`."""
        number = self._boundaries.medium(event.surface.shape)
        return dr.select(event.opaque, dr.gather(mi.BSDFPtr, self._bsdf, number, event.opaque), event.surface.bsdf())
