"""libRadtran itself: radiances of its `uvspec` with what `bake export --to libradtran` writes, and files of its `mie` read."""

import math
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from scipy.io import netcdf_file

import bakery
from bakery.physics.medium.phase import phase_integral
from tests.samples import POLARISED_DROPS

NO_UVSPEC = "BAKERY_UVSPEC names no uvspec of libRadtran (…/bin/uvspec, with …/data beside bin)"
CLOUD = """\
bakery: 1
name: cloud
wavelengths: [0.55, 0.56]
tolerance: 0.5%
medium: {sigma_s: 0.01 /m, sigma_a: 5e-4 /m, phase: {type: hg, g: 0.6}}
surface: {thickness: 200 m, tolerance: 0.2%}
"""
COSINES, SUN = (0.2, 0.4, 0.7, 0.98), 60.0
INPUT = """\
data_files_path {data}
atmosphere_file {data}/atmmod/afglus.dat
source solar
wavelength 550 550
no_absorption mol
no_scattering mol
mol_abs_param crs
rte_solver disort
number_of_streams 32
sza {sun}
phi0 0
albedo 0
umu {cosines}
phi 0 180
zout TOA
output_quantity reflectivity
quiet
"""
FILES = {
    "layer": ("aerosol_default\naerosol_file explicit layers.txt\ndisort_intcor moments\n", "layers.txt",
              "0.2 NULL\n0 cloud.layer\n", 3e-4),  # the moments that are cut
    "mie.cdf": ("wc_file 1D water.txt\nwc_properties cloud.mie.cdf interpolate\n", "water.txt", "0.2 0 0\n0 1 10\n", 1e-5)}


@pytest.mark.parametrize("file", FILES)
def test_uvspec_reads_it_and_agrees_with_the_baked_surface(call, tmp_path, file):
    """Reflectance of a layer of optical depth 2.1 in eight directions; no statistics on either side."""
    uvspec = os.environ.get("BAKERY_UVSPEC")
    if not uvspec:
        pytest.skip(NO_UVSPEC)
    (tmp_path / "cloud.yaml").write_text(CLOUD)
    for arguments in ((tmp_path / "cloud.yaml", "-o", tmp_path / "cloud.h5"),
                      ("export", tmp_path / "cloud.h5", "--to", "libradtran", "-o", tmp_path, "--effective-radius", "10um",
                       "--mass-concentration", "1g/m^3")):
        status, _, err = call(*arguments)
        assert status == 0, err
    keys, name, profile, tolerance = FILES[file]
    (tmp_path / name).write_text(profile)
    data = Path(uvspec).resolve().parent.parent / "data"
    out = subprocess.run([uvspec], input=INPUT.format(data=data, sun=SUN, cosines=" ".join(map(str, COSINES))) + keys,
                         cwd=tmp_path, capture_output=True, text=True, timeout=60, check=True).stdout
    # the irradiances, the azimuths, and for each cosine: itself, a mean over azimuths, the radiance at each azimuth
    rows = np.array([line.split() for line in out.splitlines()[2:]], float)
    assert rows[:, 0] == pytest.approx(COSINES)
    surface = bakery.open(tmp_path / "cloud.h5").surface
    for column, azimuth in ((2, 0.0), (3, np.pi)):
        ours = surface.reflectance(np.radians(SUN), np.arccos(COSINES), np.full(len(COSINES), azimuth))[0]
        np.testing.assert_allclose(rows[:, column], ours, rtol=tolerance)


POLARISED = {"550 550": "500 500", "solver disort": "solver polradtran\npolradtran nstokes 3", "streams 32": "streams 16",
             "phi 0 180": "phi 0"}


def test_its_vector_solver_sees_the_polarisation_of_the_asset(call, tmp_path):
    """Q/I of light that a layer of optical depth 1e-4 turns by 80 and 110 degrees, by polradtran, against s12/s11: within 1 %,
    most of which is its 16 streams."""
    uvspec = os.environ.get("BAKERY_UVSPEC")
    if not uvspec:
        pytest.skip(NO_UVSPEC)
    (tmp_path / "drops.yaml").write_text(POLARISED_DROPS)
    for arguments in ((tmp_path / "drops.yaml", "-o", tmp_path / "drops.h5"),
                      ("export", tmp_path / "drops.h5", "--to", "libradtran", "-o", tmp_path, "--density", "1g/cm^3")):
        status, _, err = call(*arguments)
        assert status == 0, err
    with netcdf_file(tmp_path / "drops.mie.cdf", mmap=False) as file:
        extinction, radius = (float(file.variables[name].data.ravel()[0]) for name in ("ext", "reff"))
    (tmp_path / "water.txt").write_text(f"0.2 0 0\n0 {1e-4 / 0.2 / extinction!r} {radius!r}\n")
    text = INPUT + "wc_file 1D water.txt\nwc_properties drops.mie.cdf interpolate\n"
    for before, after in POLARISED.items():
        text = text.replace(before, after)
    data = Path(uvspec).resolve().parent.parent / "data"
    cosines = " ".join(repr(math.cos(math.radians(zenith))) for zenith in (40, 10))
    out = subprocess.run([uvspec], input=text.format(data=data, sun=SUN, cosines=cosines), cwd=tmp_path, capture_output=True,
                         text=True, timeout=60, check=True).stdout.splitlines()
    intensity, q = (np.array([float(line.split()[2]) for line in out[at:at + 2]])
                    for at in (out.index(f"Stokes vector {name}") + 1 for name in "IQ"))
    medium = bakery.open(tmp_path / "drops.h5").medium
    ratio = np.asarray(medium.s12)[0] / np.asarray(medium.phase)[0]
    np.testing.assert_allclose(q / intensity, np.interp(np.radians([80.0, 110.0]), medium.theta, ratio), rtol=0.01)


MIE = """\
data_files_path {data}
mie_program MIEV0
refrac user 1.336 0.001
distribution GAMMA 7
r_eff 4
wavelength 550 560
wavelength_step 10
nstokes 1
nmom 1000
nmom_netcdf 129
nthetamax 1000
output_user netcdf
basename wc_
"""
WATER = """\
bakery: 1
name: water
wavelengths: [0.55, 0.56]
"""
OF_THE_FILE = WATER + "medium: {file: wc_mie.cdf, mass_concentration: 0.3 g/m^3}\n"
OUR_OWN = WATER + """\
particles:
  host: {n: 1}
  mass_concentration: 0.3 g/m^3
  components:
    - {name: drops, material: {n: 1.336, k: 1e-3}, density: 1 g/cm^3, size: {distribution: gamma, radius: 4 um, variance: 0.1}}
"""


def test_a_file_of_its_mie_tool_is_read(tmp_path, monkeypatch):
    """Droplets by its series and by ours.  Its angles are chosen to 1 %, its sum of sizes ends at five effective radii."""
    uvspec = os.environ.get("BAKERY_UVSPEC")
    if not uvspec:
        pytest.skip(NO_UVSPEC)
    monkeypatch.chdir(tmp_path)
    folder = Path(uvspec).resolve().parent
    subprocess.run([folder / "mie"], input=MIE.format(data=folder.parent / "data"), cwd=tmp_path, capture_output=True, text=True,
                   timeout=120, check=True)
    theirs, ours = bakery.bake(OF_THE_FILE).medium, bakery.bake(OUR_OWN).medium
    np.testing.assert_allclose(theirs.sigma_t, ours.sigma_t, rtol=2e-3)
    np.testing.assert_allclose(1 - theirs.albedo, 1 - ours.albedo, rtol=5e-3)
    np.testing.assert_allclose(theirs.g, ours.g, rtol=2e-3)
    theta = np.union1d(theirs.theta, ours.theta)
    assert phase_integral(theta, np.abs(theirs.phase(theta) - ours.phase(theta))).max() < 0.01
