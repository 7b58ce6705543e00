"""A medium for stock Mitsuba 3: homogeneous, with one `tabphase` table, and what that loses."""

import math
import re
from dataclasses import asdict, dataclass, replace
from xml.sax.saxutils import quoteattr

import numpy as np

from bakery.export.medium import Scattering, medium_of, scattering_of, without_peak
from bakery.physics.medium.regular import Loss, adaptive_table, loss, regular_table
from bakery.store.tree import Group

LIMIT = 1e-3  # of the light to another angle by the regular grid
LONGEST = 17  # power of two of the longest table: 1.8 MB of text.  Eight times as many left drizzle at 20 % of the light
WIDEST = math.radians(10)  # light that is deflected by more always counts as scattered
USELESS = 0.05  # of the light to another angle: an export that loses more says so first


@dataclass(frozen=True)
class Fragment:
    """One scene fragment."""

    name: str  # end of the file name, "" or such as "_550nm"
    xml: str  # the text of the file
    values: int  # length of the table
    resampling: Loss  # of the table against the phase function that it stands for
    # wavelength (um) -> Loss of the table against the phase function there, where one table stands for several
    colour: dict[float, Loss]
    delta: float = 0.0  # 1, largest forward delta, a share of the scattered light; it was taken out of sigma_t and phase function
    # peak, within: 1, rad: largest share of the rest in the forward peak within the angle, which no table of this length
    # resolves; it counts as unscattered and was taken out likewise
    peak: float = 0.0
    within: float = 0.0

    def useless(self) -> str:
        """What makes the fragment a poor stand-in for the asset, in words; "" where nothing does."""
        if self.resampling.misdirected > USELESS:
            return f"its table sends {100 * self.resampling.misdirected:.2g} % of the light to another angle"
        worst = max(self.colour, key=lambda um: self.colour[um].misdirected, default=None)
        if worst is not None and self.colour[worst].misdirected > USELESS:
            return (f"its one table sends {100 * self.colour[worst].misdirected:.2g} % of the light at {worst:g} um to another "
                    "angle; use --each-wavelength")
        return ""

    def as_dict(self) -> dict:
        """The losses for machines (`--json`)."""
        return {"values": self.values, "unscattered": self.delta, "peak": self.peak, "within": self.within,
                "useless": self.useless(), "resampling": asdict(self.resampling),
                "wavelengths": [{"wavelength_um": um} | asdict(misfit) for um, misfit in self.colour.items()]}


def fragments(root: Group, name: str, bands, each_wavelength: bool = False) -> list[Fragment]:
    """An asset's medium as scene fragments that stock Mitsuba 3 loads.

    name : of the medium, the `id` that scenes refer to
    bands : (3, L) 1, red, green and blue as means over the wavelengths; rows add up to 1
    each_wavelength : one fragment a wavelength instead of one in colour

    Raises AssetError : there is no medium
    """
    medium, um = scattering_of(medium_of(root, name)), root["wavelength"].data
    if each_wavelength:
        slices = [slice(i, i + 1) for i in range(um.size)]
        return [_fragment(f"{name}_{1e3 * x:.4g}nm", f"_{1e3 * x:.4g}nm", um[rows], medium.at(rows), np.ones((1, 1)))
                for x, rows in zip(um, slices, strict=True)]
    return [_fragment(name, "", um, medium, bands if um.size > 1 else np.ones((1, 1)))]


def _fragment(name, suffix, um, medium, bands) -> Fragment:
    medium = _resolved(medium)
    values, resampling = adaptive_table(medium.theta, _mean(medium), LIMIT, largest=LONGEST)
    colour = {x: loss(medium.theta, row, values) for x, row in zip(um.tolist(), medium.phase, strict=True)} if um.size > 1 else {}
    fragment = Fragment(suffix, "", len(values), resampling, colour, *(float(value) for value in
                                                                       (medium.delta.max(), medium.peak.max(), medium.within)))
    return replace(fragment, xml=_xml(name, bands @ medium.sigma_t, bands @ medium.sigma_s, values, fragment))


def _mean(medium: Scattering):
    """(A,) 1/sr, the phase function of all wavelengths together, weighted by scattering."""
    weight = medium.sigma_s if medium.sigma_s.sum() > 0 else np.ones_like(medium.sigma_s)
    return np.sum(medium.phase * (weight / weight.sum())[:, None], axis=0)


def _resolved(medium: Scattering) -> Scattering:
    """The medium without as much of its forward peak as the longest table cannot hold: by the narrowest cut that is enough."""
    def enough(end: int) -> bool:
        phase = _mean(without_peak(medium, end))
        return loss(medium.theta, phase, regular_table(medium.theta, phase, 2**LONGEST + 1)).misdirected <= LIMIT

    low, high = 0, int(np.searchsorted(medium.theta, WIDEST))
    if enough(low):
        return medium
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle, high)
    return without_peak(medium, high)


def _xml(name, sigma_t, sigma_s, values, fragment: Fragment) -> str:
    # Mitsuba takes RGB coefficients from 0 to 1 only: `scale` carries the size
    scale = float(sigma_t.max()) or 1.0
    albedo = np.divide(sigma_s, sigma_t, out=np.zeros_like(sigma_t), where=sigma_t > 0)
    table = ",".join(f"{value:.9g}" for value in values.tolist())  # 9 digits: every float32 comes back
    lost = ("\n     The unscattered (delta) transmission of the grains (up to "
            f"{100 * fragment.delta:.3g} % of what they scatter) is not in it:\n     sigma_t is smaller than the asset's "
            "by that, which is the same medium." if fragment.delta else "")
    if fragment.peak:
        lost += (f"\n     Of the rest, up to {100 * fragment.peak:.3g} % is deflected by less than "
                 f"{math.degrees(fragment.within):.3g} degrees.  It counts as unscattered:\n     sigma_t is "
                 "smaller by that as well.")
    misfit = fragment.resampling
    medium_id = quoteattr(re.sub(r"[^A-Za-z0-9_]", "_", name))
    return f"""<?xml version="1.0" encoding="utf-8"?>
<!-- A baked medium for stock Mitsuba 3.  Include it in a scene and refer to the id:
       <include filename="..."/>   <ref name="interior" id={medium_id}/>
     sigma_t times scale is in 1/m: the scene's unit is the metre.  For another, multiply scale by its length in metres.
     The phase function has {len(values)} values over cos theta from -1 (backward) to +1 (forward); against the asset
     {100 * misfit.misdirected:.2g} % of the light goes to another angle and the mean cosine is off by {misfit.g:.2g}.{lost} -->
<scene version="3.0.0">
    <medium type="homogeneous" id={medium_id}>
        {_coefficient("sigma_t", sigma_t / scale)}
        {_coefficient("albedo", np.clip(albedo, 0, 1))}
        <float name="scale" value="{scale!r}"/>
        <phase type="tabphase">
            <string name="values" value="{table}"/>
        </phase>
    </medium>
</scene>
"""


def _coefficient(name: str, value) -> str:
    if value.size == 1:
        return f'<float name="{name}" value="{float(value[0])!r}"/>'
    return f'<rgb name="{name}" value="{", ".join(repr(float(x)) for x in value)}"/>'
