"""What passes take, from the times at which progress is told: without what comes before them, and what compiles in the first."""

import numpy as np
import pytest

from renderers.pictures.pace import Pace


class Told:
    """A render that takes so long before its passes and for each of them; noise of the mean of `values` so far, one a pass."""

    def __init__(self, before, seconds, variances, *, known=2):
        self.now = 10.0
        self.pace = Pace(None, lambda: self.now)
        self.now += before
        for i, (one, _) in enumerate(zip(seconds, variances)):
            self.tell(variances, i, known)
            self.now += one
        self.tell(variances, len(seconds), known)
        self.now += 0.5  # files are written
        self.pace(1.0)

    def paced(self, **passes):
        return self.pace.paced({name: {"passes": count, "noise": 0.1, "seconds": seconds, "concentration": 0.2}
                                for name, (count, seconds) in passes.items()})

    def tell(self, variances, count, known):
        self.pace(0.1, np.sqrt(np.mean(variances[:count]) / count) if count >= known else None)


def test_setup_and_passes():
    """The first pass, in which a machine compiles, counts as much as the second."""
    found = Told(3.0, [7.0, 1.0, 1.0, 1.0], np.ones(4)).paced(walk=(4, 0.6))
    assert (found.passes, found.setup) == (4.0, 3.5)


def test_two_kinds_of_passes():
    """Noise is known after two of each, which come in turns."""
    found = Told(1.0, [5.0, 9.0, 1.0, 2.0, 1.0], np.ones(5), known=4).paced(walk=(3, 0.5), splat=(2, 1.0))
    assert (found.passes, found.setup) == (7.0, 1.5)


def test_passes_that_are_gone_on_with():
    """The noise of the earlier ones is known from the beginning; of an interruption, that it has passes is all that is known."""
    now = iter((10.0, 13.0, 14.0, 15.0, 15.5))
    pace = Pace(None, lambda: next(now), 8.0)
    for noise in (0.3, 0.28, 0.26):
        pace(0.5, noise)
    parts = {"walk": {"passes": 10, "noise": 0.26, "seconds": 1.0, "concentration": 0.1}}
    assert pace.paced(parts)[:2] == (10.0, 3.5)
    assert Told(3.0, [7.0, 1.0], np.ones(2)).pace.interrupted().passes == 8.5


def test_without_passes_all_is_setup():
    assert Told(3.0, [], np.ones(0), known=9).paced() == (0.0, 3.5, 0.0, 0.0, 0.0)


def test_noise_with_passes_shared_out_best():
    """Of one kind noise^2 seconds as it was; of two (0.1 sqrt(6 s) + 0.1 sqrt(2 s))^2."""
    alone = Told(0.0, np.ones(4), np.ones(4)).paced(walk=(4, 0.6))
    assert (alone.rate, alone.least, alone.spread) == (pytest.approx(0.04), pytest.approx(2.0), pytest.approx(0.2))
    both = Told(0.0, np.ones(8), np.ones(8), known=4).paced(walk=(2, 3.0), splat=(2, 1.0))
    assert both.rate == pytest.approx(0.01 * (6**0.5 + 2**0.5) ** 2) and both.least == pytest.approx(8.0)
    assert both.spread == pytest.approx(0.2 * 8**0.5 / (6**0.5 + 2**0.5))
    many = Told(0.0, np.ones(64), np.ones(64)).paced(walk=(64, 1.0))
    assert many.spread == pytest.approx(0.1)
