"""How many photons show that tables of a narrow beam meet a tolerance; known before anything is computed."""

from __future__ import annotations

import numpy as np

LEAST, MOST = 20_000, 4_000_000
MORE = 4  # times as many, until tables and noise together meet the tolerance
_WANTED = 50  # times the inverse squared tolerance, at first


def first_photons(tolerance) -> int:
    """Photons that are counted at first."""
    return int(np.clip(_WANTED / tolerance**2, LEAST, MOST))


def photons(tolerance) -> float:
    """Photons that a tolerance is expected to take: once more than at first."""
    return min(max(MORE * _WANTED / tolerance**2, LEAST), MOST)
