"""How many photons show that tables of a narrow beam meet a tolerance; known before anything is computed."""

import numpy as np

LEAST, MOST = 20_000, 4_000_000
MORE = 1.5  # times as many, until tables and noise together meet the tolerance
_WANTED = 50  # times the inverse squared noise
_TABLES = 0.01  # error of tables: fog's have 0.8 to 1.5 %, those of narrow lobes less


def first_photons(tolerance) -> int:
    """Photons that are counted at first."""
    return int(np.clip(_WANTED / tolerance**2, LEAST, MOST))


def photons(tolerance) -> float:
    """Photons that a tolerance is expected to take: tables have their part of it, or photons show that these miss it."""
    return float(np.clip(_WANTED / max(tolerance - _TABLES, _TABLES / 3) ** 2, LEAST, MOST))
