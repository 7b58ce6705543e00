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
equations), with what smooth boundaries below it mirror; a rough one by its facets.  A finite layer on nothing looks the same from
both sides, lets scattered light through, and unscattered light straight on (`DeltaTransmission`, at the same place: the layer has
no thickness here).  Layers on each other over air do so too, and look different from below.  Any other layer is black from
behind; `twosided` would give it a second face.

`renderers.mitsuba.layer_values` looks values up, `layer_samples` draws directions, `two_faces` tells both sides apart.
"""

import mitsuba as mi

from renderers.mitsuba import layers
from renderers.mitsuba.two_faces import surface_of


def define():
    """The plugin's class for the variant that is set; its base class is another in every variant."""

    class BakedBSDF(mi.BSDF):
        def __init__(self, props):
            self.filename = props["filename"]
            layer = layers.load(str(mi.file_resolver().resolve(self.filename)), int(props.get("layer", 0)))
            self.surface = surface_of(layer, int(props.get("channel", -1)),
                                      float(props["wavelength"]) if "wavelength" in props else None)
            mi.BSDF.__init__(self, props)  # last: Dr.Jit calls whatever has been registered, what is refused too
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
