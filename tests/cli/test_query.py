"""`bake query`: baked values, and values looked up at arguments."""

import json
import math

import numpy as np
import pytest

import bakery
from bakery.asset.lookup import lookup
from bakery.physics.medium.phase import phase_at
from bakery.report.page import page
from bakery.store.tree import Dataset, Group
from bakery.store.write import write
from tests.samples import small_asset, with_member


@pytest.fixture(scope="module")
def root():
    return small_asset()


@pytest.fixture(scope="module")
def fog(tmp_path_factory, root):
    path = tmp_path_factory.mktemp("query") / "fog.h5"
    write(path, root)
    return path


@pytest.fixture
def ask(call, fog):
    def run(*args):
        status, out, err = call("query", fog, *args)
        assert status == 0 and not err, err
        return out.splitlines()

    return run


def known(value, error):
    """What is printed of a figure: rounded by half a unit of the second digit after the first one of its error."""
    return pytest.approx(value, rel=0, abs=0.0051 * error)


def test_digits_beyond_the_error_are_not_printed(ask, call, fog, root):
    """Two beyond its first; JSON keeps all.  Figures without an error, and coordinates, have all of theirs."""
    exact = root["medium/sigma_t"].data[0]
    printed = ask("medium/sigma_t", "wavelength=0.61um")[0].split()[0]
    error = 10.0 ** math.floor(math.log10(0.004 * exact))
    assert float(printed) == round(exact, 2 - round(math.log10(error))) != exact
    assert json.loads(call("query", fog, "medium/sigma_t", "--json")[1])["value"][0] == exact
    assert float(ask("medium/theta")[2].split()[1]) == root["medium/theta"].data[1]
    assert float(ask("medium/achieved_error")[0]) == 0.004


def test_a_stored_value_comes_back(ask, root):
    first, *remarks = ask("medium/sigma_t", "wavelength=0.61um")
    value, unit = first.split()
    exact = root["medium/sigma_t"].data[0]
    assert float(value) == known(exact, 0.004 * exact) and unit == "1/m"
    assert remarks == ["# error of the stage 0.004: largest relative change of a coefficient"]
    assert float(ask("medium/g", "wavelength=465 nm")[0]) == known(root["medium/g"].data[1], 0.004)


def test_between_two_wavelengths_it_is_a_power_and_says_so(ask, root):
    first, remark, _ = ask("medium/sigma_s", "wavelength=0.5um")
    low, high = root["medium/sigma_s"].data[::-1]
    exact = low * (high / low) ** (math.log(0.5 / 0.465) / math.log(0.61 / 0.465))
    assert float(first.split()[0]) == known(exact, 0.004 * exact) and "nan" not in first
    assert remark == ("# as a power of the wavelength between 0.465 and 0.61 um; what that is off by is not known of two "
                      "wavelengths")


def test_phase_functions_are_looked_up_as_the_format_says(ask, root):
    theta, phase = root["medium/theta"].data, root["medium/phase"].data
    lines = ask("medium/phase", "theta=10deg")
    assert lines[0].split() == ["wavelength", "[um]", "phase", "[1/sr]", "+-"]
    values = [float(line.split()[1]) for line in lines[1:3]]
    assert values == [known(exact, 1e-3 * exact) for exact in phase_at(theta, phase, math.radians(10))]  # phase_bias
    first = ask("medium/phase", "theta=0.25 rad", "wavelength=0.465")[0]
    exact = float(phase_at(theta, phase[1], 0.25))
    assert float(first.split()[0]) == known(exact, 1e-3 * exact)
    # 0 is forward: were the sign of the cosine wrong, the small value would come first
    forward, backward = (float(ask("medium/phase", f"theta={at} deg", "wavelength=0.61")[0].split()[0]) for at in (0, 180))
    assert forward == known(phase[0, 0], 1e-3 * phase[0, 0]) and forward > 100 * backward


def test_several_arguments_give_a_table(ask, root):
    lines = ask("medium/phase", "theta=[0, 90, 180] deg")
    table = np.array([[float(cell) for cell in line.split()] for line in lines[1:4]])
    exact = phase_at(root["medium/theta"].data, root["medium/phase"].data, table[:, 0])
    assert np.all(abs(table[:, 1::2].T - exact) <= 0.0051e-3 * exact)
    assert np.allclose(table[:, 2::2], 1e-3 * exact.T, rtol=0.0051)  # phase_bias
    assert len(ask("optics/droplets/radius")) == 1 + 60  # coordinates have no error


def test_radii_are_nodes(ask, root):
    radius = root["optics/droplets/radius"].data
    lines = ask("optics/droplets/scattering", f"radius={float(radius[7])!r} um", "wavelength=0.61")
    value, sign, error, unit = lines[0].split()
    exact = root["optics/droplets/scattering"].data[0, 7]
    assert float(value) == known(exact, 1e-4 * exact) and unit == "um^2"
    # its own error stands beside it, so the stage's is not shown
    assert sign == "+-" and float(error) == pytest.approx(1e-4 * float(value), rel=0.05) and lines[1:] == ["# method: mie"]
    lines = ask("optics/droplets/extinction", "radius=5um", "wavelength=0.61")
    nearest = int(np.argmin(abs(radius - 5)))
    exact = root["optics/droplets/extinction"].data[0, nearest]
    assert float(lines[0].split()[0]) == known(exact, 0.004 * exact)
    assert lines[1:3] == [f"# at the nearest node of the size distribution, {radius[nearest]:.8g} um", "# method: mie"]
    assert ask("optics/droplets/method", "radius=5um", "wavelength=0.61")[0] == "mie"


def test_texts_and_attributes(ask, call, fog, root):
    assert "\n".join(ask("recipe")).strip() == bytes(root["recipe"].data).decode().strip()
    assert ask("medium/achieved_error") == ["0.004"] and ask("name") == ["fog"]
    assert json.loads(call("query", fog, "medium/tolerance", "--json")[1]) == {"path": "medium/tolerance", "value": 0.01}


def test_json_says_the_same(call, fog, root):
    found = json.loads(call("query", fog, "medium/phase", "theta=[0, 10] deg", "--json")[1])
    assert found["units"] == "1/sr" and [axis["name"] for axis in found["axes"]] == ["wavelength", "theta"]
    expected = phase_at(root["medium/theta"].data, root["medium/phase"].data, np.radians([0, 10]))
    assert found["value"] == expected.tolist() and found["stage_error"] is None
    assert json.loads(call("query", fog, "medium/g", "--json")[1])["stage_error"] == 0.004
    found = json.loads(call("query", fog, "optics/droplets/scattering", "--json")[1])
    assert found["error"] == root["optics/droplets/scattering_error"].data.tolist() and found["stage_error"] is None


def with_rays(root, switch=(340.0, 340.0), error=(0.006, 0.004)):
    """The sample with rays from those size parameters on, a number a wavelength; infinite: nowhere."""
    x = 2 * np.pi * root["optics/droplets/radius"].data / root["wavelength"].data[:, None]
    method = np.where(x >= np.array(switch)[:, None], 2, 1).astype(np.uint8)
    stored = np.where(np.isfinite(switch), switch, 0.0)
    for name, data in (("switch", stored), ("ray_difference", np.array(error))):
        root = with_member(root, f"optics/droplets/{name}", Dataset(data, "1", name))
    return with_member(root, "optics/droplets/method", Dataset(method, "1", "how", ("rayleigh", "mie", "goa")))


def remarks(root, path, **arguments):
    return tuple(remark.text for remark in lookup(root, path, arguments).remarks)


def test_queries_say_where_rays_took_over(call, root, tmp_path):
    write(tmp_path / "rays.h5", with_rays(root))
    radius = root["optics/droplets/radius"].data
    first = [radius[2 * np.pi * radius / um >= 340].min() for um in (0.61, 0.465)]
    status, out, _ = call("query", tmp_path / "rays.h5", "medium/phase", "theta=10deg", "wavelength=0.61")
    said = f"droplets: Mie below {first[0]:.3g} um (x = 340), rays above; rays differ by 0.6 %"
    assert status == 0 and out.splitlines()[-1] == f"# {said}"
    both = f"droplets: Mie below {first[0]:.3g}, {first[1]:.3g} um (x = 340), rays above; rays differ by up to 0.6 %"
    found = json.loads(call("query", tmp_path / "rays.h5", "medium/phase", "theta=10deg", "--json")[1])
    assert found["remarks"][-1] == both
    assert found["methods"] == [{"component": "droplets", "wavelength_um": um, "radius_um": at, "below": "Mie",
                                 "size_parameter": 340.0, "error": error}
                                for um, at, error in zip((0.61, 0.465), first, (0.006, 0.004), strict=True)]
    # a value between two wavelengths comes from both
    assert call("query", tmp_path / "rays.h5", "medium/g", "wavelength=0.5um")[1].splitlines()[2] == f"# {both}"


def test_what_rays_have_a_part_in(root):
    rays = with_rays(root)
    for path in ("medium/phase", "medium/cdf", "medium/g", "medium/sigma_tr", "optics/droplets/phase"):
        assert "rays above" in remarks(rays, path)[-1], path
        assert not any("rays" in remark for remark in remarks(root, path))
    # cross sections are the series' own, and so are coefficients
    for path in ("medium/sigma_t", "optics/droplets/extinction", "optics/droplets/mean_extinction", "medium/theta", "wavelength"):
        assert not remarks(rays, path), path
    assert remarks(rays, "optics/droplets/extinction", radius=50.0)[-1].startswith("method: goa (amplitudes by rays")
    # between the two boundaries the wavelengths differ
    radius = float(rays["optics/droplets/radius"].data[np.argmax(np.diff(rays["optics/droplets/method"].data, axis=0))])
    assert remarks(rays, "optics/droplets/scattering", radius=radius) == (
        "method: mie, goa (amplitudes by rays, cross sections by the series)",)
    assert remarks(rays, "optics/droplets/scattering", radius=radius, wavelength=0.61) == ("method: mie",)


def test_rays_at_some_wavelengths_everywhere_and_unrecorded(root):
    some = with_rays(root, (np.inf, 340.0))
    assert remarks(some, "medium/g")[-1].startswith("droplets at 0.465 um: Mie below 25.2 um (x = 340), rays above; rays")
    assert not remarks(some, "medium/g", wavelength=0.61)
    everywhere = with_rays(root, (0.5, 0.5))
    assert remarks(everywhere, "medium/g") == ("droplets: rays throughout, from 0.1 um (x = 0.5); rays differ by up to 0.6 %",)
    old = with_rays(root)  # an asset that tells the method of each sphere and no more
    for name in ("switch", "ray_difference"):
        old = with_member(old, f"optics/droplets/{name}", None)
    assert remarks(old, "medium/g") == ("droplets: Mie below 34.9, 25.2 um, rays above",)
    assert not remarks(with_member(root, "optics", None), "medium/g")


@pytest.mark.parametrize(("args", "said"), [
    (("medium/phse",), "did you mean medium/phase?"),
    (("sigma_t",), "did you mean medium/sigma_t?"),
    (("quite_another_thing",), "it holds recipe, wavelength, optics, medium, provenance"),
    (("medium",), "is a group; it holds sigma_t, "),
    (("medium/sigma_t", "theta=10deg"), "theta has no effect on it; wavelength would"),
    (("medium/theta", "wavelength=0.55um"), "wavelength has no effect on it; theta would"),
    (("recipe", "theta=10deg"), "theta has no effect on it"),
    (("name", "theta=10deg"), "theta has no effect on it"),
    (("medium/phase", "tetha=10deg"), "did you mean theta=…?"),
    (("medium/phase", "theta"), "arguments are wavelength=0.55um"),
    (("medium/phase", "theta=10"), "has no unit; angles take deg, rad (10 deg?)"),
    (("medium/phase", "theta=10 um"), "angles take deg, rad"),
    (("medium/phase", "theta=181deg"), "from 0 (forward) to 180 deg"),
    (("medium/phase", "theta=-1deg"), "from 0 (forward) to 180 deg"),
    (("medium/phase", "theta=1deg", "theta=2deg"), "the same argument twice"),
    (("medium/sigma_t", "wavelength=0.7um"), "the asset holds 0.61, 0.465 um and what lies between"),
    (("medium/sigma_t", "wavelength=nan"), 'found "nan"'),
    (("optics/droplets/method", "wavelength=0.5um"), "take one of 0.61, 0.465 um"),
    (("optics/droplets/extinction", "radius=100um"), "the asset holds 0.1 to 60 um"),
])
def test_wrong_questions(call, fog, args, said):
    status, out, err = call("query", fog, *args)
    assert status == 2 and not out and said in err and len(err.splitlines()) == 1, err


@pytest.mark.usefixtures("undrawn")
def test_an_error_of_a_stage_that_misses_stands_beside_every_figure(call, tmp_path, root):
    """Also beside figures that have an error of their own, and where that is 0, as of an exact formula."""
    medium = root["medium"]
    sigma_t = medium["sigma_t"].data
    poor = Group(medium.members | {"sigma_t_error": Dataset(np.zeros_like(sigma_t), "1/m", "standard error of sigma_t")},
                 medium.attributes | {"achieved_error": 0.07})
    path = tmp_path / "poor.h5"
    write(path, Group(root.members | {"medium": poor}, root.attributes))
    mark = "MISSED by stage medium: its error is 0.07, above the tolerance of 0.01"
    for what in ("medium/sigma_t", "medium/g"):
        status, out, _ = call("query", path, what, "wavelength=0.61um")
        assert status == 0 and "+-" not in out and mark in out
    assert mark in call("query", path, "medium/phase", "theta=10deg")[1]
    said = json.loads(call("query", path, "medium/phase", "theta=10deg", "--json")[1])
    assert (said["stage_error"], said["stage_tolerance"]) == (0.07, 0.01) and "above" in said["stage_missed"]
    assert call("inspect", path)[1].count("MISSED") == 2 and repr(bakery.open(path)).count("MISSED") == 1
    stages = {stage["group"]: stage["missed"] for stage in json.loads(call("inspect", path, "--json")[1])["stages"]}
    assert stages["optics"] is None and "above the tolerance" in stages["medium"]
    assert "above the tolerance of 0.01" in page(bakery.open(path).tree)


def test_optical_quantities_in_one_table(ask, call, fog):
    lines = ask("optics", "length=100m", "density=1g/cm^3")
    assert lines[0].split() == ["quantity", "unit", "0.61", "um", "+-", "0.465", "um", "+-"]
    rows = {line.split()[0]: line for line in lines if not line.startswith("#")}
    assert {"extinction", "lidar_ratio", "optical_depth", "angstrom_exponent_extinction", "effective_radius"} <= rows.keys()
    assert any(line.startswith("# depolarisation_ratio_90: needs the matrix element s12") for line in lines)
    told = json.loads(call("query", fog, "optics", "--json")[1])
    depth = told["quantities"]["optical_depth"]
    assert depth["value"] is None and "length=100m" in depth["missing"]
    assert told["intervals"] == [[0.465, 0.61]] and len(told["quantities"]["angstrom_exponent_extinction"]["value"]) == 1


def test_moments_of_a_phase_function(ask, call, fog, root):
    status, _, err = call("query", fog, "medium/moment")
    assert status == 2 and err.endswith('found no "medium/moment"; did you mean medium/moments?\n')
    lines = ask("medium/moments", "orders=2")
    assert [line.split()[0] for line in lines[1:4]] == ["0", "1", "2"] and lines[-1].startswith("# orders 0 to 2; ")
    assert float(lines[2].split()[1]) == pytest.approx(root["medium/g"].data[0], rel=1e-2)
