"""Paths in a medium that is everywhere, far outside of the scene."""

import math

import numpy as np
import pytest

from renderers.materials.medium.interactor import Medium
from renderers.transport import waves
from renderers.transport.paths import ELSEWHERE, ENDED, Colours
from renderers.transport.scattering import UNIFORM, scatterer

PATHS, START, RADIUS, ABSORBED = 20_000, 40.0, 13.0, 1e-4  # of scattered light


@pytest.mark.slow
def test_they_come_back_or_end_within_one_step():
    """In fog that absorbs nothing some took 100,000 steps, milliseconds each: a draft of fog and sand took more than ten minutes.

    Mean free paths are 1 m.  To within 12 of them around a scene of RADIUS, that is to a radius of 25 m, light comes back with a
    chance of exp(-k (r - a)) a/r: diffusion to a black ball, with Milne's extrapolation length, a = 25 - 0.71.  Of 20,000 paths
    a third goes on, with three times the weight: the standard error is 1.3 %, so a false alarm has odds of 1e-8.
    """
    rng = np.random.default_rng(1)
    direction = rng.normal(size=(PATHS, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    origin = np.full((PATHS, 3), [START, 0.0, 0.0])
    paths = waves.starting(origin, direction, 1, rng.integers(2**63, size=PATHS, dtype=np.uint64), np.zeros(PATHS, np.int64))
    fog = scatterer([1.0], [1 - ABSORBED], [0, np.pi], np.full((1, 2), UNIFORM))
    medium = Medium(fog, Colours(np.ones((3, 1)), np.ones((1, 3)) / 3), extent=(np.zeros(3), RADIUS))
    status = medium.advance(paths, np.full(PATHS, np.inf))[0]
    back = status == ELSEWHERE
    assert np.mean(back | (status == ENDED)) > 0.999  # some of the first flights come as near
    ball = RADIUS + 12 - 0.71
    expected = ball / START * math.exp(-math.sqrt(3 * ABSORBED) * (START - ball))
    assert paths.throughput[back].sum() / PATHS == pytest.approx(expected, rel=0.08)
    assert np.allclose(np.linalg.norm(paths.origin[back], axis=1), RADIUS + 12)
    assert paths.single[back].all() and np.isnan(paths.far[back]).all()  # they find all lights by themselves
    assert paths.order[back].max() > 1000
