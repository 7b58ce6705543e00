"""Directions in which a baked layer sends light, drawn in Dr.Jit, and their density.

Lobes are chosen by the light that each sends on, the mean of all wavelengths, the mirror by the root of that; within those that
are scattered directions come from a table of 32 cells a side (`renderers.mitsuba.layers`), from facets of a rough boundary by the
normals that are seen.
"""

import math

import drjit as dr
import mitsuba as mi

from renderers.mitsuba import layers
from renderers.mitsuba.layer_values import LEAST, Values, azimuth_coordinate
from renderers.mitsuba.rows import at, held, pick

MIRROR, STRAIGHT, FACETS, REFLECTED, TRANSMITTED = range(5)


class Surface(Values):
    """What the plugin computes: values, and directions that are drawn.

    layer, channel, wavelength : as of `Values`
    """

    def __init__(self, layer, channel=-1, wavelength=None):
        super().__init__(layer, channel, wavelength)
        self._cells = cells = layers.cells_of(self.layer)
        self._below_mu, self._below_phi, self._density = map(held, (cells.below_mu, cells.below_phi, cells.density))
        self._mu2, self._phi, self._shares = map(held, (cells.mu**2, cells.phi, cells.shares))
        self.flags, self._lobes = self._declared()
        self.all_flags = 0
        for flags in self.flags:
            self.all_flags = self.all_flags | flags

    def _declared(self):
        """Flags of the components, and of each lobe (`MIRROR` to `TRANSMITTED`) its component, None where there is none."""
        kinds = mi.BSDFFlags
        sides = kinds.FrontSide | kinds.BackSide if self.free else +kinds.FrontSide
        self._kinds = {MIRROR: kinds.DeltaReflection, STRAIGHT: kinds.DeltaTransmission, FACETS: kinds.GlossyReflection,
                       REFLECTED: kinds.GlossyReflection, TRANSMITTED: kinds.GlossyTransmission}
        # of facets and medium there is one component, as they have one value
        needed = {MIRROR: self.layer.mirrors, STRAIGHT: self.free, REFLECTED: True, TRANSMITTED: self.free}
        present = [lobe for lobe, is_needed in needed.items() if is_needed]
        lobes = {lobe: present.index(lobe) if lobe in present else None for lobe in self._kinds}
        if self.rough:
            lobes[FACETS] = lobes[REFLECTED]
        return [self._kinds[lobe] | sides for lobe in present], lobes

    def _chances(self, ctx, channels, wi, active):
        """Of the lobes, in all at most 1, and the mirrored and unscattered light of each channel."""
        mu = dr.clip(dr.abs(wi.z), LEAST, 1.0)
        mirrored, straight = self.single(channels, mu, active)
        last = self._cells.shares.shape[1] - 1
        x = _coordinate_of(mu) * last
        node = dr.minimum(mi.UInt32(x), last - 1)
        x = x - node
        reflected, transmitted, facets = (
            dr.lerp(at(self._shares, node + part * (last + 1), active),
                    at(self._shares, node + part * (last + 1) + 1, active), x) for part in range(3))
        # what a mirror shows is brighter than what is around it where it is seen: 0.04 of the light gets 0.2 of the samples
        light = [dr.sqrt(sum(mirrored) / len(mirrored)), sum(straight) / len(straight), facets, reflected, transmitted]
        light = [share if self._is_asked(ctx, lobe) else mu * 0.0 for lobe, share in enumerate(light)]
        # what is hardly there is still drawn, so that no value is without a density
        for lobe in (REFLECTED, TRANSMITTED):
            if self._is_asked(ctx, lobe):
                light[lobe] = dr.maximum(light[lobe], 1e-3)
        total = sum(light)
        return [share / dr.maximum(total, 1e-9) for share in light], mirrored, straight

    def _is_asked(self, ctx, lobe):
        component = self._lobes[lobe]
        if component is None:
            return False
        return ctx.is_enabled(mi.BSDFFlags(int(self.flags[component]) & int(mi.BSDFFlags.All)), component)

    def _drawn_density(self, chances, pair):
        """1/sr, with which scattered directions are drawn."""
        row, cell, turn = _cell(pair.mu0), _cell(pair.mu), dr.minimum(mi.UInt32(azimuth_coordinate(pair.cos_phi) * layers.CELLS),
                                                                      layers.CELLS - 1)
        cell = (row * layers.CELLS + cell) * layers.CELLS + turn
        side = pick(pair.reflects, mi.UInt32(0), mi.UInt32(layers.CELLS**3))
        chance = pick(pair.reflects, chances[REFLECTED], chances[TRANSMITTED])
        return chance * at(self._density, cell + side) * pair.mu

    def _density_of(self, chances, wi, wo, pair):
        density = self._drawn_density(chances, pair)
        if self.rough:
            normal = dr.normalize(wi + wo)
            facets = mi.MicrofacetDistribution(mi.MicrofacetType.GGX, self.roughness).pdf(wi, normal)
            density = density + chances[FACETS] * (facets / dr.maximum(4 * dr.dot(wo, normal), 1e-9))
        return density

    def _seen(self, wi, active):
        """Where there is something to see: from behind only layers on nothing are not black."""
        return active & (wi.z != 0) if self.free else active & (wi.z > 0)

    def eval_pdf(self, ctx, si, wo, active=True):
        channels, wi = self.rows(si), si.wi
        pair = self.pair(wi, wo)
        active = self._seen(wi, active) & (wo.z != 0)
        if not self.free:
            active = active & (wo.z > 0)
        asked = pick(pair.reflects, mi.Bool(self._is_asked(ctx, REFLECTED)), mi.Bool(self._is_asked(ctx, TRANSMITTED)))
        active = active & asked
        chances, _, _ = self._chances(ctx, channels, wi, active)
        values = [pick(active, value * pair.mu * (1 / math.pi), 0.0) for value in self.values(channels, pair, active)]
        density = pick(active, self._density_of(chances, wi, wo, pair), 0.0)
        return _spectrum(values), density

    def sample(self, ctx, si, sample1, sample2, active=True):
        channels, wi = self.rows(si), si.wi
        active = self._seen(wi, active)
        chances, mirrored, straight = self._chances(ctx, channels, wi, active)
        lobe, below = mi.UInt32(MIRROR), 0.0
        for number in range(TRANSMITTED if self.free else REFLECTED):
            below = below + chances[number]
            lobe = pick(sample1 >= below, mi.UInt32(number + 1), lobe)
        wo = self._scattered(wi, pick(lobe == TRANSMITTED, mi.UInt32(1), mi.UInt32(0)), sample2, active)
        if self.rough:
            normal, _ = mi.MicrofacetDistribution(mi.MicrofacetType.GGX, self.roughness).sample(wi, sample2)
            wo = pick(lobe == FACETS, mi.reflect(wi, mi.Normal3f(normal)), wo)
        wo = pick(lobe == MIRROR, mi.Vector3f(-wi.x, -wi.y, wi.z), wo)
        wo = pick(lobe == STRAIGHT, -wi, wo)
        single = (lobe == MIRROR) | (lobe == STRAIGHT)
        pair = self.pair(wi, wo)
        active = active & (single | (wo.z != 0 if self.free else wo.z > 0))
        density = self._density_of(chances, wi, wo, pair)
        drawn = pick(lobe == MIRROR, chances[MIRROR], pick(lobe == STRAIGHT, chances[STRAIGHT], density))
        active = active & (drawn > 0)
        scale = pick(active, 1 / dr.maximum(drawn, 1e-30), 0.0)
        smooth = active & ~single if self._jit else active
        scattered = [value * pair.mu * (1 / math.pi) for value in self.values(channels, pair, smooth)]
        values = [pick(lobe == MIRROR, m, pick(lobe == STRAIGHT, d, v)) * scale
                  for m, d, v in zip(mirrored, straight, scattered, strict=True)]
        return self._sampled(wo, drawn, lobe, active), _spectrum([pick(active, value, 0.0) for value in values])

    def _sampled(self, wo, drawn, lobe, active):
        sample = mi.BSDFSample3f() if not self._jit else dr.zeros(mi.BSDFSample3f)
        sample.wo, sample.pdf, sample.eta = wo, pick(active, drawn, 0.0), 1.0
        kind, component = mi.UInt32(0), mi.UInt32(0)
        for number, flags in self._kinds.items():
            kind = pick(lobe == number, mi.UInt32(int(flags)), kind)
            component = pick(lobe == number, mi.UInt32(self._lobes[number] or 0), component)
        sample.sampled_type, sample.sampled_component = kind, component
        return sample

    def _scattered(self, wi, side, sample2, active):
        """A direction by the cells, on the side of `wi` (side 0) or on the other (1)."""
        count = layers.CELLS
        table = side * count + _cell(dr.clip(dr.abs(wi.z), LEAST, 1.0))
        first, share = self._halved(self._below_mu, table * (count + 1), sample2.x, active)
        square = dr.lerp(at(self._mu2, first, active), at(self._mu2, first + 1, active), share)
        mirrored = sample2.y < 0.5
        second, share = self._halved(self._below_phi, (table * count + first) * (count + 1),
                                     2 * sample2.y - pick(mirrored, 0.0, 1.0), active)
        phi = dr.lerp(at(self._phi, second, active), at(self._phi, second + 1, active), share)
        sine_phi, cos_phi = dr.sincos(pick(mirrored, -phi, phi))
        sine, mu = dr.sqrt(dr.maximum(1 - square, 0.0)), dr.sqrt(dr.maximum(square, LEAST**2))
        across = dr.sqrt(wi.x * wi.x + wi.y * wi.y)
        flat = across < 1e-6
        x, y = (pick(flat, along, -part / dr.maximum(across, 1e-6)) for part, along in ((wi.x, 1.0), (wi.y, 0.0)))
        up = pick((wi.z > 0) != (side == 1), mu, -mu)
        return mi.Vector3f(sine * (cos_phi * x - sine_phi * y), sine * (sine_phi * x + cos_phi * y), up)

    def _halved(self, array, start, u, active):
        """Cell of a number in a cumulative table, and its share of it."""
        cell, half = mi.UInt32(0), layers.CELLS // 2
        while half:
            cell = cell + pick(at(array, start + cell + half, active) <= u, mi.UInt32(half), mi.UInt32(0))
            half //= 2
        below, above = at(array, start + cell, active), at(array, start + cell + 1, active)
        return cell, dr.clip((u - below) / dr.maximum(above - below, 1e-12), 0.0, 1.0)


def _coordinate_of(mu):
    """Coordinate of a direction, `layers.cosine`'s inverse."""
    return 1 - dr.sqrt(dr.maximum(1 - dr.sqrt(mu), 0.0))


def _cell(mu):
    return dr.minimum(mi.UInt32(_coordinate_of(mu) * layers.CELLS), layers.CELLS - 1)


def _spectrum(values):
    """A Spectrum of the values of channels."""
    spectrum = mi.UnpolarizedSpectrum(values[0]) if len(values) == 1 else mi.UnpolarizedSpectrum(*values)
    return mi.mueller.depolarizer(spectrum) if mi.is_polarized else spectrum
