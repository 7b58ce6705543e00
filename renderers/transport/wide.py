"""Light samples of wide lamps and of the sky through smooth boundaries of bodies: directions from `guides` are followed.

A scattering in a body follows one more way, in a direction from which light comes there, until it meets the first light.  A path
that goes such a way by chance, by refractions and single reflections alone, shares with it by the balance heuristic of the two
densities of the direction at the scattering: what happens at the surfaces is drawn alike in both.

These ways wait until all paths of a pass are over (`records`).
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr

import renderers.mitsuba  # noqa: F401  before mitsuba: it finds LLVM
from renderers.transport import media, specular

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


@dataclass
class Looking:
    """Scatterings from which a direction is followed.

    number, inside, order, throughput : of the path there;  event, before, medium : where, the direction there, the body's
    u, v : numbers for a direction
    """

    number: mi.UInt32
    event: mi.Point3f
    before: mi.Vector3f
    medium: mi.UInt32
    inside: mi.UInt32
    order: mi.UInt32
    throughput: list
    u: mi.Float
    v: mi.Float


def ways(scene, counts):
    """Ways to the first light, as `guides.Guides` asks for them; counts : function of emitters: whether they are looked for."""
    def followed(point, direction, medium, random, active):
        chain = specular.followed(scene, point, direction, mi.UInt32(1) << medium, random, active)
        return scene.seen(chain.weight, chain.radiance, active), chain.within, counts(chain.emitter)

    return followed


class Wide:
    """Wide lights, and directions from which their light comes."""

    def __init__(self, scene, guides, sigma, counts):
        """
        scene : `scene.Scene`;  guides : `guides.Guides`
        sigma : of each medium, the least extinction if its boundary is smooth, else 0
        counts : function of emitters: whether they are among these lights
        """
        self._scene, self._guides, self._sigma, self._counts = scene, guides, mi.Float(sigma), counts

    @staticmethod
    def none(width):
        """`Chance` of paths that have not scattered."""
        return Chance(dr.full(mi.Bool, False, width), dr.zeros(mi.UInt32, width), dr.full(mi.Float, 1, width))

    def departs(self, path, medium, position, active, records):
        """Changes what is known of paths that scatter at positions; some keep a record."""
        chance, random = path.chance, path.random
        looks = active & (dr.gather(mi.Float, self._sigma, medium) > 0) & records.has_space(path.counts, Looking)
        chance.looks = dr.select(active, looks, chance.looks)
        chance.turns = dr.select(active, 0, chance.turns)
        chance.share = dr.select(active, 1, chance.share)
        u, v, w = (random.next_float32() for _ in range(3))
        record = Looking(path.number, position, path.direction, medium, path.inside, path.order, path.throughput, u, v)
        records.add(path.counts, record, looks & (w < self._guides.number(medium, position, looks)))

    def turned(self, path, before, sample, shades):
        """Changes what is known of paths that a surface has turned, by a sample of the BSDF; before : `Before`."""
        chance = path.chance
        first = shades & chance.looks & (chance.turns == 0)
        medium = self._scene.innermost(before.inside)[1]
        sigma = dr.gather(mi.Float, self._sigma, medium, first)
        by_chance = path.density * dr.exp(-sigma * dr.norm(path.origin - path.drawn))
        by_sample = self._density(medium, path.drawn, before.direction, first)
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

    def _density(self, medium, point, direction, active):
        """Of directions of light samples, 1/sr."""
        return self._guides.number(medium, point, active) * self._guides.density(point, direction, active)

    def light(self, records):
        """What records come to: numbers (n,) of paths, orders (n,), emitters, and light (n, 3)."""
        looking = records.kept(Looking)
        if looking is None:
            return
        scene, guides, count = self._scene, self._guides, dr.width(looking.u)
        direction, every = guides.drawn(looking.event, looking.u, looking.v), mi.Bool(True)
        guided = self._density(looking.medium, looking.event, direction, every)
        low, high = mi.sample_tea_32(dr.reinterpret_array(mi.UInt32, looking.u), dr.reinterpret_array(mi.UInt32, looking.v))
        random = mi.PCG32(1, mi.UInt64(low), mi.UInt64(high))
        chain = specular.followed(scene, looking.event, direction, looking.inside, random, dr.full(mi.Bool, True, count))
        weights = media.product(looking.throughput, scene.media.albedo(looking.medium))
        phase = scene.media.phase(looking.medium, 0.5 * dr.squared_norm(direction - looking.before))
        passed = [dr.exp(-sigma * chain.within) for sigma in scene.media.sigma_t(looking.medium)]
        least = dr.exp(-dr.gather(mi.Float, self._sigma, looking.medium) * chain.within)
        scale = dr.rcp(media.mean(weights, phase) * least + guided)
        throughput = [w * p * t * s * scale for w, p, t, s in zip(weights, phase, passed, chain.weight)]
        active = (guided > 0) & self._counts(chain.emitter)
        yield looking.number, looking.order, chain.emitter, scene.seen(throughput, chain.radiance, active)
