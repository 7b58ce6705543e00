"""A homogeneous medium for pbrt-v4."""

import numpy as np

from bakery.export.mixture import identifier
from bakery.export.one_lobe import OneLobe

NM = (360.0, 830.0)  # what pbrt samples (Lambda_min, Lambda_max in its util/spectrum.h)


def pbrt_text(name: str, lobe: OneLobe) -> str:
    """A file for `Include`: a named medium with spectra at the asset's wavelengths.

    pbrt interpolates linearly between the wavelengths and takes 0 outside of them (PiecewiseLinearSpectrum): first and last
    value are repeated at the ends of its range, as Bakery has them.  Its single precision takes 9 digits.
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
    """Pairs of wavelength (nm) and value by wavelength, from one end of pbrt's range to the other."""
    order = np.argsort(um)
    nm, values = 1e3 * um[order], values[order]
    if nm[0] > NM[0]:
        nm, values = np.concatenate([NM[:1], nm]), np.concatenate([values[:1], values])
    if nm[-1] < NM[1]:
        nm, values = np.concatenate([nm, NM[1:]]), np.concatenate([values, values[-1:]])
    return "  ".join(f"{x:.9g} {value:.9g}" for x, value in zip(nm, values, strict=True))
