"""What is swept: axes with the recipe values at each of their coordinates.

Values are in SI units, as recipes write them (m, /m^3, /m, rad, 1, kg/m^3, m^3/m^3), and interpolated in their logarithm where
all are positive.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np


@dataclass(frozen=True)
class Swept:
    """One key that takes several values."""

    key: str  # dotted, with the indices of items
    name: str  # a short one, of letters, digits and `_`
    units: str  # of the values, such as m
    texts: tuple[str, ...]  # the values as the recipe writes them, with their units
    values: tuple[float, ...]  # the same in `units`

    @property
    def logarithmic(self) -> bool:
        """Whether values are interpolated in their logarithm."""
        return min(self.values) > 0

    def scaled(self, value: float) -> float:
        """The coordinate in which a value is interpolated."""
        return math.log(value) if self.logarithmic else float(value)

    def unscaled(self, coordinate: float) -> float:
        """The value at a coordinate."""
        return math.exp(coordinate) if self.logarithmic else float(coordinate)

    def between(self, neighbour: Swept, value: float) -> float:
        """This key's value where the other key has `value`; both take theirs in step."""
        if self.key == neighbour.key:
            return value
        if value in neighbour.values:
            return self.values[neighbour.values.index(value)]
        return self.unscaled(np.interp(neighbour.scaled(value), list(map(neighbour.scaled, neighbour.values)),
                                       list(map(self.scaled, self.values))))

    def text(self, value: float) -> str:
        """A value as a recipe takes it: as it was written, or in `units`."""
        if value in self.values:
            return self.texts[self.values.index(value)]
        return f"{float(value)!r} {self.units}".removesuffix(" 1")


@dataclass(frozen=True)
class Axis:
    """Keys that take their values in step; the first one's ascend and are the axis's coordinates."""

    keys: tuple[Swept, ...]

    @property
    def first(self) -> Swept:
        return self.keys[0]

    def texts(self, value: float) -> dict[str, str]:
        """Dotted key -> recipe text at a coordinate."""
        return {key.key: key.text(key.between(self.first, value)) for key in self.keys}


@dataclass(frozen=True)
class Sweep:
    """What a recipe sweeps."""

    axes: tuple[Axis, ...]  # every combination of their values is a point
    tolerance: float  # of the interpolation between points
    refine: bool  # whether points are added where its error is larger
    where: dict[str, str]  # the place in the recipe of each dotted key


def points(coordinates: Sequence[Sequence[float]]) -> Iterator[tuple[float, ...]]:
    """All combinations of the values on the axes, the last axis fastest."""
    return product(*coordinates)


def settings(axes: Sequence[Axis], point: Sequence[float]) -> dict[str, str]:
    """Overrides that make the recipe of a point: dotted key -> text."""
    values = {"sweep": "none"}
    for axis, value in zip(axes, point, strict=True):
        values |= axis.texts(value)
    return values


def in_words(axes: Sequence[Axis], point: Sequence[float]) -> str:
    """`radius 4 um, variance 0.1`."""
    return ", ".join(f"{key.name} {shown(key.between(axis.first, value), key.units)}"
                     for axis, value in zip(axes, point, strict=True) for key in axis.keys)


def shown(value: float, units: str) -> str:
    """A value for people: lengths in um, six digits."""
    return f"{1e6 * value:.6g} um" if units == "m" else f"{value:.6g} {units}".removesuffix(" 1")


def file_name(axes: Sequence[Axis], point: Sequence[float]) -> str:
    """`radius_4e-06-variance_0.1.h5`: in SI units."""
    return "-".join(f"{axis.first.name}_{value:.9g}" for axis, value in zip(axes, point, strict=True)) + ".h5"
