"""Optical constants of a file at a recipe's wavelengths."""

from collections.abc import Sequence

import numpy as np

from bakery.grammar.index_files import Constants, Formula, Tabulated
from bakery.physics.materials import Table, index
from bakery.physics.materials.formulas import refractive_index
from bakery.physics.materials.tables import air


class Outside(Exception):
    """Wavelengths without data: those of the recipe (um, in vacuum), and the range of the file."""

    def __init__(self, wavelengths: Sequence[float], low: float, high: float):
        super().__init__(wavelengths, low, high)
        self.wavelengths, self.low, self.high = list(wavelengths), low, high


def constants_at(constants: Constants, wavelength: Sequence[float], in_air: bool) -> tuple[np.ndarray, np.ndarray]:
    """n and k (L,) relative to vacuum; k is 0 where the file has none.

    wavelength : (L,) um, in vacuum
    in_air : the file's n are relative to air, its wavelengths in air

    Raises Outside : a wavelength beyond the range of n or of k; nothing is extrapolated
    """
    wavelength = np.asarray(wavelength, float)
    # beyond the formula's range the index of air changes by less than 4e-5 (docs of `tables.in_vacuum`)
    medium = np.array([air(min(max(um, 0.23), 1.69)) for um in wavelength]) if in_air else np.ones_like(wavelength)
    at = wavelength / medium
    pieces = [piece for piece in (constants.n, constants.k) if piece is not None]
    low, high = max(piece.range[0] for piece in pieces), min(piece.range[1] for piece in pieces)
    outside = wavelength[~((at >= low) & (at <= high))]
    if outside.size:
        raise Outside(outside.tolist(), low, high)
    k = np.zeros_like(at) if constants.k is None else _tabulated(constants.k, at, "k")
    return medium * (refractive_index(constants.n.number, constants.n.coefficients, at) if isinstance(constants.n, Formula)
                     else _tabulated(constants.n, at, "n")), k


def _tabulated(piece: Tabulated, at, name: str) -> np.ndarray:
    """n linear, k linear in ln k, as in tables of our own; a single row holds for its own wavelength."""
    wavelength, values = piece
    if len(wavelength) == 1:
        return np.full_like(at, values[0])
    ones = np.ones_like(values)
    n, k = index(Table(wavelength, *((values, 0 * ones) if name == "n" else (ones, values))), at)
    return n if name == "n" else k
