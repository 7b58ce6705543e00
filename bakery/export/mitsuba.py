"""A medium for stock Mitsuba 3: homogeneous, with one `tabphase` table, and what that loses."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass
from xml.sax.saxutils import quoteattr

import numpy as np

from bakery.export import medium_of, scattering_of
from bakery.medium.regular import Loss, adaptive_table, loss
from bakery.store.tree import Group


@dataclass(frozen=True)
class Fragment:
    """One scene fragment.

    Attributes
    ----------
    name : end of the file name, "" or such as "_550nm"
    xml : the text of the file
    values : length of the table
    resampling : Loss of the table against the phase function that it stands for
    colour : wavelength (um) -> Loss of the table against the phase function there, where one table stands for several
    unchanged : 1, largest share of scattered light that keeps its direction and was taken out of sigma_t and phase function
    """

    name: str
    xml: str
    values: int
    resampling: Loss
    colour: dict[float, Loss]
    unchanged: float = 0.0

    def as_dict(self) -> dict:
        """The losses for machines (`--json`)."""
        return {"values": self.values, "unchanged": self.unchanged, "resampling": asdict(self.resampling),
                "wavelengths": [{"wavelength_um": um} | asdict(lost) for um, lost in self.colour.items()]}


def fragments(root: Group, name: str, bands, each: bool = False) -> list[Fragment]:
    """An asset's medium as scene fragments that stock Mitsuba 3 loads.

    Parameters
    ----------
    root : the asset's tree
    name : of the medium, the `id` that scenes refer to
    bands : (3, L) 1, red, green and blue as means over the wavelengths; rows add up to 1
    each : one fragment a wavelength instead of one in colour

    Raises
    ------
    AssetError : there is no medium
    """
    medium = scattering_of(medium_of(root, name))
    um, theta, phase, sigma_t, sigma_s = root["wavelength"].data, medium.theta, medium.phase, medium.sigma_t, medium.sigma_s
    if each:
        return [_fragment(f"{name}_{1e3 * x:.4g}nm", f"_{1e3 * x:.4g}nm", sigma_t[i:i + 1], sigma_s[i:i + 1], theta, phase[i], {},
                          float(medium.unchanged[i]))
                for i, x in enumerate(um)]
    weight = sigma_s if sigma_s.sum() > 0 else np.ones_like(sigma_s)
    mean = np.sum(phase * (weight / weight.sum())[:, None], axis=0)
    if um.size > 1:
        sigma_t, sigma_s = (np.sum(bands * value, axis=1) for value in (sigma_t, sigma_s))
    each_phase = dict(zip(um.tolist(), phase, strict=True)) if um.size > 1 else {}
    return [_fragment(name, "", sigma_t, sigma_s, theta, mean, each_phase, float(medium.unchanged.max()))]


def _fragment(name, suffix, sigma_t, sigma_s, theta, phase, each_phase, unchanged) -> Fragment:
    values, lost = adaptive_table(theta, phase)
    colour = {x: loss(theta, row, values) for x, row in each_phase.items()}
    return Fragment(suffix, _xml(name, sigma_t, sigma_s, values, lost, unchanged), len(values), lost, colour, unchanged)


def _xml(name, sigma_t, sigma_s, values, lost: Loss, unchanged: float) -> str:
    # Mitsuba takes RGB coefficients from 0 to 1 only: `scale` carries the size
    scale = float(sigma_t.max()) or 1.0
    albedo = np.divide(sigma_s, sigma_t, out=np.zeros_like(sigma_t), where=sigma_t > 0)
    table = ",".join(f"{value:.9g}" for value in values.tolist())  # 9 digits: every float32 comes back
    apart = (f"\n     Light that grains leave unchanged (up to {100 * unchanged:.3g} % of what they scatter) is not in it: "
             "sigma_t is smaller\n     than the asset's by that, which is the same medium." if unchanged else "")
    medium_id = quoteattr(re.sub(r"[^A-Za-z0-9_]", "_", name))
    return f"""<?xml version="1.0" encoding="utf-8"?>
<!-- A baked medium for stock Mitsuba 3.  Include it in a scene and refer to the id:
       <include filename="..."/>   <ref name="interior" id={medium_id}/>
     sigma_t times scale is in 1/m: the scene's unit is the metre.  For another, multiply scale by its length in metres.
     The phase function has {len(values)} values over cos theta from -1 (backward) to +1 (forward); against the asset
     {100 * lost.misdirected:.2g} % of the light goes to another angle and the mean cosine is off by {lost.g:.2g}.{apart} -->
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
