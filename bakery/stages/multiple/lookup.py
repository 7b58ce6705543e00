"""A value of a table of multiple scattering at given arguments: what `bake query` prints of `multiple/point` and `segment`."""

from collections.abc import Mapping

import numpy as np

from bakery.errors import UsageError
from bakery.grammar.units import ANGLE, NUMBER_ONLY
from bakery.stages.declaration import Answer, Query, Remark, lists_of

UNITS = {"rho": "mfp", "z": "mfp", "theta": "rad", "phi": "rad", "length": "mfp"}
_NEEDED = ("rho", "z", "theta")
_TOLD = Remark("light of the third and later scattering events, per unit power")


def looked_up(asset, path: str, arguments: Mapping[str, float | tuple[float, ...]]) -> Answer:
    """The in-scattered light of third and later events at a position and direction.

    arguments : rho, z and length in mean free paths, theta and phi (0 if not given) in rad; one of them may be several

    Raises UsageError : an argument is missing, has no effect, or more than one is a list
    """
    kind = path.rpartition("/")[2]
    keys = [name for name in UNITS if kind == "segment" or name != "length"]
    example = f"rho=1 z=2 theta=30deg, and phi=…{', length=…' * (kind == 'segment')}: rho, z and length in mean free paths"
    several = lists_of(path, arguments, keys, keys, _NEEDED, example)
    for name in ("rho", "length"):
        if np.any(np.asarray(arguments.get(name, 0.0), float) < 0):
            raise UsageError(f"{path}: {name} is below 0; give lengths of 0 or more")
    coordinates = {"phi": 0.0} | {name: np.asarray(value, float) for name, value in arguments.items()}
    values = getattr(asset.multiple, kind)(**coordinates)
    axes = (("wavelength", "um", asset.wavelength),)
    axes += tuple((name, UNITS[name], coordinates[name]) for name in several)
    return Answer(path, "mfp^-3 sr^-1", values, axes, None, (_TOLD,))


_OF_POINT = {"rho": NUMBER_ONLY, "z": NUMBER_ONLY, "theta": ANGLE, "phi": ANGLE}
QUERIES = (
    Query("multiple/point", _OF_POINT, "rho=1, z=2, theta=10deg, phi=0deg", looked_up),
    Query("multiple/segment", _OF_POINT | {"length": NUMBER_ONLY}, "rho=1, z=2, theta=10deg, phi=0deg, length=2", looked_up),
)
