"""`bake export --to eradiate` and `libradtran` in Eradiate itself: its readers, and its Monte Carlo against the baked surface."""

import json
import math
import os
import subprocess

import numpy as np
import pytest

import bakery
from tests.conftest import ROOT
from tests.samples import POLARISED_DROPS

NO_ERADIATE = "BAKERY_ERADIATE names no Python that has Eradiate: `make test-eradiate` installs one and runs this"
CLOUD = """\
bakery: 1
name: cloud
wavelengths: [0.55, 0.56]
tolerance: 0.5%
medium: {sigma_s: 0.01 /m, sigma_a: 5e-4 /m, phase: {type: hg, g: 0.6}}
surface: {thickness: 200 m, tolerance: 0.2%}
"""
ZENITHS, SUN = np.array([-45.0, -10.0, 10.0, 45.0, 70.0]), 60.0  # as in tests/eradiate_scene.py


def test_eradiate_reads_it_and_agrees_with_the_baked_surface(call, tmp_path):
    """Reflectance of a layer of optical depth 2.1 in five directions, within 6 standard errors (of 8 runs: a false alarm once in
    400) and 0.5 %, the surface's and Eradiate's interpolation of the phase function."""
    python = os.environ.get("BAKERY_ERADIATE")
    if not python:
        pytest.skip(NO_ERADIATE)
    recipe, asset, made = tmp_path / "cloud.yaml", tmp_path / "cloud.h5", tmp_path / "cloud"
    recipe.write_text(CLOUD)
    for arguments in ((recipe, "-o", asset), ("export", asset, "--to", "eradiate", "-o", made),
                      ("export", asset, "--to", "libradtran", "-o", made, "--effective-radius", "10um", "--mass-concentration",
                       "1g/m^3")):
        status, _, err = call(*arguments)
        assert status == 0, err
    files = made / "cloud_eradiate.nc", made / "cloud.mie.cdf"
    out = subprocess.run([python, "-P", str(ROOT / "tests" / "eradiate_scene.py"), *files],
                         check=True, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": ""}).stdout
    found = json.loads(out.splitlines()[-1])
    cloud = bakery.open(asset)
    assert found["sigma_t"] == pytest.approx(0.0105, rel=1e-12) and found["albedo"] == pytest.approx(1 / 1.05, rel=1e-12)
    for mu, phase in ((found["mu"], found["phase"]), (found["mu_of_libradtran"][0], found["phase_of_libradtran"][0])):
        theta = np.arccos(np.clip(mu, -1, 1))
        np.testing.assert_allclose(phase, 4 * math.pi * cloud.medium.phase(theta)[0], rtol=1e-6)
    np.testing.assert_allclose(found["ext_of_libradtran"], 10.5, rtol=1e-12)
    # Eradiate's azimuth says where the sun stands; ours is 0 for light that goes on forward
    azimuth = np.where(ZENITHS < 0, 0.0, math.pi)
    ours = cloud.surface.reflectance(math.radians(SUN), np.radians(np.abs(ZENITHS)), azimuth)[0]
    assert np.all(np.abs(np.array(found["brf"]) - ours) < 6 * np.array(found["error"]) + 0.005 * ours), (found["brf"], ours)
    assert np.all(np.array(found["error"]) < 0.02 * ours)


def test_polarisation_in_eradiate_is_that_of_the_asset(call, tmp_path):
    """Light that a layer of optical depth 0.01 turns by 80 and 110 degrees: Q/I of Eradiate's polarised run, against s12/s11.
    Light scattered twice is some 3 % of it, less polarised; 200,000 paths a direction, seed fixed."""
    python = os.environ.get("BAKERY_ERADIATE")
    if not python:
        pytest.skip(NO_ERADIATE)
    recipe, asset = tmp_path / "drops.yaml", tmp_path / "drops.h5"
    recipe.write_text(POLARISED_DROPS)
    for arguments in ((recipe, "-o", asset), ("export", asset, "--to", "eradiate", "-o", tmp_path / "drops")):
        status, _, err = call(*arguments)
        assert status == 0, err
    out = subprocess.run([python, "-P", str(ROOT / "tests" / "eradiate_polarised.py"), tmp_path / "drops" / "drops_eradiate.nc"],
                         check=True, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": ""}).stdout
    stokes, medium = json.loads(out.splitlines()[-1]), bakery.open(asset).medium
    ratio = np.asarray(medium.s12)[0] / np.asarray(medium.phase)[0]
    expected = np.interp(np.radians([80.0, 110.0]), medium.theta, ratio)
    assert (expected < -0.5).all()
    np.testing.assert_allclose(np.array(stokes["Q"]) / stokes["I"], expected, rtol=0.05)
