"""`bake export --to netcdf`, `libradtran`, `eradiate`: what other readers find, and a medium baked of these files again."""

import json
import math

import numpy as np
import pytest
from scipy.io import netcdf_file

import bakery
from bakery.store.tree import Dataset
from bakery.store.write import write
from tests.libradtran import libradtran
from tests.samples import small_asset, with_member

NO_PACKAGE = "is not installed (extra `solvers`)"
DROPS = """\
bakery: 1
name: drops
wavelengths: [0.5, 0.55, 0.6]
tolerance: 2%
particles:
  host: air
  number_density: 1e9 /m^3
  components:
    - {name: drops, material: water, size: {distribution: gamma, radius: 1 um, variance: 0.2, max: 6 um}}
"""
AGAIN = """\
bakery: 1
name: again
wavelengths: {wavelengths}
tolerance: 2%
medium: {{file: {file}{more}}}
"""


@pytest.fixture(scope="module")
def drops(tmp_path_factory):
    """An asset of droplets at three wavelengths."""
    folder = tmp_path_factory.mktemp("drops")
    (folder / "drops.yaml").write_text(DROPS)
    bakery.bake(folder / "drops.yaml", folder / "drops.h5")
    return bakery.open(folder / "drops.h5")


@pytest.fixture
def export(call, tmp_path):
    """The files that a format makes of an asset, and what was said."""
    def run(asset, target, *options):
        path = tmp_path / "fog.h5"
        write(path, getattr(asset, "tree", asset))
        status, out, err = call("export", path, "--to", target, "-o", tmp_path, "--json", "--overwrite", *options)
        assert status == 0, err
        return [tmp_path / name for name in json.loads(out)["files"]]

    return run


@pytest.fixture
def again(call, tmp_path):
    """The asset of a recipe whose medium is a file; its status, and what was said."""
    def run(file, more="", wavelengths="[0.5, 0.55, 0.6]"):
        recipe = tmp_path / "again.yaml"
        recipe.write_text(AGAIN.format(file=file.name, wavelengths=wavelengths, more=more))
        status, _, err = call(recipe, "-o", tmp_path / "again.h5", "--overwrite")
        return (bakery.open(tmp_path / "again.h5") if status in (0, 3) else None), status, err

    return run


def same(asset, other, rtol=1e-9):
    """Whether the media of two assets are the same, whatever angles their tables have."""
    for name in ("sigma_t", "sigma_s", "albedo", "g"):
        np.testing.assert_allclose(asset.medium[name], other.medium[name], rtol=rtol)
    theta = np.union1d(asset.medium.theta, other.medium.theta)
    np.testing.assert_allclose(asset.medium.phase(theta), other.medium.phase(theta), rtol=rtol)


# ---- what other readers find


def test_the_file_of_the_conventions(export):
    tree = small_asset()
    (path,) = export(tree, "netcdf")
    medium = tree["medium"]
    with netcdf_file(path, mmap=False) as file:
        assert file.Conventions == b"CF-1.11" and file.asset == b"fog"
        found = {name: variable.data for name, variable in file.variables.items()}
        assert file.variables["phase_function"].units == b"sr-1" and file.variables["extinction_coefficient"].units == b"m-1"
        assert file.variables["wavelength"].standard_name == b"radiation_wavelength"
        assert file.variables["phase_function"].dimensions == ("wavelength", "scattering_angle")
        assert file.variables["phase_function"].ancillary_variables == b"phase_function_error"
    np.testing.assert_array_equal(found["wavelength"], tree["wavelength"].data)
    np.testing.assert_allclose(np.radians(found["scattering_angle"]), medium["theta"].data, rtol=1e-15)
    for name, ours in (("extinction_coefficient", "sigma_t"), ("scattering_coefficient", "sigma_s"), ("asymmetry_factor", "g"),
                       ("single_scattering_albedo", "albedo"), ("phase_function", "phase"),
                       ("phase_function_error", "phase_bias")):
        np.testing.assert_allclose(found[name], medium[ours].data, rtol=1e-14)


def test_xarray_and_netcdf4_read_all_three(export, drops):
    xarray = pytest.importorskip("xarray", reason=f"xarray {NO_PACKAGE}")
    netcdf4 = pytest.importorskip("netCDF4", reason=f"netCDF4 {NO_PACKAGE}")
    for target, name in (("netcdf", "phase_function"), ("libradtran", "phase"), ("eradiate", "phase")):
        path = export(drops, target)[0]
        data = xarray.load_dataset(path, engine="scipy")
        with netcdf4.Dataset(path) as file:
            np.testing.assert_array_equal(file[name][:], data[name].values)
        if target == "netcdf":
            assert data["phase_function"].sel(wavelength=0.55).shape == drops.medium.theta.shape
        if target == "eradiate":
            assert data["phamat"].values.tolist() == ["11"] and data["mu"].dims == ("w", "iangle")


@pytest.mark.parametrize("option", [(), ("--density", "2 g/cm^3")])
def test_libradtran_has_extinction_over_mass(export, drops, option):
    """Droplets of a gamma distribution: effective radius as stated, mass by its volume, which is exact."""
    path, layer = export(drops, "libradtran", *option)
    with netcdf_file(path, mmap=False) as file:
        found = {name: variable.data for name, variable in file.variables.items()}
        assert file.variables["ext"].units == b"km^-1/(g/m^3)" and file.variables["ext"].dimensions == ("nlam", "nreff")
        assert file.variables["phase"].dimensions == ("nlam", "nreff", "nphamat", "nthetamax")
        assert file.version == 20110916  # without it uvspec looks for one wavelength; angles from 180 degrees down
    assert found["theta"][0, 0, 0, 0] == 180.0 and (np.diff(found["theta"]) < 0).all()
    density = 2.0 if option else 1.0
    assert found["reff"][0] == pytest.approx(1.0, rel=1e-3) and found["rho"][0, 0] == density  # cut at 6 um
    mass = 1e9 * drops.tree["optics/drops/mean_volume"].data[0] * 1e-18 * 1e6 * density  # g/m^3
    np.testing.assert_allclose(found["ext"][:, 0], 1e3 * drops.medium.sigma_t / mass, rtol=1e-9)
    np.testing.assert_allclose(found["pmom"][:, 0, 0, 1], 3 * drops.medium.g, rtol=1e-9)
    np.testing.assert_allclose(found["phase"][:, 0, 0, ::-1], 4 * math.pi * np.asarray(drops.medium.phase), rtol=1e-14)
    rows = np.array([[float(word) for word in line.split()] for line in layer.read_text().splitlines()])
    expected = np.transpose([[500, 550, 600], 1e3 * drops.medium.sigma_t, drops.medium.albedo])
    np.testing.assert_allclose(rows[:, :3], expected, rtol=1e-9)
    np.testing.assert_allclose(rows[:, 3:5], np.transpose([np.ones(3), drops.medium.g]), rtol=1e-8)
    assert rows.shape[1] == 3 + found["nmom"][0, 0, 0]


@pytest.mark.parametrize(("options", "words"), [
    ((), "fog: holds no mass of particles, by which libradtran scales extinction; give --density 2.6g/cm^3 or"),
    (("--density", "1"), '--density: found "1", which has no unit'),
    (("--effective-radius", "0 um"), '--effective-radius: found "0 um"; expected a value above 0')])
def test_what_libradtran_needs(call, tmp_path, options, words):
    write(tmp_path / "fog.h5", small_asset())
    status, out, err = call("export", tmp_path / "fog.h5", "--to", "libradtran", *options)
    assert status == 2 and not out and words in err
    bare = with_member(small_asset(), "optics", None)
    write(tmp_path / "bare.h5", bare)
    assert "give --effective-radius 10um" in call("export", tmp_path / "bare.h5", "--to", "libradtran")[2]


def test_eradiate_has_its_own_order(export):
    """Wavelengths and cosines ascend, whatever the asset's order; the integral of phase is 2."""
    tree = small_asset()
    (path,) = export(tree, "eradiate")
    with netcdf_file(path, mmap=False) as file:
        found = {name: variable.data for name, variable in file.variables.items()}
        assert file.format == b"Aer-Core v2"
    np.testing.assert_allclose(found["w"], [465, 610], rtol=1e-15)
    np.testing.assert_allclose(found["ext"], 1e3 * tree["medium/sigma_t"].data[::-1], rtol=1e-15)
    assert (np.diff(found["mu"], axis=1) > 0).all() and (found["nangles"] == found["mu"].shape[1]).all()
    np.testing.assert_allclose(np.trapezoid(found["phase"][0], found["mu"]), 2, rtol=1e-8)


# ---- polarisation

RAYLEIGH = """\
bakery: 1
name: molecules
wavelengths: [0.5, 0.4]
tolerance: 0.1%
phase: {polarized: true}
particles:
  number_density: 1e20 /m^3
  components:
    - {name: spheres, material: {n: 1.33}, size: {distribution: single, radius: 1 nm}}
"""


@pytest.fixture(scope="module")
def molecules(tmp_path_factory):
    """A polarised asset of spheres of size parameter 0.01."""
    folder = tmp_path_factory.mktemp("molecules")
    (folder / "molecules.yaml").write_text(RAYLEIGH)
    bakery.bake(folder / "molecules.yaml", folder / "molecules.h5")
    return bakery.open(folder / "molecules.h5")


def test_the_file_of_the_conventions_holds_rayleighs_coefficients(export, molecules):
    """Of Rayleigh scattering, de Haan, Bosma & Hovenier 1987, eq. 141: alpha1 = (1, 0, 1/2), alpha2 = (0, 0, 3), alpha3 = 0,
    alpha4 = (0, 3/2), beta1 = (0, 0, sqrt(3/2)), beta2 = 0; to the table's tolerance, and x^2 = 2e-4."""
    (path,) = export(molecules, "netcdf")
    with netcdf_file(path, mmap=False) as file:
        found = {name: variable.data for name, variable in file.variables.items()}
        assert file.variables["expansion_beta1"].dimensions == ("wavelength", "order")
    expected = {"alpha1": [1, 0, 0.5], "alpha2": [0, 0, 3], "alpha3": [0, 0, 0], "alpha4": [0, 1.5, 0],
                "beta1": [0, 0, math.sqrt(1.5)], "beta2": [0, 0, 0]}
    for name, row in expected.items():
        np.testing.assert_allclose(found[f"expansion_{name}"][:, :3], [row, row], atol=3e-3, err_msg=name)
        assert np.abs(found[f"expansion_{name}"][:, 3:]).max(initial=0.0) < 3e-3
    for name in ("12", "33", "34"):
        np.testing.assert_array_equal(found[f"scattering_matrix_{name}"], molecules.medium[f"s{name}"])
    assert (found["expansion_cut"] <= 1e-3).all()


@pytest.mark.parametrize("target", ["eradiate", "libradtran"])
def test_others_have_the_elements_in_their_order(export, again, molecules, target):
    """4 pi s of Rayleigh scattering: 3/4 (1 + mu^2), -3/4 (1 - mu^2), 3/2 mu, 0; of libRadtran their Legendre series too.
    A medium is baked of both."""
    path, mass = export(molecules, target, *(("--density", "1 g/cm^3") if target == "libradtran" else ()))[0], ""
    with netcdf_file(path, mmap=False) as file:
        found = {name: variable.data for name, variable in file.variables.items()}
    phase = found["phase"][:, 0] if target == "eradiate" else found["phase"][0, 0]
    mu = found["mu"][0] if target == "eradiate" else np.cos(np.radians(found["theta"][0, 0, 0]))
    expected = [0.75 * (1 + mu**2), -0.75 * (1 - mu**2), 1.5 * mu, 0 * mu]
    np.testing.assert_allclose(phase, expected, atol=2e-3)
    if target == "eradiate":
        assert found["phamat"].tobytes() == b"11123334"
    else:
        series = found["pmom"][0, 0, :, :3]
        np.testing.assert_allclose(series, [[1, 0, 0.5], [-0.5, 0, 0.5], [0, 1.5, 0], [0, 0, 0]], atol=2e-3)
        mass = f", mass_concentration: {1e20 * molecules.tree['optics/spheres/mean_volume'].data[0] * 1e-12:.15g} g/m^3"
    back, status, err = again(path, mass, "[0.5, 0.4]")
    assert status == 0, err
    same(back, molecules, rtol=1e-6)


def test_what_is_lost_of_polarisation_is_said(call, tmp_path, molecules, drops):
    """Formats without a place for the expansion say so; a scalar asset says what would bring polarisation."""
    for asset in (molecules, drops):
        write(tmp_path / f"{asset.name}.h5", asset.tree)
    for target, more, words in (("netcdf", (), "polarisation: s12, s33 and s34 at every angle, and expansion coefficients"),
                                ("disort", (), "polarisation is left out: the solvers are for scalar light"),
                                ("eradiate", (), "so expansion coefficients are left out"),
                                ("libradtran", ("--density", "1 g/cm^3"), "none in generalised spherical functions")):
        status, _, err = call("export", tmp_path / "molecules.h5", "--to", target, "-o", tmp_path / target, *more)
        assert status == 0 and words in err, err
    assert "`phase: {polarized: true}` would" in call("export", tmp_path / "drops.h5", "--to", "netcdf", "-o", tmp_path / "n")[2]


# ---- there and back


@pytest.mark.parametrize(("target", "more"), [("netcdf", ""), ("eradiate", ""),
                                              ("libradtran", ", mass_concentration: {mass} g/m^3")])
def test_a_medium_is_baked_of_the_export(export, again, drops, target, more):
    path = export(drops, target)[0]
    mass = 1e9 * drops.tree["optics/drops/mean_volume"].data[0] * 1e-12
    back, status, err = again(path, more.format(mass=f"{mass:.15g}"))
    assert status == 0 and back.stages["medium"]["achieved_error"] == 0, err
    same(back, drops)


@pytest.mark.parametrize("target", ["netcdf", "eradiate", "libradtran"])
def test_the_same_bytes_every_time(export, drops, target):
    first = [path.read_bytes() for path in export(drops, target)]
    assert first == [path.read_bytes() for path in export(drops, target)]


def test_between_the_wavelengths_of_a_file(export, again, drops):
    """Extinction, scattering and scattered light are linear; the stated error covers the medium that is baked there."""
    (path,) = export(drops, "netcdf")
    back, status, _ = again(path, wavelengths="[0.5, 0.57]")
    medium, t = drops.medium, 0.4
    expected = [medium.sigma_s[0], (1 - t) * medium.sigma_s[1] + t * medium.sigma_s[2]]
    np.testing.assert_allclose(back.medium.sigma_s, expected, rtol=1e-12)
    mixed = ((1 - t) * medium.sigma_s[1] * np.asarray(medium.phase)[1] + t * medium.sigma_s[2] * np.asarray(medium.phase)[2])
    np.testing.assert_allclose(back.medium.phase(medium.theta)[1], mixed / back.medium.sigma_s[1], rtol=1e-9)
    stated = back.stages["medium"]["achieved_error"]
    assert 0 < stated < 0.2 and status == (3 if stated > 0.02 else 0)
    (path.parent / "true.yaml").write_text(DROPS.replace("[0.5, 0.55, 0.6]", "[0.57]"))
    bakery.bake(path.parent / "true.yaml", path.parent / "true.h5")
    true = bakery.open(path.parent / "true.h5")
    off = np.abs(back.medium.phase(true.medium.theta)[1] / true.medium.phase(true.medium.theta)[0] - 1).max()
    # both tables have their own 2 % beside it
    assert off < 3 * stated + 0.04


# ---- other people's files


@pytest.mark.parametrize("classic", [True, False])
def test_humidity_of_an_opac_file(again, tmp_path, classic):
    """Extinction per mass times mass; between humidities linear in scattered light."""
    path = libradtran(tmp_path / "waso.mie.cdf", hum=[0, 50, 80], classic=classic)
    asset, status, err = again(path, ", mass_concentration: 10 ug/m^3, humidity: 50%", "[0.5, 0.6]")
    assert status == 0, err
    # 200 km^-1/(g/m^3) is 0.2 m^2/g, of 1e-5 g/m^3
    np.testing.assert_allclose(asset.medium.sigma_t, 2e-6, rtol=1e-7)
    np.testing.assert_allclose(asset.medium.albedo, 0.9, rtol=1e-7)
    np.testing.assert_allclose(asset.medium.g, [0.6, 0.65], atol=1e-3)
    between, status, err = again(path, ", mass_concentration: 10 ug/m^3, humidity: 65%", "[0.5]")
    assert status == 3 and "between the file's wavelengths and other values the medium is known to" in err
    np.testing.assert_allclose(between.medium.sigma_t, 2.5e-6, rtol=1e-7)
    np.testing.assert_allclose(between.medium.g, (2 * 0.6 + 3 * 0.7) / 5, atol=1e-3)


def test_effective_radius_of_a_cloud_file(again, tmp_path):
    path = libradtran(tmp_path / "wc.mie.cdf", reff=[5, 10])
    asset, status, err = again(path, ", mass_concentration: 0.3 g/m^3, effective_radius: 10 um", "[0.6]")
    assert status == 0 and asset.medium.sigma_t[0] == pytest.approx(0.06, rel=1e-7), err


@pytest.mark.parametrize(("changes", "more", "words"), [
    ({}, ", humidity: 50%", "medium: found no mass_concentration; expected the mass of the particles in a volume"),
    ({}, ", mass_concentration: 1 g/m^3", "medium: found no humidity; expected one of the file's, 0 to 80 %"),
    ({}, ", mass_concentration: 1 g/m^3, humidity: 90%", "found a relative humidity of 90 %; expected 0 to 80 %"),
    ({}, ", mass_concentration: 1 g/m^3, humidity: 50%, effective_radius: 5 um",
     "found effective_radius; expected humidity: the file has values over humidity"),
    ({}, ", mass_concentration: 1, humidity: 50%", 'found "1", which has no unit; mass concentrations take'),
    ({}, ", mass_concentration: 1 g/m^3, humidity: 50%, albedo: 0.5", "found albedo beside file; expected only one of them"),
    ({"ext": None}, "", "found the variables hum, ntheta, phase, ssa, theta, wavelen; expected those of libRadtran"),
    ({"ssa": np.full((2, 3), 1.2)}, "", "found the single-scattering albedo 1.2; expected 0 to 1"),
    ({"ext": np.full((2, 3), -1.0)}, "", "found an extinction that is not finite, below 0"),
    ({"ntheta": np.full((2, 3, 1), 1, np.int32)}, "", "found 1 angles of a phase function; expected 2 or more"),
    ({"ntheta": np.full((2, 3, 1), 300, np.int32)}, "", "found angles from 0 to"),
    ({"phase": np.full((2, 3, 1, 600), np.nan)}, "", "found a phase function that is not finite, or below 0"),
    ({"phase": np.full((2, 3, 1, 600), 9.0)}, "", "found a phase function whose integral over cos theta is 18; expected 2"),
    ({"wavelen": np.array([0.5, 0.5])}, "", "found values of wavelength that are not finite and distinct"),
    ({"wavelen": np.array([0.7, 0.8])}, ", mass_concentration: 1 g/m^3, humidity: 50%",
     'found the wavelength 0.6 um, for which "own.cdf" has no data; expected 0.7 to 0.8 um')])
def test_wrong_files(again, tmp_path, changes, more, words):
    path = libradtran(tmp_path / "own.cdf", hum=[0, 50, 80], **changes)
    asset, status, err = again(path, more, "[0.6]")
    assert status == 2 and asset is None and "Traceback" not in err and all(part in err for part in words.split("; ")), err


def test_strings_of_variable_length_are_refused(again, tmp_path):
    """HDF5 loops for ever in a damaged heap of them."""
    import h5py

    path = libradtran(tmp_path / "own.cdf", hum=[0, 50], classic=False)
    with h5py.File(path, "a") as file:
        file["ext"].attrs["units"] = "km^-1/(g/m^3)"
    assert 'found the units of "ext" as a string of variable length' in again(path)[2]


def test_keys_of_a_file_stand_beside_one(again, tmp_path, call):
    (tmp_path / "no.yaml").write_text("bakery: 1\nname: no\nmedium: {albedo: 0.5, mean_free_path: 1 mm, humidity: 50%}\n")
    err = call(tmp_path / "no.yaml")[2]
    assert "found humidity without file" in err and "medium.phase: missing; expected phase: phase function" in err
    (tmp_path / "text.nc").write_text("no netcdf")
    assert 'found no NetCDF file in "text.nc"; expected NetCDF 3 or 4' in again(tmp_path / "text.nc")[2]
    assert "there is no such file" in again(tmp_path / "none.nc")[2]


@pytest.mark.parametrize("classic", [True, False])
def test_damaged_files_end_in_a_message(again, tmp_path, classic):
    """Cut at 20 places, and with bytes changed in 60 ways: an asset or one message."""
    from bakery.grammar import optical_files
    from bakery.grammar.units import Wrong

    data = libradtran(tmp_path / "own.cdf", hum=[0, 50], classic=classic).read_bytes()
    draw = np.random.default_rng(5)
    cases = [data[:int(at)] for at in np.linspace(0, len(data) - 1, 20)]
    for _ in range(60):
        changed = bytearray(data)
        for at in draw.integers(0, min(len(data), 1500), draw.integers(1, 5)):
            changed[at] = draw.integers(0, 256)
        cases.append(bytes(changed))
    refused = 0
    for case in cases:
        try:
            optical_files.read(case)
        except Wrong as wrong:
            refused += 1
            assert wrong.found.startswith("found") and wrong.expected
    assert refused >= 20


def test_a_delta_is_no_part_of_the_files(export):
    """Unscattered transmission of grains is taken out; errors of the peak are not told as those of the rest."""
    tree = small_asset()
    share = Dataset(np.array([0.2, 0.2]), "1", "forward_delta")
    (path,) = export(with_member(tree, "medium/forward_delta", share), "netcdf")
    with netcdf_file(path, mmap=False) as file:
        assert "phase_function_error" not in file.variables
        sigma_s, sigma_a = tree["medium/sigma_s"].data, tree["medium/sigma_a"].data
        np.testing.assert_allclose(file.variables["extinction_coefficient"].data, 0.8 * sigma_s + sigma_a, rtol=1e-12)
