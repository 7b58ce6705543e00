"""Baked phase function (`bakedphase`).

Looks up the phase function of an asset: an irregular table in s = sin^2(theta/2), sampled exactly.

Parameters
----------
filename : string
    The asset, an HDF5 file with a `medium` group.  Relative paths are searched where Mitsuba searches (beside the scene).
channel : integer
    Position of one wavelength of the asset, from 0; default -1, all of them.
wavelength : float
    One wavelength in um, linear between the asset's tables and clamped; instead of `channel`.

What `channel = -1` means depends on the variant:

============ =============================================================================================================
mono         the mean of the tables, weighted by sigma_s (exact where the asset has one wavelength)
rgb          one table a channel.  A red, a green and a blue wavelength are taken as they are; any other list is averaged
             over 0.58-0.70, 0.50-0.58 and 0.40-0.50 um, linear in wavelength, weighted by sigma_s
spectral     the table at each ray's wavelengths, linear between the asset's, clamped outside
polarized    as spectral; Mueller matrices where the asset has s12, s33, s34, else the phase function depolarises
============ =============================================================================================================

Usage::

    <medium type="homogeneous" name="interior">
        <phase type="bakedphase"> <string name="filename" value="fog.h5"/> </phase>
        ...
    </medium>

With one table pdf and value are equal and the weight is 1.  With several, a direction is drawn from the mean of the tables
in play, and the weight is value / pdf for each channel.  That weight multiplies at every scattering event: for media of
high order it is better to render channel by channel, as the preview does.

Conventions: `mei.wi` points back along the path, so cos(theta) = -dot(wi, wo) and theta = 0 is forward.  Mueller elements
are those of Bohren & Huffman 1983, eq. 4.77: s12 = (|S2|^2 - |S1|^2) / 2, s33 = Re(S1 S2*), s34 = Im(S2 S1*), for
Q = parallel - perpendicular to the scattering plane, scaled as the phase function is.
"""

import drjit as dr
import mitsuba as mi
import numpy as np

from renderers.mitsuba import tables as asset_tables
from renderers.mitsuba.rows import Rows, bands, between, pick


def define():
    """The plugin's class for the variant that is set; its base class is another in every variant."""

    class BakedPhase(mi.PhaseFunction):
        def __init__(self, props):
            self.filename = props["filename"]
            self.tables = asset_tables.load(str(mi.file_resolver().resolve(self.filename))).selected(
                int(props.get("channel", -1)), float(props["wavelength"]) if "wavelength" in props else None, bands())
            self.function = PhaseFunction(self.tables)
            mi.PhaseFunction.__init__(self, props)  # last: Dr.Jit calls whatever has been registered, what is refused too
            self.m_flags = +mi.PhaseFunctionFlags.Anisotropic

        def sample(self, ctx, mei, sample1, sample2, active=True):
            return self.function.sample(mei, sample1, sample2, active)

        def eval_pdf(self, ctx, mei, wo, active=True):
            return self.function.eval_pdf(mei, wo, active)

        def to_string(self):
            return f"BakedPhase[{self.filename}, {len(self.tables)} tables of {self.tables.s.size} angles]"

    return BakedPhase


class PhaseFunction:
    """What the plugin computes, in the variant that is set.

    tables : `renderers.mitsuba.tables.Tables`
    """

    def __init__(self, tables):
        self.tables = tables
        self.rows = Rows(tables)

    def channels(self, mei):
        """(lower row, upper row, weight of the upper) for every channel; one entry where all channels share a table."""
        if len(self.tables) == 1:
            return [(0, 0, 0.0)]
        if not mi.is_spectral:
            return [(row, row, 0.0) for row in range(len(self.tables))]
        places = (between(self.tables.wavelength, mei.wavelengths[k]) for k in range(len(mei.wavelengths)))
        return [(lower, lower + 1, weight) for lower, weight in places]

    def lookup(self, array, channel, i, t, active):
        lower, upper, weight = channel
        f0, f1 = self.rows.pair(array, lower, i, active)
        value = dr.fma(f1 - f0, t, f0)
        if lower is upper or len(self.tables) == 1:
            return value
        f0, f1 = self.rows.pair(array, upper, i, active)
        return dr.lerp(value, dr.fma(f1 - f0, t, f0), weight)

    def evaluate(self, channels, i, t, active):
        """Value of every channel at the place t of interval i, and the density of the sampling there."""
        values = [self.lookup(self.rows.value, channel, i, t, active) for channel in channels]
        return values, sum(values[1:], values[0]) * (1.0 / len(values))

    def spectrum(self, values):
        return mi.UnpolarizedSpectrum(values[0]) if len(values) == 1 else mi.UnpolarizedSpectrum(*values)

    def sample(self, mei, sample1, sample2, active=True):
        channels = self.channels(mei)
        row = 0
        if len(channels) > 1 or channels[0][0] is not channels[0][1]:
            position = sample1 * len(channels)
            chosen = dr.minimum(mi.UInt32(position), len(channels) - 1)
            fraction = position - chosen
            row = mi.UInt32(0)
            for k, (lower, upper, weight) in enumerate(channels):
                row = pick(chosen == k, pick(fraction < weight, mi.UInt32(upper), mi.UInt32(lower)), row)
        i = self.rows.interval(self.rows.cdf, row, sample2.x, active)
        (s0, s1), (below, _) = self.rows.pair(self.rows.s, 0, i, active), self.rows.pair(self.rows.cdf, row, i, active)
        f0, f1 = self.rows.pair(self.rows.value, row, i, active)
        # Stable root of the quadratic cdf: no difference of near-equal numbers for flat or steep intervals.
        start, slope = 4 * np.pi * f0, 4 * np.pi * (f1 - f0)
        c = dr.maximum(sample2.x - below, 0.0) / (s1 - s0)
        root = dr.sqrt(dr.maximum(start * start + 2 * slope * c, 0.0))
        t = dr.minimum(2 * c / dr.maximum(start + root, 1e-30), 1.0)
        s = dr.minimum(dr.fma(s1 - s0, t, s0), 1.0)
        sin_phi, cos_phi = dr.sincos(2 * np.pi * sample2.y)
        sin_theta = 2 * dr.sqrt(s * (1 - s))
        wo = mi.Frame3f(-mei.wi).to_world(mi.Vector3f(sin_theta * cos_phi, sin_theta * sin_phi, 1 - 2 * s))
        values, pdf = self.evaluate(channels, i, t, active)
        inverse = pick(pdf > 0, 1 / dr.maximum(pdf, 1e-30), 0.0)
        return wo, self.coloured(channels, values, inverse, mei.wi, wo, i, t, active), pdf

    def eval_pdf(self, mei, wo, active=True):
        channels = self.channels(mei)
        s = dr.minimum(dr.squared_norm(wo + mei.wi) * 0.25, 1.0)
        i = self.rows.interval(self.rows.s, 0, s, active)
        s0, s1 = self.rows.pair(self.rows.s, 0, i, active)
        t = (s - s0) / (s1 - s0)
        values, pdf = self.evaluate(channels, i, t, active)
        return self.coloured(channels, values, 1.0, mei.wi, wo, i, t, active), pdf

    def coloured(self, channels, values, factor, wi, wo, i, t, active):
        """The values as a Spectrum: colour, or a Mueller matrix in polarized variants."""
        s11 = self.spectrum([value * factor for value in values])
        if not mi.is_polarized:
            return s11
        if self.rows.elements is None:
            return mi.mueller.depolarizer(s11)
        s12, s33, s34 = (self.spectrum([self.lookup(array, channel, i, t, active) * factor for channel in channels])
                         for array in self.rows.elements)
        return _mueller(s11, s12, s33, s34, wi, wo)


def _mueller(s11, s12, s33, s34, wi, wo):
    """The Mueller matrix of scattering from -wi to wo, in the bases that Mitsuba has for these directions."""
    zero = mi.UnpolarizedSpectrum(0.0)
    # Bohren & Huffman's perpendicular axis is -y of Mitsuba's right-handed (x, y, d), so U changes sign and V does not.
    matrix = mi.Spectrum(s11, s12, zero, zero,
                         s12, s11, zero, zero,
                         zero, zero, s33, -s34,
                         zero, zero, s34, s33)
    # Light runs opposite to the camera path.  The axes lie in the scattering plane, where Q is parallel - perpendicular.
    d_in, d_out = -wo, wi
    normal = dr.cross(d_in, d_out)
    flat = dr.squared_norm(normal) < 1e-12  # forward and backward have no plane; any will do there
    normal = dr.normalize(pick(flat, mi.Frame3f(d_in).s, normal))
    return mi.mueller.rotate_mueller_basis(
        matrix, d_in, dr.cross(normal, d_in), mi.mueller.stokes_basis(d_in),
        d_out, dr.cross(normal, d_out), mi.mueller.stokes_basis(d_out))
