"""Which of several tiles stands for a fraction."""

import numpy as np


def nearest_denser(fractions, fraction: float) -> tuple[int, float]:
    """The least dense tile that is at least as dense as a fraction; the densest where none is.

    Parameters
    ----------
    fractions : (T,) 1, of the tiles
    fraction : 1, wished

    Returns
    -------
    index : of the tile
    wider : 1, >= 1, what its centres and its cell are multiplied by, with the same spheres, so that it fills just the fraction
    """
    fractions = np.asarray(fractions, float)
    dense = fractions >= fraction * (1 - 1e-9)
    index = int(np.argmin(np.where(dense, fractions, np.inf)) if dense.any() else np.argmax(fractions))
    return index, max(float(fractions[index]) / fraction, 1.0) ** (1 / 3)
