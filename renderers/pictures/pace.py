"""How quickly passes make a picture better: what comes before them, what they take, and the noise that a second of them leaves.

Times are read off a renderer by passes (`renderers.pictures.progressive`) when it tells its progress: before each pass, and at
the end.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

_MANY = 16  # passes of which a bright spot in the noise is no chance any more: the noise of later ones is like theirs


class Paced(NamedTuple):
    """A render by passes; of a renderer without, all is `setup`.

    passes : processor seconds of them; the first of each kind, in which a machine compiles, counts as much as its second
    setup : of the rest, once; without what went into compiling
    least : processor seconds of two passes of each kind, before which there is no picture with noise
    rate : noise^2 times processor seconds of passes, as it is with kinds of passes shared out best
    spread : standard error of ln(rate)
    """

    passes: float
    setup: float
    least: float = 0.0
    rate: float = 0.0
    spread: float = 0.0


class Pace:
    """Takes the place of a progress function, and remembers when it was called."""

    def __init__(self, progress: Callable | None, clock: Callable[[], float], earlier: float = 0.0):
        """
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

    def interrupted(self) -> Paced:
        """What the passes of all calls took, up to now, as they were."""
        return Paced(self._earlier + (self._told[-1][0] - self._told[0][0] if self._told else 0.0), 0.0)

    def paced(self, parts: Mapping[str, Mapping]) -> Paced:
        """What the passes of all calls took, now that they are over; `parts`: of the renderer's report, {} of one without."""
        noisy = [i for i, (_, noise) in enumerate(self._told) if noise]
        if not parts or not noisy:
            return Paced(0.0, self._clock() - self._begin)
        times, first, kinds = [at for at, _ in self._told], noisy[0], len(parts)
        # noise is known after two passes of each kind, or from the beginning where earlier passes are gone on with
        earliest = max(first - 2 * kinds, 0)
        early = 2 * (times[first] - times[first - kinds]) if first >= 2 * kinds else times[first] - times[earliest]
        # between two renders of one call, of which the first ends without noise, lies no pass
        later = sum(times[i] - times[i - 1] for i in noisy[1:] if i - 1 in noisy)
        setup = times[earliest] - self._begin + self._clock() - times[noisy[-1]]
        return Paced(self._earlier + early + later, setup, *shared_out(parts, self._earlier + early + later))


def shared_out(parts, passes):
    """`least`, `rate` and `spread`: N passes of a kind, of c seconds, leave the variance v/N; in T seconds in all, best shared
    out, all kinds leave (sum of sqrt(v c))^2 / T."""
    count, noise, seconds, even = (np.array([part[key] for part in parts.values()], float)
                                   for key in ("passes", "noise", "seconds", "concentration"))
    if not np.sum(count * seconds) > 0:
        return 0.0, 0.0, 0.0
    cost = seconds * passes / np.sum(count * seconds)  # of all processors
    roots = noise * np.sqrt(count * cost)
    spread = even * np.sqrt(np.minimum(1.0, _MANY / count))
    whole = float(np.sum(roots))
    return 2 * float(np.sum(cost)), whole**2, float(np.linalg.norm(roots * spread)) / whole if whole > 0 else 0.0
