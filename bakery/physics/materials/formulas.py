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


def _sellmeier(c, lam, count):
    return np.sqrt(1 + c[0] + sum(b * lam**2 / (lam**2 - d**2) for b, d in _pairs(c, count)))


def _sellmeier_2(c, lam, count):
    return np.sqrt(1 + c[0] + sum(b * lam**2 / (lam**2 - d) for b, d in _pairs(c, count)))


def _polynomial(c, lam, count):
    return np.sqrt(_powers(c, lam, count) + np.zeros_like(lam))


def _powers(c, lam, count, first: int = 1):
    return (c[0] if first == 1 else 0.0) + sum(b * lam**d for b, d in _pairs(c, count, first))


def _resonances(c, lam, count):
    peaks = sum(c[i] * lam**c[i + 1] / (lam**2 - c[i + 2] ** c[i + 3]) for i in (1, 5))
    return np.sqrt(c[0] + peaks + _powers(c, lam, count, 9))


def _cauchy(c, lam, count):
    return _powers(c, lam, count) + np.zeros_like(lam)


def _gases(c, lam, count):
    return 1 + c[0] + sum((b / (d - lam**-2) for b, d in _pairs(c, count)), np.zeros_like(lam))


def _herzberger(c, lam, count):
    beyond = 1 / (lam**2 - 0.028)
    return c[0] + c[1] * beyond + c[2] * beyond**2 + c[3] * lam**2 + c[4] * lam**4 + c[5] * lam**6


def _retro(c, lam, count):
    share = c[0] + c[1] * lam**2 / (lam**2 - c[2]) + c[3] * lam**2
    return np.sqrt((1 + 2 * share) / (1 - share))


def _exotic(c, lam, count):
    return np.sqrt(c[0] + c[1] / (lam**2 - c[2]) + c[3] * (lam - c[4]) / ((lam - c[4]) ** 2 + c[5]))


_FORMULAS = {1: _sellmeier, 2: _sellmeier_2, 3: _polynomial, 4: _resonances, 5: _cauchy, 6: _gases, 7: _herzberger, 8: _retro,
             9: _exotic}
