"""Spheres in a concentric shell: against the closed form in many digits, published values, and the limits."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from bakery.mie import amplitudes, coated_amplitudes, coated_efficiencies, efficiencies
from bakery.physics.mie import absorption, coated
from tests.physics.coated_reference import coated as closed_form

REFERENCE = json.loads((Path(__file__).parent / "coated_reference.json").read_text())


def named(case):
    return f"{case['core']} in {case['shell']} {case['x']:.3g} {case['y']:.3g}"


@pytest.mark.parametrize("case", REFERENCE["cases"], ids=named)
def test_reference_case(case):
    """20 digits of mpmath.  What is lost near m = 1 is 1e-16/|m - 1|, of angles and q_back 1e-16 y, as of homogeneous spheres."""
    core, shell, x, y = complex(case["core"]), complex(case["shell"]), case["x"], case["y"]
    soft = 1 + 1e-2 / max(abs(core - 1), abs(shell - 1))
    for name, value in zip(("q_ext", "q_sca", "q_abs", "q_back", "g"), coated_efficiencies(core, shell, x, y)):
        limit = soft * (max(1e-11 if soft > 2 else 4e-13, 1e-14 * y) if name == "q_back" else 1e-12 if name == "q_abs" else 3e-13)
        there = float(case[name])
        # of clear spheres the printed q_abs is rounding
        assert value == pytest.approx(there, rel=limit, abs=0 if core.imag + shell.imag > 0 or name != "q_abs" else 1e-30), name
    s1, s2 = coated_amplitudes(core, shell, x, y, np.array(REFERENCE["angles"]))
    for i, (r1, i1, r2, i2) in enumerate(case["amplitudes"]):
        t1, t2 = complex(float(r1), float(i1)), complex(float(r2), float(i2))
        error = max(abs(s1[i] - t1), abs(s2[i] - t2)) / max(abs(t1), abs(t2))
        assert error < soft * max(1e-12, 1e-14 * y), REFERENCE["angles"][i]


def test_the_example_of_the_textbook():
    """Bohren & Huffman 1983, appendix B, p. 489: a core of 0.171 um in a sphere of 6.265 um at a wavelength of 3 um."""
    q_ext, q_sca, _, q_back, _ = coated_efficiencies(1.59 + 0.66j, 1.409 + 0.1747j, 2 * np.pi * 0.171 / 3, 2 * np.pi * 6.265 / 3)
    assert (f"{q_ext:.5f}", f"{q_sca:.5f}", f"{q_back:.7f}") == ("2.32803", "1.14341", "0.0285099")


def test_the_oracle_knows_homogeneous_spheres():
    q_ext, q_sca, *_ = closed_form(1.5 + 0.01j, 1.5 + 0.01j, 3.0, 7.0)
    there = efficiencies(1.5 + 0.01j, 7.0)
    assert float(q_ext) == pytest.approx(there[0], rel=1e-14) and float(q_sca) == pytest.approx(there[1], rel=1e-14)


@pytest.mark.parametrize("m", [1.33, 1.5 + 1e-8j, 1.5 + 0.01j, 1.95 + 0.79j, 0.055 + 3.42j])
@pytest.mark.parametrize("y", [1e-6, 0.01, 1.0, 30.0, 1000.0])
def test_a_core_of_the_shells_material_is_no_core(m, y):
    """By the formulas for two layers, an ulp apart, not by the way round them."""
    theta = np.linspace(0, np.pi, 50)
    there = *efficiencies(m, y)[:2], absorption(m, y), *efficiencies(m, y)[2:]
    s1, s2 = amplitudes(m, y, theta)
    near = complex(np.nextafter(m.real, 9), m.imag)
    for core, ratio in ((m, 0.5), (near, 0.01), (near, 0.5), (near, 0.999)):
        new = coated_efficiencies(core, m, ratio * y, y)
        for i, limit in enumerate((1e-13, 1e-13, 1e-12, max(1e-13, 1e-14 * y), 1e-13)):
            assert new[i] == pytest.approx(there[i], rel=limit, abs=1e-300)
        t1, t2 = coated_amplitudes(core, m, ratio * y, y, theta)
        scale = np.maximum(abs(s1), abs(s2))
        assert np.max(np.maximum(abs(t1 - s1), abs(t2 - s2)) / scale) < max(1e-13, 1e-14 * y)


@pytest.mark.parametrize("y", [0.5, 20.0])
def test_no_core_and_no_shell(y):
    core, shell = 1.95 + 0.79j, 1.43
    assert coated_efficiencies(core, shell, 0.0, y)[0] == efficiencies(shell, y)[0]
    assert coated_efficiencies(core, shell, y, y)[0] == efficiencies(core, y)[0]
    thin = coated_efficiencies(core, shell, y * (1 - 1e-9), y)
    assert thin[0] == pytest.approx(efficiencies(core, y)[0], rel=1e-7)  # both ends are reached from inside
    small = coated_efficiencies(core, shell, 1e-5 * y, y)
    assert small[0] == pytest.approx(efficiencies(shell, y)[0], rel=1e-9)
    assert small[2] > 0


def test_a_shell_of_the_host_is_no_shell():
    for core, x in ((1.5 + 0.1j, 8.0), (1.33, 3.0)):
        there, new = efficiencies(core, x), coated_efficiencies(core, 1.0, x, 10.0)
        assert new[0] * 100 == pytest.approx(there[0] * x * x, rel=1e-12)
        assert new[4] == pytest.approx(there[3], rel=1e-12)


def test_clear_spheres_absorb_nothing_at_all():
    y = np.geomspace(1e-3, 500, 200)
    q_ext, q_sca, q_abs, *_ = coated_efficiencies(1.5, 1.33, 0.7 * y, y)
    assert (q_abs == 0).all() and (q_ext == q_sca).all()


def test_absorption_goes_with_k():
    """Linear in the k of the shell while that is small: the digits are those of the absorption, not of the extinction."""
    weak, weaker = (coated_efficiencies(1.5, 1.33 + 1j * k, 3.0, 5.0)[2] for k in (1e-10, 1e-14))
    assert weak / weaker == pytest.approx(1e4, rel=1e-6)


def test_the_seam_between_the_second_solutions():
    """On both sides of Im z2 = 1, where the functions change, values are those of the closed form."""
    k = coated.FADED / 20.0
    for shell in (1.4 + 1j * k * (1 - 1e-12), 1.4 + 1j * k * (1 + 1e-12)):
        new, there = coated_efficiencies(1.6 + 0.2j, shell, 12.0, 20.0), closed_form(1.6 + 0.2j, shell, 12.0, 20.0, ())
        assert np.allclose(new, [float(value) for value in there[:5]], rtol=1e-13, atol=0)


def test_thick_dark_shells_hide_the_core():
    for y in (1e3, 1e5):
        new = coated_efficiencies(1.33, 1.5 + 1j, 0.9 * y, y)
        assert new[0] == pytest.approx(efficiencies(1.5 + 1j, y)[0], rel=1e-13)
    assert np.isfinite(coated_efficiencies(5 + 100j, 10 + 100j, 900.0, 1000.0)).all()


@pytest.mark.slow
def test_random_spheres_are_those_of_the_closed_form():
    rng = np.random.default_rng(0)
    for _ in range(150):
        core, shell = (complex(rng.uniform(0.3, 3), rng.choice([0.0, 10 ** rng.uniform(-9, 0.6)])) for _ in range(2))
        y = 10 ** rng.uniform(-2, 2)
        x = y * rng.choice([rng.uniform(0.01, 1), 1 - 10 ** rng.uniform(-6, -1)])
        new, there = coated_efficiencies(core, shell, x, y), closed_form(core, shell, x, y, ())
        assert np.allclose(new[:2] + new[4:], [float(there[i]) for i in (0, 1, 4)], rtol=1e-11, atol=0), (core, shell, x, y)
        if core.imag + shell.imag > 0:
            assert new[2] == pytest.approx(float(there[2]), rel=1e-10), (core, shell, x, y)


@pytest.mark.parametrize("arguments, message", [
    ((1.5, 1.33, 2.0, 1.0), "x = 2: that of a core lies between 0"), ((1.5, 1.33, -1.0, 1.0), "x = -1"),
    ((1.5, 1.33 - 1j, 0.5, 1.0), "k < 0"), ((1.5 - 1j, 1.33, 0.5, 1.0), "k < 0"), ((np.inf, 1.33, 0.5, 1.0), "perfect conductor"),
    ((1.5, 1.33, 0.5, 1e7), "size parameters from"), ((1.5, 1.33, math.nan, 1.0), "x = nan"),
    ((np.ones(3), np.ones(2), 0.5, 1.0), "broadcast"), (("a", 1.33, 0.5, 1.0), "numbers")])
def test_what_is_no_coated_sphere_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        coated_efficiencies(*arguments)
    with pytest.raises(ValueError, match=message):
        coated_amplitudes(*arguments, 0.0)


def test_arrays_broadcast_and_scalars_stay():
    q = coated_efficiencies(np.array([1.5, 1.6])[:, None], 1.33, 1.0, np.array([2.0, 3.0, 4.0]))
    assert all(value.shape == (2, 3) for value in q) and isinstance(coated_efficiencies(1.5, 1.33, 1.0, 2.0)[0], float)
    assert q[0][1, 2] == coated_efficiencies(1.6, 1.33, 1.0, 4.0)[0]
    s1, _ = coated_amplitudes(1.5, 1.33, np.array([0.5, 1.0]), 2.0, np.zeros((4, 1)))
    assert s1.shape == (2, 4, 1) and s1.dtype == complex
