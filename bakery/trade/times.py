"""What repeated, noisy times show: ratios to a baseline, their spread, and when they have been repeated enough.

Every run is bracketed by runs of one fixed setting, the baseline.  A machine that slows down slows both, so what counts is the
ratio; seconds are that ratio times the median of all baselines.
"""

import math
from collections.abc import Iterable, Sequence
from itertools import combinations
from statistics import median

SHORT, LONG = 10.0, 60.0  # seconds: runs below are repeated three times at least, runs above not at all
MOST = 9  # repeats
REPEATING = 5.0  # seconds that repeats beyond the least number may take a setting
PRECISE = 0.02  # standard error of a median, relative, at which more repeats add nothing
UNKNOWN = 0.05  # spread of one time, relative, while nothing has been repeated
LEAST = 0.005  # spread below which no clock on a shared machine is believed


def least_repeats(seconds: float) -> int:
    """How often a run of so many seconds is made at least."""
    return 3 if seconds < SHORT else 2 if seconds < LONG else 1


def repeat_again(seconds: Sequence[float], ratios: Sequence[float], hopeless: bool = False) -> bool:
    """Whether another repeat is worth it.

    seconds : of the runs so far
    ratios : the same relative to the baseline
    hopeless : the first run showed that the setting is far from the front: once is enough
    """
    if not seconds:
        return True
    typical, count = median(seconds), len(seconds)
    if hopeless or count < least_repeats(typical):
        return not hopeless
    if count >= MOST or count * typical >= REPEATING:
        return False
    return standard_error(deviation([ratios]), count) > PRECISE


def deviation(groups: Iterable[Sequence[float]]) -> float:
    """Standard deviation of ln(time) of a single run, from the differences within groups of repeats.

    The median of |ln a - ln b| over all pairs of a group, over 0.954: for a normal distribution that is its standard deviation,
    and a few runs that something else delayed do not move it.
    """
    pairs = [abs(math.log(a / b)) for group in groups for a, b in combinations(group, 2)]
    return max(median(pairs) / 0.9539, LEAST) if pairs else UNKNOWN


def standard_error(spread: float, count: int) -> float:
    """Standard error of the median of so many runs; that of a mean where the median is one."""
    return spread * (1.2533 if count > 2 else 1.0) / math.sqrt(count)


def quantiles(values: Sequence[float]) -> tuple[float, float, float, float]:
    """Median, median absolute deviation, smallest, largest."""
    middle = median(values)
    return middle, median(abs(value - middle) for value in values), min(values), max(values)
