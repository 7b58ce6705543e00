"""What a statistical test allows chance: one meaning of odds, and the standard errors that they come to.

Odds are always the probability that a right program fails a comparison, should its random numbers be drawn anew; seeds are fixed,
so a test that passes does so for good.  Tests of a probability compare it with `ODDS`, tests of a distance take `sigmas`.
"""

import math

from scipy import stats

ODDS = 1e-7  # of one comparison: the some thousand of all suites fail once in a few thousand seeds


def sigmas(blocks: float = math.inf, odds: float = ODDS, comparisons: int = 1) -> float:
    """Within how many standard errors every one of several comparisons is, but for the odds of all of them together.

    blocks : independent estimates whose scatter gives the standard error (Student's t); inf: it is known (a normal number)
    comparisons : that hold at once (Bonferroni; they need not be independent)
    """
    return float(stats.t.isf(odds / (2 * comparisons), blocks - 1))


SIGMAS = sigmas()  # of one normal number: 5.33
