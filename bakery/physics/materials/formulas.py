"""Dispersion formulas by the numbers that refractiveindex.info gives them."""

from collections.abc import Sequence

import numpy as np

FEWEST = {1: 1, 2: 1, 3: 1, 4: 9, 5: 1, 6: 1, 7: 3, 8: 4, 9: 6}  # coefficients
MOST = {1: 17, 2: 17, 3: 17, 4: 17, 5: 11, 6: 11, 7: 6, 8: 4, 9: 6}


def refractive_index(number: int, coefficients: Sequence[float], wavelength) -> np.ndarray:
    """n (L,) by a formula; nan where it has no real value.

    number : 1 to 9
    coefficients : as many as the formula takes; those left out at its end are 0
    wavelength : (L,) um

    Source: M. N. Polyanskiy, refractiveindex.info, "Dispersion formulas".
    """
    lam = np.asarray(wavelength, float)
    c = np.zeros(max(MOST[number], len(coefficients)))
    c[:len(coefficients)] = coefficients
    with np.errstate(all="ignore"):
        return _FORMULAS[number](c, lam, len(coefficients))


def _pairs(c, count: int, first: int = 1):
    """(C_2, C_3), (C_4, C_5), ... as many as are given."""
    return [(c[i], c[i + 1]) for i in range(first, count, 2)]


def _powers(c, lam, count, first: int = 1):
    return sum((b * lam**d for b, d in _pairs(c, count, first)), np.zeros_like(lam))


def _herzberger(c, lam, count):
    beyond = 1 / (lam**2 - 0.028)
    return c[0] + c[1] * beyond + c[2] * beyond**2 + c[3] * lam**2 + c[4] * lam**4 + c[5] * lam**6


def _retro(c, lam, count):
    share = c[0] + c[1] * lam**2 / (lam**2 - c[2]) + c[3] * lam**2
    return np.sqrt((1 + 2 * share) / (1 - share))


_FORMULAS = {
    1: lambda c, lam, count: np.sqrt(1 + c[0] + sum(b * lam**2 / (lam**2 - d**2) for b, d in _pairs(c, count))),  # Sellmeier
    2: lambda c, lam, count: np.sqrt(1 + c[0] + sum(b * lam**2 / (lam**2 - d) for b, d in _pairs(c, count))),
    3: lambda c, lam, count: np.sqrt(c[0] + _powers(c, lam, count)),
    4: lambda c, lam, count: np.sqrt(c[0] + sum(c[i] * lam**c[i + 1] / (lam**2 - c[i + 2] ** c[i + 3]) for i in (1, 5))
                                     + _powers(c, lam, count, 9)),
    5: lambda c, lam, count: c[0] + _powers(c, lam, count),  # Cauchy
    6: lambda c, lam, count: 1 + c[0] + sum((b / (d - lam**-2) for b, d in _pairs(c, count)), np.zeros_like(lam)),  # gases
    7: _herzberger,
    8: _retro,
    9: lambda c, lam, count: np.sqrt(c[0] + c[1] / (lam**2 - c[2]) + c[3] * (lam - c[4]) / ((lam - c[4]) ** 2 + c[5])),
}
