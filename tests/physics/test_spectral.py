"""Media between the baked wavelengths: what is claimed of the interpolation covers what a bake at those wavelengths shows."""

import numpy as np
import pytest

import bakery
from bakery.errors import UsageError
from bakery.physics.medium import spectral
from bakery.physics.medium.phase import phase_at, phase_integral

RECIPE = """bakery: 1
name: drops
wavelengths: [{}]
tolerance: 1%
phase: {{polarized: true}}
particles:
  number_density: 1e8 /m^3
  components:
    - {{name: drops, material: {}, size: {{{}}}}}
"""
HAZE = "{n: 1.45, k: 0.001}", "distribution: lognormal, radius: 0.1 um, sigma: 1.6, min: 0.005 um, max: 2 um"
CLOUD = "water", "distribution: gamma, radius: 5 um, variance: 0.1"
STORED, WANTED = (0.65, 0.6, 0.45, 0.55, 0.5), (0.46, 0.475, 0.52, 0.525, 0.575, 0.59, 0.64)


def baked(of, wavelengths):
    return bakery.bake(RECIPE.format(", ".join(map(str, wavelengths)), *of))


@pytest.mark.slow
@pytest.mark.parametrize("of", [HAZE, CLOUD], ids=["haze", "cloud"])
@pytest.mark.parametrize("stored", [STORED, (0.61, 0.55, 0.465)], ids=["five", "rgb"])
def test_what_is_claimed_covers_a_bake_at_these_wavelengths(of, stored):
    wanted = [um for um in WANTED if min(stored) < um < max(stored)]
    asset, truth = baked(of, stored), baked(of, wanted)
    medium = asset.medium.at(wanted)
    for name in ("sigma_t", "sigma_s", "sigma_a", "albedo", "g"):
        assert (np.abs(medium[name] - truth.medium[name]) <= medium.bias[name]).all(), name
    theta, of_truth = medium.theta, truth.medium.phase
    right, bias = (phase_at(of_truth.theta, np.asarray(table), theta) for table in (of_truth.table, of_truth.error))
    # what the truth itself is known to be off by is no fault of the interpolation's
    assert (np.abs(medium.phase.table - right) <= medium.phase.error + bias).all()
    off = np.abs(medium["s12"] - phase_at(of_truth.theta, truth.medium["s12"], theta))
    assert np.mean(off > medium.bias["s12"] + bias) < 2e-3
    # and the claim is no empty one: within a factor of ten of the true error of the light as a whole
    true = phase_integral(theta, np.abs(medium.phase.table - right)).max()
    assert true < phase_integral(theta, medium.phase.error).max() < 12 * true


def test_angstroms_law_is_met_exactly():
    um = np.array([0.7, 0.4, 0.5, 0.6])
    values = np.stack([3 * um**-1.3, 0.1 * um**0.5], axis=1)
    wanted = np.array([0.4, 0.45, 0.66])
    computed = spectral.interpolated(spectral.places(um, wanted), values)
    assert np.allclose(computed, np.stack([3 * wanted**-1.3, 0.1 * wanted**0.5], axis=1), rtol=1e-14)
    error = spectral.missed(um, wanted, lambda at: spectral.interpolated(at, values), values)
    assert error.max() < 1e-14 and (error[0] == 0).all()


def test_zeros_and_signs_go_linearly():
    um, values = np.array([0.4, 0.5, 0.6]), np.array([0.0, 1.0, -1.0])
    assert spectral.interpolated(spectral.places(um, np.array([0.45, 0.55])), values) == pytest.approx([0.5, 0.0], abs=1e-12)


def test_a_gap_wider_than_those_left_out_counts_more():
    """A quadratic over ln wavelength, three neighbours close and one far: the claim covers the middle of the gap too."""
    logarithm = np.array([0.0, 0.02, 0.04, 0.6])
    um = np.exp(logarithm)
    values = np.exp(logarithm**2)
    wanted = np.exp([0.1, 0.32, 0.5])
    computed = spectral.interpolated(spectral.places(um, wanted), values)
    error = spectral.missed(um, wanted, lambda at: spectral.interpolated(at, values), values)
    assert (np.abs(computed - np.exp(np.log(wanted) ** 2)) <= error).all()


def medium_of(wavelengths):
    return bakery.bake({"bakery": 1, "name": "gel", "wavelengths": list(wavelengths), "tolerance": "1%", "medium": {
        "sigma_s": f"{[float(um**-4) for um in wavelengths]} /m", "sigma_a": "0 /m", "phase": {"type": "rayleigh"}}}).medium


def test_between_two_wavelengths_the_error_is_unknown():
    medium = medium_of([0.4, 0.8]).at("[400, 500] nm")
    assert medium.sigma_t == pytest.approx([0.4**-4, 0.5**-4]) and medium.albedo.tolist() == [1, 1]
    assert np.isfinite(medium.bias["sigma_t"][0]) and np.isnan(medium.bias["sigma_t"][1])
    assert np.isnan(medium.phase.error[1]).all() and np.isfinite(medium.phase.error[0]).all()


def test_one_wavelength_has_nothing_between():
    medium = medium_of([0.5])
    assert medium.at(0.5).sigma_t == medium.sigma_t
    with pytest.raises(UsageError, match=r"wavelength: found 0.6 um; the asset holds 0.5 um$"):
        medium.at(0.6)


def test_wavelengths_of_a_phase_function():
    medium = medium_of([0.7, 0.4, 0.5])
    theta = np.linspace(0, np.pi, 5)
    assert medium.phase(theta, wavelength="450 nm").shape == (5,)
    assert medium.phase(theta, wavelength=[0.45, 0.6]).shape == (2, 5)
    assert np.array_equal(medium.phase(theta, wavelength=0.4), medium.phase(theta)[1])
    assert np.array_equal(medium.phase(theta, wavelength=0.45), medium.at(0.45).phase(theta)[0])
    assert np.abs(phase_integral(medium.theta, medium.phase.at([0.45, 0.61]).table) - 1).max() < 1e-14
    for wrong, told in ((0.8, "found 0.8 um; the asset holds 0.7, 0.4, 0.5 um and what lies between"), ("0.45 kg", "kg"),
                        (float("nan"), "found nan"), (None, "found None")):
        with pytest.raises(UsageError, match=told):
            medium.at(wrong)
