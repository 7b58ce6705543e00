"""Angles of a phase table: where to begin, and bisection until linear interpolation in cos theta is good enough.

The grid is theta ascending from exactly 0 to exactly pi; all tables that share it are refined together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from bakery.physics.medium import phase

LIMIT = 1_000_000  # angles
_WIDEST = math.radians(1.0)
_RATIO = 0.12  # step over distance from the place that is being closed in upon
_PER_RIPPLE = 3.0  # first angles in a ripple of period pi / x
_SMEARED = 4.0  # ripples die out where size parameter * relative width * angle from the axis exceeds this
_ROUNDS = 200


class TooManyAngles(ValueError):
    """The tolerance would need more than `LIMIT` angles."""


@dataclass(frozen=True)
class Refined:
    """A grid that meets its tolerance.

    theta (A,) rad; values (C, E, A); error (C, A) of the values, as given; tag (C, A) as given; between (C, A-1): absolute error
    of the interpolant between two angles, in units of element 0; relative (C,): largest error over the reference value.
    """

    theta: np.ndarray
    values: np.ndarray
    error: np.ndarray
    tag: np.ndarray
    between: np.ndarray
    relative: np.ndarray


def start(features, bows=()):
    """First angles for spheres.

    Parameters
    ----------
    features : pairs (size parameter, relative width of its distribution); width 0 for spheres of one size
    bows : angles (rad) near which a rainbow stands, with its width (rad)

    Returns
    -------
    theta : (A,) rad

    Notes
    -----
    Steps grow in proportion to the distance from 0, pi and the bows, from a fraction of 1/x, to 1 degree.  Narrow distributions
    keep interference ripples of period pi/x up to an angle of about 4/(x width) from the axis: there the steps resolve them.
    """
    places = [(angle, width / 2) for angle, width in bows]
    combs = []
    for x, width in features:
        places += [(0.0, 0.15 / x), (math.pi, 0.15 / x)]
        if x > 1:
            combs.append((_SMEARED / (x * width) if x * width * math.pi > _SMEARED else math.pi, math.pi / (_PER_RIPPLE * x)))
    steepest = {}
    for angle, finest in places:  # one place per angle: the finest
        steepest[angle] = min(finest, steepest.get(angle, math.inf))
    places = list(steepest.items())
    combs = [c for c in combs if not any(o[0] >= c[0] and o[1] <= c[1] and o != c for o in combs)]

    def step(t):
        h = min(_WIDEST, min((max(fine, _RATIO * abs(t - a)) for a, fine in places), default=_WIDEST))
        edge = min(t, math.pi - t)
        return min([h] + [period for reach, period in combs if edge <= reach])

    theta = [0.0]
    while theta[-1] < math.pi:
        if len(theta) > LIMIT:
            raise TooManyAngles(f"more than {LIMIT} angles")
        last = theta[-1]
        h = step(last)
        # a place ahead may ask for smaller steps than the present one: do not jump over it
        theta.append(last + max(min(h, step(min(last + h, math.pi)) * 2), h / 8))
    theta[-1] = math.pi
    if len(theta) > 2 and theta[-1] - theta[-2] < 0.3 * (theta[-2] - theta[-3]):
        del theta[-2]
    return np.array(theta)


def bows(n):
    """Rainbow angles (rad) of order p = 2 and 3 for a real relative index n; those that exist."""
    angles = []
    for p in (2, 3):
        if 1 < n < p:
            incident = math.acos(math.sqrt((n * n - 1) / (p * p - 1)))
            inside = math.asin(math.sin(incident) / n)
            turned = 2 * (incident - inside) + (p - 1) * (math.pi - 2 * inside)
            angles.append(abs(math.remainder(turned, 2 * math.pi)))
    return angles


def middle(a, b):
    """The angle half-way between a and b in cos theta, without forming a cosine near 1."""
    low = np.sqrt((np.sin(a / 2) ** 2 + np.sin(b / 2) ** 2) / 2)
    high = np.sqrt((np.cos(a / 2) ** 2 + np.cos(b / 2) ** 2) / 2)
    return np.where(a + b < math.pi, 2 * np.arcsin(np.minimum(low, 1)), math.pi - 2 * np.arcsin(np.minimum(high, 1)))


def refine(theta, evaluate, tolerance, crest=None, earlier=None, limit=LIMIT, finest=0.0, most=math.inf,
           integrated=False):
    """Bisect a grid until the interpolant meets a tolerance half-way between all neighbours.

    Parameters
    ----------
    theta : (A,) rad, first grid
    evaluate : (theta (B,), floor (C, B)) -> values (C, E, B), error (C, B), tag (C, B).  `error` is relative to element 0;
        `floor` is the larger tag of the two neighbours, None at first: what the values should at least be made with
    tolerance : the interpolation error plus the value's own error, over the reference value, stays below it
    crest : (C,) rad or None; where above 0 the reference is the largest value within that distance (a neighbouring crest of
        the ripples of equal spheres), else the value itself
    earlier : values, error, tag at theta, from an earlier call
    integrated : what the interpolant misses beyond the values' own errors, summed over all cells, stays below the tolerance as a
        share of the integral over the sphere, instead of each cell below it
    most : of the values' own error, as much as counts where a cell is judged: more angles do not lower what is beyond it
    finest : rad; cells narrower than this are left as they are: what an approximation does there is no structure of its object

    Raises
    ------
    TooManyAngles

    Notes
    -----
    Few sizes leave ripples of single spheres, which are errors of the values and no structure of their average.  Resolving them
    took 11,896 angles for hail (0.5 to 3 mm) at 3 % of the light; bisecting only what exceeds them takes 504.
    """
    values, error, tag = evaluate(theta, None) if earlier is None else earlier
    channels = values.shape[0]
    reach = np.zeros(channels) if crest is None else np.asarray(crest, float)
    cells = len(theta) - 1
    between, worst, undecided = np.zeros((channels, cells)), np.zeros((channels, cells)), np.ones(cells, bool)
    excess = np.zeros((channels, cells))
    for _ in range(_ROUNDS):
        cell = np.flatnonzero(undecided)
        new = middle(theta[cell], theta[cell + 1])
        # neighbours in double precision, or as good as
        undecided[cell[(new <= theta[cell]) | (new >= theta[cell + 1]) | (theta[cell + 1] - theta[cell] < finest)]] = False
        cell = np.flatnonzero(undecided)
        if not len(cell):
            break
        if len(theta) + len(cell) > 2 * limit:
            raise TooManyAngles(f"more than {limit} angles")
        new = middle(theta[cell], theta[cell + 1])
        at_new, error_new, tag_new = evaluate(new, np.maximum(tag[:, cell], tag[:, cell + 1]))
        reference = _reference(theta, values[:, 0], new, at_new[:, 0], reach)
        miss = np.abs((values[:, :, cell] + values[:, :, cell + 1]) / 2 - at_new).max(axis=1)
        value_error = error_new * at_new[:, 0]
        # in a sum over cells independent errors add in squares; where each counts, they may have the same sign
        between[:, cell] = np.hypot(miss, value_error) if integrated else miss + value_error
        worst[:, cell] = np.divide(between[:, cell], reference, out=np.zeros_like(miss), where=reference > 0)
        counted = np.minimum(value_error, most * reference) if most < math.inf else value_error
        judged = np.divide(miss + counted, reference, out=np.zeros_like(miss), where=reference > 0)
        if integrated:
            node_error = error * values[:, 0]
            at_ends = np.maximum(node_error[:, cell], node_error[:, cell + 1])
            excess[:, cell] = np.maximum(miss - np.maximum(value_error, at_ends), 0.0)
            shares = excess * _light(theta, values[:, 0])
            if (shares.sum(axis=1) <= tolerance).all():
                break
            judged = shares[:, cell] * cells
        bad = judged > tolerance
        uneven = bad & (tag[:, cell] != tag[:, cell + 1])
        failing = np.zeros(cells, bool)
        failing[cell] = bad.any(axis=0) & ~uneven.any(axis=0)
        # a cell may pass by accident: it passes only with its neighbours
        failing[cell] |= (np.roll(failing, 1) | np.roll(failing, -1))[cell] & ~uneven.any(axis=0)
        split = np.flatnonzero(failing)
        undecided[:] = False
        step = cell[uneven.any(axis=0)]
        if len(step):
            # a jump between values made at different levels is no structure: make both at the higher one instead of bisecting it
            level = tag.copy()
            for end, other in ((step, step + 1), (step + 1, step)):
                np.maximum.at(level, (slice(None), end), tag[:, other])
            node = np.unique(np.concatenate([step, step + 1]))
            values[:, :, node], error[:, node], tag[:, node] = evaluate(theta[node], level[:, node])
            undecided[np.clip(np.concatenate([node - 1, node]), 0, cells - 1)] = True
            undecided[split] = False
        if not len(split):
            continue
        if len(theta) + len(split) > limit:
            raise TooManyAngles(f"more than {limit} angles")
        pick = np.searchsorted(cell, split)
        where = split + 1
        theta = np.insert(theta, where, new[pick])
        values = np.insert(values, where, at_new[:, :, pick], axis=2)
        error = np.insert(error, where, error_new[:, pick], axis=1)
        tag = np.insert(tag, where, tag_new[:, pick], axis=1)
        between = np.insert(between, where, between[:, split], axis=1)
        worst = np.insert(worst, where, worst[:, split], axis=1)
        excess = np.insert(excess, where, excess[:, split], axis=1)
        undecided = np.insert(undecided, where, True)
        undecided[split + np.arange(len(split))] = True
        cells = len(theta) - 1
    reference = _reference(theta, values[:, 0], theta, values[:, 0], reach)
    value_error = np.divide(error * values[:, 0], reference, out=np.zeros_like(error), where=reference > 0)
    return Refined(theta, values, error, tag, between, np.maximum(worst.max(axis=1), value_error.max(axis=1)))


def _light(theta, f):
    """(C, A-1): what one unit of f in a cell adds to the integral over the sphere, as a share of it."""
    areas = phase.steps(theta)
    return areas / np.sum((f[:, 1:] + f[:, :-1]) / 2 * areas, axis=1)[:, None]


def _reference(theta, f, at, f_at, reach):
    """(C, B): f_at, or the largest f within `reach` of it."""
    out = f_at.copy()
    for c in np.flatnonzero(reach > 0):
        low = np.searchsorted(theta, at - reach[c], side="left")
        high = np.searchsorted(theta, at + reach[c], side="right")
        out[c] = np.maximum(out[c], largest(f[c], low, high))
    return out


def largest(f, low, high):
    """max of f[low:high] for arrays of bounds; 0 where a range is empty."""
    count = high - low
    out = np.zeros(len(low))
    table = f  # of maxima over 2^j entries
    for j in range(int(count.max(initial=0)).bit_length()):
        k = np.flatnonzero((count >= 1 << j) & (count < 2 << j))
        out[k] = np.maximum(table[low[k]], table[high[k] - (1 << j)])
        table = np.maximum(table[: -(1 << j)], table[1 << j :])
    return out
