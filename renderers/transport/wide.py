"""Light samples of wide lamps and of the sky through smooth boundaries of bodies: directions from `guides` are followed.

A scattering in a body follows one more way, in a direction from which light comes there, until it meets the first light.  A path
that goes such a way by chance, by refractions and single reflections alone, shares with it by the balance heuristic of the two
densities of the direction at the scattering: what happens at the surfaces is drawn alike in both.

These ways wait until all paths of a pass are over (`records`).
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr

from renderers.transport import specular
from renderers.transport.guides import Looking

import mitsuba as mi  # isort: skip

# records of a lane, for each path, and at least: a glass of milk has 1.3 a path of its picture.  With a pixel a lane, three
# have 1.6 times the variance of eight, in 0.9 of the time
SPACE = 8.0, 8
# of the light of voxels and bins, that neighbours get.  Variance times time with over without: the shipped glass of milk 0.85,
# milk that shares the tumbler's inner wall, under a lamp of 25 mm, 0.85
BLUR = 0.1


@dataclass
class Chance:
    """Of paths since their last scattering in a body.

    looks : whether light samples look for light from there;  turns : surfaces that have turned the path since
    share : of the light that it meets, which counts
    """

    looks: mi.Bool
    turns: mi.UInt32
    share: mi.Float


def ways(scene, counts):
    """Ways to the first light, as `guides.Guides` asks for them; counts : function of emitters: whether they are looked for."""
    def followed(point, direction, medium, random, active):
        chain = specular.followed(scene, point, direction, mi.UInt32(1) << medium, random, active)
        return scene.seen(chain.weight, chain.radiance, active), chain.within, counts(chain.emitter)

    return followed


class Wide(Looking):
    """Wide lights, and directions from which their light comes."""

    KIND = "wide"

    def __init__(self, scene, guides, sigma, counts):
        """
        scene : `scene.Scene`;  guides : `guides.Guides`
        sigma : of each medium, the least extinction if its boundary is smooth, else 0
        counts : function of emitters: whether they are among these lights
        """
        self.scene, self.guides, self.sigma, self._counts = scene, guides, mi.Float(sigma), counts

    @staticmethod
    def none(width):
        """`Chance` of paths that have not scattered."""
        return Chance(dr.full(mi.Bool, False, width), dr.zeros(mi.UInt32, width), dr.full(mi.Float, 1, width))

    def departs(self, path, medium, position, active, records):
        """Changes what is known of paths that scatter at positions; some keep a record."""
        chance, looks = path.chance, self.looks(path, medium, position, active, records)
        chance.looks = dr.select(active, looks, chance.looks)
        chance.turns = dr.select(active, 0, chance.turns)
        chance.share = dr.select(active, 1, chance.share)

    def turned(self, path, before, sample, shades):
        """Changes what is known of paths that a surface has turned, by a sample of the BSDF; before : `Before`."""
        chance = path.chance
        first = shades & chance.looks & (chance.turns == 0)
        medium = self.scene.innermost(before.inside)[1]
        by_chance = path.density * self.reaches(medium, dr.norm(path.origin - path.drawn), first)
        by_sample = self.density(medium, path.drawn, before.direction, first)
        chance.share = dr.select(first, by_chance / (by_chance + by_sample), chance.share)
        chance.turns += dr.select(shades, mi.UInt32(1), mi.UInt32(0))
        chance.share = dr.select(shades & ~specular.goes_on(sample, path.inside, chance.turns), 1, chance.share)

    def meets(self, path, emitter, light):
        """Light that paths meet, less what light samples bring of it."""
        chance = path.chance
        shines = emitter != None  # noqa: E711, compares every lane
        share = dr.select(shines & self._counts(emitter), chance.share, 1)
        chance.share = dr.select(shines, 1, chance.share)  # the first light ends the ways of light samples
        return [value * share for value in light]

    def followed(self, sight, direction, density, random):
        """Emitters, and light as linear sRGB, of directions of `Sight`s."""
        every = dr.full(mi.Bool, True, dr.width(density))
        chain = specular.followed(self.scene, sight.event, direction, sight.inside, random, every)
        redirected, scale = self.redirected(sight, direction, density, chain.within)
        passed = [dr.exp(-sigma * chain.within) for sigma in self.scene.media.sigma_t(sight.medium)]
        throughput = [weight * t * s * scale for weight, t, s in zip(redirected, passed, chain.weight)]
        active = (density > 0) & self._counts(chain.emitter)
        return [(chain.emitter, self.scene.seen(throughput, chain.radiance, active))]
