"""`bake export --to libradtran` in libRadtran itself: radiances of its `uvspec` with both files, against the baked surface."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

import bakery

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
