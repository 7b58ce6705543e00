"""Angles of a phase table: where to begin, and bisection until linear interpolation in cos theta is good enough.

The grid is theta ascending from exactly 0 to exactly pi; all tables that share it are refined together.
"""

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


def start(features, bows=(), wider=1.0):
    """First angles for spheres.

    features : pairs (size parameter, relative width of its distribution); width 0 for spheres of one size
    bows : angles (rad) near which a rainbow stands, with its width (rad)
    wider : factor of all steps but those in ripples

    Returns theta : (A,) rad

    Steps grow in proportion to the distance from 0, pi and the bows, from a fraction of 1/x, to 1 degree.  Narrow distributions
    keep interference ripples of period pi/x up to an angle of about 4/(x width) from the axis: there the steps resolve them.
    """
    places = [(angle, wider * width / 2) for angle, width in bows]
    ratio, widest = wider * _RATIO, wider * _WIDEST
    combs = []
    for x, width in features:
        places += [(0.0, wider * 0.15 / x), (math.pi, wider * 0.15 / x)]
        if x > 1:
            combs.append((_SMEARED / (x * width) if x * width * math.pi > _SMEARED else math.pi, math.pi / (_PER_RIPPLE * x)))
    steepest = {}
    for angle, finest in places:  # one place per angle: the finest
        steepest[angle] = min(finest, steepest.get(angle, math.inf))
    places = list(steepest.items())
    combs = [c for c in combs if not any(o[0] >= c[0] and o[1] <= c[1] and o != c for o in combs)]

    def step(t):
        h = widest
        for angle, finest in places:
            h = min(h, max(finest, ratio * abs(t - angle)))
        edge = min(t, math.pi - t)
        for reach, period in combs:
            if edge <= reach:
                h = min(h, period)
        return h

    theta, h = [0.0], step(0.0)
    while theta[-1] < math.pi:
        if len(theta) > LIMIT:
            raise TooManyAngles(f"more than {LIMIT} angles")
        last = theta[-1]
        ahead = min(last + h, math.pi)
        next_step = step(ahead)
        # a place ahead may ask for smaller steps than the present one: do not jump over it
        theta.append(last + max(min(h, next_step * 2), h / 8))
        h = next_step if theta[-1] == ahead else step(theta[-1])
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

    theta : (A,) rad, first grid
    evaluate : (theta (B,), floor (C, B)) -> values (C, E, B), error (C, B), tag (C, B).  `error` is relative to element 0;
        `floor` is the larger tag of the two neighbours, None at first: what the values should at least be made with
    tolerance : the interpolation error plus the value's own error, over the reference value, stays below it
    crest : (C,) rad or None; where above 0 the reference in a trough between two crests within that distance (the ripples of
        equal spheres) is the lower one of them, else the value itself
    earlier : values, error, tag at theta, from an earlier call
    integrated : what the interpolant misses beyond the values' own errors, summed over all cells, stays below the tolerance as a
        share of the integral over the sphere, instead of each cell below it
    most : of the values' own error, as much as counts where a cell is judged: more angles do not lower what is beyond it
    finest : rad; cells narrower than this are left as they are: what an approximation does there is no structure of its object

    Raises TooManyAngles

    Few sizes leave ripples of single spheres, which are errors of the values and no structure of their average.  Resolving them
    took 11,896 angles for hail (0.5 to 3 mm) at 3 % of the light; bisecting only what exceeds them takes 504.
    """
    table = _Bisected(theta, evaluate(theta, None) if earlier is None else earlier, crest)
    for _ in range(_ROUNDS):
        cell = table.next_cells(finest)
        if not len(cell):
            break
        if len(table.theta) + len(cell) > 2 * limit:
            raise TooManyAngles(f"more than {limit} angles")
        new = middle(table.theta[cell], table.theta[cell + 1])
        middles = _Middles(cell, new, *evaluate(new, np.maximum(table.tag[:, cell], table.tag[:, cell + 1])))
        judged = table.judged(middles, tolerance, most, integrated)
        if judged is None:
            break
        split = table.failing(cell, judged > tolerance, evaluate)
        if not len(split):
            continue
        if len(table.theta) + len(split) > limit:
            raise TooManyAngles(f"more than {limit} angles")
        table.split(split, middles)
    return table.refined()


@dataclass(frozen=True)
class _Middles:
    """Cells that are looked at (M,), angles in their middles, and values, error and tag there."""

    cell: np.ndarray
    theta: np.ndarray
    values: np.ndarray
    error: np.ndarray
    tag: np.ndarray


class _Bisected:
    """A grid that is being bisected: values, error and tag at theta (A,), and of its cells (C, A - 1) what lies between the ends:
    in all (`between`), relative to the reference (`worst`), beyond the values' own errors (`excess`)."""

    def __init__(self, theta, at_nodes, crest):
        self.theta, (self.values, self.error, self.tag) = theta, at_nodes
        channels, cells = self.values.shape[0], len(theta) - 1
        self.reach = np.zeros(channels) if crest is None else np.asarray(crest, float)
        self.between, self.worst, self.excess = (np.zeros((channels, cells)) for _ in range(3))
        self.undecided = np.ones(cells, bool)

    def next_cells(self, finest):
        """Cells that are still to be judged, but for those whose ends are neighbours in double precision, or as good as."""
        theta, cell = self.theta, np.flatnonzero(self.undecided)
        new = middle(theta[cell], theta[cell + 1])
        self.undecided[cell[(new <= theta[cell]) | (new >= theta[cell + 1]) | (theta[cell + 1] - theta[cell] < finest)]] = False
        return np.flatnonzero(self.undecided)

    def judged(self, middles, tolerance, most, integrated):
        """What is held to the tolerance, of each channel and cell; None where all of the table is good enough already."""
        cell, at_middles = middles.cell, middles.values
        reference = _reference(self.theta, self.values[:, 0], middles.theta, at_middles[:, 0], self.reach)
        miss = np.abs((self.values[:, :, cell] + self.values[:, :, cell + 1]) / 2 - at_middles).max(axis=1)
        value_error = middles.error * at_middles[:, 0]
        # in a sum over cells independent errors add in squares; where each counts, they may have the same sign
        self.between[:, cell] = np.hypot(miss, value_error) if integrated else miss + value_error
        self.worst[:, cell] = np.divide(self.between[:, cell], reference, out=np.zeros_like(miss), where=reference > 0)
        if not integrated:
            counted = np.minimum(value_error, most * reference) if most < math.inf else value_error
            return np.divide(miss + counted, reference, out=np.zeros_like(miss), where=reference > 0)
        node_error = self.error * self.values[:, 0]
        at_ends = np.maximum(node_error[:, cell], node_error[:, cell + 1])
        self.excess[:, cell] = np.maximum(miss - np.maximum(value_error, at_ends), 0.0)
        shares = self.excess * _light(self.theta, self.values[:, 0])
        if (shares.sum(axis=1) <= tolerance).all():
            return None
        return shares[:, cell] * (len(self.theta) - 1)

    def failing(self, cell, bad, evaluate):
        """Cells to bisect, of those that are `bad` (C, M).  A jump between values made at different levels is no structure: such
        values are made anew, both at the higher level."""
        cells = len(self.theta) - 1
        uneven = (bad & (self.tag[:, cell] != self.tag[:, cell + 1])).any(axis=0)
        failing = np.zeros(cells, bool)
        failing[cell] = bad.any(axis=0) & ~uneven
        # a cell may pass by accident: it passes only with its neighbours
        failing[cell] |= (np.roll(failing, 1) | np.roll(failing, -1))[cell] & ~uneven
        split, step = np.flatnonzero(failing), cell[uneven]
        self.undecided[:] = False
        if len(step):
            level = self.tag.copy()
            for end, neighbour in ((step, step + 1), (step + 1, step)):
                np.maximum.at(level, (slice(None), end), self.tag[:, neighbour])
            node = np.unique(np.concatenate([step, step + 1]))
            self.values[:, :, node], self.error[:, node], self.tag[:, node] = evaluate(self.theta[node], level[:, node])
            self.undecided[np.clip(np.concatenate([node - 1, node]), 0, cells - 1)] = True
            self.undecided[split] = False
        return split

    def split(self, cells, middles):
        """Bisect cells, of those that were looked at; both halves are undecided."""
        pick, at = np.searchsorted(middles.cell, cells), cells + 1
        self.theta = np.insert(self.theta, at, middles.theta[pick])
        self.values = np.insert(self.values, at, middles.values[:, :, pick], axis=2)
        self.error = np.insert(self.error, at, middles.error[:, pick], axis=1)
        self.tag = np.insert(self.tag, at, middles.tag[:, pick], axis=1)
        self.between, self.worst, self.excess = (np.insert(array, at, array[:, cells], axis=1)
                                                 for array in (self.between, self.worst, self.excess))
        self.undecided = np.insert(self.undecided, at, True)
        self.undecided[cells + np.arange(len(cells))] = True

    def refined(self):
        """The table as it is."""
        reference = _reference(self.theta, self.values[:, 0], self.theta, self.values[:, 0], self.reach)
        value_error = np.divide(self.error * self.values[:, 0], reference, out=np.zeros_like(self.error), where=reference > 0)
        worst = np.maximum(self.worst.max(axis=1), value_error.max(axis=1))
        return Refined(self.theta, self.values, self.error, self.tag, self.between, worst)


def _light(theta, f):
    """(C, A-1): what one unit of f in a cell adds to the integral over the sphere, as a share of it."""
    areas = phase.steps(theta)
    return areas / np.sum((f[:, 1:] + f[:, :-1]) / 2 * areas, axis=1)[:, None]


def _reference(theta, f, at, f_at, reach):
    """(C, B): f_at, or the lower one of the largest f on either side of it within `reach`: on a slope without troughs f_at."""
    out = f_at.copy()
    for c in np.flatnonzero(reach > 0):
        low = np.searchsorted(theta, at - reach[c], side="left")
        begin, end = np.searchsorted(theta, at, side="left"), np.searchsorted(theta, at, side="right")
        high = np.searchsorted(theta, at + reach[c], side="right")
        out[c] = np.maximum(out[c], np.minimum(largest(f[c], low, begin), largest(f[c], end, high)))
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
