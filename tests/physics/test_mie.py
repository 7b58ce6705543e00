"""Lorenz-Mie theory against arbitrary precision, published tables, closed limits and conservation laws."""

import json
from pathlib import Path

import mpmath
import numpy as np
import pytest

from bakery.physics.mie import absorption, amplitudes, efficiencies

REFERENCE = json.loads((Path(__file__).parent / "mie_reference.json").read_text())
PUBLISHED = REFERENCE["published"]
EPS = 2.0**-53


def literal(m, x, theta=()):
    """The series of Bohren & Huffman 4.53, 4.74, term by term with 160 digits: q_ext, q_sca, q_abs, q_back, g, S1, S2."""
    with mpmath.workdps(160):
        m, x = mpmath.mpmathify(m), mpmath.mpf(x)
        z = m * x
        mu = [mpmath.cos(mpmath.mpf(float(t))) for t in theta]
        last = int(x + 9 * x ** (mpmath.mpf(1) / 3)) + 8

        def psi(y):  # psi_0 .. psi_last; upward loses at most 100 of the digits
            f = [mpmath.sin(y), mpmath.sin(y) / y - mpmath.cos(y)]
            for n in range(1, last):
                f.append((2 * n + 1) / y * f[n] - f[n - 1])
            return f

        chi = [mpmath.cos(x), mpmath.cos(x) / x + mpmath.sin(x)]
        for n in range(1, last):
            chi.append((2 * n + 1) / x * chi[n] - chi[n - 1])
        px, pz = psi(x), psi(z)
        xi = [p - 1j * c for p, c in zip(px, chi)]
        a, b = [0], [0]
        for n in range(1, last):
            d = pz[n - 1] / pz[n] - n / z
            for series, factor in ((a, d / m + n / x), (b, d * m + n / x)):
                series.append((factor * px[n] - px[n - 1]) / (factor * xi[n] - xi[n - 1]))
        orders = range(1, len(a))
        ext = sum((2 * n + 1) * mpmath.re(a[n] + b[n]) for n in orders) * 2 / x**2
        sca = sum((2 * n + 1) * (abs(a[n]) ** 2 + abs(b[n]) ** 2) for n in orders) * 2 / x**2
        back = abs(sum((2 * n + 1) * (-1) ** n * (a[n] - b[n]) for n in orders)) ** 2 / x**2
        cross = sum(mpmath.mpf(n * (n + 2)) / (n + 1) * mpmath.re(a[n] * mpmath.conj(a[n + 1]) + b[n] * mpmath.conj(b[n + 1]))
                    for n in range(1, len(a) - 1))
        cross += sum(mpmath.mpf(2 * n + 1) / (n * (n + 1)) * mpmath.re(a[n] * mpmath.conj(b[n])) for n in orders)
        s1, s2 = [], []
        for c in mu:
            before, pi, one, two = mpmath.mpf(0), mpmath.mpf(1), 0, 0
            for n in orders:
                tau = n * c * pi - (n + 1) * before
                f = mpmath.mpf(2 * n + 1) / (n * (n + 1))
                one, two = one + f * (a[n] * pi + b[n] * tau), two + f * (a[n] * tau + b[n] * pi)
                before, pi = pi, ((2 * n + 1) * c * pi - (n + 1) * before) / n
            s1.append(complex(one))
            s2.append(complex(two))
        lost = ext - sca if m.imag and m.real else 0.0  # m^2 is real: not the 160th digit
        return (float(ext), float(sca), float(lost), float(back), float(4 * cross / x**2 / sca), np.array(s1), np.array(s2))


def compare(m, x, expected, theta=None, digits=1.0):
    """Against q_ext, q_sca, q_abs, q_back, g, S1, S2; rounding grows like x because every phase does."""
    q_ext, q_sca, q_back, g = efficiencies(m, x)
    slack = digits * (20 + 0.002 * x) * EPS
    for name, value, exact in zip(("q_ext", "q_sca", "q_abs"), (q_ext, q_sca, absorption(m, x)), expected):
        assert abs(value - exact) <= 2 * slack * abs(exact), (name, m, x, value, exact)
    assert abs(g - expected[4]) <= 4 * slack * max(abs(expected[4]), min(x * x, 1e-2)), ("g", m, x, g, expected[4])
    # S(pi) is what is left of a sum of N terms: a few times x EPS.
    floor = 1e-14 * min(q_sca, 1.0) * (x > 1)
    assert abs(q_back - expected[3]) <= digits * (100 + 3 * x) * EPS * expected[3] + floor, ("q_back", m, x)
    if theta is not None:
        for mine, exact in zip(amplitudes(m, x, theta), expected[5:]):
            error = abs(mine - exact) / np.maximum(abs(expected[5]), abs(expected[6]))
            assert np.all(error <= digits * (40 + 3 * x) * EPS), ("S", m, x, np.max(error))


@pytest.mark.parametrize("case", REFERENCE["cases"], ids=lambda c: f"x={c['x']} m={'+'.join(c['m'])}i")
def test_reference_case(case):
    exact = [float(case[key]) for key in ("Qext", "Qsca", "Qabs", "Qback", "g")]
    s = [np.array([complex(float(re), float(im)) for re, im in case[key]]) for key in ("S1", "S2")]
    theta = np.arccos(REFERENCE["cos_theta"])
    x, m = float(case["x"]), complex(*map(float, case["m"]))
    compare(m, x, exact, digits=2)
    s1, s2 = amplitudes(m, x, theta)
    local = np.maximum(abs(s[0]), abs(s[1]))
    tolerance = max(2e-14, 4e-16 * x) if abs(m - 1) > 0.01 else 4e-12  # at 1e5 half an ulp of theta is worth 1e-11
    assert np.max(abs(s1 - s[0]) / local) < tolerance
    assert np.max(abs(s2 - s[1]) / local) < tolerance


RNG = np.random.default_rng(20240611)
ABSORBING = [0.0, 0.0, 1e-16, 1e-12, 1e-6, 1e-3, 0.1, 1.0, 0.0, 3.0]
RANDOM = [(complex(n, k), x) for n, k, x in zip(RNG.uniform(0.5, 3.0, 10), ABSORBING, 10 ** RNG.uniform(-3, 2.2, 10))]
EXTREME = [
    (1.33 + 1e-16j, 1e-10), (0.055 + 3.42j, 1e-8), (10 + 10j, 30.0), (1 + 1e-8 + 0j, 1e-4), (1 + 1e-8 + 0j, 200.0),
    (1 - 1e-6 + 1e-9j, 20.0), (1.0 + 1e-9j, 5.0), (1.005 + 0.002j, 100.0), (0.981 + 0j, 50.0), (1.5 + 1000j, 0.3),
    (1.5 + 100j, 20.0), (1000 + 0j, 0.01), (3j, 2.0), (0.75 + 0j, 250.0), (1.33 + 1e-16j, 100.0), (0.01 + 0.5j, 5.0),
    (1.33 + 0j, 0.0399), (2.5 + 0j, 3.0)]


@pytest.mark.parametrize("m, x", RANDOM + EXTREME)
def test_arbitrary_precision(m, x):
    theta = np.array([0.0, 1e-7, 0.01, 0.5, np.pi / 2, 1.6, 2.5, 3.14, np.pi])
    # digits 30: a narrow resonance (k = 0, large n) or a dark direction magnifies the rounding of m x and theta.
    compare(m, x, literal(m, x, theta), theta, digits=30)


@pytest.mark.parametrize("x", [0.01, 3.0, 40.0, 150.0])
@pytest.mark.parametrize("side", [0.01999, 0.02001])
def test_seam_of_the_difference_form(x, side):
    for m in (1 + side + 0j, 1 - side + 0j, 1 + side * 1j):
        compare(m, x, literal(m, x), digits=20)


@pytest.mark.parametrize(
    "side, x", [(0.0999, 30.0), (0.1001, 30.0), (0.7, 1.9999), (0.7, 2.0001), (0.1001, 2.0001), (9.0, 2.0001)])
def test_seam_of_the_steps(side, x):
    """Sizes and real indices from which b_{n+1} comes from b_{n-1}."""
    for m in (1 + side, abs(1 - side)):
        compare(m, x, literal(m, x), digits=3)


def test_wiscombe_table():
    values = PUBLISHED["wiscombe_miev0"]["values"]
    for row in values:
        m = np.inf if row["m"] == "perfect conductor" else complex(*map(float, row["m"]))
        q_ext, q_sca, _, g = efficiencies(m, float(row["x"]))
        for value, printed in ((q_ext, row["Qext"]), (q_sca, row["Qsca"]), (g * q_sca, row["g_times_Qsca"])):
            # Printed to seven digits.  Case 1 is MIEV0's small-sphere formula: 5e-5 from the series in multiple precision.
            assert abs(value - printed) < (1e-4 if row["miev0_case"] == 1 else 2e-6) * abs(printed) + 1e-10, row
    assert len(values) >= 15


def test_bohren_huffman_appendix():
    table = PUBLISHED["bohren_huffman_appendix_a"]["values"]
    x, theta = 2 * np.pi * 0.525 / 0.6328, np.radians(np.arange(0, 181, 9))
    q_ext, q_sca, q_back, _ = efficiencies(1.55, x)
    assert (round(q_ext, 5), round(q_sca, 5), round(q_back, 5)) == (table["Qext"], table["Qsca"], table["Qback"])
    s1, s2 = amplitudes(1.55, x, theta)
    s11, s12 = (abs(s2) ** 2 + abs(s1) ** 2) / 2, (abs(s2) ** 2 - abs(s1) ** 2) / 2
    product = s2 * s1.conj()
    assert s11 / s11[0] == pytest.approx(table["S11_norm"], rel=2e-5, abs=1e-7)
    assert -s12 / s11 == pytest.approx(table["minus_S12_over_S11"], rel=1e-4, abs=1e-5)
    assert product.real / s11 == pytest.approx(table["S33_over_S11"], rel=1e-4, abs=1e-5)
    assert product.imag / s11 == pytest.approx(table["S34_over_S11"], rel=1e-4, abs=1e-5)


@pytest.mark.parametrize("m", [1.33, 1.5 + 1e-3j, 0.75, 0.055 + 3.42j, 1 + 1e-8])
def test_rayleigh_limit(m):
    """The next term is x^2 smaller, times |m|^2 and a resonance: 200 x^2."""
    x = 1e-6
    m = complex(m)
    contrast = (m - 1) * (m + 1) / (m * m + 2)
    q_ext, q_sca, q_back, g = efficiencies(m, x)
    assert q_sca == pytest.approx(8 / 3 * x**4 * abs(contrast) ** 2, rel=1e-9)
    assert absorption(m, x) == pytest.approx(4 * x * contrast.imag, rel=1e-9)
    assert q_back == pytest.approx(4 * x**4 * abs(contrast) ** 2, rel=1e-9)
    assert 0 < abs(g) < 1e-10
    assert q_ext == q_sca + absorption(m, x)


def test_large_spheres_take_out_twice_their_section():
    x = np.array([1e3, 1e4, 1e5, 1e6])
    for m in (1.5 + 0.1j, 2 + 5j):  # no ripple: the edge term 1.9924 x^(-2/3) remains, then one in 1/x
        excess = efficiencies(m, x)[0] - 2
        assert np.all(excess > 0)
        assert np.all(abs(excess * x ** (2 / 3) - 1.9924) < 12 * x ** (-1 / 3))


@pytest.mark.parametrize("m", [1.33, 0.75, 1.5 + 0.01j, 0.055 + 3.42j])
def test_forward_and_backward(m):
    """Optical theorem at 0; S1 = S2 at 0; S1 = -S2 at pi; backscattering efficiency."""
    x = np.array([1e-6, 1e-2, 1.0, 7.3, 60.0, 1234.5])
    s1, s2 = amplitudes(m, x, np.array([0.0, np.pi]))
    q_ext, q_sca, q_back, _ = efficiencies(m, x)
    assert np.array_equal(s1[:, 0], s2[:, 0])
    assert np.all(abs(s1[:, 1] + s2[:, 1]) <= 1e-15 * abs(s1[:, 1]))
    # Re S1(0) is the same sum of Re a_n: equal but for rounding
    assert 4 * s1[:, 0].real / x**2 == pytest.approx(q_ext, rel=1e-13)
    assert 4 * abs(s1[:, 1]) ** 2 / x**2 == pytest.approx(q_back, rel=1e-11)


def test_energy():
    """The integral of |S1|^2 + |S2|^2 over the sphere is the scattering cross section, its mean cosine g."""
    mu, weight = np.polynomial.legendre.leggauss(200)  # degree 2 N < 400: exact, but for the weights' own 1e-12
    for m, x in ((1.33, 40.0), (1.5 + 0.2j, 80.0), (0.75, 100.0)):
        s1, s2 = amplitudes(m, x, np.arccos(mu))
        intensity = abs(s1) ** 2 + abs(s2) ** 2
        _, q_sca, _, g = efficiencies(m, x)
        assert np.sum(weight * intensity) / x**2 == pytest.approx(q_sca, rel=2e-11)
        assert np.sum(weight * mu * intensity) / x**2 == pytest.approx(q_sca * g, rel=2e-11)


def test_small_angles_of_large_spheres():
    """cos(theta) would lose these angles: against the literal series at x = 300, and the smooth peak at 1e5."""
    theta = np.array([0.0, 1e-9, 1e-7, 1e-6, 1e-5, 1e-4])
    s1, s2 = amplitudes(1.33, 300.0, theta)
    exact = literal(1.33, 300.0, theta)
    assert np.max(abs(s1 - exact[5]) / abs(exact[5])) < 2e-13
    s1, _ = amplitudes(1.33, 1e5, theta[:4])
    drop = 1 - abs(s1) / abs(s1[0])  # (x theta)^2/8 of an Airy disc
    assert drop[2:] == pytest.approx((1e5 * theta[2:4]) ** 2 / 8, rel=2e-2, abs=1e-12)


MATERIALS = [1 + 1e-8, 1 - 1e-8, 1.0001, 1.33, 1.5 + 1e-16j, 1.5 + 1j, 0.75, 0.1, 0.055 + 3.42j, 10 + 10j, 1 + 1000j,
             1e-3 + 1e3j, 1j, 1.0 + 1e-12j, np.inf]


def test_everything_is_finite_and_within_bounds():
    x = np.logspace(-12, 6, 19)
    with np.errstate(all="raise"):
        for m in MATERIALS:
            q_ext, q_sca, q_back, g = efficiencies(m, x)
            q_abs = absorption(m, x)
            for value in (q_ext, q_sca, q_abs, q_back, g):
                assert np.all(np.isfinite(value)), m
            assert np.all(q_ext >= q_sca) and np.all(q_sca >= 0) and np.all(q_abs >= 0) and np.all(q_back >= 0), m
            assert np.all(abs(g) <= 1), m
            if np.imag(m) == 0:
                assert np.all(q_abs == 0), m
            wide = x[x < 2e3]
            s1, s2 = amplitudes(m, wide, np.array([0.0, 1e-3, 1.0, np.pi / 2, 2.0, np.pi]))
            assert np.all(np.isfinite(s1)) and np.all(np.isfinite(s2)), m
        assert efficiencies(1.33, 1e6)[0] == pytest.approx(2, abs=3e-4)
        assert efficiencies(1.0, 5.0) == (0.0, 0.0, 0.0, 0.0)


def test_result_does_not_depend_on_company():
    """Bit for bit: alone or among others, in any order, all angles or some, few spheres or enough for several threads."""
    rng = np.random.default_rng(5)
    x = 10 ** rng.uniform(-3, 3.5, 300)
    theta = np.linspace(0, np.pi, 40)
    for m in (1.33, 1.4 + 0.01j, 1.001):
        together = np.array(efficiencies(m, x))
        assert np.array_equal(together[:, ::-1], np.array(efficiencies(m, x[::-1])))
        s = np.array(amplitudes(m, x[:50], theta))
        for i in (0, 7, 33):
            assert np.array_equal(together[:, i], np.array(efficiencies(m, x[i])))
            assert np.array_equal(s[:, i], np.array(amplitudes(m, x[i], theta)))
            assert np.array_equal(s[:, i, 3:20:5], np.array(amplitudes(m, x[i], theta[3:20:5])))
    mixed = np.array(efficiencies(np.where(x > 1, 1.33, 1.4 + 0.01j), x))
    assert np.array_equal(mixed[:, 0], np.array(efficiencies(1.33 if x[0] > 1 else 1.4 + 0.01j, x[0])))


@pytest.mark.slow
def test_block_kernels_against_their_literal_twins():
    from bakery.physics.mie.angular import intensity_block, mueller_block
    from bakery.physics.mie.coefficients import cross_section_block

    rng = np.random.default_rng(6)
    x = 10 ** rng.uniform(-2, 2.5, 37)
    weight = rng.uniform(0, 1, x.size)
    theta = rng.permutation(np.append(np.linspace(0, np.pi, 41), np.nextafter(np.pi / 2, 4)))
    for m in (1.33 + 0j, 1.5 + 0.01j):
        s1, s2 = amplitudes(m, x, theta)
        product = s2 * s1.conj()
        elements = [(abs(s2) ** 2 + abs(s1) ** 2) / 2, (abs(s2) ** 2 - abs(s1) ** 2) / 2, product.real, product.imag]
        intensity, mueller, sections = np.empty(theta.size), np.full((4, theta.size), 7.0), np.empty((4, x.size))
        intensity_block(m, x, weight, theta, intensity)
        mueller_block(m, x, weight, theta, mueller)
        cross_section_block(m, x, *sections)
        scale = np.einsum("r,ra->a", weight, elements[0])
        assert intensity == pytest.approx(scale, rel=1e-13)
        for part, element in enumerate(elements):
            assert np.all(abs(mueller[part] - np.einsum("r,ra->a", weight, element)) <= 1e-13 * scale)
        q_ext, q_sca, _, g = efficiencies(m, x)
        assert np.array_equal(sections, [q_ext, q_sca, absorption(m, x), g])
    intensity_block(1.33 + 0j, x[:0], weight[:0], theta, intensity)
    assert np.all(intensity == 0)


def test_shapes():
    assert all(isinstance(value, float) for value in efficiencies(1.33, 2)) and isinstance(absorption(1.33, 2), float)
    assert efficiencies(np.array([1.33, 1.5])[:, None], np.ones(3))[0].shape == (2, 3)
    assert efficiencies(1.33, np.empty(0))[0].shape == (0,)
    s1, s2 = amplitudes([[1.33], [1.5]], [1.0, 2.0, 3.0], np.zeros((4, 5)))
    assert s1.shape == s2.shape == (2, 3, 4, 5)
    assert amplitudes(1.33, 2.0, np.zeros(7))[0].shape == (7,) and np.ndim(amplitudes(1.33, 2.0, 0.3)[0]) == 0


@pytest.mark.parametrize("m, x, says", [
    (1.33, 0.0, "x = 0"), (1.33, -1.0, "x = -1"), (1.33, np.nan, "x = nan"), (1.33, 1e9, "x = 1e+09"), (1.33, 1e-30, "x = 1e-30"),
    (1.33 - 0.1j, 1.0, "gain"), (-1.33, 1.0, "n is not negative"), (complex(np.nan, 0), 1.0, "finite"),
    (complex(1, np.inf), 1.0, "finite"), (0.0, 1.0, "m = 0"), (1e9, 1.0, "perfect conductor is inf"), (5e3, 1e6, "above"),
    ("water", 1.0, "numbers"), ([1.3, 1.4], [1.0, 2.0, 3.0], "broadcast"),
])
def test_refusals(m, x, says):
    for function in (efficiencies, absorption, lambda m, x: amplitudes(m, x, 0.0)):
        with pytest.raises(ValueError, match=says.replace("+", r"\+")):
            function(m, x)


@pytest.mark.parametrize("theta", [-0.1, 3.2, np.nan, [0.0, 180.0]])
def test_angles_are_radians(theta):
    with pytest.raises(ValueError, match="radians"):
        amplitudes(1.33, 1.0, theta)
