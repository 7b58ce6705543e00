"""Where an asset keeps the coordinate of an axis, and the standard error and the bias of an array."""

import numpy as np

from bakery.errors import UsageError
from bakery.grammar.units import WAVELENGTH, Wrong, parse_any
from bakery.physics.medium.spectral import places
from bakery.store.tree import Dataset, Group

ERROR = "_error"  # X_error is the standard error of a Monte Carlo figure X
BIAS = "_bias"  # X_bias is the estimated size of the systematic error of X: quadrature, interpolation, the model
# letter in a declared shape -> the dataset that holds the coordinate, looked for beside the array, then upwards, then in `medium`
COORDINATES = {"L": "wavelength", "A": "theta", "B": "theta", "R": "radius"}  # B: angles of one group alone


def coordinate(root: Group, path: str, letter: str) -> tuple[str, Dataset] | None:
    """Path and dataset of the coordinate of an axis, as seen from the dataset at `path`."""
    name = COORDINATES.get(letter)
    if name is None:
        return None
    parts = path.split("/")[:-1]
    for above in [parts[:n] for n in range(len(parts), -1, -1)] + [["medium"]]:
        prefix = "/".join([*above, name])
        try:
            member = root[prefix]
        except KeyError:
            continue
        if isinstance(member, Dataset) and member.data.ndim == 1:
            return prefix, member
    return None


def standard_error(root: Group, path: str) -> np.ndarray | None:
    """The values of `X_error` beside a Monte Carlo figure X, or None."""
    return _beside(root, path, ERROR)


def stated_error(root: Group, path: str) -> np.ndarray | None:
    """The error that is stated of X as a whole: `X_error` and `X_bias`, added in squares where there are both; or None."""
    parts = [values for values in (_beside(root, path, ERROR), _beside(root, path, BIAS)) if values is not None]
    return np.hypot(*parts) if len(parts) == 2 else parts[0] if parts else None


def _beside(root: Group, path: str, suffix: str) -> np.ndarray | None:
    try:
        member = root[path + suffix]
    except KeyError:
        return None
    same = isinstance(member, Dataset) and member.data.shape == root[path].data.shape
    return member.data if same else None


def wavelengths(wanted, stored) -> np.ndarray:
    """Wavelengths that were asked for, in um: a number, several, or text with its unit; UsageError outside of the stored ones."""
    try:
        wanted = parse_any(wanted, WAVELENGTH) if isinstance(wanted, str) else wanted
        um = np.asarray(wanted, float)
        places(stored, um)
    except Wrong as wrong:
        raise UsageError(f"wavelength: {wrong.found}; {wrong.expected}") from None
    except (TypeError, ValueError):
        held = ", ".join(f"{x:.6g}" for x in np.atleast_1d(stored))
        asked = ", ".join(f"{x:.6g}" if isinstance(x, float) else str(x) for x in np.ravel(wanted))
        raise UsageError(f"wavelength: found {asked} um; the asset holds {held} um"
                         + (" and what lies between" if np.size(stored) > 1 else "")) from None
    return um
