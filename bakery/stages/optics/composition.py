"""What the components of an asset are by number and mass: read from the recipe that the asset keeps."""

import numpy as np

from bakery.errors import RecipeError
from bakery.grammar.text import Mapping, Scalar, Sequence, Source, parse
from bakery.grammar.units import DENSITY, FRACTION, Quantity, Wrong
from bakery.grammar.units import parse as value_of
from bakery.store.tree import Group, read_text

_MASS = {"kg/m^3": 0, "g/m^3": -3, "mg/m^3": -6, "ug/m^3": -9, "ng/m^3": -12, "g/cm^3": 3}
MASS_DENSITY = Quantity("density", "densities", "kg/m^3", _MASS, "g/cm^3")
_VOLUMES = {"um^3/cm^3": -12, "mm^3/m^3": -9, "cm^3/m^3": -6, "m^3/m^3": 0}
VOLUMES = Quantity("volume concentration", "volume concentrations", "m^3/m^3", _VOLUMES, "um^3/cm^3")
_AMOUNTS = {"number_density": DENSITY, "volume_fraction": FRACTION, "volume_concentration": VOLUMES,
            "mass_concentration": MASS_DENSITY}
_UNLIKE = ("coating", "growth")  # keys of components whose particles are not of their material alone


def components(root: Group, optics: Group) -> tuple[list[dict], str]:
    """Components with their share of the particles, and why that is not known.

    Each has name, fraction (1), volume (um^3, mean), density (kg/m^3, None where the recipe states none), radius (R,) um,
    share (R,) of all particles, extinction (L,) um^2.
    """
    groups = {name: member for name, member in optics.groups.items() if "radius" in member.members}
    written = _written(root)
    volumes = {name: _volume(group) for name, group in groups.items()}
    fractions = _fractions(volumes, written)
    if fractions is None:
        return [], ("needs the shares of the components by number (particles.components[].fraction, or an amount of each that is "
                    "not coated or grown), which the recipe does not state")
    parts = []
    for name, group in groups.items():
        parts.append({"name": name, "fraction": fractions[name], "volume": volumes[name], "radius": group["radius"].data,
                      "share": fractions[name] * group["weight"].data, "extinction": group["mean_extinction"].data,
                      "density": _density(written.get(name))})
    return parts, ""


def _volume(group: Group) -> float:
    """Mean volume of a particle, um^3."""
    if "mean_volume" in group.members:
        return float(group["mean_volume"].data[0])
    return float(4 / 3 * np.pi * np.sum(group["weight"].data * group["radius"].data ** 3))


def _density(part) -> float | None:
    """Density of a component's particles, where the recipe states that of all they are made of."""
    return None if part is None or any(key in part for key in _UNLIKE) else _value(part, "density", MASS_DENSITY)


def _written(root: Group) -> dict[str, Mapping]:
    """The components of the recipe by name."""
    try:
        tree = parse(Source("recipe", read_text(root["recipe"]))).root
    except (RecipeError, KeyError):
        return {}
    particles = tree.get("particles") if isinstance(tree, Mapping) else None
    of = particles.get("components") if isinstance(particles, Mapping) else None
    return {part["name"].text: part for part in (of if isinstance(of, Sequence) else [])
            if isinstance(part, Mapping) and isinstance(part.get("name"), Scalar)}


def _fractions(volumes: dict[str, float], written: dict) -> dict[str, float] | None:
    """Share of the particles of each component; None where the recipe does not say."""
    if len(volumes) == 1:
        return dict.fromkeys(volumes, 1.0)
    for numbers in ({name: _value(written.get(name), "fraction", FRACTION) for name in volumes},
                    {name: _number(written.get(name), volume) for name, volume in volumes.items()}):
        if None not in numbers.values() and sum(numbers.values()) > 0:
            return {name: number / sum(numbers.values()) for name, number in numbers.items()}
    return None


def _number(part, volume: float) -> float | None:
    """Particles per volume of a component by its own amount, in a unit of all components; None where it has none."""
    for key, quantity in _AMOUNTS.items():
        amount = _value(part, key, quantity)
        if amount is None:
            continue
        if key == "number_density":
            return amount * 1e-18  # per um^3, as the others come out
        density = _density(part) if key == "mass_concentration" else 1.0
        return None if density is None or any(unlike in part for unlike in _UNLIKE) else amount / (density * volume)
    return None


def _value(part, key: str, quantity: Quantity) -> float | None:
    node = part.get(key) if isinstance(part, Mapping) else None
    try:
        return value_of(node.text, quantity) if isinstance(node, Scalar) else None
    except Wrong:
        return None
