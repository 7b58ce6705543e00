"""Variance of a pixel as more and more passes will show it, from the few of a pilot.

Of light that a few bright paths bring, few passes show too little noise: brighter paths come that are rarer.  So the squares of
what passes differ by have a heavy tail, and their mean over more of them is larger.  The largest squares of a pilot tell how
heavy: they are taken for those of a Pareto law, whose index is by Hill's estimator (Hill 1975), and the law gives what the same
tail holds among as many squares as a picture has.  Of the two largest it counts only that they are larger than the third: no
single path decides how heavy a tail is.  But the mean of what the pilot shows is never too large on average, however few paths it
is of, and the law is not believed where it says less: a pilot comes upon a bright path because there are more of them.

How well all that is known is told by leaving out regions of the picture, one at a time (the jackknife, Tukey 1958): paths that
are bright together, such as the steps of a chain that stays at a place, lie in one region.  One that has most of the squares
leaves them uncertain by a factor of e, as one event tells how often such events come.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from renderers.pictures.means import tiles

_LARGEST = 16  # squares that the law stands for
_BEYOND = 2  # of them, that are only known to be brighter than the next
_BRIGHT = 0.01  # share of the pixels, that do not tell how squares from the median are to be scaled
_FEWEST = 2  # squares that a law is read off; one or two far above the rest are the law's brightest
# ln(square) rises by the power times ln(1 / odds): at 1 the variance is infinite, at 2 the mean luminance would be
_STEEPEST = 1.9
# A power before any square is seen, and as how many squares that counts.  The brightest path of a scene is no brighter than its
# lamps, which a law does not know: of beads, whose brightest dots are alike, 32 squares and a weight of 4 foretold 9 times the
# noise
_USUAL, _WEIGHT = 0.75, 16


class Tail(NamedTuple):
    """What squares of differences are: their mean is the variance.

    Attributes
    ----------
    body : of all but the largest, their sum over the number of all
    head : of the largest, the least of them times their share of the number
    power : inverse of the index of the law
    number : of squares that the law stands for; 0: of none
    count : of all
    dim : sum of all but a fixed number of the largest, over `count`
    shown : mean of all
    """

    body: float
    head: float = 0.0
    power: float = 0.0
    number: int = 0
    count: int = 1
    dim: float = 0.0
    shown: float = 0.0

    def variance(self, among: float | None = None) -> float:
        """Mean of so many squares, by the law up to the largest that they have usually, or as shown if that is more; None: of as
        many as these are."""
        if not self.number:
            return self.shown
        rise, depth = self.power - 1, math.log(max(self.number * (among or self.count) / self.count, 1.0))
        return max(self.body + self.head * (math.expm1(rise * depth) / rise if abs(rise) > 1e-9 else depth), self.shown)


def of_passes(passes, among: float | None = None) -> tuple[Tail, float]:
    """`Tail` of a pilot, and the standard error of the logarithm of its variance among so many squares.

    passes : (n, H, W) luminance of passes, n from 2
    """
    squares = _squares(np.asarray(passes, float))
    label = tiles(*squares.shape[1:]).ravel()
    order = np.argsort(label, kind="stable")
    ends = np.cumsum(np.bincount(label))[:-1]
    regions = [part.ravel() for part in np.split(squares.reshape(len(squares), -1)[:, order], ends, axis=1)]
    # the largest of each are all that can be among the largest of some of them
    largest = [-np.sort(-part)[:_LARGEST + 1] if part.size <= _LARGEST else
               np.sort(np.partition(part, -_LARGEST - 1)[-_LARGEST - 1:])[::-1] for part in regions]
    sums, counts = np.array([part.sum() for part in regions]), np.array([part.size for part in regions])
    tail = _fitted(np.concatenate(largest), sums.sum(), counts.sum())
    if len(regions) < 2 or not sums.sum() > 0:
        return tail, 0.0
    without = [_fitted(np.concatenate(largest[:region] + largest[region + 1:]), sums.sum() - sums[region],
                       counts.sum() - counts[region]) for region in range(len(regions))]
    every, *logs = np.log([max(part.variance(among or tail.count), 1e-300) for part in (tail, *without)])
    return tail, float(np.linalg.norm(np.clip(np.array(logs) - every, -1.0, 1.0)))


def _squares(passes):
    """(n, H, W) whose mean is the variance, of passes from their median, which a bright path in one of them leaves as it is: from
    their mean all squares of the pixel would be large.  Those of two passes are alike: (1, H, W)."""
    squares = (passes - np.median(passes, axis=0)) ** 2
    if len(passes) == 2:
        return 2 * squares[:1]
    variance, mean = passes.var(axis=0, ddof=1), squares.mean(axis=0)
    dim = mean <= np.quantile(mean, 1 - _BRIGHT)
    pixels = dim if np.any(mean[dim] > 0) else mean > 0
    return squares * (variance[pixels].sum() / mean[pixels].sum() if pixels.any() else 0.0)


def _alike(largest) -> int:
    """How many of squares but the last the law is of: where most of its rise is one step down from some, these are of their own,
    such as dots of a brightness."""
    number = len(largest) - 1
    rises = np.arange(1, number + 1) * np.log(largest[:-1] / largest[1:])
    step = int(np.argmax(rises))
    return step if step >= _FEWEST and rises[step] > rises.sum() / 2 else number


def _fitted(largest, total, count) -> Tail:
    largest, count = np.sort(largest)[::-1][:_LARGEST + 1], max(int(count), 1)
    number, dim = min(int(np.count_nonzero(largest > 0)), len(largest)) - 1, float(max(total - largest.sum(), 0.0) / count)
    if number < 2:
        return Tail(0.0, count=count, dim=dim, shown=float(total / count))
    number = _alike(largest[:number + 1])
    first, least = largest[:number], float(largest[number])
    # how far the brightest are above the next does not count (an estimate of censored numbers): they may be one path
    beyond = min(_BEYOND, number - 1)
    counted = np.log(np.minimum(first, first[beyond]) / least).sum()
    power = float((counted + _WEIGHT * _USUAL) / (number - beyond + _WEIGHT))
    return Tail(float(max(total - first.sum(), 0.0) / count), number * least / count, min(power, _STEEPEST), number, count, dim,
                float(total / count))
