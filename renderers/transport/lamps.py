"""Light samples of lamps through smooth boundaries of bodies (manifold next-event estimation).

A scattering in a body draws a point on a lamp, and `manifold` finds the place on the boundary where its light is refracted
towards the scattering; where there are panes, `refractions` the way through these and the boundary.  A path that went that way by
chance would have been found so if the walk from its scattering to the point of the lamp ends where it came through: then both
share by the balance heuristic of their densities, else it counts alone.  So nothing is lost where walks end nowhere, or at one of
several places.

Walks wait until all paths of a pass are over: each lane keeps `records` of scatterings and of lamps that its paths have met.
Where it has no space for more no lamp is looked for, and what paths meet by chance counts in full.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import drjit as dr
import numpy as np

from bakery.kernels import stream_key
from renderers.mitsuba.shading import arrays, single
from renderers.transport import flights, media
from renderers.transport.distances import Distances
from renderers.transport.manifold import numbered, refracts
from renderers.transport.refractions import Refractions
from renderers.transport.skies import Sky

import mitsuba as mi  # isort: skip

# records of a lane: scatterings from which lamps are looked for, and lamps met, for each path, and at least.  A path from the eye
# has half a scattering and a twentieth of a lamp in a shipped glass of milk, 2.4 scatterings in a cup of wax with a flame in it.
# Lanes without space leave lamps to chance: with two scatterings a path the cup had 2.9 times the variance, and 4.1 times where a
# lane has a single pixel.  Memory that has no record takes no place: the cup has 1.07 GB, with two 0.58
SCATTERINGS, ARRIVALS = (8.0, 8), (0.25, 2)
_TRIED = 1 << 14  # walks that tell how many end
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


@dataclass
class Scattering:
    """Scatterings from which lamps are looked for.

    number, inside, order, throughput : of the path there;  event, before, medium : as of a `Departure`
    lamp, u, v : which of all lamps, and numbers for a point on it
    """

    number: mi.UInt32
    event: mi.Point3f
    before: mi.Vector3f
    medium: mi.UInt32
    inside: mi.UInt32
    order: mi.UInt32
    throughput: list
    lamp: mi.UInt32
    u: mi.Float
    v: mi.Float


@dataclass
class Arrival:
    """Lamps that paths have met by single directions after scatterings.

    number, inside, order : of the path;  event, before, medium, density : as of a `Departure`
    drawn : where it came from;  lamp : which of all;  point, normal : there;  light : linear sRGB
    """

    number: mi.UInt32
    event: mi.Point3f
    before: mi.Vector3f
    medium: mi.UInt32
    density: mi.Float
    inside: mi.UInt32
    order: mi.UInt32
    drawn: mi.Point3f
    lamp: mi.UInt32
    point: mi.Point3f
    normal: mi.Vector3f
    light: list


class Lamps:
    """The lamps that are drawn, and boundaries through which they are looked for."""

    def __init__(self, scene, manifold, lamps, sigma, straight, through_panes):
        """
        scene : `scene.Scene`;  manifold : `Manifold`
        lamps : how likely each is drawn, by shapes; last the environment, if it is, by a `skies.Sky`
        sigma : of each medium, the least extinction if its boundary is one of `manifold`, else 0
        straight : whether ways from scatterings to boundaries of `manifold` go through one homogeneous medium
        through_panes : whether lamps are looked for through panes, too
        """
        self._scene, self._manifold, self._straight = scene, manifold, straight
        self._refractions = Refractions(scene.scene, manifold) if through_panes else None
        self._sigma = mi.Float(sigma)
        shares = np.array(list(lamps.values()))
        shapes = [lamp for lamp in lamps if not isinstance(lamp, Sky)]
        self._sky = next((lamp for lamp in lamps if isinstance(lamp, Sky)), None)
        areas = [1.0 if isinstance(lamp, Sky) else float(np.array(lamp.surface_area()).ravel()[0]) for lamp in lamps]
        self._from_one = numbered(scene.scene, shapes, 1 + np.arange(len(shapes)))
        self._density = single(shares / areas)
        self._is_sky = mi.UInt32([int(isinstance(lamp, Sky)) for lamp in lamps])
        self._cumulated = [dr.opaque(mi.Float, float(share)) for share in np.cumsum(shares)[:-1]]
        self._shapes = mi.ShapePtr([scene.scene.shapes()[0] if isinstance(lamp, Sky) else lamp for lamp in lamps])
        self._emitters = mi.EmitterPtr([lamp.emitter if isinstance(lamp, Sky) else lamp.emitter() for lamp in lamps])
        self._distances = Distances(scene.scene, manifold, [partial(_towards, lamp) for lamp in lamps])

    @staticmethod
    def none(width):
        """`Departure` of paths that have not scattered."""
        return dr.zeros(Departure, width)

    def departs(self, path, medium, position, density, active, records):
        """Changes departures of paths that scatter at positions, and go on with density (1/sr); some keep a record."""
        departure, random = path.departure, path.random
        sigma = dr.gather(mi.Float, self._sigma, medium)
        looks = active & (sigma > 0) & records.has_space(path.counts, "scattering", "arrival")
        density = dr.select(looks, density, 0)
        departure.event, departure.before, departure.medium, departure.density = (
            dr.select(active, after, before) for after, before in (
                (position, departure.event), (path.direction, departure.before), (medium, departure.medium),
                (density, departure.density)))
        departure.turned &= ~active
        u, first, second = (random.next_float32() for _ in range(3))
        lamp = self._drawn(random.next_float32()) if self._cumulated else dr.zeros(mi.UInt32, dr.width(u))
        record = Scattering(path.number, position, path.direction, medium, path.inside, path.order, path.throughput, lamp, first,
                        second)
        records.add(path.counts, "scattering", record, looks & (u < self._chance(medium, position, lamp, looks)))

    def turned(self, path, sample, shades):
        """Changes departures of paths that a surface has turned, by a sample of the BSDF."""
        # through panes only refractions turn what still counts as found by a light sample
        further = ~path.departure.turned if self._refractions is None else True
        refracted = further & mi.has_flag(sample.sampled_type, mi.BSDFFlags.DeltaTransmission)
        path.departure.density = dr.select(shades & ~refracted, 0, path.departure.density)
        path.departure.turned |= shades

    def meets(self, path, event, light, records):
        """Light of lamps that paths meet, without what light samples might have found, of which records are kept."""
        departure, lamp_ahead = path.departure, self._ahead(event)
        arrives = departure.turned & (departure.density > 0) & (lamp_ahead > 0) & path.single
        point, normal = event.surface.p, event.surface.n
        if self._sky:
            point = dr.select(event.misses, self._sky.reached(departure.event, path.direction), point)
            normal = dr.select(event.misses, -path.direction, normal)
        record = Arrival(path.number, departure.event, departure.before, departure.medium, departure.density, path.inside,
                         path.order, path.drawn, lamp_ahead - 1, point, normal, light)
        records.add(path.counts, "arrival", record, arrives)
        return [dr.select(arrives, 0, value) for value in light]

    def light(self, records):
        """What records come to: numbers (n,) of paths, orders (n,), emitters, and light (n, 3)."""
        scattering, arrival = records.kept("scattering"), records.kept("arrival")
        if scattering is not None:
            yield self._columns(scattering, self._light(scattering))
        if arrival is not None:
            share = self._share(arrival)
            yield self._columns(arrival, [value * share for value in arrival.light])

    def success(self):
        """Share of walks that end, from places near boundaries, by how likely lamps are looked for from there."""
        manifold, random = self._manifold, mi.PCG32(_TRIED, initstate=int(stream_key(0, "render.lamps_tried")))
        low, high = (mi.Point3f(*map(float, corner)) for corner in manifold.box)
        x = low + (high - low) * mi.Vector3f(*(random.next_float32() for _ in range(3)))
        u, v = (mi.Point2f(random.next_float32(), random.next_float32()) for _ in range(2))
        ray = mi.Ray3f(x, mi.warp.square_to_uniform_sphere(u))
        hit = self._scene.scene.ray_intersect_preliminary(ray, coherent=False)
        active = hit.is_valid() & self._scene.boundaries.is_body(hit.shape) & manifold.begins_within(ray)
        lamp = self._drawn(random.next_float32()) if self._cumulated else dr.zeros(mi.UInt32, _TRIED)
        chance = self._chance(self._scene.boundaries.medium(hit.shape), x, lamp, active)
        ends = active & self._walk(x, self._drawn_points(lamp, x, v, active))[1]
        chance, ends = (values.astype(float) for values in arrays(_TRIED, dr.select(active, chance, 0), ends))
        return float((chance * ends).sum() / max(chance.sum(), 1e-30))

    def _columns(self, record, light):
        return record.number, record.order, dr.gather(mi.EmitterPtr, self._emitters, record.lamp), light

    def _walk(self, x, y):
        """Ways from scatterings to points on lamps, and whether they end there."""
        active = dr.full(mi.Bool, True, dr.width(x))
        if self._refractions is not None:
            walk = self._refractions.walk(x, y, active)
            return walk, walk.ends
        walk = self._manifold.walk(x, y, active)
        bend = self._manifold.bend(walk.row, walk.uv, x, y)
        return bend, walk.ends & refracts(bend)

    def _share(self, arrival):
        """Which share counts of light met by chance."""
        bend, through = self._walk(arrival.event, arrival.point)
        if self._refractions is not None:  # media between panes are not looked for, by light samples (`_passed`) as here
            through &= (bend.boundaries == 1) | (arrival.inside == 0)
        by_chance = arrival.density * bend.likely()
        by_sample = self._density_at(arrival, arrival.point, through) / bend.solid_angle(arrival.normal)
        return dr.select(through & bend.is_at(arrival.drawn), by_chance / (by_chance + by_sample), 1)

    def _chance(self, medium, x, lamp, active):
        """That a lamp is looked for from x: exp(-s), s mean free paths from where the straight way to it leaves the body."""
        return dr.exp(-dr.gather(mi.Float, self._sigma, medium) * self._distances.of(x, lamp, active))

    def _density_at(self, record, point, active):
        """Of points on lamps that are drawn from where records begin, one over the area."""
        chance = self._chance(record.medium, record.event, record.lamp, active)
        return chance * self._densities(record.lamp, record.event, point)

    def _ahead(self, event):
        """Lamps that paths meet, from 1; 0 of other surfaces."""
        ahead = dr.gather(mi.UInt32, self._from_one, dr.reinterpret_array(mi.UInt32, event.surface.shape), event.meets)
        return dr.select(event.misses, mi.UInt32(dr.width(self._is_sky)), ahead) if self._sky else ahead

    def _drawn_points(self, lamp, x, u, active):
        """On lamps, for points x."""
        drawn = dr.gather(mi.ShapePtr, self._shapes, lamp, active).sample_position(0.0, u, active).p
        if self._sky:
            is_sky = active & (dr.gather(mi.UInt32, self._is_sky, lamp) > 0)
            drawn = dr.select(is_sky, self._sky.drawn(x, u, is_sky), drawn)
        return drawn

    def _densities(self, lamp, x, y):
        """Of points y on lamps, drawn from x, one over the area."""
        density = dr.gather(mi.Float, self._density, lamp)
        if not self._sky:
            return density
        is_sky = dr.gather(mi.UInt32, self._is_sky, lamp) > 0
        return dr.select(is_sky, density * self._sky.density(x, y, is_sky), density)

    def _drawn(self, u):
        lamp = mi.UInt32(0)
        for below in self._cumulated:
            lamp += dr.select(u >= below, mi.UInt32(1), mi.UInt32(0))
        return lamp

    def _shining(self, lamp, x, bend, point, active):
        """Radiance of points on lamps, drawn from x, towards boundaries, and their normals; 0 where nothing shines."""
        shape = dr.gather(mi.ShapePtr, self._shapes, lamp, active)
        # met by a ray, as paths meet it: with the normal of its triangle, and what shines there
        ray = mi.Ray3f(point - _SHORT * bend.beyond * bend.outward, bend.outward)
        ray.maxt = 2 * _SHORT * bend.beyond
        surface = self._scene.scene.ray_intersect(ray, mi.RayFlags.All, False, active)
        shines = active & surface.is_valid() & (surface.shape == shape)
        radiance, normal = dr.select(shines, shape.emitter().eval(surface, shines), 0), surface.n
        if self._sky:
            is_sky = dr.gather(mi.UInt32, self._is_sky, lamp) > 0
            radiance = dr.select(is_sky, self._sky.radiance(dr.normalize(point - x), active & is_sky), radiance)
            normal = dr.select(is_sky, -bend.outward, normal)
        return radiance, normal

    def _light(self, scattering):
        """Light of points on lamps through the boundary to scatterings."""
        scene = self._scene
        point = self._drawn_points(scattering.lamp, scattering.event, mi.Point2f(scattering.u, scattering.v), True)
        bend, active = self._walk(scattering.event, point)
        radiance, normal = self._shining(scattering.lamp, scattering.event, bend, point, active)
        active &= dr.any(radiance > 0)
        weights = media.product(scattering.throughput, scene.media.albedo(scattering.medium))
        phase = scene.media.phase(scattering.medium, 0.5 * dr.squared_norm(bend.inward + scattering.before))
        by_chance = media.mean(weights, phase) * bend.likely()
        by_sample = self._density_at(scattering, point, active) / bend.solid_angle(normal)
        radiance *= bend.passes() / (by_chance + by_sample)
        passed = self._passed(scattering, bend, point, active)
        return scene.seen([w * p * t for w, p, t in zip(weights, phase, passed)], radiance, active)

    def _passed(self, scattering, bend, point, active):
        """What media and surfaces leave of light on both parts of its way."""
        scene = self._scene
        at_boundary = mi.Interaction3f(0.0, 0.0, dr.zeros(mi.Color0f), bend.point, bend.normal)
        inside = scene.boundaries.outside(bend.point, bend.normal, bend.outward, scattering.medium, scattering.inside, active)
        if self._refractions is not None:
            active &= (bend.boundaries == 1) | (inside == 0)
        beyond = flights.transmittance(scene, at_boundary.spawn_ray_to(point), inside, active)
        if self._straight:
            within = [dr.exp(-sigma * bend.within) for sigma in scene.media.sigma_t(scattering.medium)]
        else:
            ray = mi.Ray3f(scattering.event, -bend.inward)
            ray.maxt = bend.within * (1 - mi.math.ShadowEpsilon)
            within = flights.transmittance(scene, ray, scattering.inside, active)
        return media.product(beyond, within)


def _towards(lamp, point, u):
    """Directions from points to points on a lamp, by uniform numbers."""
    target = lamp.drawn(point, u, True) if isinstance(lamp, Sky) else lamp.sample_position(0.0, u).p
    return dr.normalize(target - point)
