"""Checked values of a section as attributes: what stages read of a recipe.

Pydantic's models say what may stand in a recipe.  What the checks found behind a key (optical constants behind the name of a
material, one number a wavelength behind a single one, columns behind the name of a file) takes the place of what was written.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import BaseModel

from bakery.grammar.fields import takes_auto


@dataclass(frozen=True, eq=False)
class Index:
    """Optical constants n + ik at the recipe's wavelengths, relative to vacuum; `n` (L,), `k` (L,)."""

    name: str
    n: np.ndarray
    k: np.ndarray


class Values(Mapping):
    """The values of a section by name, as attributes or items, read-only.

    None where a recipe leaves a number to the stage (auto) or out.
    """

    def __init__(self, values: Mapping[str, Any]):
        self.__dict__.update(values)

    def __setattr__(self, name, value):
        raise AttributeError(f"{name}: the values of a recipe do not change")

    def __getitem__(self, name: str):
        return vars(self)[name]

    def __iter__(self):
        return iter(vars(self))

    def __len__(self) -> int:
        return len(vars(self))

    def __repr__(self) -> str:
        return f"Values({', '.join(f'{name}={_short(value)}' for name, value in vars(self).items())})"


def _short(value) -> str:
    """A value in words; a table or a mesh as its kind only."""
    large = isinstance(value, np.ndarray) and value.size > 16
    large = large or isinstance(value, tuple) and any(isinstance(part, bytes) for part in value)
    return f"<{type(value).__name__}>" if large else repr(value)


def resolved(value, key: str, replacements: Mapping[str, Any]):
    """A parsed value with all that was found behind its key and the keys below it.

    value : a pydantic model, a list or tuple of values, a value
    replacements : dotted key -> what stands behind it
    """
    if key in replacements:
        if isinstance(replacements[key], np.ndarray):
            replacements[key].flags.writeable = False
        return replacements[key]
    if isinstance(value, BaseModel):
        return Values({name: None if takes_auto(field) and getattr(value, name) == "auto"
                       else resolved(getattr(value, name), f"{key}.{name}", replacements)
                       for name, field in type(value).model_fields.items()})
    if isinstance(value, (list, tuple)):
        return tuple(resolved(item, f"{key}[{i}]", replacements) for i, item in enumerate(value))
    return value


def frozen(array) -> np.ndarray:
    """A read-only copy, float64."""
    array = np.array(array, dtype=float)
    array.flags.writeable = False
    return array
