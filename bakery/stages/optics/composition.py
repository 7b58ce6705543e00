"""What the components of an asset are by number and mass: read from the recipe that the asset keeps."""

from __future__ import annotations

import numpy as np

from bakery.errors import RecipeError
from bakery.grammar.text import Mapping, Scalar, Sequence, Source, parse
from bakery.grammar.units import DENSITY, FRACTION, Quantity, Wrong
from bakery.grammar.units import parse as value_of
from bakery.store.tree import Group, read_text

_MASS = {"kg/m^3": 0, "g/m^3": -3, "mg/m^3": -6, "ug/m^3": -9, "ng/m^3": -12, "g/cm^3": 3}
MASS_DENSITY = Quantity("density", "densities", "kg/m^3", _MASS, "g/cm^3")
_SHARES = (("fraction", FRACTION), ("number_density", DENSITY))


def components(root: Group, optics: Group) -> tuple[list[dict], str]:
    """Components with their share of the particles, and why that is not known.

    Each has name, fraction (1), volume (um^3, mean), density (kg/m^3, None where the recipe states none), radius (R,) um,
    share (R,) of all particles, extinction (L,) um^2.
    """
    groups = {name: member for name, member in optics.members.items() if isinstance(member, Group) and "radius" in member.members}
    written = _written(root)
    fractions = _fractions(groups, written)
    if fractions is None:
        return [], ("needs the shares of the components by number (particles.components[].fraction or number_density), which the "
                    "recipe does not state")
    parts = []
    for name, group in groups.items():
        radius, weight = group["radius"].data, group["weight"].data
        volume = float(group["mean_volume"].data[0]) if "mean_volume" in group.members else \
            float(4 / 3 * np.pi * np.sum(weight * radius**3))
        parts.append({"name": name, "fraction": fractions[name], "volume": volume, "radius": radius,
                      "share": fractions[name] * weight, "extinction": group["mean_extinction"].data,
                      "density": _value(written.get(name), "density", MASS_DENSITY)})
    return parts, ""


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


def _fractions(groups: dict, written: dict) -> dict[str, float] | None:
    """Share of the particles of each component; None where the recipe does not say."""
    if len(groups) == 1:
        return dict.fromkeys(groups, 1.0)
    for key, quantity in _SHARES:
        values = {name: _value(written.get(name), key, quantity) for name in groups}
        if None not in values.values() and sum(values.values()) > 0:
            return {name: value / sum(values.values()) for name, value in values.items()}
    return None


def _value(part, key: str, quantity: Quantity) -> float | None:
    node = part.get(key) if isinstance(part, Mapping) else None
    try:
        return value_of(node.text, quantity) if isinstance(node, Scalar) else None
    except Wrong:
        return None
