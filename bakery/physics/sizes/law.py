"""What a distribution of radii declares: recipes, their schema and messages, docs and quadrature read it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

NARROW = 1e-9  # relative width below which sizes cannot be distinguished: phases change by < 1e-3 even at x = 1e6
# what the value of a key is: um; a geometric standard deviation; a share, also in %; a number; path of a file of radii (um) and
# densities, two arrays when it is read; path of a file of bins, (edges in um, amounts, power) when it is read
LENGTH, DEVIATION, FRACTION, NUMBER, COLUMNS, BINS = "length", "deviation", "fraction", "number", "columns", "bins"


class Key(NamedTuple):
    """A key of a recipe's size."""

    words: str  # what it is
    kind: str = LENGTH  # one of those above
    bounds: Mapping[str, float] = {}  # `least`, `most`, `above`, `below`, of fractions and numbers
    instead_of: str = ""  # the key in place of which it may stand; "" where it stands for itself


def positive(radius: float) -> float:
    """A radius (um) that is one; else ValueError."""
    if not 0 < radius < math.inf:
        raise ValueError(f"radius {radius:g} um; a radius is above 0")
    return radius


class Law:
    """A distribution of radii, one particle over its whole range; classes are frozen dataclasses, with fields as they like."""

    name: ClassVar[str]  # as recipes name it
    words: ClassVar[str]  # for people
    keys: ClassVar[Mapping[str, Key]]  # of a recipe's size, by their names
    cut: ClassVar[bool] = True  # whether `min` and `max` may cut it
    discrete: ClassVar[bool] = False  # whether all particles have one radius, its `radius`, and there is no density
    # key of which a smaller value would make the tail of large radii shorter; "" where there is none
    widened_by: ClassVar[str] = ""
    bends: tuple[float, ...] = ()  # radii (um) between which its density is smooth, ascending; () where it is everywhere

    @classmethod
    def of(cls, size: Any) -> Law:
        """The law of a recipe's size, which has its keys as attributes; ValueError where a value is out of range.

        Where it is so narrow that sizes cannot be distinguished, a law of one size.
        """
        if "radius" in cls.keys:
            positive(size.radius)
        return cls(**{name: getattr(size, name) for name, key in cls.keys.items() if not key.instead_of})

    @classmethod
    def choices(cls) -> dict[str, tuple[str, ...]]:
        """Each key that has to be given, with the ones that may stand in its place."""
        return {name: (name, *(synonym for synonym, key in cls.keys.items() if key.instead_of == name))
                for name, key in cls.keys.items() if not key.instead_of}

    def density(self, r):
        """dn/dr, 1/um, at r (R,) um."""
        raise NotImplementedError

    def moment(self, power, lower=0.0, upper=math.inf):
        """Integral of r^power dn from `lower` to `upper`, um^power."""
        raise NotImplementedError

    def reach(self):
        """Radii outside which neither the number nor the r^6-weighted density is visible to double precision."""
        raise NotImplementedError
