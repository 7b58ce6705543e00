"""What statistical tests allow chance."""

import re

import numpy as np
import pytest
from scipy import stats

from tests.conftest import ROOT
from tests.odds import ODDS, SIGMAS, sigmas


def test_standard_errors_have_their_odds():
    assert SIGMAS == sigmas() == pytest.approx(stats.norm.isf(ODDS / 2)) == pytest.approx(5.33, abs=0.01)
    assert sigmas(odds=0.0027) == pytest.approx(3, abs=1e-3)
    assert SIGMAS < sigmas(1000) < sigmas(32) < sigmas(12) and sigmas(32, 1e-6) < sigmas(32, 1e-6, comparisons=9)
    # of sets of three means of eight normal numbers one in twenty is off; 2e4 sets know that to 0.0015
    drawn = np.random.default_rng(1).normal(size=(20_000, 3, 8))
    away = np.abs(drawn.mean(axis=-1)) / (drawn.std(axis=-1, ddof=1) / 8**0.5)
    shares = [np.mean(np.any(away > limit, axis=1)) for limit in (sigmas(8, 0.05, 3), sigmas(odds=0.05, comparisons=3))]
    assert shares[0] == pytest.approx(0.05, abs=0.01) and shares[1] > 0.09, "as of normal numbers more would fail"


def test_odds_are_defined_in_one_place():
    numbers = re.compile(r"^(?:\w+, )?(?:ODDS|SIGMAS)(?:, \w+)? = [\d.]", re.MULTILINE)
    defined = [path.name for path in (ROOT / "tests").rglob("*.py") if numbers.search(path.read_text(encoding="utf-8"))]
    assert defined == ["odds.py"]
