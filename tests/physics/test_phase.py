"""Phase tables: exactness for the interpolant, samplers, formulas, similarity, mixing."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, stats

from bakery.physics.medium import analytic, grid, mixing, phase, similarity
from bakery.physics.medium.kernels import phase_layout, phase_sample, phase_value
from bakery.system.compiled import njit
from tests.odds import ODDS


def random_table(seed, count=50):
    draw = np.random.default_rng(seed)
    theta = np.sort(np.concatenate([draw.random(count) * math.pi, 10.0 ** draw.uniform(-8, 0, count)]))
    theta = np.concatenate([[0.0], theta, [math.pi]])
    f, _ = phase.normalised(theta, 10.0 ** draw.uniform(-3, 3, (2, len(theta))) * (draw.random((2, len(theta))) > 0.1))
    return theta, f


@pytest.mark.parametrize("seed", range(5))
def test_normalisation_and_cdf_are_exact_for_the_interpolant(seed):
    theta, f = random_table(seed)
    assert np.abs(phase.phase_integral(theta, f) - 1).max() < 1e-13
    cdf = phase.cumulative(theta, f)
    assert (cdf[:, 0] == 0).all() and (cdf[:, -1] == 1).all() and (np.diff(cdf) >= 0).all()
    # brute force over mu in each cell with a rule that is exact for quadratics
    mu = np.cos(theta)
    g = sum(integrate.fixed_quad(
                lambda m: m * phase.phase_at(theta, f[0],
                                             np.arccos(np.clip(m, -1, 1))),
                mu[i +1],
                mu[i],
                n=3) [0] for i in range(len(theta) -1))
    # cosines lose 1e-16/theta at the smallest angles: the brute force, not the table
    assert phase.mean_cosine(theta, f)[0] == pytest.approx(2 * math.pi * g, abs=1e-6)


def test_steps_keep_their_digits_at_small_angles():
    theta = np.array([0.0, 1e-9, 2e-9, 1.0, math.pi])
    assert phase.steps(theta)[:2] == pytest.approx([0.5e-18, 1.5e-18], rel=1e-15)
    assert phase.steps(theta).sum() == pytest.approx(2, rel=1e-15)


def test_evaluation_is_linear_in_the_cosine():
    theta = np.array([0.0, 0.4, 1.3, math.pi])
    f = 3 + 2 * np.cos(theta)
    at = np.linspace(0, math.pi, 101)
    assert phase.phase_at(theta, f, at) == pytest.approx(3 + 2 * np.cos(at), rel=1e-14)
    assert (phase.phase_at(theta, f, theta) == f).all()
    assert phase.phase_at(theta, np.stack([f, f]), at.reshape(1, 101)).shape == (2, 1, 101)
    with pytest.raises(ValueError):
        phase.phase_at(theta, f, 3.2)


def test_mean_cosine_of_henyey_greenstein():
    for g in (-0.9, -0.2, 0.0, 0.5, 0.9, 0.99, 0.9999):
        theta, f, _, relative = analytic.tabulated("hg", 1e-4, 1, np.array([g]))
        assert relative <= 2e-4
        # 1 - g is what diffuses: it is right to the tolerance too
        assert 1 - phase.mean_cosine(theta, f)[0] == pytest.approx(1 - g, rel=3e-4)


@pytest.mark.parametrize("g", [0.7, -0.95, 0.9999, -0.9999])
def test_tabulated_error_covers_the_true_one(g):
    theta, f, error, relative = analytic.tabulated("hg", 1e-3, 1, np.array([g]))
    at = np.concatenate([np.linspace(0, math.pi, 5001), np.geomspace(1e-7, 1, 3000), math.pi - np.geomspace(1e-7, 1, 3000)])
    there = analytic.henyey_greenstein(at, g)
    off = np.abs(phase.phase_at(theta, f[0], at) - there)
    assert (off <= phase.phase_at(theta, error[0], at) + 1e-14 * there).mean() > 0.99
    assert (off / there).max() <= relative <= 2e-3
    assert len(theta) < 2000


def test_henyey_greenstein_second_moment_is_g_squared():
    theta, f, *_ = analytic.tabulated("hg", 1e-5, 1, np.array([0.8]))
    mu = np.cos(theta)
    # exact integral of a product of linear f and the Legendre polynomial, Simpson on halves
    mid = (mu[1:] + mu[:-1]) / 2
    p2 = lambda m: 1.5 * m * m - 0.5  # noqa: E731
    cell = (f[0, :-1] * p2(mu[:-1]) + 2 * (f[0, :-1] + f[0, 1:]) * p2(mid) + f[0, 1:] * p2(mu[1:])) / 6
    assert 2 * math.pi * np.sum(cell * phase.steps(theta)) == pytest.approx(0.64, rel=1e-4)


def test_isotropic_rayleigh_gaussian():
    theta, f, *_ = analytic.tabulated("isotropic", 1e-3, 3)
    assert f.shape == (3, 2) and f == pytest.approx(np.full((3, 2), 1 / (4 * math.pi)))
    theta, f, *_ = analytic.tabulated("rayleigh", 1e-4, 1)
    assert phase.mean_cosine(theta, f)[0] == pytest.approx(0, abs=1e-12)
    assert f[0, 0] == pytest.approx(3 / (8 * math.pi), rel=2e-4)
    spread = math.radians(30)
    theta, f, *_ = analytic.tabulated("gaussian", 1e-4, 1, spread=spread)
    at = np.radians([0, 20, 60, 120])
    got = phase.phase_at(theta, f[0], at)
    assert got[1:] / got[0] == pytest.approx(np.exp(-0.5 * (at[1:] / spread) ** 2), rel=3e-4)
    norm = 2 * math.pi * integrate.quad(lambda t: math.exp(-0.5 * (t / spread) ** 2) * math.sin(t), 0, math.pi)[0]
    assert got[0] == pytest.approx(1 / norm, rel=3e-4)
    # so narrow that most of the sphere is empty
    theta, f, *_ = analytic.tabulated("gaussian", 1e-2, 1, spread=math.radians(0.01))
    assert np.isfinite(f).all() and f[0, 0] == pytest.approx(1 / (2 * math.pi * math.radians(0.01) ** 2), rel=1e-2)


def test_a_users_table_is_kept_and_checked():
    given = (np.array([0.0, 0.5, 2.0, math.pi]), np.array([5.0, 2.0, 0.0, 1.0]))
    theta, f, error, relative = analytic.tabulated("table", 1e-2, 2, table=given)
    assert (theta == given[0]).all() and f.shape == (2, 4) and f[0] / f[0, 0] == pytest.approx(given[1] / 5) and relative == 0
    for bad in ((given[0][1:], given[1][1:]), (given[0], -given[1]), (given[0], 0 * given[1])):
        with pytest.raises(ValueError):
            analytic.tabulated("table", 1e-2, 1, table=bad)


@njit
def drawn(v, steps, f, cdf, xi, turns, density):
    for i in range(len(xi)):
        turns[i] = phase_sample(v, steps, f, cdf, xi[i])
        density[i] = phase_value(v, steps, f, turns[i])


def sampled(theta, f, xi):
    """Angles that the kernel of the loops draws by numbers xi (N,), and their density, 1/sr."""
    turns, density = np.empty(len(xi)), np.empty(len(xi))
    drawn(*phase_layout(theta, f), xi, turns, density)
    return 2 * np.arcsin(np.sqrt(np.minimum(turns / 2, 1.0))), density


@pytest.mark.parametrize("make", [lambda: analytic.tabulated("hg", 1e-2, 1, np.array([0.9]))[:2], lambda: random_table(7)])
def test_samples_follow_the_table(make):
    """Chi-square over 100 cells of equal probability; a right sampler fails with odds 1e-7 for each of the two."""
    theta, f = make()
    f = f[0]
    cdf = phase.cumulative(theta, f)
    xi = np.random.default_rng(11).random(1_000_000)
    angle, density = sampled(theta, f, xi)
    assert np.allclose(density, phase.phase_at(theta, f, angle), rtol=1e-6, atol=1e-12)
    def counts(angle):
        # probability below each sampled angle by exact integration of the interpolant, written independently
        i = np.clip(np.searchsorted(theta, angle, side="right") - 1, 0, len(theta) - 2)
        up = 2 * np.sin((angle + theta[i]) / 2) * np.sin((angle - theta[i]) / 2)
        below = cdf[i] + 2 * math.pi * up * (f[i] + phase.phase_at(theta, f, angle)) / 2
        return np.bincount(np.minimum((below * 100).astype(int), 99), minlength=100)

    assert stats.chisquare(counts(angle)).pvalue > ODDS
    # the power of the test: samples of a table whose nodes are off by 3 % are told apart
    wrong, _ = phase.normalised(theta, f * (1 + 0.03 * np.random.default_rng(12).choice([-1.0, 1.0], len(theta))))
    assert stats.chisquare(counts(sampled(theta, wrong, xi)[0])).pvalue < 1e-7
    # mean cosine within five standard errors
    mu = np.cos(angle)
    assert abs(mu.mean() - phase.mean_cosine(theta, f)) < 5 * mu.std() / 1e3


def test_sampling_at_the_ends_and_on_empty_cells():
    theta = np.array([0.0, 1.0, 2.0, math.pi])
    f, _ = phase.normalised(theta, np.array([0.0, 0.0, 1.0, 0.0]))
    angle, density = sampled(theta, f, np.array([0.0, 1e-18, 0.5, 1 - 1e-16]))
    assert np.isfinite(angle).all() and (angle >= 1.0).all() and (angle <= math.pi).all() and (density >= 0).all()


@settings(max_examples=50, deadline=None)
@given(st.floats(0, 1), st.floats(-0.9999, 0.9999), st.floats(1e-6, 1e6))
def test_similarity_relations(co_albedo, g, sigma):
    s, a = sigma * (1 - co_albedo), sigma * co_albedo
    sigma_t, albedo, sigma_tr = similarity.reduced(s, a, g)
    assert 0 <= albedo <= 1 and sigma_t >= a
    assert sigma_tr**2 == pytest.approx(3 * a * sigma_t, rel=1e-12, abs=1e-300)
    assert similarity.reduced(s, 0.0, g)[1] == (1 if s > 0 else 0)


def test_a_delta_is_put_in_and_taken_out():
    theta = np.insert(np.linspace(0, math.pi, 181), 1, 1e-3)
    f = phase.normalised(theta, np.stack([1 + 0.5 * np.cos(theta), 1 - 0.3 * np.cos(theta), np.ones_like(theta)]))[0]
    share = np.array([0.3, 0.0, 1.0])
    peaked = phase.with_delta(theta, f, share)
    assert phase.phase_integral(theta, peaked) == pytest.approx(1, abs=1e-12)
    # the peak stands below theta[1], with the light that keeps its direction
    assert phase.cumulative(theta, peaked)[:, 1] == pytest.approx(share, abs=1e-6)
    assert phase.mean_cosine(theta, peaked) == pytest.approx(share + (1 - share) * phase.mean_cosine(theta, f), abs=1e-6)
    assert phase.without_delta(theta, peaked, share) == pytest.approx(f, rel=1e-9)
    assert np.array_equal(phase.without_delta(theta, f[1], 0.0), f[1])


def test_a_medium_without_its_peak_absorbs_as_much():
    albedo, extinction = similarity.without_peak(0.9, 0.4)
    assert extinction * (1 - albedo) == pytest.approx(0.1) and extinction * albedo == pytest.approx(0.9 * 0.6)
    assert similarity.without_peak(1.0, 1.0) == (0.0, 0.0)


def test_number_density_from_volume_fraction():
    # a cubic metre with 1e-6 of water in spheres of 1 um^3 mean volume
    assert mixing.number_density([0.25, 0.75], [1.0, 1.0], 1e-6) == pytest.approx(1e12)
    assert mixing.volume_fraction([0.25, 0.75], [4.0, 1.0], 1e12) == pytest.approx(1.75e-6)
    assert mixing.bulk_absorption(1.96e-9, 0.55) == pytest.approx(0.04478, rel=1e-3)


def test_mixture_weights_phase_functions_by_what_they_scatter():
    theta = np.linspace(0, math.pi, 181)
    one, _ = phase.normalised(theta, np.ones((1, 181)))
    two, _ = phase.normalised(theta, 1 + 0.9 * np.cos(theta)[None])
    elements = np.stack([one, two])[:, :, None]
    s, a, mixed, error = mixing.mixed([0.75, 0.25], 1e9, np.array([[2.0], [6.0]]), np.array([[0.0], [4.0]]), elements,
                                      np.stack([0.01 * one, 0.03 * two]), theta)
    assert s == pytest.approx(1e-3 * 3.0) and a == pytest.approx(1e-3)
    assert mixed[0, 0] == pytest.approx((one + two)[0] / 2, rel=1e-12)
    assert error[0] == pytest.approx((0.01 * one + 0.03 * two)[0] / 2, rel=1e-12)


def test_bisection_refuses_too_many_angles_and_finds_a_hidden_peak():
    def narrow(theta, floor):
        f = 1 / (1 + ((theta - 2.0) / 1e-4) ** 2) + 1
        return f[None, None], np.zeros((1, len(theta))), np.zeros((1, len(theta)), int)

    made = grid.refine(grid.start([(10.0, 0.5)], [(2.0, 1e-4)]), narrow, 1e-3)
    at = np.linspace(1.99, 2.01, 4001)
    assert np.abs(phase.phase_at(made.theta, made.values[0, 0], at) / narrow(at, None)[0][0, 0] - 1).max() < 1.5e-3
    assert made.theta[0] == 0 and made.theta[-1] == math.pi and (np.diff(made.theta) > 0).all()
    with pytest.raises(grid.TooManyAngles):
        grid.refine(grid.start([(10.0, 0.5)], [(2.0, 1e-4)]), narrow, 1e-6, limit=500)


@pytest.mark.parametrize("stated", [0.1, 0.0])
def test_ripples_within_the_values_own_error_are_not_resolved(stated):
    """Few sizes leave ripples that are errors of the values; where no error is stated they are structure, and are resolved."""
    def rippled(theta, floor):
        f = (1 + 0.05 * np.sin(20_000 * theta)) / (0.01 + theta**2)
        return f[None, None], np.full((1, len(theta)), stated), np.zeros((1, len(theta)), int)

    first = grid.start([(1000.0, 0.5)])
    made = grid.refine(first, rippled, 0.01, integrated=True)
    assert (len(made.theta) < 1.5 * len(first)) if stated else (len(made.theta) > 20 * len(first))


def test_rainbows_stand_at_their_angles():
    # primary at 137.48 degrees, secondary at 129.90 for n = 1.33; 157.16 and 93.13 for n = 1.5
    assert np.degrees(grid.bows(1.33)) == pytest.approx([137.48, 129.90], abs=0.01)
    assert np.degrees(grid.bows(1.5)) == pytest.approx([157.16, 93.13], abs=0.01)
    assert grid.bows(0.75) == []
