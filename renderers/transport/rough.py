"""Light samples of lamps through rough boundaries of bodies: directions from `guides` meet the boundary, which samples lamps.

A scattering in a body looks in one more direction, from which light comes there through the rough boundary.  Where that meets the
boundary it draws a lamp, and a direction of the BSDF, which may meet one (balance heuristic).  A path that comes there by chance
does the same, so that both share by the balance heuristic of the two densities of the direction at the scattering, by the phase
function and by the guides.

These directions wait until all paths of a pass are over (`records`).
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr

from renderers.transport import flights, media
from renderers.transport.guides import Guides, Looking
from renderers.transport.manifold import numbered

import mitsuba as mi  # isort: skip

SPACE = 3.0, 8  # records of a lane, for each path, and at least
# Of directions, 0.025 sr: a lamp is seen through roughness of 0.1 under some 0.01 sr.  Ball of roughness 0.1, variance times time
# and seconds to measure: 0.0073 and 1.7 by 8 ways, 0.0091 and 0.9 by 2; by 24 x 48 bins of 2 ways 0.011 and 1.5
BINS, WAYS = (16, 32), 4
# Without it bins in which no way finds light hold most of the variance: it is 15 times as large
BLUR = 0.1


@dataclass
class Entry:
    """Of paths since their last scattering in a body.

    looks : whether light samples look for light from there, and no surface has turned the path since;  medium : of the body
    share : of the light that it finds, which counts
    """

    looks: mi.Bool
    medium: mi.UInt32
    share: mi.Float


@dataclass
class Crossing:
    """Ways from scatterings to rough surfaces.

    surface : that they meet;  random : PCG32
    inside : bodies around, a bit each;  weight : of each wavelength;  active : whether there is such a surface
    """

    surface: mi.SurfaceInteraction3f
    random: mi.PCG32
    inside: mi.UInt32
    weight: list
    active: mi.Bool


class Rough(Looking):
    """Lights through rough boundaries."""

    KIND = "rough"

    def __init__(self, scene, manifold, sigma, surfaces):
        """
        scene : `scene.Scene`;  manifold : `manifold.Manifold` of the bodies
        sigma : of each medium, the least extinction if its boundary is rough, else 0
        surfaces : shapes of Mitsuba that are rough and refract, all of the scene
        """
        self.scene, self.sigma = scene, mi.Float(sigma)
        self._surfaces = numbered(scene.scene, surfaces, [1] * len(surfaces))
        self.guides = Guides(scene, manifold, sigma, self._ways_of, BINS, WAYS, BLUR)

    @staticmethod
    def none(width):
        """`Entry` of paths that have not scattered."""
        return Entry(dr.full(mi.Bool, False, width), dr.zeros(mi.UInt32, width), dr.full(mi.Float, 1, width))

    def departs(self, path, medium, position, active, records):
        """Changes what is known of paths that scatter at positions; some keep a record."""
        entry, looks = path.entry, self.looks(path, medium, position, active, records)
        entry.looks, entry.medium = dr.select(active, looks, entry.looks), dr.select(active, medium, entry.medium)
        entry.share = dr.select(active, 1, entry.share)

    @staticmethod
    def meets(path, light):
        """Light that paths meet, less what light samples bring of it."""
        return [value * path.entry.share for value in light]

    def sampled(self, path, event, light):
        """Light of light samples at events, less what others bring of it."""
        self._arrive(path, event)
        return [value * path.entry.share for value in light]

    def _arrive(self, path, event):
        """Changes what is known of paths that have come to an event."""
        entry, shades = path.entry, event.meets & ~event.crosses
        first = shades & entry.looks & self._meets(event.surface, path.direction)
        by_phase = path.density * self.reaches(entry.medium, dr.norm(event.surface.p - path.drawn), first)
        by_guides = self.density(entry.medium, path.drawn, path.direction, first)
        share = dr.select(first & (by_guides > 0), by_phase / (by_phase + by_guides), 1)
        entry.share = dr.select(shades | event.scatters, share, entry.share)
        entry.looks &= ~shades

    def _ways_of(self, point, direction, medium, random, active):
        """Light of ways, as `guides` asks for it."""
        width = dr.width(point)
        surface, _, inside = flights.onward(self.scene, mi.Ray3f(point, direction), mi.UInt32(1) << medium, active)
        weight = [dr.full(mi.Float, 1, width) for _ in range(self.scene.waves)]
        drawn, turned = self._lights(Crossing(surface, random, inside, weight, self._meets(surface, direction) & active))
        return [a + b for a, b in zip(drawn[1], turned[1])], dr.norm(surface.p - point), dr.full(mi.Bool, True, width)

    def _meets(self, surface, direction):
        """Whether rays meet a rough boundary, but for those that may turn paths as the surface of a body in a rough one."""
        meets = surface.is_valid() & (dr.gather(mi.UInt32, self._surfaces, dr.reinterpret_array(mi.UInt32, surface.shape)) > 0)
        return meets & ~(self.scene.far.chance(surface, direction, meets) > 0) if self.scene.far else meets

    def _lights(self, crossing):
        """Emitters, and light as linear sRGB, of light samples where ways meet surfaces, and of directions of the BSDF there."""
        scene, surface, random, bsdf = self.scene, crossing.surface, crossing.random, crossing.surface.bsdf()
        interaction = mi.Interaction3f(0.0, 0.0, dr.zeros(mi.Color0f), surface.p, surface.n)
        u = mi.Point2f(random.next_float32(), random.next_float32())
        light, radiance = scene.scene.sample_emitter_direction(interaction, u, False, crossing.active)
        active = crossing.active & (light.pdf > 0) & dr.any(radiance > 0)
        value, by_bsdf = bsdf.eval_pdf(mi.BSDFContext(), surface, surface.to_local(light.d), active)
        radiance *= value * dr.select(light.delta, 1, light.pdf / (light.pdf + by_bsdf))
        active &= dr.any(radiance > 0)
        inside = scene.boundaries.beyond(surface, light.d, crossing.inside, active)
        passed = flights.of_light(scene, interaction, light, inside, active)
        drawn = light.emitter, scene.seen(media.product(crossing.weight, passed), radiance, active)

        number, u = random.next_float32(), mi.Point2f(random.next_float32(), random.next_float32())
        sample, factor = bsdf.sample(mi.BSDFContext(), surface, number, u, crossing.active)
        factor = scene.reflectance(dr.select(dr.all(dr.isfinite(factor)), factor, 0))
        onward = surface.to_world(sample.wo)
        ray = mi.Ray3f(scene.from_surface(surface, onward), onward)
        inside = scene.boundaries.beyond(surface, ray.d, crossing.inside, crossing.active)
        ahead, passed, _ = flights.onward(scene, ray, inside, crossing.active & (sample.pdf > 0))
        weight = media.product(media.product(crossing.weight, factor), passed)
        return drawn, self._light_ahead(interaction, ahead, weight, sample.pdf, crossing.active)

    def _light_ahead(self, before, surface, weight, density, active):
        """Emitters, and light, that directions from interactions `before` meet, drawn with density (1/sr)."""
        scene = self.scene
        seen = mi.DirectionSample3f(scene.scene, surface, before)
        active &= (density > 0) & (seen.emitter != None)  # noqa: E711, compares every lane
        by_light = scene.scene.pdf_emitter_direction(before, seen, active)
        radiance = seen.emitter.eval(surface, active) * dr.select(active, density / (density + by_light), 0)
        return seen.emitter, scene.seen(weight, radiance, active)

    def followed(self, sight, direction, density, random):
        """Emitters, and light as linear sRGB, of directions of `Sight`s."""
        surface, passed, inside = flights.onward(self.scene, mi.Ray3f(sight.event, direction), sight.inside, density > 0)
        redirected, scale = self.redirected(sight, direction, density, dr.norm(surface.p - sight.event))
        throughput = [weight * t * scale for weight, t in zip(redirected, passed)]
        lights = self._lights(Crossing(surface, random, inside, throughput, self._meets(surface, direction) & (density > 0)))
        dr.eval(lights)  # both by one kernel
        return lights
