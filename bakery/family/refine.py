"""Where a family needs points: the error of its interpolation half-way between them, and what is added where it is too large.

Media come from a function of their place, so nothing here knows how they are baked.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from bakery.family.axes import Axis, in_words, points
from bakery.physics.medium.between import METHODS, Optics, Tables, difference, hole, interpolated, tabulated

# Errors elsewhere are up to 1.1 times those half-way for clouds, 1.2 for Henyey-Greenstein lobes whose error is below 10 %
ROOM = 0.8
HALVINGS = 10  # of an interval that a recipe gives
MOST = 10_000  # points in all
STUCK = 0.7  # an error that two halvings leave above this share of itself is not one of interpolation
UNKNOWN = math.inf  # error of an interval whose middle, or one of whose points, is not there


@dataclass
class Refined:
    """Points on axes, and what is between them."""

    axes: Sequence[Axis]  # what is swept
    values: list[list[float]]  # of the points on each axis, in SI units
    tables: Tables  # of the media at the points
    method: str = METHODS[0]  # of interpolation, the one with the smaller error
    # half-way between the points of each axis, infinite where it is not known; None where nothing was measured
    errors: list[np.ndarray | None] = field(default_factory=list)
    limits: list[str] = field(default_factory=list)  # why no more points were added where the error is too large, in words

    @property
    def error(self) -> float | None:
        """Of the interpolation, where it is known: axes add up, and other places than middles may be worse by a quarter.  None
        where an axis of several points has no known error."""
        several = [error for error, values in zip(self.errors, self.values, strict=True) if len(values) > 1]
        if any(error is None or not np.isfinite(error).any() for error in several):
            return None
        return sum(float(error[np.isfinite(error)].max()) for error in several) / ROOM


class _Media:
    """The media of points, asked for anew whenever they are gone through."""

    def __init__(self, places: Iterable[tuple[float, ...]], medium: Callable[[tuple[float, ...]], Optics | None]):
        self._places, self._medium = list(places), medium

    def __iter__(self) -> Iterator[Optics | None]:
        return map(self._medium, self._places)


def given(axes: Sequence[Axis], medium: Callable[[tuple[float, ...]], Optics | None]) -> Refined:
    """The points that a recipe gives, and nothing between them.

    medium : place in SI units -> the medium there, None where there is none
    """
    values = [list(axis.first.values) for axis in axes]
    tables = _tables(axes, values, medium)
    return Refined(axes, values, tables, _methods(tables)[0], [None] * len(axes))


def refined(axes: Sequence[Axis], medium: Callable[[tuple[float, ...]], Optics | None], tolerance: float, integrated: bool,
            told: Callable[[float | None], None]) -> Refined:
    """The points of a recipe, and those in between that the tolerance takes.

    Every middle between two neighbours on an axis, at each point of the other axes, is compared with what the points give there;
    where the difference is too large the middle becomes a point, until no difference is.

    medium : as of `given`
    tolerance : of the interpolation, which the axes share
    integrated : whether phase functions are compared as a whole, see `between.difference`
    told : takes the error so far
    """
    values = [list(axis.first.values) for axis in axes]
    allowed = ROOM * tolerance / max(sum(len(along) > 1 for along in values), 1)
    history: dict[tuple[int, float], list[float]] = {}  # (axis, where an interval begins) -> errors of those that it was cut from
    while True:
        tables = _tables(axes, values, medium)
        method, errors = _measured(axes, values, tables, medium, integrated)
        result = Refined(axes, values, tables, method, errors)
        told(result.error)
        cuts, result.limits = [], []
        for axis, error in enumerate(errors):
            for i in np.flatnonzero(error > allowed) if error is not None else ():
                before = history.get((axis, values[axis][i]), [])
                why = _why_not(float(error[i]), before)
                if why:
                    ends = " and ".join(in_words(axes[axis:axis + 1], [end]) for end in values[axis][i:i + 2])
                    size = "not known" if error[i] == UNKNOWN else f"{error[i] / ROOM:.2g}"
                    result.limits.append(f"between {ends} its error is {size}: {why}")
                else:
                    cuts.append((axis, int(i), [*before, float(error[i])]))
        if cuts and _count(values, cuts) > MOST:
            result.limits.append(f"{_count(values, cuts):,} points would be needed next; up to {MOST:,} are baked")
            cuts = []
        if not cuts:
            return result
        values = [list(along) for along in values]
        for axis, i, before in reversed(cuts):
            middle = _middle(axes[axis], values[axis], i)
            history[axis, values[axis][i]] = history[axis, middle] = before
            values[axis].insert(i + 1, middle)


def _tables(axes, values, medium) -> Tables:
    scaled = [np.array([axis.first.scaled(value) for value in along]) for axis, along in zip(axes, values, strict=True)]
    return tabulated(scaled, _Media(points(values), medium))


def _methods(tables: Tables) -> tuple[str, ...]:
    """Those that can be used: a monotone cubic looks beyond its cell, where a point may be missing."""
    return ("linear",) if tables.missing.any() else METHODS


def _measured(axes, values, tables: Tables, medium, integrated: bool) -> tuple[str, list[np.ndarray | None]]:
    """The better method, and its errors half-way between the points of each axis."""
    by_method = {}
    middles = list(_middles(axes, values, tables, medium))
    for method in _methods(tables):
        errors = [np.zeros(len(along) - 1) if len(along) > 1 else None for along in values]
        for axis, i, scaled, truth in middles:
            errors_here = UNKNOWN if truth is None else difference(interpolated(tables, scaled, method), truth, integrated)
            errors[axis][i] = max(errors[axis][i], errors_here)
        by_method[method] = errors
    best = min(by_method, key=lambda method: sum(error.max(initial=0.0) for error in by_method[method] if error is not None))
    return best, by_method[best]


def _middles(axes, values, tables: Tables, medium) -> Iterator[tuple[int, int, list[float], Optics | None]]:
    """Axis, interval, coordinates and medium of every middle; None for the medium where there is none to compare."""
    for axis, along in enumerate(values):
        for i in range(len(along) - 1):
            places = [[_middle(axes[axis], along, i)] if k == axis else nodes for k, nodes in enumerate(values)]
            for point in points(places):
                scaled = [swept.first.scaled(value) for swept, value in zip(axes, point, strict=True)]
                yield axis, i, scaled, None if hole(tables, scaled) else medium(point)


def _middle(axis: Axis, values: Sequence[float], i: int) -> float:
    """The value half-way between two points, in the coordinate that is interpolated in."""
    return axis.first.unscaled((axis.first.scaled(values[i]) + axis.first.scaled(values[i + 1])) / 2)


def _why_not(error: float, before: Sequence[float]) -> str:
    """Why an interval is not cut, in words; nothing where it is."""
    if error == UNKNOWN:
        return "a point there failed"
    if len(before) >= 2 and error > STUCK * before[-2]:
        return "more points do not help, so it is the members' own; a smaller tolerance of the recipe would"
    return f"{HALVINGS} halvings were made; give more points there" if len(before) >= HALVINGS else ""


def _count(values, cuts) -> int:
    """Points after cuts."""
    return int(np.prod([len(along) + sum(axis == cut for cut, *_ in cuts) for axis, along in enumerate(values)]))
