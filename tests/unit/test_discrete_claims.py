"""Scenes of separate particles that ship, and the graininess that docs/discrete-claims.md tells of."""

import numpy as np
import pytest

from benchmarks.figures_discrete import stand


@pytest.mark.parametrize("number, size", [(3e4, 8), (1e6, 8), (1e6, 1)])
def test_graininess_is_that_of_counts(number, size):
    """Poisson counts under a slope: 1/sqrt(mean count) to 6 standard errors of the scatter of correlated differences."""
    y, x = np.mgrid[0:64, 0:64] / 64
    counts = np.random.default_rng(1).poisson(number / 64**2 * (0.75 + 0.5 * x), (64, 64)).astype(float)
    blocks = (64 / size) ** 2
    assert stand.graininess(counts, size) == pytest.approx(np.sqrt(blocks / number), rel=6 * 1.5 / np.sqrt(2 * blocks))
