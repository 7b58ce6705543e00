"""Where an asset keeps the coordinate of an axis and the standard error of an array."""

from __future__ import annotations

import numpy as np

from bakery.store.tree import Dataset, Group

# letter in a declared shape -> the dataset that holds the coordinate, looked for beside the array, then upwards, then in `medium`
COORDINATES = {"L": "wavelength", "A": "theta", "B": "theta", "R": "radius"}  # B: angles of one group alone


def coordinate(root: Group, path: str, letter: str) -> tuple[str, Dataset] | None:
    """Path and dataset of the coordinate of an axis, as seen from the dataset at `path`."""
    name = COORDINATES.get(letter)
    if name is None:
        return None
    parts = path.split("/")[:-1]
    for places in [parts[:n] for n in range(len(parts), -1, -1)] + [["medium"]]:
        here = "/".join([*places, name])
        try:
            found = root[here]
        except KeyError:
            continue
        if isinstance(found, Dataset) and found.data.ndim == 1:
            return here, found
    return None


def standard_error(root: Group, path: str) -> np.ndarray | None:
    """The values of `X_error` beside a Monte Carlo figure X, or None."""
    try:
        found = root[path + "_error"]
    except KeyError:
        return None
    same = isinstance(found, Dataset) and found.data.shape == root[path].data.shape
    return found.data if same else None
