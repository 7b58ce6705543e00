"""How quickly passes make a picture better: what comes before them, what they take, and how sure their noise is.

Read off the times at which a renderer by passes (`renderers.progressive`) tells its progress: before each pass, and at the end.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

_BLOCKS = 8  # of passes, from whose scatter the spread is taken
_FEWEST = 4  # blocks with which it says something
_UNKNOWN = 0.3  # spread where there are fewer: of the variance by four passes of a picture with bright spots


class Paced(NamedTuple):
    """A render by passes.

    Attributes
    ----------
    passes : processor seconds of them; the first of each kind, in which a machine compiles, counts as much as its second
    setup : of the rest, once; without what went into compiling
    spread : standard error of ln(noise^2 times seconds of passes)
    """

    passes: float
    setup: float
    spread: float


class Pace:
    """Takes the place of a progress function, and remembers when it was called."""

    def __init__(self, progress: Callable | None, clock: Callable[[], float], earlier: float = 0.0):
        """
        Parameters
        ----------
        progress : function of (fraction 0 to 1, noise or None), or None
        clock : processor seconds so far
        earlier : processor seconds of the passes of earlier calls, with which this one goes on
        """
        self._progress, self._clock, self._earlier = progress, clock, earlier
        self._begin, self._told = clock(), []

    def __call__(self, fraction, noise=None):
        self._told.append((self._clock(), noise))
        if self._progress:
            self._progress(fraction, noise)

    def paced(self, kinds: int | None) -> Paced:
        """What the passes of all calls took, up to now.

        kinds : of passes, 0 of a renderer without, None where it is not known: then all passes count as they were
        """
        known = [i for i, (_, noise) in enumerate(self._told) if noise]
        times = [at for at, _ in self._told]
        if kinds is None:
            return Paced(self._earlier + (times[-1] - times[0] if times else 0.0), 0.0, _UNKNOWN)
        if not kinds or not known:
            return Paced(0.0, self._clock() - self._begin, 0.0)
        first = known[0]
        # noise is known after two passes of each kind, or from the beginning where earlier passes are gone on with
        begun = max(first - 2 * kinds, 0)
        early = 2 * (times[first] - times[first - kinds]) if first >= 2 * kinds else times[first] - times[begun]
        # between two renders of one call, of which the first ends without noise, lies no pass
        steps = [times[i] - times[i - 1] if i - 1 in known else 0.0 for i in known[1:]]
        seconds = self._earlier + early + np.cumsum([0.0, *steps])
        setup = times[begun] - self._begin + self._clock() - times[known[-1]]
        return Paced(float(seconds[-1]), float(setup), _spread(seconds, np.array([self._told[i][1] for i in known])))


def _spread(seconds, noise) -> float:
    """Standard error of ln(noise^2 seconds) at the end, from both (N,) as they went; from blocks of passes."""
    at = np.unique(np.linspace(0, len(seconds) - 1, min(_BLOCKS, len(seconds))).round().astype(int))
    if len(at) < _FEWEST or seconds[at[0]] <= 0:
        return _UNKNOWN
    # the variance of a pass, by what it adds to the sum of squares: noise^2 is that sum over the square of time
    sums, width = noise[at] ** 2 * seconds[at] ** 2, np.diff(seconds[at], prepend=0.0)
    whole = sums[-1] / seconds[-1]
    apart = np.diff(sums, prepend=0.0) - whole * width
    return float(np.sqrt(len(at) / (len(at) - 1) * np.sum(apart**2)) / sums[-1])
