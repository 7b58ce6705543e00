"""A value of a table of multiple scattering at given arguments: what `bake query` prints of `multiple/point` and `segment`."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bakery.asset.lookup import Answer
from bakery.errors import UsageError
from bakery.physics.multiple.kinds import KINDS

PATHS = tuple(f"multiple/{kind}" for kind in KINDS)
UNITS = {"rho": "mfp", "z": "mfp", "theta": "rad", "phi": "rad", "length": "mfp"}
_NEEDED = ("rho", "z", "theta")


def looked_up(asset, path: str, arguments: Mapping[str, float | tuple[float, ...]]) -> Answer:
    """The in-scattered light of third and later events at a position and direction.

    Parameters
    ----------
    asset : from `bakery.open`
    path : one of `PATHS`
    arguments : rho, z and length in mean free paths, theta and phi (0 if not given) in rad; one of them may be several

    Raises
    ------
    UsageError : an argument is missing, has no effect, or more than one is a list
    """
    kind = path.rpartition("/")[2]
    known = [name for name in UNITS if kind == "segment" or name != "length"]
    useless = [name for name in arguments if name not in known]
    if useless:
        raise UsageError(f"{path}: {useless[0]} has no effect on it; {', '.join(known)} would")
    missing = [name for name in _NEEDED if name not in arguments]
    if missing:
        raise UsageError(f"{path}: {', '.join(missing)} missing; give rho=1 z=2 theta=30deg, and phi=…" + (", length=…" * (
            kind == "segment")) + ": rho, z and length in mean free paths")
    several = [name for name in arguments if np.ndim(arguments[name])]
    if len(several) > 1:
        raise UsageError(f"{path}: {' and '.join(several)} are lists; only one may be")
    for name in ("rho", "length"):
        if np.any(np.asarray(arguments.get(name, 0.0), float) < 0):
            raise UsageError(f"{path}: {name} is below 0")
    given = {"phi": 0.0} | {name: np.asarray(value, float) for name, value in arguments.items()}
    values = getattr(asset.multiple, kind)(**given)
    axes = (("wavelength", "um", asset.wavelength),)
    axes += tuple((name, UNITS[name], given[name]) for name in several)
    return Answer(path, "mfp^-3 sr^-1", values, axes, None, ("light of the third and later scattering events, per unit power",))
