"""Quadrature over a size distribution, in nested levels: each level keeps the nodes of the one before and adds the midpoints.

What is averaged oscillates in the size parameter with period ~pi and carries resonances narrower than any grid, so that no rule
of high order helps; what helps is to put the nodes where the particles count.  The rule is the trapezoid in a variable u in
[0, 1] whose density over ln r is `0.9 (r^2.5 dn/dlnr)^0.6 + 0.1`, both parts normalised: near the optimum of stratified sampling
for quantities that grow like r^2 .. r^3 when a node costs ~r, and with a floor that leaves no gap.  For water drops (median
5 um, sigma 1.5) 2048 nodes then do what 4096 do that are uniform in ln r (docs/averages.md).  Since dn/dlnr divided by the node
density is bounded, edges of a cut and steps of a table cost no more than a cell.
"""

import math
from dataclasses import dataclass

import numpy as np

from bakery.physics.sizes.distributions import Part, Population

LAST_NODES = 2**18  # nodes of a part at the last level; in a mixture the finest part may have four times as many
_FIRST_STEP = 4.0  # step in size parameter, at the sizes that scatter most, of the first level: a coarser one is useless
COARSE, SPARSE = 16, 8  # steps to begin with where errors are judged over all angles together
_KEPT = 2**14  # nodes that a level may add and be kept
_FEWEST, _MOST = 64, 4096  # nodes of the first level


@dataclass(frozen=True)
class _Map:
    """ln r as a function of u: the inverse of the integral of a piecewise linear node density."""

    s: np.ndarray  # (S,) ln r
    rho: np.ndarray  # (S,) density of nodes over ln r, integral 1
    u: np.ndarray  # (S,) its integral

    def at(self, u):
        """ln r and the node density there."""
        i = np.clip(np.searchsorted(self.u, u, side="right") - 1, 0, len(self.s) - 2)
        step = self.s[i + 1] - self.s[i]
        slope = (self.rho[i + 1] - self.rho[i]) / step
        offset = u - self.u[i]
        d = 2 * offset / (self.rho[i] + np.sqrt(np.maximum(self.rho[i] ** 2 + 2 * slope * offset, 0.0)))
        d = np.clip(d, 0.0, step)
        return self.s[i] + d, self.rho[i] + slope * d


class Nodes:
    """Nested quadrature levels for a population.

    wavenumber : (L,) 1/um, in the host; the longest decides how far the tails reach, the shortest how fine the first level is
    tolerance : the neglected part of the number, and of the r^4-weighted number (r^6 below x = 1), is under a hundredth of it
    steps : begin with at most so many, whatever they resolve, for errors that are judged over all angles together
    count : about so many sizes for each part in all three levels, whatever they resolve; None: as fine as the ripples ask, and
        levels to refine

    Averages of `f` follow from sums over new nodes only: with `F` the sum over `fixed()`, `C_0` the sum over `fresh(0)` and
    `C_j = C_(j-1)/2 + sum over fresh(j)`, the average at level j is `(F + C_j(f)) / (F + C_j(1))`.
    """

    def __init__(self, population: Population, wavenumber, tolerance: float, count: int | None = None,
                 steps: int | None = None):
        k = np.atleast_1d(np.asarray(wavenumber, float))
        single = [part for part in population.parts if part.law.discrete]
        self._fixed = (np.array([part.law.radius for part in single], float), np.array([part.share for part in single], float))
        self.wavenumber = float(k.max())
        self._parts = [part for part in population.parts if not part.law.discrete]
        self.counted = count is not None
        self._fresh: dict[int, tuple] = {}
        self._maps, self.first = [], []  # `first`: nodes of each part's first level
        # (size parameter at the shortest wavelength, relative width) of each part, weighted by r^2.5
        self.features = [(float(r) * self.wavenumber, 0.0) for r in self._fixed[0]]
        for part in self._parts:
            grid, first, feature = _prepare(part, k, tolerance)
            self._maps.append(grid)
            self.first.append(max(1, round((count - 1) / 4)) if count is not None else min(first, steps or first))
            self.features.append(feature)
        self.levels = 1
        if self._parts and self.counted:
            self.levels += 2
        elif self._parts:
            self.levels += int(math.log2(min(LAST_NODES / min(self.first), 4 * LAST_NODES / max(self.first))))

    @property
    def refinable(self) -> bool:
        """Whether there is anything to integrate; discrete sizes are exact."""
        return bool(self._parts)

    def fixed(self):
        """Radii (um) and weights of discrete sizes."""
        return self._fixed

    def fresh(self, level: int):
        """Radii (um) and weights of the nodes that a level adds, ascending within each part; weights for that level's step."""
        kept = self._fresh.get(level)
        if kept is not None:
            return kept
        radii, weights = [np.empty(0)], [np.empty(0)]
        for part, grid, first in zip(self._parts, self._maps, self.first):
            count = first << level
            i = np.arange(count + 1) if level == 0 else np.arange(1, count, 2)
            r, w = _rule(part, grid, i, count)
            radii.append(r)
            weights.append(w)
        new = np.concatenate(radii), np.concatenate(weights)
        if len(new[0]) <= _KEPT:
            # every wavelength asks for the same: of 500, a third of the time of a bake of aerosol
            for array in new:
                array.flags.writeable = False
            self._fresh[level] = new
        return new

    def count(self, level: int) -> int:
        """Number of nodes of a level."""
        return len(self._fixed[0]) + sum((first << level) + 1 for first in self.first)

    def whole(self, level: int):
        """All nodes of a level by ascending radius (um), with weights that add up to 1."""
        radii, weights = [self._fixed[0]], [self._fixed[1]]
        for part, grid, first in zip(self._parts, self._maps, self.first):
            count = first << level
            r, w = _rule(part, grid, np.arange(count + 1), count)
            radii.append(r)
            weights.append(w)
        r, w = np.concatenate(radii), np.concatenate(weights)
        order = np.argsort(r, kind="stable")
        r, w = r[order], w[order]
        return r, w / math.fsum(w)

    def span(self):
        """Smallest and largest radius, um."""
        ends = [(r, r) for r in self._fixed[0]] + [(math.exp(m.s[0]), math.exp(m.s[-1])) for m in self._maps]
        return min(a for a, _ in ends), max(b for _, b in ends)


def _rule(part: Part, grid: _Map, i, count):
    s, rho = grid.at(i / count)
    r = np.clip(np.exp(s), part.lower, part.upper)
    if part.law.bends:
        r = np.clip(r, part.law.bends[0], part.law.bends[-1])
    number = part.share / part.law.moment(0, part.lower, part.upper)
    weight = number * part.law.density(r) * r / rho / count
    weight[(i == 0) | (i == count)] *= 0.5
    return r, weight


def tails(part: Part, wavenumber, tolerance: float):
    """Smallest and largest radius (um) of a part that count at a tolerance; wavenumber (L,) 1/um, in the host."""
    low, high = _ends(part, np.atleast_1d(np.asarray(wavenumber, float)), tolerance)
    return math.exp(low), math.exp(high)


def _ends(part: Part, k, tolerance):
    """ln r of the tails' ends."""
    low, high = part.law.reach()
    low, high = max(low, part.lower), min(high, part.upper)
    s = _fine(part, math.log(low), math.log(high))
    number = _number(part, s)
    # forward intensity grows like r^4, below x = 1 everything like r^6
    top = number * np.exp(4 * (s - s[-1])) / (1 + (k.min() * np.exp(s)) ** -2.0)
    neglected = tolerance / 100
    from_below, from_above = _integral(s, number), _integral(-s[::-1], top[::-1])[::-1]
    keep = (from_below > neglected * from_below[-1]) & (from_above > neglected * from_above[0])
    inside = np.flatnonzero(keep)
    return s[max(inside[0] - 1, 0)], s[min(inside[-1] + 1, len(s) - 1)]


def _prepare(part: Part, k, tolerance):
    """Node map, nodes of the first level, and (size parameter, relative width) of one part."""
    s = _fine(part, *_ends(part, k, tolerance))
    number = _number(part, s)
    weight = number * np.exp(2.5 * (s - s[-1]))
    weight /= _integral(s, weight)[-1]
    rho = weight**0.6
    rho = 0.9 * rho / _integral(s, rho)[-1] + 0.1 / (s[-1] - s[0])
    u = _integral(s, rho)
    rho, u = rho / u[-1], u / u[-1]
    x = k.max() * np.exp(s)
    step = _integral(s, weight * x / rho)[-1]  # in size parameter, times the number of nodes
    first = int(np.clip(2 ** math.ceil(math.log2(max(step / _FIRST_STEP, 1.0))), _FEWEST, _MOST))
    mean = _integral(s, weight * (s - s[0]))[-1]
    width = math.sqrt(max(_integral(s, weight * (s - s[0] - mean) ** 2)[-1], 0.0))
    return _Map(s, rho, u), first, (float(k.max() * math.exp(s[0] + mean)), width)


def _fine(part: Part, low, high, count=4097):
    s = np.linspace(low, high, count)
    if part.law.bends:
        rows = np.log(np.array([r for r in part.law.bends if r > 0]))
        s = np.union1d(s, rows[(rows > low) & (rows < high)])
    return s


def _number(part: Part, s):
    """dn/dlnr on the grid."""
    r = np.exp(s)
    if part.law.bends:
        r = np.clip(r, part.law.bends[0], part.law.bends[-1])
    return part.law.density(r) * r


def _integral(s, f):
    """Running integral by trapezoids, from 0."""
    return np.concatenate([[0.0], np.cumsum((f[1:] + f[:-1]) / 2 * np.diff(s))])
