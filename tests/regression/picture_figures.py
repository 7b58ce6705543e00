"""Figures of pictures: means over independent blocks, how much they scatter, and whether two may be of the same picture."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy import stats

from renderers import colour

RARE = 0.25  # of blocks: where fewer bring the scatter of a figure, other blocks may have much less of it by chance
EDGE = 4  # regions along a side
ROUNDING = 1e-5  # relative: figures without scatter are the same but for that

# ---- figures of pictures


def figures(layers: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """What is kept of a picture: R, G, B of its mean and of each order's; luminance of lights, and of regions."""
    means = {name: np.asarray(image, float).mean(axis=(0, 1)) for name, image in layers.items()}
    found = {"mean": means[""], "regions": regions(layers[""] @ colour.LUMINANCE).ravel()}
    found |= {name: mean for name, mean in means.items() if name.startswith("order")}
    return found | {name: np.atleast_1d(mean @ colour.LUMINANCE) for name, mean in means.items() if name.startswith("light.")}


def regions(image: np.ndarray) -> np.ndarray:
    """Means (EDGE, EDGE) of an image (H, W)."""
    return np.array([[part.mean() for part in np.array_split(row, EDGE, axis=1)] for row in np.array_split(image, EDGE, axis=0)])


class Figures:
    """Means of figures over blocks, and their scatter (Welford 1962).

    count : blocks;  value, square, largest : by name; mean, sum of squared distances from it, and the largest of these
    """

    def __init__(self, count=0, value=None, square=None, largest=None):
        self.count, self.value, self.square, self.largest = count, value or {}, square or {}, largest or {}

    def add(self, block: Mapping[str, np.ndarray]):
        self.count += 1
        for name in dict.fromkeys([*self.value, *block]):
            # a layer that a picture lacks is black in it
            mean = self.value.get(name, 0.0)
            step = block.get(name, 0.0) - mean
            self.value[name] = mean + step / self.count
            distance = step * (block.get(name, 0.0) - self.value[name])
            if name not in self.square and self.count > 1:
                distance = (self.count - 1) / self.count * step**2
            self.square[name] = self.square.get(name, 0.0) + distance
            self.largest[name] = np.maximum(self.largest.get(name, 0.0), distance)

    @property
    def error(self) -> dict[str, np.ndarray]:
        """Standard errors; not known before the second block."""
        return {name: np.sqrt(square / (self.count * max(self.count - 1, 1))) for name, square in self.square.items()}

    @property
    def luminance(self) -> float:
        return float(self.value["mean"] @ colour.LUMINANCE)

    def worst(self) -> float:
        """Largest standard error of mean and orders, luminance over that of the picture."""
        if self.count < 2:
            return math.inf
        return max(float(np.sqrt(colour.LUMINANCE @ error**2)) for name, error in self.error.items()
                   if name == "mean" or name.startswith("order")) / max(self.luminance, 1e-30)

    def kept(self) -> dict:
        """As the file has it: by name values, errors, and of all squared distances the share of the largest."""
        return {name: {"value": _short(self.value[name], 6), "error": _short(self.error[name], 3),
                       "largest": _short(self.largest[name] / np.maximum(self.square[name], 1e-300), 2)} for name in self.value}

    @classmethod
    def of(cls, kept: Mapping, count: int) -> Figures:
        """What `kept` made."""
        value, error, largest = ({name: np.array(one[key], float) for name, one in kept.items()}
                                 for key in ("value", "error", "largest"))
        square = {name: one**2 * count * (count - 1) for name, one in error.items()}
        return cls(count, value, square, {name: largest[name] * square[name] for name in value})


def _short(values, digits) -> list[float]:
    return [float(f"{one:.{digits}g}") for one in values]


# ---- comparison


class Deviation(NamedTuple):
    """Of one figure: `name`, `old` and `new`, their joint standard `error`, and the `odds` of being so far apart by chance."""

    name: str
    old: float
    new: float
    error: float
    odds: float


def compare(old: Figures, new: Figures) -> list[Deviation]:
    """Each figure of an entry, the least likely one first.

    Notes
    -----
    Student's t with the degrees of freedom of Welch and Satterthwaite, fewer where few blocks bring most of the scatter.
    """
    made = []
    for name in sorted(set(old.value) | set(new.value)):
        zero = np.zeros_like(old.value.get(name, new.value.get(name)))
        sides = [(side.value.get(name, zero), *_variance(side, other, name, zero)) for side, other in ((old, new), (new, old))]
        (a, va, fa), (b, vb, fb) = sides
        joint, level = np.sqrt(va + vb), max(abs(old.luminance), abs(new.luminance))
        freedom = (va + vb) ** 2 / np.maximum(va**2 / fa + vb**2 / fb, 1e-300)
        apart = np.maximum(np.abs(a - b) - ROUNDING * level, 0)
        odds = np.where(joint > 0, 2 * stats.t.sf(apart / np.maximum(joint, 1e-300), np.maximum(freedom, 1)), apart == 0)
        made += [Deviation(f"{name}[{i}]", *map(float, one)) for i, one in enumerate(zip(a, b, joint, odds))]
    return sorted(made, key=lambda one: one.odds)


def _variance(side: Figures, other: Figures, name: str, zero) -> tuple:
    """Variance of a side's mean and its degrees of freedom.

    Light that few blocks find leaves most of its scatter to chance: where the other side has more of it by block, that counts.
    """
    variance = side.square.get(name, zero) / max(side.count - 1, 1)
    freedom, of_other = _freedom(side, name, zero), _freedom(other, name, zero)
    borrowed = other.square.get(name, zero) / max(other.count - 1, 1)
    scattered = variance > 0
    variance = np.where(scattered & (of_other >= RARE * other.count), variance, np.maximum(variance, borrowed))
    return variance / side.count, np.where(scattered, freedom, of_other)


def _freedom(side: Figures, name: str, zero):
    """Blocks less one, or as many as would have the largest squared distance by chance, 2 log n of n normal numbers."""
    square, largest = side.square.get(name, zero), side.largest.get(name, zero)
    return np.clip(2 * math.log(side.count) * square / np.maximum(largest, 1e-300), 1, side.count - 1)
