"""Which tables are made of a medium: light that keeps its direction, orders, and photons in the solver's place."""

import math

import numpy as np
import pytest

from bakery.physics.medium import phase as phases
from bakery.physics.multiple import choice, legendre
from bakery.physics.multiple.kinds import POINT, SEGMENT

# so near to 0 that no moment sees where the peak ends
THETA = np.insert(np.linspace(0, math.pi, 181), 1, 1e-4)
SMOOTH = phases.normalised(THETA, 1 + 0.5 * np.cos(THETA))[0]


def medium(albedo, delta):
    return choice.Medium(albedo, THETA, phases.with_delta(THETA, SMOOTH, delta), delta)


def test_what_keeps_its_direction_is_not_scattered():
    plain, packed = choice.solved(medium(0.5, 0.0), None), choice.solved(medium(0.625, 0.4), None)
    assert packed.peak == 0.4 and packed.peak_angle == THETA[1] and plain.peak_angle == 0
    assert packed.phase == pytest.approx(SMOOTH, rel=1e-6)
    # 0.625 (1 - 0.4) / (1 - 0.625 0.4) = 0.5: the same medium
    assert packed.solution.medium.albedo == pytest.approx(0.5)
    assert packed.solution.medium.scaled == pytest.approx(plain.solution.medium.scaled, rel=1e-4, abs=1e-9)
    nothing = choice.solved(medium(1.0, 1.0), None)
    assert nothing.solution.medium.albedo == 0 and nothing.peak == 1


def test_orders_follow_the_phase_function():
    """As many as it takes up to 96; where more would be needed 40 are kept, and the peak is cut."""
    theta = np.concatenate([[0], np.geomspace(1e-4, math.pi, 600)])
    for g, order, cut in ((0.5, 12, False), (0.97, 40, True)):
        mu = np.cos(theta)
        f = phases.normalised(theta, (1 - g * g) / (1 + g * g - 2 * g * mu) ** 1.5)[0]
        found = choice.solved(choice.Medium(0.5, theta, f, 0.0), None)
        assert (found.peak > 0) == cut and found.solution.medium.order <= 96
        assert found.solution.medium.order == pytest.approx(order, abs=2)
        assert np.abs(legendre.moments(theta, found.phase, 120)[found.solution.medium.order + 1:]).max() < 3e-4


@pytest.mark.slow
def test_both_methods_tabulate_the_same_medium():
    asked = choice.Asked(5.0, 2.0, 0.1, None, 4000, 0)
    solver = choice.by_solver(medium(0.625, 0.4), (POINT,), asked)[POINT]
    photons = choice.by_photons(medium(0.625, 0.4), (POINT, SEGMENT), asked)
    assert set(photons) == {POINT, SEGMENT} and not solver.counted and photons[SEGMENT].table.kind == SEGMENT
    for one in photons.values():
        assert (one.albedo, one.extinction, one.peak, one.peak_angle) == pytest.approx((0.5, 0.75, 0.4, THETA[1]))
        assert one.phase == pytest.approx(solver.phase, rel=1e-12) and one.counted["photons"][0] > 0
    assert solver.extinction == pytest.approx(0.75) and solver.table.error_with_solver < 0.1
    assert choice.error([solver, photons[POINT]]) == photons[POINT].table.error_with_solver
    assert choice.error([]) == choice.error([solver, None]) == math.inf


@pytest.mark.parametrize("albedo", [1e-12, 1e-300])
def test_a_medium_that_scatters_next_to_nothing(albedo):
    """Far from the source less light than a double holds: finite tables, a finite error, no warning."""
    f = phases.normalised(THETA, 0.75 / (1.25 - np.cos(THETA)) ** 1.5)[0]
    asked = choice.Asked(None, 2.0, 0.05, None, 4000, 0)
    dark = choice.by_solver(choice.Medium(albedo, THETA, f, 0.0), (SEGMENT,), asked)[SEGMENT]
    assert all(np.isfinite(values).all() for values in dark.table.arrays().values()) and np.isfinite(dark.table.error_with_solver)
