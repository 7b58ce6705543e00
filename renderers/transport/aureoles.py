"""Directions toward small lamps in thin media: the aureole around a lamp, as surfaces and scatterings there see it.

Fog scatters light forward, by a degree or ten: a surface that a lamp shines at sees a bright ring around it.  A direction drawn
from the BSDF hits upon it one time in a thousand, and is a bright dot in the picture.  So some directions are drawn around lamps,
in a way that suits narrow peaks and wide ones; the throughput counts the density of both together.  What densities light samples
share with is left as it was: weights of the balance heuristic may be of any densities, if all use the same.
"""

import math

import drjit as dr

import renderers.mitsuba  # noqa: F401  before mitsuba: it finds LLVM

import mitsuba as mi  # isort: skip

# of directions that are drawn around lamps, where all light is theirs.  Variance times time over that without: spot lamp in fog
# of droplets, shares 0.15, 0.3, 0.5: 0.12, 0.09, 0.04 (few bright samples are most of it: known to a factor of 2); small lamp in
# haze, 0.3 and 0.5: 0.31, 0.23; six of them 0.99, 0.98.  Other directions weigh more by as much, at each bounce: with this share
# under a sky that brings most of the light the variance was 4 to 9 times that without
_SHARE = 0.4
# rad, angle from which on their density is even in the logarithm of the angle, and within even in the angle: as aureoles of
# droplets are, which grow as one over the angle within their forward peak
_PEAK = 0.03
_NEAR = 0.5  # half of the diagonal of a lamp's box over its distance


class Aureoles:
    """Of lamps.

    emitters : of Mitsuba
    spheres : (n, 4) their middles, and half of the diagonals of the boxes around them, in units of the scene
    light : share of the scene's light, 0 to 1, that is theirs (`World.small_share`)
    """

    def __init__(self, emitters, spheres, light):
        self._emitters = [mi.EmitterPtr(emitter) for emitter in emitters]
        self._share = dr.opaque(mi.Float, _SHARE * light)
        self._spheres = [[dr.opaque(mi.Float, float(value)) for value in sphere] for sphere in spheres]

    def turned(self, path, surface, bsdf, sample, factor, active):
        """Samples of a BSDF and their factors, some of them drawn anew; active : where light comes from a thin medium.

        Only where the BSDF reflects, and that not as a mirror: elsewhere lamps are looked for otherwise.
        """
        active = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
        for flag in (mi.BSDFFlags.Delta, mi.BSDFFlags.Transmission):
            active &= ~mi.has_flag(bsdf.flags(), flag)
        facing = dr.select(surface.wi.z > 0, mi.Vector3f(surface.n), -mi.Vector3f(surface.n))
        drawn, lobes, share = self._drawn(path, surface.p, facing)
        around = active & (path.random.next_float32() < share)
        wo = dr.select(around, surface.to_local(drawn), sample.wo)
        value, density = bsdf.eval_pdf(mi.BSDFContext(), surface, wo, active)
        mixed = dr.lerp(density, lobes(surface.to_world(wo)), share)
        sample.wo, sample.pdf = wo, dr.select(active, density, sample.pdf)
        sample.sampled_type = dr.select(around, mi.UInt32(+mi.BSDFFlags.DiffuseReflection), sample.sampled_type)
        return sample, dr.select(active, dr.select(mixed > 0, value / mixed, 0), factor)

    def scattered(self, path, media, medium, position, before, after, active):
        """Directions, densities and throughput after scatterings, some of them drawn anew.

        before : direction and weights (throughput times albedo) before;  after : what `media.scattered` gives
        """
        (incident, weights), (direction, density, throughput) = before, after
        drawn, lobes, share = self._drawn(path, position)
        around = active & (path.random.next_float32() < share)
        direction = dr.select(around, drawn, direction)
        phase = media.phase(medium, 0.5 * dr.squared_norm(direction - incident))
        summed = sum(weights[1:], weights[0])
        mean = dr.select(summed > 0, sum(w * p for w, p in zip(weights, phase)) / summed, 0)
        mixed = dr.lerp(mean, lobes(direction), share)
        throughput = [dr.select(active, dr.select(mixed > 0, w * p / mixed, 0), t) for w, p, t in zip(weights, phase, throughput)]
        return direction, dr.select(active, mean, density), throughput

    def _drawn(self, path, point, facing=None):
        """Directions around lamps; a function of directions that gives their density; and the share that is to be drawn so.

        Lamps count by what they would light there if nothing stood between.
        facing : normals of surfaces, behind which no lamp counts
        """
        middles, peaks, weights = [], [], []
        interaction = mi.Interaction3f(0.0, 0.0, dr.zeros(mi.Color0f), point, mi.Normal3f(0))
        for emitter, (x, y, z, size) in zip(self._emitters, self._spheres):
            towards = mi.Vector3f(x, y, z) - mi.Vector3f(point)
            squared = dr.maximum(dr.squared_norm(towards), 1e-30)
            middle = towards * dr.rsqrt(squared)
            # what lies before the lamp itself is no aureole
            peaks.append(dr.clip(size * dr.rsqrt(squared), _PEAK, 1))
            sample, light = emitter.sample_direction(interaction, mi.Point2f(0.5), True)
            # none where a lamp is near or around: it needs no looking for
            apart = dr.square(size) < _NEAR**2 * squared
            irradiance = dr.select(apart & (sample.pdf > 0) & dr.all(dr.isfinite(light)), dr.mean(light), 0)
            weights.append(irradiance if facing is None else irradiance * dr.maximum(dr.dot(facing, middle), 0))
            middles.append(middle)
        summed = sum(weights[1:], weights[0])
        weights = [dr.select(summed > 0, weight / summed, 0) for weight in weights]

        def density(direction):
            return sum(weight * _density(dr.norm(direction - middle), peak)
                       for middle, peak, weight in zip(middles, peaks, weights))

        remaining, middle, peak = path.random.next_float32(), middles[0], peaks[0]
        for k in range(1, len(weights)):
            remaining -= weights[k - 1]
            middle, peak = (dr.select(remaining >= 0, new[k], old) for new, old in ((middles, middle), (peaks, peak)))
        theta = dr.minimum(peak * (dr.exp(path.random.next_float32() * dr.log(1 + math.pi / peak)) - 1), math.pi)
        sine, cosine = dr.sincos(2 * math.pi * path.random.next_float32())
        aside, along = dr.sincos(theta)
        direction = mi.Frame3f(middle).to_world(mi.Vector3f(aside * cosine, aside * sine, along))
        return dr.normalize(direction), density, dr.select(summed > 0, self._share, 0)


def _density(chord, peak):
    """Of directions (1/sr), at the chord between theirs and that of the lamp on the unit sphere."""
    half = dr.clip(0.5 * chord, 1e-6, 1)
    theta = 2 * dr.asin(half)
    sine = dr.maximum(2 * half * dr.sqrt(1 - dr.square(half)), 1e-6)
    return 1 / (2 * math.pi * sine * dr.log(1 + math.pi / peak) * (theta + peak))
