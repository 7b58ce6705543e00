"""Which settings are worth their time: the Pareto front of error against time, and its knee.  Pure arithmetic.

Times are noisy and errors are known down to a floor only.  A setting is on the front if it is faster, beyond the noise, than
every more accurate setting on it; errors below the floor count as equal.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

CERTAINTY = 3.0  # standard errors by which one time has to be shorter than another


@dataclass(frozen=True)
class Point:
    """A measured setting.  `spread` is the standard error of ln(seconds)."""

    seconds: float
    error: float
    spread: float = 0.0


def faster(a: Point, b: Point) -> bool:
    """Whether a takes less time than b, beyond the noise of both."""
    return math.log(b.seconds / a.seconds) > CERTAINTY * math.hypot(a.spread, b.spread)


def front(points: Sequence[Point], floor: float = 0.0) -> list[int]:
    """Indices of the points on the front, fastest (least accurate) first.

    points : in the order of preference among equals
    floor : error below which settings cannot be distinguished

    Walked from the most accurate point on, so that "not faster beyond the noise" cannot creep along a row of points, each of
    which differs little from the next.
    """
    error = [max(point.error, floor) for point in points]
    efficient: list[int] = []
    for i in sorted(range(len(points)), key=lambda i: (error[i], i)):
        if all(faster(points[i], points[j]) for j in efficient):
            efficient = [j for j in efficient if error[j] < error[i]] + [i]  # of equally accurate ones the faster
    return efficient[::-1]


def dominating(points: Sequence[Point], i: int, on_front: Sequence[int], floor: float = 0.0) -> int | None:
    """The fastest point of the front that is at least as accurate as point i, which is not faster than it; None if i is on it."""
    if i in on_front:
        return None
    least = max(points[i].error, floor)
    better = [j for j in on_front if max(points[j].error, floor) <= least and not faster(points[i], points[j])]
    return min(better, key=lambda j: points[j].seconds)


def cheapest(points: Sequence[Point], tolerance: float) -> int | None:
    """The fastest point whose true error meets a tolerance, or None."""
    meeting = [i for i, point in enumerate(points) if point.error <= tolerance]
    return min(meeting, key=lambda i: (points[i].seconds, i), default=None)


def knee(points: Sequence[Point], floor: float = 0.0) -> int | None:
    """Index of the knee of a front (fastest first): beyond it a gain in one of error and time costs most of the other.

    The point farthest below the chord between the ends, in ln(error) over ln(time) with both scaled to 1; None where no point
    lies below it by more than a hundredth, as for fewer than three.

    Source: I. Das, Structural Optimization 18, 107 (1999): the knee as the point of the front with the largest distance from the
    line through the individual minima.
    """
    if len(points) < 3:
        return None
    x = [math.log(point.seconds) for point in points]
    y = [math.log(max(point.error, floor, 1e-300)) for point in points]
    if not (x[-1] > x[0] and y[0] > y[-1]):
        return None
    below = [1 - (a - x[0]) / (x[-1] - x[0]) - (b - y[-1]) / (y[0] - y[-1]) for a, b in zip(x, y, strict=True)]
    best = max(range(len(points)), key=lambda i: below[i])
    return best if below[best] > 0.01 else None
