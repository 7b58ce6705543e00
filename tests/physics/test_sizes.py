"""Size distributions against closed forms, scipy and brute force."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, special, stats

from bakery.physics.sizes import Nodes, population

K = 2 * math.pi / np.array([0.61, 0.465])


def size(distribution, **given):
    values = dict(radius=None, sigma=None, variance=None, min=None, max=None, file=None, of=())
    return SimpleNamespace(distribution=distribution, **(values | given))


@pytest.mark.parametrize("power", [1, 2, 3, 4, 6])
def test_lognormal_moments_are_the_closed_form(power):
    p = population(size("lognormal", radius=5.0, sigma=1.5))
    assert p.moment(power) == pytest.approx(5.0**power * math.exp(0.5 * (power * math.log(1.5)) ** 2), rel=1e-13)


def test_gamma_radius_and_variance_are_effective_radius_and_variance():
    p = population(size("gamma", radius=10.0, variance=0.11))
    assert p.effective_radius == pytest.approx(10.0, rel=1e-13)
    effective_variance = p.moment(4) / p.moment(2) / p.effective_radius**2 - 1
    assert effective_variance == pytest.approx(0.11, rel=1e-11)


@pytest.mark.parametrize("variance", [1e-7, 1e-3, 0.1, 0.4])
def test_gamma_density_is_scipys(variance):
    law = population(size("gamma", radius=3.0, variance=variance)).parts[0].law
    there = stats.gamma((1 - 2 * variance) / variance, scale=3.0 * variance)
    r = there.ppf([0.01, 0.3, 0.5, 0.9, 0.999])
    # scipy subtracts large logarithms: at shape 1e7 it keeps 9 digits
    assert np.allclose(law.density(r), there.pdf(r), rtol=1e-7)


@pytest.mark.parametrize("s", [size("lognormal", radius=5.0, sigma=1.5, min=3.0, max=8.0),
                         size("gamma", radius=5.0, variance=0.2, min=2.0, max=30.0)])
def test_cuts_restrict_and_renormalise(s):
    p = population(s)
    n = p.parts[0].law.density
    whole = integrate.quad(n, s.min, s.max, epsabs=0, epsrel=1e-12)[0]
    for power in (1, 3):
        there = integrate.quad(lambda r: n(np.array(r)) * r**power, s.min, s.max, epsabs=0, epsrel=1e-12)[0] / whole
        assert p.moment(power) == pytest.approx(there, rel=1e-10)
    assert p.cumulative(s.min) == 0 and p.cumulative(s.max) == pytest.approx(1, rel=1e-14)


def test_upper_tail_keeps_its_digits():
    """9 to 9.5 standard deviations above the median, where both normal integrals round to 1."""
    s = size("lognormal", radius=1.0, sigma=math.e, min=math.exp(9.0), max=math.exp(9.5))
    density = lambda t: math.exp(-(t**2 - 81) / 2)  # noqa: E731
    there = integrate.quad(lambda t: density(t) * math.exp(t), 9, 9.5)[0] / integrate.quad(density, 9, 9.5)[0]
    assert population(s).moment(1) == pytest.approx(there, rel=1e-9)


def test_table_is_linear_between_rows_and_integrated_exactly():
    p = population(size("table", file=(np.array([1.0, 3.0]), np.array([0.0, 5.0]))))
    # dn/dr = (r - 1)/2 on [1, 3]
    assert p.moment(0) == pytest.approx(1, rel=1e-15)
    assert p.moment(1) == pytest.approx((27 - 1) / 6 - (9 - 1) / 4, rel=1e-14)
    assert p.moment(3) == pytest.approx((3**5 - 1) / 10 - (3**4 - 1) / 8, rel=1e-14)
    assert p.quantile(0.25) == pytest.approx(2.0, rel=1e-11)


@pytest.mark.parametrize("sigma, radius", [(1.01, 4.0), (1.5, 0.1), (2.51, 0.471), (9.0, 1e-3)])
def test_effective_radius_and_variance_stand_for_radius_and_sigma(sigma, radius):
    """Moments <r^3>/<r^2> and <r^4><r^2>/<r^3>^2 - 1 of scipy's law of the parameters that were found."""
    law = population(size("lognormal", radius=radius, sigma=sigma)).parts[0].law
    there = stats.lognorm(math.log(sigma), scale=radius)
    m2, m3, m4 = (there.moment(p) for p in (2, 3, 4))
    same = population(size("lognormal", effective_radius=m3 / m2, effective_variance=m4 * m2 / m3**2 - 1)).parts[0].law
    assert same.radius == pytest.approx(law.radius, rel=1e-10) and same.sigma == pytest.approx(law.sigma, rel=1e-10)
    mixed = population(size("lognormal", effective_radius=m3 / m2, sigma=sigma)).parts[0].law
    assert mixed.radius == pytest.approx(radius, rel=1e-12)
    gamma = population(size("gamma", effective_radius=2.0, effective_variance=0.1)).parts[0].law
    assert gamma == population(size("gamma", radius=2.0, variance=0.1)).parts[0].law


@pytest.mark.parametrize("exponent", [0.0, 1e-12, 2.0, 3.0, 4.5])
def test_junge_is_scipys_truncated_power_law(exponent):
    p = population(size("junge", exponent=exponent, min=0.05, max=20.0))
    there = stats.loguniform(0.05, 20.0) if exponent < 1e-9 else stats.truncpareto(exponent, 400.0, scale=0.05)
    r = np.geomspace(0.0501, 19.9, 7)
    assert np.allclose(p.parts[0].law.density(r), there.pdf(r), rtol=1e-9)
    for power in (0, 1, 2, 3, 4):
        mean = integrate.quad(lambda s: math.exp((power + 1) * s) * there.pdf(math.exp(s)), math.log(0.05), math.log(20.0),
                              epsabs=0, epsrel=1e-11)[0]
        assert p.moment(power) == pytest.approx(mean, rel=1e-9)
    assert p.cumulative(1.0) == pytest.approx(there.cdf(1.0), rel=1e-9)
    nodes = Nodes(p, K, 0.01)
    radius, weight = nodes.whole(4)
    for power in (0, 2, 3):
        assert np.sum(weight * radius**power) == pytest.approx(p.moment(power), rel=1e-3)


def test_histogram_is_scipys_over_the_logarithm():
    edge, count = np.array([0.1, 0.2, 0.3, 0.8, 1.0, 3.0]), np.array([5.0, 40.0, 0.0, 7.0, 0.5])
    p = population(size("histogram", file=(edge, count, 0.0)))
    there = stats.rv_histogram((count, np.log(edge)), density=False)
    r = np.array([0.15, 0.25, 0.5, 0.9, 2.0])
    assert np.allclose(p.parts[0].law.density(r) * r, there.pdf(np.log(r)), rtol=1e-13)
    for power in (1, 2, 3, 4):
        mean = sum(there.expect(lambda s: np.exp(power * s), lb=a, ub=b) for a, b in zip(np.log(edge), np.log(edge[1:])))
        assert p.moment(power) == pytest.approx(mean, rel=1e-9)
    assert p.moment(3) == pytest.approx(p.mean_volume * 3 / (4 * math.pi), rel=1e-14)
    radius, weight = Nodes(p, K, 0.01).whole(5)
    assert not weight[(radius > 0.3001) & (radius < 0.7999)].any()  # nothing in the empty bin
    for power in (0, 2, 3):
        assert np.sum(weight * radius**power) == pytest.approx(p.moment(power), rel=2e-3)


def test_histogram_of_volumes_gives_the_volumes_back():
    edge, volume = np.geomspace(0.1, 10, 9), np.array([1.0, 2, 5, 0, 3, 1, 8, 2])
    law = population(size("histogram", file=(edge, volume, 3.0))).parts[0].law
    shares = np.array([law.moment(3, a, b) for a, b in zip(edge, edge[1:])])
    assert np.allclose(shares / shares.sum(), volume / volume.sum(), rtol=1e-13)
    flat = law.density(np.array([0.11, 0.15])) * np.array([0.11, 0.15]) ** 4  # dV/dlnr within a bin
    assert flat[0] == pytest.approx(flat[1], rel=1e-13)


@pytest.mark.parametrize("file", [((1.0, 1.0), (1.0,), 0), ((1.0, 2.0), (0.0,), 0), ((0.0, 2.0), (1.0,), 0),
                                  ((1.0, 2.0), (-1.0,), 0)])
def test_histograms_that_are_none_are_refused(file):
    with pytest.raises(ValueError, match="histogram"):
        population(size("histogram", file=file))


def test_mixture_shares_count_particles_and_the_cut_is_of_the_sum():
    parts = ((0.9, size("lognormal", radius=1.0, sigma=1.3)), (0.1, size("single", radius=20.0)))
    p = population(size("mixture", of=parts))
    assert [part.share for part in p.parts] == pytest.approx([0.9, 0.1], rel=1e-14)
    cut = population(size("mixture", of=parts, min=1.0))
    # half of the log-normal part is above its median
    assert [part.share for part in cut.parts] == pytest.approx([0.45 / 0.55, 0.1 / 0.55], rel=1e-13)
    assert cut.quantile(0.95) == pytest.approx(20.0, rel=1e-11)


def test_sigma_one_is_a_single_size():
    assert population(size("lognormal", radius=2.0, sigma=1.0)).single
    almost = population(size("lognormal", radius=2.0, sigma=1.0001))
    assert almost.moment(3) == pytest.approx(8.0, rel=1e-6)


@pytest.mark.parametrize("s, words", [
    (size("lognormal", radius=1.0, sigma=1.01, min=5.0), "between min"),
    (size("lognormal", radius=1.0, sigma=2.0, min=5.0, max=5.0), "single"),
    (size("single", radius=1.0, max=0.5), "between min"),
    (size("gamma", radius=1.0, variance=0.5), "0.5"),
    (size("lognormal", radius=1.0, sigma=0.9), "sigma"),
    (size("table", file=(np.array([1.0, 2.0]), np.array([0.0, 0.0]))), "zero"),
])
def test_impossible_distributions_are_refused(s, words):
    with pytest.raises(ValueError, match=words):
        population(s)


SIZES = [
    size("lognormal", radius=5.0, sigma=1.5, min=0.1, max=60.0), size("lognormal", radius=0.02, sigma=3.0),
    size("lognormal", radius=5.0, sigma=1.0001), size("lognormal", radius=5.0, sigma=1.5, min=4.0, max=6.0),
    size("gamma", radius=5.0, variance=0.1), size("gamma", radius=5.0, variance=0.45), size("gamma", radius=5.0, variance=1e-8),
    size("table", file=(np.array([0.0, 1.0, 1.0001, 5.0]), np.array([0.0, 0.0, 1.0, 0.0]))),
    size("mixture", of=((0.995, size("lognormal", radius=5.0, sigma=1.5)), (0.005, size("single", radius=50.0))),
         min=1.0, max=60.0),
    size("single", radius=1e-9),
]


@pytest.mark.parametrize("s", SIZES)
def test_levels_are_nested_and_converge_to_exact_moments(s):
    p = population(s)
    nodes = Nodes(p, K, 0.01)
    level = min(5, nodes.levels - 1)
    radius, weight = nodes.whole(level)
    assert abs(weight.sum() - 1) < 1e-14 and (weight >= 0).all() and (np.diff(radius) >= 0).all()
    assert len(radius) == nodes.count(level)
    for power in (2, 3, 4):
        # what is neglected is below a hundredth of the tolerance at each end; the sum of both, and of the number
        assert np.sum(weight * radius**power) == pytest.approx(p.moment(power), rel=4e-4)
    if nodes.refinable:
        coarse = nodes.whole(level - 1)[0]
        assert np.isin(np.round(np.log(coarse), 9), np.round(np.log(radius), 9)).all()
        fixed, total = nodes.fixed(), None
        for j in range(level + 1):
            r, w = nodes.fresh(j)
            new = np.array([w.sum(), np.sum(w * r**3)])
            total = new if total is None else total / 2 + new
        total = total + np.array([fixed[1].sum(), np.sum(fixed[1] * fixed[0] ** 3)])
        # the running sum over new nodes is the rule over all nodes
        assert total[1] / total[0] == pytest.approx(np.sum(weight * radius**3), rel=1e-12)


def test_tails_reach_as_far_as_the_tolerance_asks():
    p = population(size("lognormal", radius=100.0, sigma=2.0))
    low, high = Nodes(p, K, 0.01).span()
    width = math.log(2.0)
    assert special.ndtr(math.log(low / 100.0) / width) < 1e-4
    assert special.ndtr(-(math.log(high / 100.0) / width - 4 * width)) < 1.01e-4  # of the r^4-weighted number


@settings(max_examples=30, deadline=None)
@given(st.floats(-7, 3), st.floats(1.001, 3.0), st.floats(0, 3), st.floats(0.05, 6))
def test_any_lognormal_has_good_weights(log_radius, sigma, low, span):
    radius = 10.0**log_radius
    s = size("lognormal", radius=radius, sigma=sigma, min=radius * sigma ** (low - 1.5), max=radius * sigma ** (low - 1.5 + span))
    p = population(s)
    nodes = Nodes(p, K, 0.01)
    r, w = nodes.whole(min(3, nodes.levels - 1))
    assert np.isfinite(r).all() and (r > 0).all() and (w >= 0).all() and abs(w.sum() - 1) < 1e-13
    assert s.min * (1 - 1e-12) <= r[0] and r[-1] <= s.max * (1 + 1e-12)
    assert np.sum(w * r**3) == pytest.approx(p.moment(3), rel=1e-3)
