"""Error against time of methods that render one picture, each from a single render: noise falls with time, the rest stays.

error(t)^2 = error beneath the noise^2 + noise^2 * (time of passes taken / (t - time before them)).  Pure arithmetic.
"""

import math
from collections.abc import Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from bakery.system.resources import duration
from bakery.trade.front import Point, faster, front, knee

_TIMES = 65  # of a grid
_AHEAD = 64.0  # times the longest render, up to which curves are drawn
_CLOCK = 0.1  # standard error of ln(seconds), of a machine that does other things besides: processor time depends on them too


class Curve(NamedTuple):
    """A method."""

    name: str  # of it
    seconds: float  # that its render takes, of all cores together, with kinds of passes shared out best
    first: float  # s, before which it has no picture
    noise: float  # that is left in its picture, relative; 0 of a method without
    error: float  # beneath the noise, relative; 0 of the reference, and where it does not stand out of the noise
    most: float  # upper bound of the error
    setup: float = 0.0  # s, of `seconds`, before the first pass
    spread: float = 0.0  # standard error of ln(noise^2 times seconds of passes)
    # share of a tolerance within which the method keeps its error by itself: it counts with no more, unless it surely is more;
    # None of a method that promises nothing
    kept: float | None = None

    @property
    def sure(self) -> float:
        """The error beneath the noise where it stands out of it, else its upper bound: what may be hidden counts as there."""
        return self.error or self.most

    @property
    def least(self) -> float:
        """Lower bound of the error, as far below as the upper one is above, in squares."""
        return math.sqrt(max(2 * self.error**2 - self.most**2, 0.0))

    def after(self, seconds, beneath=None):
        """Error (...) after (...) s, with what is sure beneath the noise unless another is given."""
        passes = np.maximum(np.asarray(seconds) - self.setup, 1e-9)
        return np.sqrt((self.sure if beneath is None else beneath) ** 2 + self.noise**2 * (self.seconds - self.setup) / passes)

    def beneath(self, tolerance: float) -> float:
        """The error beneath the noise that counts where a tolerance is to be met."""
        return self.sure if self.kept is None else min(self.sure, max(self.kept * tolerance, self.least))

    def until(self, tolerance: float, beneath: float | None = None) -> float:
        """Seconds after which the error is below a tolerance, by what counts beneath the noise; inf if that is not said."""
        allowed_square = tolerance**2 - (self.beneath(tolerance) if beneath is None else beneath) ** 2
        if not allowed_square > 0:
            return math.inf
        return max(self.first, self.setup + self.noise**2 * (self.seconds - self.setup) / allowed_square)

    def point(self, tolerance: float, beneath: float | None = None) -> Point:
        """When it meets a tolerance, with how sure that is."""
        seconds = self.until(tolerance, beneath)
        passes = max(1 - self.setup / seconds, 0.0) if math.isfinite(seconds) else 0.0
        return Point(seconds, tolerance, math.hypot(_CLOCK, passes * self.spread))


def times(curves: Sequence[Curve]) -> np.ndarray:
    """Seconds (T,), ascending, at which curves are compared."""
    return np.geomspace(min(curve.first for curve in curves), _AHEAD * max(curve.seconds for curve in curves), _TIMES)


def compared(curves: Sequence[Curve], tolerance: float) -> dict:
    """Which method is closest at which time, the knee, and what to take.

    Returns chosen : dict with `tolerance`; `ranges`, of times in which a method is closest: `name`, `begin` and `end` (s, None at
        the end); `knee` (`name`, `seconds`, `error`) or None; by name `until`, seconds to the tolerance or None, and `spread`,
        the standard error of its logarithm; `advised`, see there; `advice`, sentences; `never`, names of methods that surely miss
        the tolerance; `others`, sentences about those that are not sure to meet it
    """
    at = [(curve, seconds) for seconds in times(curves) for curve in curves if seconds >= curve.first * (1 - 1e-9)]
    points = [Point(float(seconds), float(curve.after(seconds, curve.beneath(tolerance)))) for curve, seconds in at]
    efficient = front(points)
    grouped = [list(group) for _, group in groupby(efficient, key=lambda i: at[i][0].name)]
    ranges = [{"name": at[group[0]][0].name, "begin": points[group[0]].seconds} for group in grouped]
    for span, later in zip(ranges, [*ranges[1:], {"begin": None}], strict=True):
        span["end"] = later["begin"]
    bend = knee([points[i] for i in efficient])
    # where one method follows another the front has a step, which is no bend
    on_a_curve = bend is not None and len({at[i][0].name for i in efficient[max(bend - 1, 0):bend + 2]}) == 1
    chosen = efficient[bend] if on_a_curve else None
    until = {curve.name: curve.until(tolerance) for curve in curves}
    best = advised(curves, tolerance)
    return {"tolerance": tolerance, "ranges": ranges,
            "until": {name: t if math.isfinite(t) else None for name, t in until.items()},
            "spread": {curve.name: curve.point(tolerance).spread for curve in curves}, "advised": best,
            "knee": None if chosen is None else {"name": at[chosen][0].name, "seconds": points[chosen].seconds,
                                                "error": points[chosen].error},
            "advice": list(_advice(ranges, None if chosen is None else (at[chosen][0].name, points[chosen]), curves, best,
                                   tolerance)),
            "never": [curve.name for curve in curves if curve.least >= tolerance],
            "others": [_not_sure(curve, tolerance) for curve in curves if math.isinf(until[curve.name])]}


def _advice(ranges, knee, curves, best, tolerance):
    """Sentences; knee : name and point, or None."""
    if len(ranges) == 1:
        yield f"{ranges[0]['name']} is closest to the reference at all times."
    else:
        parts = [f"{span['name']} " + (f"up to {duration(span['end'])}" if span["end"] else "from there on") for span in ranges]
        yield f"Closest to the reference, by time of all cores together: {', '.join(parts)}."
    if knee:
        yield (f"Knee: {knee[0]} after {duration(knee[1].seconds)}, {100 * knee[1].error:.2g} %; from there on more time brings "
               "less.")
    if best:
        yield _taken(best, tolerance)
    elif all(curve.least >= tolerance for curve in curves):
        yield f"For {_percent(tolerance)}: none of them, however long."


def _not_sure(curve, tolerance):
    return (f"{curve.name} stays {100 * curve.error:.2g} % off, however long." if curve.least >= tolerance else
            f"Noise hides whether {curve.name} reaches {_percent(tolerance)}: its error is below {100 * curve.most:.2g} %.")


def advised(curves: Sequence[Curve], tolerance: float) -> dict | None:
    """The method that meets a tolerance first; None where none is sure to.

    Returns found : dict with `name`, `seconds`, `spread` (standard error of their logarithm), `beneath` (error beneath the noise
        that counts), `noise` (that the picture may have), `hidden` (whether noise hides that error), `bound` (whether it is an
        upper bound), `alike` (names of methods that are not slower beyond the noise), `open` (of those that may be quicker, but
        noise hides whether they meet the tolerance), `next` (`name`, `ratio` of the times: the quickest of the others) or None
    """
    points = {curve.name: curve.point(tolerance) for curve in curves if math.isfinite(curve.until(tolerance))}
    if not points:
        return None
    order = sorted(points, key=lambda name: points[name].seconds)
    best, others = order[0], order[1:]
    alike = [name for name in others if not faster(points[best], points[name])]
    slower = [name for name in others if name not in alike]
    curve = next(curve for curve in curves if curve.name == best)
    beneath = curve.beneath(tolerance)
    hidden = [curve.name for curve in curves if curve.name not in points and curve.least < tolerance
              and not faster(points[best], curve.point(tolerance, curve.least))]
    return {"name": best, "seconds": points[best].seconds, "spread": points[best].spread, "beneath": beneath,
            "noise": math.sqrt(tolerance**2 - beneath**2), "hidden": bool(curve.kept) and beneath < curve.sure,
            "bound": not curve.error, "alike": alike, "open": hidden,
            "next": {"name": slower[0], "ratio": points[slower[0]].seconds / points[best].seconds} if slower else None}


def contenders(curves: Sequence[Curve], tolerance: float) -> list[str]:
    """Names of the methods that may meet a tolerance first, if what noise hides is not there: two or more, or none."""
    best = advised(curves, tolerance)
    if best is None:
        return [curve.name for curve in curves if curve.least < tolerance]
    names = [best["name"], *best["alike"], *best["open"]]
    return names if len(names) > 1 else []


def _taken(contenders, tolerance) -> str:
    words = [f"For {_percent(tolerance)}: {contenders['name']}, after {duration(contenders['seconds'])}"]
    if contenders["next"]:
        words.append(f"{contenders['next']['ratio']:.2g} times as fast as {contenders['next']['name']}")
    if contenders["alike"]:
        words.append(f"not distinguished from {_listed(contenders['alike'])}")
    if contenders["open"]:
        words.append(f"noise hides whether {_listed(contenders['open'])} would be quicker")
    if contenders["hidden"]:
        words.append(f"noise hides its own error, which counts as {100 * contenders['beneath']:.2g} %")
    elif contenders["beneath"]:
        words.append(f"its own error is {100 * contenders['beneath']:.2g} %" + " at most" * contenders["bound"])
    return "; ".join(words) + "."


def _listed(names) -> str:
    *others, last = names
    return f"{', '.join(others)} and {last}" if others else last


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"
