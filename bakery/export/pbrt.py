"""A homogeneous medium for pbrt-v4."""

from __future__ import annotations

import numpy as np

from bakery.export.mixture import identifier
from bakery.export.one_lobe import OneLobe


def pbrt_text(name: str, lobe: OneLobe) -> str:
    """A file for `Include`: a named medium with spectra at the asset's wavelengths.

    Parameters
    ----------
    name : of the medium
    lobe : the medium

    Notes
    -----
    pbrt interpolates linearly between the wavelengths and keeps the first and last value outside of them
    (`PiecewiseLinearSpectrum::FromInterleaved`), as Bakery does.  Its single precision takes 9 digits.
    """
    medium = identifier(name)
    remarks = "\n".join(f"# {line}" for line in lobe.remarks())
    return f"""# A baked medium for pbrt-v4.  In a scene, before its shapes:
#   Include "..."
#   AttributeBegin
#     MediumInterface "{medium}" ""
#     Material "interface"
#     Shape "sphere" "float radius" 1
#   AttributeEnd
# sigma_a and sigma_s are in 1/m, wavelengths in nm: the scene's unit is the metre.  For another, set scale to its length
# in metres.
{remarks}
MakeNamedMedium "{medium}"
    "string type" "homogeneous"
    "spectrum sigma_a" [ {_spectrum(lobe.um, lobe.sigma_a)} ]
    "spectrum sigma_s" [ {_spectrum(lobe.um, lobe.sigma_s)} ]
    "float g" {lobe.g:.9g}
    "float scale" 1
"""


def _spectrum(um, values) -> str:
    """Pairs of wavelength (nm) and value by wavelength."""
    return "  ".join(f"{1e3 * um[i]:.9g} {values[i]:.9g}" for i in np.argsort(um))
