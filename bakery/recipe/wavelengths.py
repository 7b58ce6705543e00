"""Wavelengths in the wrong unit: a bare 610 is 610 um, where a medium given by numbers bakes as well as in the visible."""

from collections.abc import Sequence

EYE = 0.36, 0.83  # um; luminous efficiency below 1e-5 outside
TABLES = 0.18, 5.0  # um; from the first to the last row of the tables in assets/materials
NEAR = 0.1, 20.0  # um; beyond it nothing that is rendered is seen or tabulated


def far(values: Sequence[float]) -> list[float]:
    """The wavelengths (um) that are far from what is seen and from where materials are known."""
    return [value for value in values if not NEAR[0] <= value <= NEAR[1]]


def likely(values: Sequence[float]) -> str:
    """`610, 550 nm`: what wavelengths (um) would be in the unit that was probably meant; "" where none suggests itself."""
    for low, high in (EYE, TABLES):
        for factor in (1e-3, 1e3, 1e-6, 1e6):  # nm, mm, nm for mm, m
            if all(low <= factor * value <= high for value in values):
                unit, scale = ("nm", 1e3) if factor < 1 else ("um", 1.0)
                return f"{listed([scale * factor * value for value in values])} {unit}"
    return ""


def listed(values: Sequence[float]) -> str:
    """The first of the values."""
    return ", ".join(f"{value:g}" for value in values[:8]) + (", …" if len(values) > 8 else "")
