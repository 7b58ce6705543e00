"""How many particles there are: by number, by volume or by mass, of all together or of each component."""

# no annotations from __future__: pydantic would have to compile each of them again, some 3 ms in all
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from bakery.grammar.fields import number, one_of
from bakery.grammar.section import given
from bakery.grammar.text import Mapping, mappings
from bakery.grammar.units import DENSITY, FRACTION, MASS_CONCENTRATION, MASS_DENSITY, VOLUME_CONCENTRATION

if TYPE_CHECKING:
    from bakery.recipe.checker import Checker

AMOUNTS = ("number_density", "volume_fraction", "volume_concentration", "mass_concentration")
NumberDensity = number(DENSITY, above=0, most=1e30) | None
VolumeFraction = number(FRACTION, above=0, below=1) | None
VolumeConcentration = number(VOLUME_CONCENTRATION, above=0, below=1) | None
MassConcentration = number(MASS_CONCENTRATION, above=0, most=3e4) | None
# from aerogel to the heaviest metals
Density = number(MASS_DENSITY, least=1, most=3e4) | None
DENSITY_KEY = Field(None, description="Mass per volume of the material, such as 1.77 g/cm^3; needed for mass_concentration.")


def amount_fields(whose: str) -> dict:
    """Name -> field of each amount."""
    return {"number_density": Field(None, description=f"{whose} per volume, such as 1e8 /m^3."),
            "volume_fraction": Field(None, description=f"Volume of {whose.lower()} per volume."),
            "volume_concentration": Field(None, description=f"Volume of {whose.lower()} per volume, such as 12 um^3/cm^3."),
            "mass_concentration": Field(None, description=f"Mass of {whose.lower()} per volume, such as 35 ug/m^3.")}


def check_amounts(checker: "Checker", section: Mapping, parts: Sequence[Mapping]) -> None:
    """One amount: of all particles, whose components are shares, or of each component."""
    together, by_part = given(section, *AMOUNTS), [given(part, *AMOUNTS) for part in parts]
    names = one_of(AMOUNTS)
    if together or not any(by_part):
        if not together:
            checker.report_section(section, "found no amount of particles", f"expected {names}, here or in each component")
        elif len(together) > 1:
            second = section.get(together[1], section)
            checker.report_section(second, f"found {together[1]} beside {together[0]}", "expected only one of them")
        for part, amount in zip(parts, by_part):
            if amount:
                checker.report_section(part.get(amount[0], part), f"found {amount[0]} of a component beside {together[0]} of all",
                                       "expected amounts of all together or of each component")
        _densities(checker, parts if "mass_concentration" in together else ())
        return
    for part, amount in zip(parts, by_part):
        if not amount:
            checker.report_section(part, "found no amount", f"expected {names}, as other components have one")
        elif len(amount) > 1:
            checker.report_section(part.get(amount[1], part), f"found {amount[1]} beside {amount[0]}",
                                   "expected only one of them")
        if "fraction" in part:
            beside = amount[0] if amount else "amounts of components"
            checker.report_section(part["fraction"], f"found a fraction beside {beside}",
                                   "expected it with an amount of all particles only")
    _densities(checker, [part for part, amount in zip(parts, by_part) if "mass_concentration" in amount])


def _densities(checker: "Checker", parts) -> None:
    coatings = [coating for part in parts for coating in mappings(part.get("coating"))]
    for material in (*parts, *coatings):
        if not given(material, "density"):
            checker.report_section(material, "found no density, which mass_concentration needs",
                                   "expected the mass per volume of the material, such as density: 1.77 g/cm^3")


def amounts(particles, volume, mass) -> tuple[float, list[float]]:
    """Number and shares of the particles that a recipe's section describes.

    Parameters
    ----------
    volume : (K,) um^3, mean volume of a dry particle of each component, its coating included
    mass : (K,) um^3 kg/m^3, mean mass of the same; nan where no density is given

    Returns
    -------
    number : 1/m^3, of all kinds
    fraction : (K,) shares by number, adding up to 1
    """
    from bakery.physics.medium.mixing import number_density

    volume, mass = np.asarray(volume, float), np.asarray(mass, float)

    def count(of, fraction, volume, mass):
        if of.number_density is not None:
            return of.number_density
        if of.mass_concentration is not None:
            return number_density(fraction, mass, of.mass_concentration)
        return number_density(fraction, volume, of.volume_fraction if of.volume_fraction is not None else of.volume_concentration)

    parts = particles.components
    if any(getattr(particles, name) is not None for name in AMOUNTS):
        fraction = [float(part.fraction) for part in parts]
        return count(particles, fraction, volume, mass), fraction
    per_component = np.array([count(part, [1.0], volume[i:i + 1], mass[i:i + 1]) for i, part in enumerate(parts)])
    total = float(np.sum(per_component))
    return total, (per_component / total).tolist()
