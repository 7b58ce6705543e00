"""A medium of the text of an OPAC component: `medium: {file: suso99, number_density: 3000 /cm^3}`."""

import numpy as np
import pytest

import bakery
from bakery.errors import RecipeError
from bakery.grammar import optical_files
from bakery.grammar.units import Wrong

# Hess, Koepke & Schult 1998, OPAC 3.1, data file suso99: sulphate at 99 % humidity, of one particle in a cm^3; absorption stands
# without a space before its minus
LINES = """\
#  2.500E-01 1.116E-03 1.116E-03 1.397E-09 1.000E+00 0.782E+00 9.232E-01  1.365E+00 -3.286E-08
#  5.000E-01 1.213E-03 1.213E-03-1.446E-10 1.000E+00 0.795E+00 1.004E+00  1.338E+00 -1.245E-09
#  3.000E+00 5.716E-04 1.962E-04 3.754E-04 3.432E-01 0.683E+00 4.729E-01  1.369E+00 -2.672E-01
"""
HEAD = """\
# sulfate (99%)
#
# size distribution: lognormal
# ------------------
#   minimum radius, [um]:      1.030E-02
#
# optical parameters:
# -------------------
#
# wavelength ext.coef  sca.coef  abs.coef  si.sc.alb  asym.par  ext.nor    ref.real  ref.imag
#     [um]     [1/km]    [1/km]    [1/km]
#
"""
MIDDLE = """\
#
# volume phase function [1/km]:
# -----------------------------
#
# sca.ang. | wavelengths --->
# ---------|------------------
#          | 2.500E-01 5.000E-01 3.000E+00
#
"""
RECIPE = """\
bakery: 1
name: sulphate
wavelengths: [0.25, 0.5, 3]
medium: {file: suso99, MORE}
"""


def opac(lines=LINES, middle=MIDDLE, last=180.0):
    """A file as OPAC writes them; its phase functions, scattering times 1/sr, are lobes of Henyey and Greenstein."""
    degrees = np.concatenate([np.arange(0, 5, 0.1), np.arange(5, 10, 0.5), np.arange(10, last + 1, 1.0)])
    g, scattering = np.array([0.782, 0.795, 0.683]), np.array([1.116e-3, 1.213e-3, 1.962e-4])
    mu = np.cos(np.radians(degrees))[:, None]
    phase = scattering * (1 - g**2) / (4 * np.pi * (1 + g**2 - 2 * g * mu) ** 1.5)
    rows = [f"{angle:11.3E}  " + " ".join(f"{value:.3E}" for value in row) for angle, row in zip(degrees, phase)]
    return (HEAD + lines + middle + "\n".join(rows) + "\n").encode()


def test_a_medium_of_opacs_sulphate(tmp_path):
    """Extinction, albedo and asymmetry as OPAC's file suso99 states them, for 3000 particles in a cm^3."""
    (tmp_path / "suso99").write_bytes(opac())
    (tmp_path / "suso99.yaml").write_text(RECIPE.replace("MORE", "number_density: 3000 /cm^3"))
    bakery.bake(tmp_path / "suso99.yaml", tmp_path / "suso99.h5")
    medium = bakery.open(tmp_path / "suso99.h5").medium
    np.testing.assert_allclose(medium.sigma_t, 3 * np.array([1.116e-3, 1.213e-3, 5.716e-4]), rtol=1e-12)
    np.testing.assert_allclose(medium.albedo, [1 - 1.397e-9 / 1.116e-3, 1, 0.3432], rtol=2e-4)
    assert medium.albedo[0] < 1 and medium.albedo[1] == 1  # absorption counts where it has digits; below 0 it is none
    np.testing.assert_allclose(medium.g, [0.782, 0.795, 0.683], atol=2e-3)


@pytest.mark.parametrize(("data", "words"), [
    (opac(middle=MIDDLE.replace("[1/km]", "[1/m]")), "found no unit 1/km"),
    (opac(middle=MIDDLE.replace(" 3.000E+00", "")), "found phase functions in lines of 4 numbers"),
    (opac().replace(b"  0.000E+00", b"  0.000E+00  1.000E+00"), "found phase functions in"),
    (opac(middle=MIDDLE.replace("3.000E+00", "3.100E+00")), "found 3 wavelengths of phase functions, 3 of coefficients"),
    (opac(middle="#\n"), "found no title \"phase function\""),
    (opac(lines=LINES.replace(" 1.397E-09", "")), "found optical parameters in 3 lines of 8 or 9 numbers"),
    (opac(lines=LINES.replace("1.116E-03 1.116E-03", "1.116E-03 1.000E-03")), "found an extinction that is not scattering"),
    (opac(last=170.0), "found angles from 0 to 170 deg"),
    (opac()[:400], "found no title")])
def test_wrong_texts_are_refused(data, words):
    with pytest.raises(Wrong) as wrong:
        optical_files.read(data)
    assert words in wrong.value.found


@pytest.mark.parametrize(("more", "words"), [
    ("humidity: 99%", "found no number_density; expected the number of the particles in a volume"),
    ("number_density: 3000", 'found "3000", which has no unit'),
    ("number_density: 1 /cm^3, mass_concentration: 1 g/m^3",
     "found a mass_concentration; expected number_density: the file holds extinction per particle")])
def test_amounts_that_do_not_fit(tmp_path, call, more, words):
    (tmp_path / "suso99").write_bytes(opac())
    (tmp_path / "suso99.yaml").write_text(RECIPE.replace("MORE", more))
    status, _, err = call(tmp_path / "suso99.yaml")
    assert status == 2 and words in err


@pytest.mark.parametrize(("particles", "key"), [
    ("{file: suso99, number_density: 3000 /cm^3}", "particles.file"),
    ("{host: air, number_density: 3000 /cm^3, components: [{name: sulphate, file: suso99}]}", "particles.components[0].file")])
def test_particles_of_a_file_are_told_the_line_to_write(tmp_path, particles, key):
    """A file of optical properties has no sizes: the message, and there is one only, holds the text of the medium that it is."""
    (tmp_path / "suso99").write_bytes(opac())
    path = tmp_path / "suso99.yaml"
    as_medium = "medium: {file: suso99, number_density: 3000 /cm^3}"
    path.write_text(RECIPE.replace("medium: {file: suso99, MORE}", f"particles: {particles}"))
    with pytest.raises(RecipeError) as refused:
        bakery.recipe.load(path)
    (problem,) = refused.value.problems
    assert (problem.line, problem.key) == (4, key) and problem.expected.endswith(f", {as_medium}")
    path.write_text(RECIPE.replace("medium: {file: suso99, MORE}", as_medium))
    assert bakery.recipe.load(path).medium.number_density == 3e9


def test_a_humidity_of_particles_of_a_file_is_one_of_the_medium(tmp_path):
    with pytest.raises(RecipeError, match=r'medium: \{file: "a, b.nc", mass_concentration: 10 ug/m\^3, humidity: 80%\}'):
        bakery.bake({"bakery": 1, "name": "haze", "wavelengths": [0.5], "particles": {
            "file": "a, b.nc", "mass_concentration": "10 ug/m^3", "relative_humidity": "80%"}})
