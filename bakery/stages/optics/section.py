"""Recipe sections `particles` and `phase`: suspended spheres, and options of their single scattering."""

# no annotations from __future__: pydantic would have to compile each of them again, some 3 ms in all
import json
from typing import TYPE_CHECKING

from pydantic import Field

from bakery.grammar.fields import AUTO, ComponentName, Flag, Share, number, whole, word
from bakery.grammar.section import HostOf, MaterialOf, Section, given
from bakery.grammar.text import Mapping, Scalar, mappings
from bakery.stages.declaration import RecipeSection
from bakery.stages.optics.amounts import (
    AMOUNTS,
    DENSITY_KEY,
    Density,
    MassConcentration,
    NumberDensity,
    VolumeConcentration,
    VolumeFraction,
    amount_fields,
    check_amounts,
)
from bakery.stages.optics.layers import Coating, Growth, RelativeHumidity, check_layers
from bakery.stages.optics.size_keys import Size, check_size

if TYPE_CHECKING:
    from bakery.recipe.checker import Checker

_OF_ALL, _OF_EACH = amount_fields("Spheres"), amount_fields("Its spheres")


# keys of particles -> of a medium that a file gives, which has neither sizes nor indices
_OF_A_FILE = {"file": "file", "mass_concentration": "mass_concentration", "number_density": "number_density",
              "effective_radius": "effective_radius", "humidity": "humidity", "relative_humidity": "humidity"}


def _as_medium(*sections: Mapping) -> tuple[str, str, str]:
    """What is said of a file of optical properties as particles: the line that takes it."""
    texts = {_OF_A_FILE[key]: _flow(node.text) for section in sections for key, node in section.items()
             if key in _OF_A_FILE and isinstance(node, Scalar)}
    line = ", ".join(f"{key}: {text}" for key, text in ({"file": "FILE"} | texts).items())
    return ("file", "found a file of optical properties, which has no sizes of particles",
            f"expected it as a medium instead of particles, medium: {{{line}}}")


def _flow(text: str) -> str:
    """A text as it stands between the braces of a mapping."""
    return text if text and not set(text) & set(",[]{}#:\"'") and text == text.strip() else json.dumps(text, ensure_ascii=False)


class Component(Section):
    name: ComponentName = Field(description="Name of the group in the asset.")
    material: MaterialOf = Field(description="A material of assets/materials, {n, k}, {file}, or {mixing}.")
    fraction: Share = Field(1.0, description="Share of the particle number; the shares of all components add up to 1.")
    size: Size = Field(description="Distribution of the radii.")
    number_density: NumberDensity = _OF_EACH["number_density"]
    volume_fraction: VolumeFraction = _OF_EACH["volume_fraction"]
    volume_concentration: VolumeConcentration = _OF_EACH["volume_concentration"]
    mass_concentration: MassConcentration = _OF_EACH["mass_concentration"]
    density: Density = DENSITY_KEY
    coating: Coating | None = Field(None, description="A concentric shell; the sizes are those of the cores.")
    growth: Growth | None = Field(None, description="Water taken up from humid air; sizes and amounts are of dry particles.")

    @classmethod
    def elsewhere(cls, section: Mapping) -> tuple[str, str, str] | None:
        if "file" not in section or "size" in section or "material" in section:
            return None  # the file of a size or of a material, a level too high
        return _as_medium(*mappings(section.parent and section.parent.parent), section)


class Particles(Section):
    """Suspended spheres."""

    host: HostOf = Field("air", description="Medium around the spheres: a material, {n}, or {file}.")
    number_density: NumberDensity = _OF_ALL["number_density"]
    volume_fraction: VolumeFraction = _OF_ALL["volume_fraction"]
    volume_concentration: VolumeConcentration = _OF_ALL["volume_concentration"]
    mass_concentration: MassConcentration = _OF_ALL["mass_concentration"]
    relative_humidity: RelativeHumidity = Field(None, description="Relative humidity of the air, 0 to below 100 %.")
    components: list[Component] = Field(min_length=1, max_length=256, description="The kinds of particles.")

    @classmethod
    def elsewhere(cls, section: Mapping) -> tuple[str, str, str] | None:
        return _as_medium(section) if "file" in section else None


class SingleScattering(Section):
    """Options of the single-scattering stage."""

    method: word("auto", "mie", "goa") = Field(
        "auto", description="How spheres are computed: series (mie), rays for the large ones (goa), or rays if they are "
        "measured to be accurate enough and save time (auto)."
    )
    orders: whole(0, 50) = Field(3, description="Rays: highest number of chords.")
    polarized: Flag = Field(False, description="Also bake the Mueller elements s11, s12, s33, s34.")
    switch: number(least=30, most=1e8, words=AUTO) = Field("auto", description="Size parameter from which method goa uses rays.")
    edge: word("narrow", "wide", "none") = Field("narrow", description="Rays: window of exact waves at the edge of a sphere.")
    rainbow: Flag = Field(True, description="Rays: the uniform formula at rainbows.")
    axis: Flag = Field(True, description="Rays: the uniform formula at 0 and 180 degrees.")
    radii: whole(3, 10**6, words=AUTO) = Field("auto", description="Number of sizes, whatever the error.")
    angles: whole(3, 10**6, words=AUTO) = Field("auto", description="Number of angles, whatever the error.")


# ---- what holds between the keys


def check_particles(checker: "Checker", section: Mapping) -> None:
    """Amounts, shares, optical constants and sizes of suspended spheres."""
    parts = checker.components(section)
    if any(part.model and part.model.elsewhere(part) for part in (section, *parts)):
        return
    host = checker.host(section, "air")
    check_amounts(checker, section, parts)
    check_layers(checker, section, parts, host)
    of = section.get("components")
    if parts and len(parts) == len(of) and not any(given(part, *AMOUNTS) for part in parts):
        checker.shares(of, "fraction", parts, 1.0)
    for part in parts:
        checker.index(part, "material")
        for size in mappings(part.get("size")):
            check_size(checker, size, host)


def check_phase(checker: "Checker", section: Mapping) -> None:
    """Options of single scattering stand beside particles, and a switch to rays beside rays."""
    beside = [name for name in checker.scattering if name in checker.tree]
    if beside and "particles" not in beside:
        checker.report_section(section, f"found options of single scattering beside {beside[0]}",
                               "expected them with particles only" + (" (medium.phase?)" if "medium" in beside else ""))
    if checker.value(section, "switch") not in ("auto", None) and checker.value(section, "method") != "goa":
        checker.report(section["switch"], "found a size parameter for the switch to rays with another method than goa",
                       "expected method: goa beside it, or switch: auto")


PARTICLES = RecipeSection("particles", Particles, "Suspended spheres: fog, dust, bubbles.", check_particles, scatters=True)
PHASE = RecipeSection("phase", SingleScattering, "Options of the single-scattering stage.", check_phase, beside="particles")
