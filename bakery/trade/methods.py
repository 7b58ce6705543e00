"""Error against time of methods that render one picture, each from a single render: noise falls with time, the rest stays.

error(t)^2 = error beneath the noise^2 + noise^2 * (time taken / t).  Pure arithmetic.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from bakery.system.resources import duration
from bakery.trade.front import Point, front, knee

_TIMES = 65  # of a grid
_AHEAD = 64.0  # times the longest render, up to which curves are drawn


class Curve(NamedTuple):
    """A method.

    Attributes
    ----------
    name : of it
    seconds : that its render took, of all cores together
    first : s, before which it has no picture
    noise : that is left in its picture, relative
    error : beneath the noise, relative; 0 of the reference, and where it does not stand out of the noise
    most : upper bound of the error
    """

    name: str
    seconds: float
    first: float
    noise: float
    error: float
    most: float

    @property
    def sure(self) -> float:
        """The error beneath the noise where it stands out of it, else its upper bound: what may be hidden counts as there."""
        return self.error or self.most

    def after(self, seconds, beneath=None):
        """Error (...) after (...) s, with what is sure beneath the noise unless another is given."""
        return np.sqrt((self.sure if beneath is None else beneath) ** 2 + self.noise**2 * self.seconds / np.asarray(seconds))

    def until(self, tolerance: float) -> float:
        """Seconds after which the error is surely below a tolerance; inf if that is not said."""
        left = tolerance**2 - self.sure**2
        return max(self.first, self.noise**2 * self.seconds / left) if left > 0 else math.inf


def times(curves: Sequence[Curve]) -> np.ndarray:
    """Seconds (T,), ascending, at which curves are compared."""
    return np.geomspace(min(curve.first for curve in curves), _AHEAD * max(curve.seconds for curve in curves), _TIMES)


def compared(curves: Sequence[Curve], tolerance: float) -> dict:
    """Which method is closest at which time, the knee, and what to take.

    Returns
    -------
    found : dict with `tolerance`; `ranges`, of times in which a method is closest: `name`, `begin` and `end` (s, None at the
        end); `knee` (`name`, `seconds`, `error`) or None; `until` by name, seconds to the tolerance or None; `advice`, sentences
    """
    at = [(curve, seconds) for seconds in times(curves) for curve in curves if seconds >= curve.first * (1 - 1e-9)]
    points = [Point(float(seconds), float(curve.after(seconds))) for curve, seconds in at]
    efficient = front(points)
    grouped = [list(group) for _, group in groupby(efficient, key=lambda i: at[i][0].name)]
    ranges = [{"name": at[group[0]][0].name, "begin": points[group[0]].seconds} for group in grouped]
    for one, later in zip(ranges, [*ranges[1:], {"begin": None}], strict=True):
        one["end"] = later["begin"]
    bend = knee([points[i] for i in efficient])
    # where one method follows another the front has a step, which is no bend
    on_a_curve = bend is not None and len({at[i][0].name for i in efficient[max(bend - 1, 0):bend + 2]}) == 1
    found = efficient[bend] if on_a_curve else None
    until = {curve.name: curve.until(tolerance) for curve in curves}
    return {"tolerance": tolerance, "ranges": ranges,
            "until": {name: t if math.isfinite(t) else None for name, t in until.items()},
            "knee": None if found is None else {"name": at[found][0].name, "seconds": points[found].seconds,
                                                "error": points[found].error},
            "advice": [_closest(ranges), *([] if found is None else [_bend(at[found][0].name, points[found])]),
                       *_for(curves, until, tolerance)]}


def _closest(ranges):
    if len(ranges) == 1:
        return f"{ranges[0]['name']} is closest to the reference at all times."
    parts = [f"{one['name']} " + (f"up to {duration(one['end'])}" if one["end"] else "from there on") for one in ranges]
    return f"Closest to the reference, by time of all cores together: {', '.join(parts)}."


def _bend(name, point):
    return f"Knee: {name} after {duration(point.seconds)}, {100 * point.error:.2g} %; from there on more time brings less."


def _for(curves, until, tolerance):
    """Sentences about a tolerance."""
    wanted = f"{100 * tolerance:.3g} %"
    best = min(curves, key=lambda curve: until[curve.name])
    if math.isfinite(until[best.name]):
        yield f"For {wanted}: {best.name}, after {duration(until[best.name])}."
    elif all(curve.error for curve in curves):
        yield f"For {wanted}: none of them, however long."
    for curve in curves:
        if math.isinf(until[curve.name]):
            yield (f"{curve.name} stays {100 * curve.error:.2g} % off, however long." if curve.error else
                   f"Noise hides whether {curve.name} reaches {wanted}: its error is below {100 * curve.most:.2g} %.")
