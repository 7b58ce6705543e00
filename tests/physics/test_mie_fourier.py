"""Amplitudes at many angles: the transform against long sums, and where it gives way to recurrences."""

import numpy as np
import pytest

from bakery.physics.mie import MANY_ANGLES, SMALLEST, amplitudes, coefficients
from bakery.physics.mie.legendre import APART, LEAF, NODES, box_tables, legendre_to_fourier, levels, ratios

LONG = np.longdouble
PI = LONG(np.pi) + LONG(1.2246467991473532e-16)
ANGLES = np.sort(np.append(np.linspace(0, np.pi, 401), 10 ** np.random.default_rng(11).uniform(-7, 0, 60)))


def long_sums(m, x, theta):
    """S1, S2 by the difference form of the recurrences with 64 bits of mantissa, from the kernel's a_n, b_n."""
    last = coefficients.terms(x)
    work = np.empty((last + 2, 4, 1))
    coefficients.coefficients(complex(m), np.array([x]), work)
    a_r, a_i, b_r, b_i = work[:last, :, 0].T.astype(LONG)
    front = theta <= np.pi / 2
    half = np.sin(np.where(front, theta.astype(LONG), PI - theta.astype(LONG)) / 2)
    v = 2 * half * half
    p, q, e, f = 1 - v / 2, v / 2, 0 * v, 0 * v
    sums = np.zeros((4, theta.size), LONG)
    for i in range(last):
        n = LONG(i + 1)
        k, sign = 2 * n + 1, -1 if i % 2 else 1
        plus, minus = np.where(front, p, sign * q), np.where(front, q, sign * p)
        for row, coefficient, function in zip(sums, (a_r[i] + b_r[i], a_i[i] + b_i[i], a_r[i] - b_r[i], a_i[i] - b_i[i]),
                                              (plus, plus, minus, minus)):
            row += k * coefficient * function
        e, f = e - k * v * p, f + k * (2 / (n * (n + 1)) - v) * q
        step = (n + 1) / (n * (n + 2))
        p, q = p + step * e, q + step * f
    return (sums[0] + sums[2]) / 2 + 0.5j * (sums[1] + sums[3]), (sums[0] - sums[2]) / 2 + 0.5j * (sums[1] - sums[3])


def worst(m, x, theta, values):
    """Largest error over the larger of |S1|, |S2| at its angle."""
    exact = long_sums(m, x, theta)
    local = np.maximum(abs(exact[0]), abs(exact[1]))
    return float(max(np.max(abs(value - long_value) / local) for value, long_value in zip(values, exact)))


@pytest.mark.parametrize("m, x", [(1.33, 50.0), (1.33, 777.7), (0.75, 300.0), (1.5 + 1j, 2000.0), (1.33 + 1e-6j, 5000.0),
                                  (np.inf, 400.0)])
def test_transform_against_long_sums(m, x):
    """The bound of the recurrences: rounding grows like x, half an ulp of theta alone is worth x 1e-16 between two fringes."""
    assert worst(m, x, ANGLES, amplitudes(m, x, ANGLES)) < max(5e-12, 4e-16 * x)


@pytest.mark.slow
@pytest.mark.parametrize("m, x", [(1.33, 20_000.0), (1.5 + 0.1j, 60_000.0), (0.75, 30_000.0)])
def test_transform_of_large_spheres(m, x):
    assert worst(m, x, ANGLES, amplitudes(m, x, ANGLES)) < 4e-16 * x


def test_soft_spheres_are_summed_by_recurrences_at_the_side():
    """m = 1.0001: the peak is 1e8 of |S| at the side, and 1e-16 of it too much there."""
    x = 2000.0
    many, few = amplitudes(1.0001, x, ANGLES), amplitudes(1.0001, x, ANGLES[::2])
    peak = np.max(abs(few[0]))
    side = abs(few[0]) < 1e-6 * peak
    assert side.sum() > 50
    for a, b in zip(many, few):
        assert np.array_equal(a[::2][side], b[side])
        assert np.all(abs(a[::2] - b) < 1e-14 * peak)


def test_ends():
    x = np.array([60.0, 345.6, 4000.0])
    s1, s2 = amplitudes(1.33, x, np.linspace(0, np.pi, 500))
    assert np.array_equal(s1[:, 0], s2[:, 0]) and np.array_equal(s1[:, -1], -s2[:, -1])
    few = amplitudes(1.33, x, np.array([0.0, np.pi]))
    assert s1[:, [0, -1]] == pytest.approx(few[0], rel=1e-14)


def test_result_does_not_depend_on_other_spheres_or_angles():
    """Bit for bit, also where spheres share a grid or leave the side-by-side kernels; from MANY_ANGLES on, any angles."""
    x = np.concatenate([np.linspace(20.0, 320.0, 40), [1000.0, 1010.0, 11_500.0, 11_501.0, 12_600.0]])
    theta = np.linspace(0, np.pi, 2 * MANY_ANGLES)
    together = np.array(amplitudes(1.33, x, theta))
    order = np.random.default_rng(4).permutation(x.size)
    assert np.array_equal(together[:, order], np.array(amplitudes(1.33, x[order], theta)))
    for i in (0, 7, 20, 41, 43, 44):
        assert np.array_equal(together[:, i], np.array(amplitudes(1.33, x[i], theta)))
        assert np.array_equal(together[:, i, 1::2], np.array(amplitudes(1.33, x[i], theta[1::2])))


def test_seam():
    """A sphere just below SMALLEST and just above, one angle too few and enough."""
    theta = np.linspace(0, np.pi, MANY_ANGLES)
    for x in (np.nextafter(SMALLEST, 0), SMALLEST):
        assert worst(1.5 + 0.01j, x, theta, amplitudes(1.5 + 0.01j, x, theta)) < 1e-12
    fewer = amplitudes(1.33, 200.0, theta[:-1])
    assert np.max(abs(amplitudes(1.33, 200.0, theta)[0][:-1] - fewer[0])) < 1e-15 * abs(fewer[0][0])


@pytest.mark.parametrize("last", [5, 2 * APART * LEAF + 1, 3000])
def test_fourier_coefficients_against_their_sum(last):
    rng = np.random.default_rng(last)
    size = (last // 2 // LEAF + 1) * LEAF
    h = np.zeros((2, 4, 2, size))
    for n in range(1, last + 1):
        h[:, :, n % 2, n // 2] = rng.normal(size=(2, 4))
    table, g = ratios(2 * size + (APART + 1) * LEAF), h.copy()
    legendre_to_fourier(g, np.array([last, last]), table, box_tables(), np.zeros((2, 2, levels(size)[-1], 8, NODES)))
    long_table = np.cumprod(np.append(LONG(1), (np.arange(2 * size, dtype=LONG) + LONG(0.5)) / (np.arange(2 * size) + 1)))
    assert np.max(abs(table[:long_table.size] / long_table - 1)) < 5e-16
    for parity in range(2):
        for j in range(0, (last - parity) // 2 + 1, 17):
            i = np.arange(j, (last - parity) // 2 + 1)
            row = long_table[i - j] * long_table[i + j + parity]
            exact = h[:, :, parity, i] @ row
            assert np.max(abs(g[:, :, parity, j] - exact)) < 1e-14 * float(np.sqrt(np.sum(row**2)))


@pytest.mark.parametrize("grid", [512, 20 << 6, 25 << 8, 16 << 11])
def test_cosine_sums_against_scipy(grid):
    from scipy.fft import dct

    from bakery.physics.mie.cosines import cosine_sums

    series = np.full((grid, 4), np.nan)  # the upper half is not read
    series[:grid // 2] = np.random.default_rng(grid).normal(size=(grid // 2, 4))
    series[grid // 2] = 0.0
    exact = dct(np.nan_to_num(series).astype(LONG), type=3, axis=0)
    cosine_sums(series, np.empty(8 * grid))
    assert np.max(abs(series - exact)) < 2e-15 * float(np.sqrt(np.mean(exact**2)))
