"""Light samples of lamps through smooth boundaries of bodies (manifold next-event estimation).

A scattering in a body draws a point on a lamp, and `manifold` the place on the boundary where its light is refracted towards the
scattering; where there are panes, `refractions` the way through these and the boundary.  A path that went that way by chance
would have been found so if the walk from its scattering to the point of the lamp ends where it came through: then both share by
the balance heuristic of their densities, else it counts alone.  So nothing is lost where walks end nowhere, or at one of several
places.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import drjit as dr
import numpy as np

import renderers.mitsuba  # noqa: F401  before mitsuba: it finds LLVM
from renderers.transport import flights, media, solid_angles
from renderers.transport.distances import Distances
from renderers.transport.manifold import Manifold, numbered, refracts
from renderers.transport.refractions import Refractions

import mitsuba as mi  # isort: skip

# a lamp is looked for with exp(-s) times this and the phase function, at most 1, s mean free paths from where the straight way to
# it leaves the body.  Variance times time of all light, 0.5 and 2 over 1: 1.00 and 1.11 (glass of milk), 0.99 and 1.02 (candle),
# 0.96 and 1.05 (head), 0.94 and 1.03 (bumpy ball); without the phase function 1.1 in the glass of milk
_SURE = 1.0
_EVEN = 0.1  # in place of so much of the phase function: light comes in by another direction than the straight one
_SHORT = 1e-3  # of the distance to a lamp: the ray that meets it begins so far before the point


@dataclass
class Departure:
    """Of paths, their last scattering in a body from which lamps are drawn.

    event : where;  before : direction of the path there;  medium : the body's
    density : 1/sr, of the direction from there; 0 where no light sample could take its place
    turned : whether a surface has turned the path since
    """

    event: mi.Point3f
    before: mi.Vector3f
    medium: mi.UInt32
    density: mi.Float
    turned: mi.Bool


class Lamps:
    """The lamps that are drawn, and boundaries through which they are looked for."""

    def __init__(self, scene, manifold, lamps, sigma, straight, through_panes):
        """
        Parameters
        ----------
        scene : `scene.Scene`;  manifold : `Manifold`
        lamps : how likely each is drawn, by shapes
        sigma : of each medium, the least extinction if its boundary is one of `manifold`, else 0
        straight : whether ways from scatterings to boundaries of `manifold` go through one homogeneous medium
        through_panes : whether lamps are looked for through panes, too
        """
        self._scene, self._manifold, self._straight = scene, manifold, straight
        self._refractions = Refractions(scene.scene, manifold) if through_panes else None
        self._sigma = mi.Float(sigma)
        shapes, shares = list(lamps), np.array(list(lamps.values()))
        areas = [float(np.array(shape.surface_area()).ravel()[0]) for shape in shapes]
        self._from_one = numbered(scene.scene, shapes, 1 + np.arange(len(shapes)))
        self._density = mi.Float((shares / areas).astype(np.float32))
        self._cumulated = [dr.opaque(mi.Float, float(share)) for share in np.cumsum(shares)[:-1]]
        self._shapes = mi.ShapePtr(shapes)
        self._distances = Distances(scene.scene, manifold, shapes)

    @staticmethod
    def none(width):
        """`Departure` of paths that have not scattered."""
        return Departure(dr.zeros(mi.Point3f, width), dr.zeros(mi.Vector3f, width), dr.zeros(mi.UInt32, width),
                         dr.zeros(mi.Float, width), dr.full(mi.Bool, False, width))

    def departed(self, departure, event, before, sample, density):
        """`Departure` of paths that go on from an event, to which they came by directions `before`, by a sample of the BSDF or
        with density (1/sr) of a scattering."""
        shades = event.meets & ~event.crosses
        # through panes only refractions turn what still counts as found by a light sample
        further = ~departure.turned if self._refractions is None else True
        refracted = shades & further & mi.has_flag(sample.sampled_type, mi.BSDFFlags.DeltaTransmission)
        kept = dr.select(shades & ~refracted, 0, departure.density)
        drawn = dr.gather(mi.Float, self._sigma, event.medium) > 0
        begins = dr.select(drawn, density, 0)
        return Departure(dr.select(event.scatters, event.position, departure.event),
                         dr.select(event.scatters, before, departure.before),
                         dr.select(event.scatters, event.medium, departure.medium), dr.select(event.scatters, begins, kept),
                         ~event.scatters & (departure.turned | shades))

    def connected(self, path, event):
        """Light of lamps drawn from scatterings, linear sRGB, their emitters, and which share of light met by chance counts."""
        surface, departure = event.surface, path.departure
        u = [path.random.next_float32() for _ in range(3 + (len(self._cumulated) > 0))]
        lamp_ahead = self._ahead(event)
        arrives = departure.turned & (departure.density > 0) & (lamp_ahead > 0)
        medium = dr.select(arrives, departure.medium, event.medium)
        sigma = dr.gather(mi.Float, self._sigma, medium)
        starts = event.scatters & (sigma > 0)
        lamp = dr.select(arrives, lamp_ahead - 1, self._drawn(u[-1]))
        x = dr.select(arrives, departure.event, event.position)
        distance = self._distances.of(x, lamp, starts | arrives)
        shape = dr.gather(mi.ShapePtr, self._shapes, lamp, starts)
        y = dr.select(arrives, surface.p, shape.sample_position(0.0, mi.Point2f(u[1], u[2]), starts).p)
        before = dr.select(arrives, departure.before, path.direction)
        phase = self._scene.media.phase(medium, 0.5 * dr.squared_norm(dr.normalize(y - x) - before))
        chance = _chance(sigma * distance, media.total(phase) / len(phase))
        starts &= u[0] < chance
        walk = (self._refractions or self._manifold).walk(x, y, starts | arrives)

        def ends(walk):
            bend, through = walk, walk.ends
            if self._refractions is None:
                bend = self._manifold.bend(walk.row, walk.uv, x, y)
                through &= refracts(bend)
            density = chance * dr.gather(mi.Float, self._density, lamp)
            by_chance, by_sample = departure.density * bend.likely(), density / bend.solid_angle(surface.n)
            share = dr.select(arrives & through & bend.is_at(path.drawn), by_chance / (by_chance + by_sample), 1)
            return self._sampled(path, event, shape, density, bend, starts & through, y), share

        def ends_nowhere(walk):
            width = dr.width(walk.ends)
            return [dr.zeros(mi.Float, width) for _ in range(3)], dr.full(mi.Float, 1, width)

        light, share = dr.if_stmt((walk,), walk.ends, ends, ends_nowhere, label="refracted light")
        return light, shape.emitter(), share

    def _ahead(self, event):
        """Lamps that paths meet, from 1; 0 of other surfaces."""
        return dr.gather(mi.UInt32, self._from_one, dr.reinterpret_array(mi.UInt32, event.surface.shape), event.meets)

    def _drawn(self, u):
        lamp = mi.UInt32(0)
        for below in self._cumulated:
            lamp += dr.select(u >= below, mi.UInt32(1), mi.UInt32(0))
        return lamp

    def _sampled(self, path, event, shape, density, bend, active, point):
        """Light of points on lamps, drawn with density (one over the area), through the boundary to scatterings."""
        scene = self._scene
        # met by a ray, as paths meet it: with the normal of its triangle, and what shines there
        ray = mi.Ray3f(point - _SHORT * bend.beyond * bend.outward, bend.outward)
        ray.maxt = 2 * _SHORT * bend.beyond
        surface = scene.scene.ray_intersect(ray, mi.RayFlags.All, False, active)
        active &= surface.is_valid() & (surface.shape == shape)
        radiance = shape.emitter().eval(surface, active)
        active &= dr.any(radiance > 0)
        weights = media.product(path.throughput, scene.media.albedo(event.medium))
        phase = scene.media.phase(event.medium, 0.5 * dr.squared_norm(bend.inward + path.direction))
        by_chance, by_sample = media.mean(weights, phase) * bend.likely(), density / bend.solid_angle(surface.n)
        radiance *= bend.passes() / (by_chance + by_sample)
        passed = self._passed(path, event, bend, point, active)
        return scene.seen([w * p * t for w, p, t in zip(weights, phase, passed)], radiance, active)

    def _passed(self, path, event, bend, point, active):
        """What media and surfaces leave of light on both parts of its way."""
        scene = self._scene
        at_boundary = mi.Interaction3f(0.0, 0.0, dr.zeros(mi.Color0f), bend.point, bend.normal)
        inside = scene.boundaries.outside(bend.point, bend.normal, bend.outward, event.medium, path.inside, active)
        if self._refractions is not None:  # media between panes are not looked for
            active &= (bend.boundaries == 1) | (inside == 0)
        beyond = flights.transmittance(scene, at_boundary.spawn_ray_to(point), inside, active)
        if self._straight:
            within = [dr.exp(-sigma * bend.within) for sigma in scene.media.sigma_t(event.medium)]
        else:
            ray = mi.Ray3f(event.position, -bend.inward)
            ray.maxt = bend.within * (1 - mi.math.ShadowEpsilon)
            within = flights.transmittance(scene, ray, path.inside, active)
        return media.product(beyond, within)


def _chance(depth, phase):
    """That a lamp is looked for, so many mean free paths from where the straight way to it leaves the body.

    phase : 1/sr, phase function for light that comes that way
    """
    return dr.minimum(1, _SURE * dr.exp(-depth) * dr.lerp(4 * math.pi * phase, 1, _EVEN))


def lamps(scene, world, bodies):
    """`Lamps` of a scene, None where none is to be drawn.

    scene : `scene.Scene`;  bodies : by the numbers of their media
    """
    shapes = {shape.id(): shape for shape in world.scene.shapes()}
    smooth = {number: shapes[body.name] for number, body in bodies.items() if _smooth(shapes[body.name])}
    if not smooth:
        return None
    blind, names = any(body.matched for body in bodies.values()), {body.name for body in bodies.values()}
    panes = [shape for name, shape in shapes.items() if name not in names and _smooth(shape)]
    if blind or scene.regions.bounded or scene.regions.always:  # what is between panes would have to be known
        panes = []
    boundaries = list(smooth.values())
    drawn = solid_angles.drawn(scene, boundaries, panes)
    if not drawn:
        return None
    least = {number: float(min(bodies[number].medium.sigma_t)) * world.unit for number in smooth}
    around = {shape: solid_angles.index_around(scene, shape, panes, drawn) for shape in boundaries} if panes else {}
    manifold = Manifold(scene.scene, scene.boundaries, {shape: least[number] for number, shape in smooth.items()}, blind,
                        around, panes)
    sigma = [least.get(number, 0.0) for number in range(len(scene.entries))]
    return Lamps(scene, manifold, drawn, sigma, not blind and not scene.regions.bounded, bool(panes))


def _smooth(shape):
    """Whether a shape is a mesh whose boundary does nothing but refract and reflect all light."""
    return shape.is_mesh() and not shape.has_flipped_normals() and shape.bsdf().class_name() == "SmoothDielectric" \
        and list(mi.traverse(shape.bsdf()).keys()) == ["eta"]
