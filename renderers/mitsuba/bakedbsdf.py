"""Baked surface (`bakedbsdf`).

Looks up how a plane layer of an asset's medium sends light back and lets it through: the stage `surface`.

Parameters
----------
filename : string
    The asset, an HDF5 file with a `surface` group.  Relative paths are searched where Mitsuba searches (beside the scene).
layer : integer
    Position of the thickness among those of the asset, from 0; default 0.
channel : integer
    Position of one wavelength of the asset, from 0; default -1, all of them.
wavelength : float
    One wavelength in um, linear between the asset's and clamped; instead of `channel`.

What `channel = -1` means depends on the variant:

============ =============================================================================================================
mono         the mean over the wavelengths
rgb          a red, a green and a blue wavelength are taken as they are; any other list is averaged over 0.58-0.70,
             0.50-0.58 and 0.40-0.50 um, linear in wavelength
spectral     at each ray's wavelengths, linear between the asset's, clamped outside
polarized    as spectral; light leaves without polarisation
============ =============================================================================================================

Usage::

    <bsdf type="bakedbsdf"> <string name="filename" value="white_paint.h5"/> <integer name="layer" value="1"/> </bsdf>

Light that is scattered once, the boundary and the base are exact at every angle; light that is scattered more often is linear
between the nodes of a grid, within 0.2 % where 96 nodes reach that.  A smooth boundary mirrors light in one direction (Fresnel's
equations); a rough one by its facets.  A finite layer on nothing looks the same from both sides, lets scattered light through,
and unscattered light straight on (`DeltaTransmission`, at the same place: the layer has no thickness here).  Any other layer is
black from behind; `twosided` would give it a second face.

Lobes are chosen by the light that each sends on, the mean of all wavelengths, the mirror by the root of that; within those that
are scattered directions come from a table of 32 cells a side (`renderers.mitsuba.layers`), from facets of a rough boundary by the
normals that are seen.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from renderers.mitsuba import layers
from renderers.mitsuba.rows import pick

_LEAST = 1e-6  # cosine; single precision has no smaller ones to add to
MIRROR, STRAIGHT, FACETS, REFLECTED, TRANSMITTED = range(5)


def define():
    """The plugin's class for the variant that is set; its base class is another in every variant."""

    class BakedBSDF(mi.BSDF):
        def __init__(self, props):
            mi.BSDF.__init__(self, props)
            self.filename = props["filename"]
            layer = layers.load(str(mi.file_resolver().resolve(self.filename)), int(props.get("layer", 0)))
            self.surface = Surface(layer, int(props.get("channel", -1)),
                                   float(props["wavelength"]) if "wavelength" in props else None)
            self.m_components, self.m_flags = self.surface.flags, self.surface.all_flags

        def sample(self, ctx, si, sample1, sample2, active=True):
            return self.surface.sample(ctx, si, sample1, sample2, active)

        def eval(self, ctx, si, wo, active=True):
            return self.surface.eval_pdf(ctx, si, wo, active)[0]

        def pdf(self, ctx, si, wo, active=True):
            return self.surface.eval_pdf(ctx, si, wo, active)[1]

        def eval_pdf(self, ctx, si, wo, active=True):
            return self.surface.eval_pdf(ctx, si, wo, active)

        def to_string(self):
            return f"BakedBSDF[{self.filename}, {len(self.surface.layer.wavelength)} wavelengths]"

    return BakedBSDF


class _Pair(NamedTuple):
    """Two directions, as a layer sees them.

    mu, mu0 : cosines in air, positive;  inner, inner0 : in the medium;  sines : product of the sines in the medium times the
    cosine of the azimuth between the directions of travel;  cos_phi : that;  reflects : whether both are on one side
    """

    mu: object
    mu0: object
    inner: object
    inner0: object
    sines: object
    cos_phi: object
    reflects: object


class Surface:
    """What the plugin computes, in the variant that is set.

    layer : `layers.Layer`;  channel, wavelength : of the plugin's parameters
    """

    def __init__(self, layer, channel=-1, wavelength=None):
        bands = "mono" if mi.is_monochromatic else "rgb" if mi.is_rgb else "spectral"
        self.layer, self._channels = layers.selected(layer, channel, wavelength, bands)
        table = self.layer.table
        self.index, self.rough, self.roughness, self.free = table.index, self.layer.rough, table.roughness, table.free
        self._finite, self._based = bool(np.isfinite(table.depth).any()), bool(np.any(table.base > 0))
        self._jit = dr.is_jit_v(mi.Float)
        self._nodes, self._azimuths = table.reflected.shape[1], table.reflected.shape[3]
        self._size = table.reflected[0].size  # of a row
        self._grid = self._held(np.concatenate([table.reflected.ravel(), table.transmitted.ravel()]))
        self._behind = table.reflected.size  # where transmitted light begins
        steps = 1 << math.ceil(math.log2(len(table.s)))
        self._halves, self._angles = steps // 2, len(table.s)
        self._s = self._held(np.concatenate([table.s, np.full(steps - len(table.s) + 1, 2.0)]))
        self._phase = self._held(table.phase)
        self._depth, self._once, self._peak, self._base = (
            self._held(values) for values in (table.depth, table.once, table.peak, table.base))
        self._cells = cells = layers.cells_of(self.layer)
        self._below_mu, self._below_phi, self._density = map(self._held, (cells.below_mu, cells.below_phi, cells.density))
        self._mu2, self._phi, self._shares = map(self._held, (cells.mu**2, cells.phi, cells.shares))
        self.flags, self._lobes = self._declared()
        self.all_flags = 0
        for flags in self.flags:
            self.all_flags = self.all_flags | flags

    def _declared(self):
        """Flags of the components, and of each lobe (`MIRROR` to `TRANSMITTED`) its component, None where there is none."""
        kinds = mi.BSDFFlags
        sides = kinds.FrontSide | kinds.BackSide if self.free else +kinds.FrontSide
        wanted = {MIRROR: (kinds.DeltaReflection, self.layer.mirrors), STRAIGHT: (kinds.DeltaTransmission, self.free),
                  FACETS: (kinds.GlossyReflection, self.rough), REFLECTED: (kinds.GlossyReflection, True),
                  TRANSMITTED: (kinds.GlossyTransmission, self.free)}
        present = [lobe for lobe, (_, needed) in wanted.items() if needed]
        if self.rough:  # one component: facets and medium have one value
            present.remove(FACETS)
        lobes = {lobe: present.index(lobe) if lobe in present else None for lobe in wanted}
        if self.rough:
            lobes[FACETS] = lobes[REFLECTED]
        return [wanted[lobe][0] | sides for lobe in present], lobes

    def _held(self, values):
        values = np.asarray(values, float).ravel()
        return mi.Float(values.astype(np.float32)) if self._jit else values.tolist()

    def _at(self, array, index, active=True):
        """Entries of what is held; a number that is known is read here and now."""
        return dr.gather(mi.Float, array, index, active) if self._jit else array[int(index)]

    # ---- directions

    def pair(self, wi, wo):
        mu0, mu = dr.clip(dr.abs(wi.z), _LEAST, 1.0), dr.clip(dr.abs(wo.z), _LEAST, 1.0)
        across = -(wi.x * wo.x + wi.y * wo.y)
        sines = dr.sqrt((wi.x * wi.x + wi.y * wi.y) * (wo.x * wo.x + wo.y * wo.y))
        cos_phi = pick(sines > 1e-12, dr.clip(across / dr.maximum(sines, 1e-12), -1.0, 1.0), 0.0)
        return _Pair(mu, mu0, self._inside(mu), self._inside(mu0), across / self.index**2, cos_phi, wi.z * wo.z > 0)

    def _inside(self, mu):
        if self.index == 1.0 or self.rough:
            return mu
        return dr.sqrt(dr.maximum((self.index - 1) * (self.index + 1) + mu * mu, 0.0)) / self.index

    def fresnel(self, mu, inner):
        """Share that a boundary reflects; cosines outside and inside."""
        if self.index == 1.0:
            return mu * 0.0
        n = self.index
        across, along = (mu - n * inner) / (mu + n * inner), (n * mu - inner) / (n * mu + inner)
        return pick(inner > 0, 0.5 * (across * across + along * along), 1.0)

    # ---- values

    def rows(self, si):
        """[(row, weight), ...] of each channel; rows are numbers or UInt32 arrays."""
        if self._channels:
            return self._channels
        knots = [1e3 * wavelength for wavelength in self.layer.wavelength]
        if len(knots) == 1:
            return [[(0, 1.0)]]
        return [self._between(knots, si.wavelengths[k]) for k in range(len(si.wavelengths))]

    def _between(self, knots, wavelength):
        lower, weight = mi.UInt32(0), mi.Float(0.0)
        for row, (lower_knot, upper_knot) in enumerate(zip(knots, knots[1:], strict=False)):
            inside = wavelength >= lower_knot
            lower = pick(inside, mi.UInt32(row), lower)
            weight = pick(inside, dr.clip((wavelength - lower_knot) / (upper_knot - lower_knot), 0.0, 1.0), weight)
        return [(lower, 1 - weight), (lower + 1, weight)]

    def _coordinate(self, mu, inner):
        s = mu if self.index > 1 and not self.rough else dr.sqrt(inner)
        x = (1 - dr.sqrt(dr.maximum(1 - s, 0.0))) * (self._nodes - 1)
        node = dr.minimum(mi.UInt32(x), self._nodes - 2)
        return node, x - node

    def values(self, channels, pair, active):
        """pi times BRDF or BTDF of each channel, without light that goes on in single directions; facets included."""
        (i, x), (j, y) = self._coordinate(pair.mu, pair.inner), self._coordinate(pair.mu0, pair.inner0)
        z = _azimuth(pair.cos_phi) * (self._azimuths - 1)
        k = dr.minimum(mi.UInt32(z), self._azimuths - 2)
        z = z - k
        cell = (i * self._nodes + j) * self._azimuths + k
        if self.free:
            cell = cell + pick(pair.reflects, mi.UInt32(0), mi.UInt32(self._behind))
        corners = [(cell + (a * self._nodes + b) * self._azimuths, (x if a else 1 - x) * (y if b else 1 - y))
                   for a in range(2) for b in range(2)]

        def smooth(row):
            total = 0.0
            for corner, weight in corners:
                below, above = (self._at(self._grid, corner + row * self._size + step, active) for step in (0, 1))
                total = total + weight * dr.fma(above - below, z, below)
            return total

        if self.rough:
            facets = self._of_facets(pair)
            values = {}
            return [self._summed(channel, values, lambda row: smooth(row) + facets) for channel in channels]
        through = (1 - self.fresnel(pair.mu, pair.inner)) * (1 - self.fresnel(pair.mu0, pair.inner0)) / self.index**2
        step, t = self._angle(pair, active)
        values = {}

        def layer(row):
            phase = self._at(self._phase, step + row * self._angles, active)
            phase = dr.fma(self._at(self._phase, step + row * self._angles + 1, active) - phase, t, phase)
            once = self._at(self._once, row + mi.UInt32(0), active) * phase
            return pick(through > 0, through * self._sent(row, pair, smooth(row), once, active), 0.0)

        return [self._summed(channel, values, layer) for channel in channels]

    def _summed(self, channel, values, function):
        """Of a channel; rows that are numbers are computed once."""
        total = None
        for row, weight in channel:
            if isinstance(row, int) and row in values:
                value = values[row]
            else:
                value = function(row)
                if isinstance(row, int):
                    values[row] = value
            total = value * weight if total is None else total + value * weight
        return total

    def _sent(self, row, pair, smooth, once, active):
        """Reflectance or transmittance inside of the boundary, from what is smooth and what is scattered once."""
        total = pair.inner + pair.inner0
        if not self._finite:
            return (smooth + once) / total
        depth = self._at(self._depth, row + mi.UInt32(0), active)
        x, x0 = 1 / dr.maximum(pair.inner, _LEAST), 1 / dr.maximum(pair.inner0, _LEAST)
        stopped, stopped0 = _stopped(depth * x), _stopped(depth * x0)
        on_both = stopped + stopped0 - stopped * stopped0
        result = (smooth * stopped * stopped0 + once * on_both) / total
        if self._based:
            result = result + self._at(self._base, row + mi.UInt32(0), active) * (1 - on_both)
        if not self.free:
            return result
        rate = depth * dr.abs(x - x0)
        mean = pick(rate > 1e-6, _stopped(rate) / dr.maximum(rate, 1e-6), 1.0)
        direct = x * x0 * depth * (1 - dr.minimum(stopped, stopped0)) * mean
        return pick(pair.reflects, result, smooth * stopped * stopped0 / total + once * direct)

    def _angle(self, pair, active):
        """Interval of the scattering angle, and its share of it: s = sin^2(theta / 2) by differences of the directions."""
        sides = pair.inner + pair.inner0
        if self.free:
            sides = pick(pair.reflects, sides, pair.inner - pair.inner0)
        squares = (2 - pair.mu * pair.mu - pair.mu0 * pair.mu0) / self.index**2 - 2 * pair.sines
        s = dr.clip(0.25 * (sides * sides + squares), 0.0, 1.0)
        step, half = mi.UInt32(0), self._halves
        while half:
            step = step + pick(self._at(self._s, step + half, active) <= s, mi.UInt32(half), mi.UInt32(0))
            half //= 2
        step = dr.minimum(step, self._angles - 2)
        below = self._at(self._s, step, active)
        return step, dr.clip((s - below) / (self._at(self._s, step + 1, active) - below), 0.0, 1.0)

    def _of_facets(self, pair):
        """R of light that facets reflect once (GGX, Smith's shadowing)."""
        doubled = pair.mu * pair.mu0 - pair.sines * self.index**2
        onto = dr.sqrt(dr.maximum(0.5 * (1 + doubled), 1e-12))
        upright = dr.minimum(0.5 * (pair.mu + pair.mu0) / onto, 1.0)
        square = self.roughness**2
        spread = (square - 1) * upright * upright + 1
        seen = 4 / ((1 + dr.sqrt(1 + square * (1 / (pair.mu * pair.mu) - 1)))
                    * (1 + dr.sqrt(1 + square * (1 / (pair.mu0 * pair.mu0) - 1))))
        inner = dr.sqrt(dr.maximum((self.index - 1) * (self.index + 1) + onto * onto, 0.0)) / self.index
        return seen * self.fresnel(onto, inner) * square / (spread * spread) / (4 * pair.mu * pair.mu0)

    def single(self, channels, mu, active):
        """Mirrored and unscattered light of each channel, which go on in single directions."""
        inner = self._inside(mu)
        front = self.fresnel(mu, inner) if self.layer.mirrors else mu * 0.0
        if not self.free:
            return [front for _ in channels], [mu * 0.0 for _ in channels]
        values = {}

        def of_row(row):
            x = 1 / dr.maximum(inner, _LEAST)
            passes = dr.exp(-self._at(self._depth, row + mi.UInt32(0), active) * x)
            down = (1 - front) ** 2 * passes / dr.maximum(1 - (front * passes) ** 2, 1e-9)
            # light of the peak is counted as scattered
            unscattered = dr.maximum(1 - self._at(self._peak, row + mi.UInt32(0), active) * x, 0.0)
            return mi.Vector2f(pick(inner > 0, down * front * passes, 0.0), pick(inner > 0, down * unscattered, 0.0))

        sums = [self._summed(channel, values, of_row) for channel in channels]
        return [front + part.x for part in sums], [part.y for part in sums]

    # ---- the plugin's methods

    def _chances(self, ctx, channels, wi, active):
        """Of the lobes, in all at most 1, and the mirrored and unscattered light of each channel."""
        mu = dr.clip(dr.abs(wi.z), _LEAST, 1.0)
        mirrored, straight = self.single(channels, mu, active)
        last = self._cells.shares.shape[1] - 1
        x = _coordinate_of(mu) * last
        node = dr.minimum(mi.UInt32(x), last - 1)
        x = x - node
        reflected, transmitted, facets = (
            dr.lerp(self._at(self._shares, node + part * (last + 1), active),
                    self._at(self._shares, node + part * (last + 1) + 1, active), x) for part in range(3))
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
        row, cell, turn = _cell(pair.mu0), _cell(pair.mu), dr.minimum(mi.UInt32(_azimuth(pair.cos_phi) * layers.CELLS),
                                                                      layers.CELLS - 1)
        cell = (row * layers.CELLS + cell) * layers.CELLS + turn
        side = pick(pair.reflects, mi.UInt32(0), mi.UInt32(layers.CELLS**3))
        chance = pick(pair.reflects, chances[REFLECTED], chances[TRANSMITTED])
        return chance * self._at(self._density, cell + side) * pair.mu

    def _facets_density(self, wi, wo):
        normal = dr.normalize(wi + wo)
        facets = mi.MicrofacetDistribution(mi.MicrofacetType.GGX, self.roughness)
        return facets.pdf(wi, normal) / dr.maximum(4 * dr.dot(wo, normal), 1e-9)

    def _density_of(self, chances, wi, wo, pair):
        density = self._drawn_density(chances, pair)
        if self.rough:
            density = density + chances[FACETS] * self._facets_density(wi, wo)
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
        types = {MIRROR: mi.BSDFFlags.DeltaReflection, STRAIGHT: mi.BSDFFlags.DeltaTransmission,
                 FACETS: mi.BSDFFlags.GlossyReflection, REFLECTED: mi.BSDFFlags.GlossyReflection,
                 TRANSMITTED: mi.BSDFFlags.GlossyTransmission}
        for number, flags in types.items():
            kind = pick(lobe == number, mi.UInt32(int(flags)), kind)
            component = pick(lobe == number, mi.UInt32(self._lobes[number] or 0), component)
        sample.sampled_type, sample.sampled_component = kind, component
        return sample

    def _scattered(self, wi, side, sample2, active):
        """A direction by the cells, on the side of `wi` (side 0) or on the other (1)."""
        count = layers.CELLS
        table = side * count + _cell(dr.clip(dr.abs(wi.z), _LEAST, 1.0))
        first, share = self._halved(self._below_mu, table * (count + 1), sample2.x, active)
        square = dr.lerp(self._at(self._mu2, first, active), self._at(self._mu2, first + 1, active), share)
        mirrored = sample2.y < 0.5
        second, share = self._halved(self._below_phi, (table * count + first) * (count + 1),
                                     2 * sample2.y - pick(mirrored, 0.0, 1.0), active)
        phi = dr.lerp(self._at(self._phi, second, active), self._at(self._phi, second + 1, active), share)
        sine_phi, cos_phi = dr.sincos(pick(mirrored, -phi, phi))
        sine, mu = dr.sqrt(dr.maximum(1 - square, 0.0)), dr.sqrt(dr.maximum(square, _LEAST**2))
        across = dr.sqrt(wi.x * wi.x + wi.y * wi.y)
        flat = across < 1e-6
        x, y = (pick(flat, along, -part / dr.maximum(across, 1e-6)) for part, along in ((wi.x, 1.0), (wi.y, 0.0)))
        up = pick((wi.z > 0) != (side == 1), mu, -mu)
        return mi.Vector3f(sine * (cos_phi * x - sine_phi * y), sine * (sine_phi * x + cos_phi * y), up)

    def _halved(self, array, start, u, active):
        """Cell of a number in a cumulative table, and its share of it."""
        cell, half = mi.UInt32(0), layers.CELLS // 2
        while half:
            cell = cell + pick(self._at(array, start + cell + half, active) <= u, mi.UInt32(half), mi.UInt32(0))
            half //= 2
        below, above = self._at(array, start + cell, active), self._at(array, start + cell + 1, active)
        return cell, dr.clip((u - below) / dr.maximum(above - below, 1e-12), 0.0, 1.0)


def _azimuth(cos_phi):
    """Coordinate of an azimuth, `layers.azimuth`'s inverse."""
    return 0.5 * (1 + dr.sqrt(dr.maximum(0.5 - 0.5 * cos_phi, 0.0)) - dr.sqrt(dr.maximum(0.5 + 0.5 * cos_phi, 0.0)))


def _coordinate_of(mu):
    """Coordinate of a direction, `layers.cosine`'s inverse."""
    return 1 - dr.sqrt(dr.maximum(1 - dr.sqrt(mu), 0.0))


def _cell(mu):
    return dr.minimum(mi.UInt32(_coordinate_of(mu) * layers.CELLS), layers.CELLS - 1)


def _stopped(x):
    """1 - exp(-x), to single precision where x is small, too."""
    return pick(x < 0.01, x * (1 - x * (0.5 - x * (1 / 6))), 1 - dr.exp(-x))


def _spectrum(values):
    """A Spectrum of the values of channels."""
    spectrum = mi.UnpolarizedSpectrum(values[0]) if len(values) == 1 else mi.UnpolarizedSpectrum(*values)
    return mi.mueller.depolarizer(spectrum) if mi.is_polarized else spectrum
