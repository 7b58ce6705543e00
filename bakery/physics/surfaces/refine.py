"""Half as many moments again until the answer no longer changes by more than what is asked for, then rounded to what is left."""

import math

import numpy as np

from bakery.physics.multiple.legendre import moments
from bakery.physics.surfaces.rounding import least_light, rounded
from bakery.physics.surfaces.slab import Slab, free, layers, rough_within
from bakery.physics.surfaces.solution import Covered, Solution, Stacked, solve

FEWEST, MOST = 16, 640  # Legendre moments
_MOSTLY = 128  # that are told at first: all of them take half as long as the solution by 48
_MOST_NODES = 256  # moments, where there are as many nodes
_MOST_BETWEEN = 81  # where facets lie on several media: operators take seconds each then, by the fifth power
# error that a change leaves, over the change: that of the peak that is still cut off over that of the last step, within 1.3 times
# for Henyey and Greenstein's functions and fog; and no less than a quarter
_MARGIN, _LEAST = 1.5, 0.25
_FEW = 2e-3  # error that is left by nodes fewer than moments, and at most twice the change: 0.25 % was the most
_BETWEEN = 3.0  # the same where facets lie on several media, whose sums converge slowly: 2.5 was the most of four
_PEAK = 0.6  # share of light that may be cut off, over the tolerance: errors at index 1 are 0.3 to 0.8 of it
_STEP = 0.08  # of what rounding may change: many orders add up
_ROUNDED = 0.1  # of the tolerance: rounding may always change as much
_FLOOR = 1e-3  # of the median: below, errors count as if relative to that (values at grazing angles are a thousand times larger)
_COSINES = np.array([math.cos(math.radians(89.9)), 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0])
_AZIMUTHS = np.linspace(0, math.pi, 5)


def refined(slab: Slab, tolerance: float, most: int = MOST) -> tuple[Solution | Covered | Stacked, float]:
    """The solution, rounded to what its error leaves of the tolerance, and its relative error, that of rounding included."""
    solution, error = converged(slab, tolerance, most)
    return compact(solution, error, tolerance)


def converged(slab: Slab, tolerance: float, most: int = MOST) -> tuple[Solution | Covered | Stacked, float]:
    """The solution, and its relative error, by its change from two thirds of the moments: largest over angles to 89.9 degrees.

    The error leaves a part of the tolerance to rounding, or is above that where `most` moments do not reach it.
    """
    between = rough_within(slab) and slab.under is not None
    if rough_within(slab) or free(slab):
        most = min(most, _MOST_BETWEEN if between else _MOST_NODES)
    known = min(most, _MOSTLY)
    wanted = moments_of(slab, known)
    count, before, error = _first(slab, wanted, tolerance), None, math.inf
    if count > known // 2:
        wanted, known = moments_of(slab, most), most
        count = _first(slab, wanted, tolerance)
    while True:
        solution = solve(slab, wanted, count, tolerance)
        values = _values(solution)
        if before is not None:
            error = max(map(_change, values, before))
            error = _BETWEEN * error if between else _error_after(error, wanted, count, solution.nodes.leaving < count)
        if error <= (1 - _ROUNDED) * tolerance or 3 * count // 2 > most:
            return solution, error
        before, count = values, 3 * count // 2
        if count >= known < most:
            wanted, known = moments_of(slab, most), most


def _first(slab: Slab, wanted, tolerance: float) -> int:
    """Moments to begin with: two thirds of those that leave out a peak of little light."""
    if slab.under is not None or slab.index != 1 or slab.depth < 1:
        return FEWEST
    small = np.flatnonzero(slab.albedo * wanted <= _PEAK * tolerance)
    return max(FEWEST, 2 * int(small[0] if len(small) else len(wanted) - 1) // 3)


def _error_after(change: float, wanted, count: int, few: bool) -> float:
    """Error after a change from two thirds of `count` moments; few: there are fewer nodes than moments."""
    # of two moments the larger one: of lobes to both sides every other is small, of those backward every other is below 0
    fewer = next(fewer for fewer in range(2 * count // 3, count) if 3 * fewer // 2 == count)
    shares = [[np.abs(row[k:k + 2]).max() for k in (fewer, count)]
              for row in (wanted if isinstance(wanted, list) else [wanted])]
    share = max(float(now / (before - now)) if before > now else float(now > 0) for before, now in shares)
    if few:
        return min(2 * change, change * min(max(share, _LEAST), 1.0) + _FEW)
    return change * min(max(_MARGIN * share, _LEAST), 1.0)


def compact(solution: Solution | Covered | Stacked, error: float, tolerance: float):
    """A solution of an error with its orders rounded to what that leaves of a tolerance, and its error with rounding."""
    budget = min(max(tolerance - error, _ROUNDED * tolerance), 0.5 * tolerance)
    values, step, light = _values(solution), _STEP * budget, least_light(solution)
    while True:
        result = rounded(solution, step, light)
        # elsewhere than at the few angles of the test it is somewhat larger
        change = 0.0 if result is solution else 2 * max(map(_change, _values(result), values))
        if change <= budget:
            return result, error + change
        step *= 0.7


def moments_of(slab: Slab, most: int):
    """(most + 1,) Legendre moments of a slab's phase function; a list of them, one a layer, where others are under it."""
    if slab.under is None:
        return moments(slab.theta, slab.phase, most)
    return [moments(part.theta, part.phase, most) for part in layers(slab)[0]]


def _values(solution: Solution | Covered | Stacked) -> tuple[np.ndarray, ...]:
    """Reflection and transmission at the angles of the test."""
    at = np.meshgrid(_COSINES, _COSINES, _AZIMUTHS, indexing="ij")
    # where the peak is cut off, transmitted light is not told
    apart = np.abs(at[0] - at[1]) + at[2] > 0
    return solution.reflection(*at), np.where(apart, solution.transmission(*at), 0.0)


def _change(values, before) -> float:
    scale = np.maximum(np.abs(values), _FLOOR * np.median(np.abs(values)))
    return float(np.max(np.divide(np.abs(values - before), scale, out=np.zeros_like(scale), where=scale > 0)))
