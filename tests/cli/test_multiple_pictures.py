"""`bake plot` of multiple scattering: what is drawn is what the tables hold."""

import csv
import json

import numpy as np
import pytest
from matplotlib.figure import Figure

from bakery.cli import status_of
from bakery.draw.picture import drawn
from bakery.physics.multiple import choice, point
from bakery.report.figures import title_of
from bakery.stages.multiple import pictures as multiple
from bakery.store.read import read

RECIPE = """\
bakery: 1
name: cloud
wavelengths: {wavelengths}
tolerance: 3%
medium: {{albedo: {albedo}, mean_free_path: 1 mm, phase: {phase}}}
multiple_scattering: {options}
"""
ISOTROPIC = "{type: isotropic}"


@pytest.fixture(scope="module")
def bake(tmp_path_factory):
    def baked(name, albedo, options, wavelengths="[0.55]", phase=ISOTROPIC):
        folder = tmp_path_factory.mktemp(name)
        recipe = RECIPE.format(albedo=albedo, options=options, wavelengths=wavelengths, phase=phase)
        (folder / "cloud.yaml").write_text(recipe)
        status = status_of([str(folder / "cloud.yaml"), "-o", str(folder / "cloud.h5"), "--quiet"])
        assert status in (0, 3)  # 3: less good than asked for
        return folder / "cloud.h5"
    return baked


@pytest.fixture(scope="module")
def cloud(bake):
    return bake("three", "[0.6, 0.8, 0]", "{extent: 8}", "[0.45, 0.55, 0.65]", "{type: hg, g: 0.4}")


@pytest.fixture(scope="module")
def found(cloud):
    return {picture.name: picture for picture in multiple.pictures(read(cloud))}


def columns(picture):
    return {name: np.asarray(values) for name, values in picture.columns}


@pytest.mark.slow
def test_the_plane_shows_the_light(found, cloud):
    """Colour is the solver's integral over directions; the picture is that of 0.55 um, as at 0.65 um nothing is scattered."""
    medium, data = read(cloud)["medium"], columns(found["multiple_point"])
    solved = choice.solved(choice.Medium(0.8, medium["theta"].data, medium["phase"].data[1], 0.0), None).solution
    some = np.random.default_rng(3).integers(0, data["z [mfp]"].size // 2, 60)  # of the first panel
    z, rho, value = (data[name][some] for name in ("z [mfp]", "rho [mfp]", "integral over directions [mfp^-3]"))
    exact = point.integral(solved.medium, np.hypot(rho, z), np.arctan2(rho, z))
    assert np.abs(value / exact - 1).max() < 0.02  # table 0.9 %, the rough sum over directions 1 %
    assert np.allclose(data["over the singular part [mfp^-2]"][some], value * np.hypot(rho, z))
    assert data["z [mfp]"].min() < 0 < data["z [mfp]"].max()


def test_both_kinds_at_the_middle_wavelength(found):
    assert list(found) == ["multiple_point", "multiple_segment", "multiple_errors"]


def test_the_errors_are_those_of_the_bake(found, cloud):
    data, root = dict(found["multiple_errors"].columns), read(cloud)
    assert data["source"] == ["point"] * 2 + ["segment"] * 2 and data["wavelength [um]"].tolist() == [0.45, 0.55] * 2
    for name in ("error", "error_with_solver", "error_worst"):
        stored = [100 * root[f"multiple/{kind}/w{k}/{name}"].data[0] for kind in ("point", "segment") for k in (0, 1)]
        assert data[f"{name} [%]"].tolist() == stored


@pytest.mark.slow
def test_each_picture_with_its_data(call, bake, tmp_path):
    """Only a segment; of three wavelengths the middle one, by the wavelength and not by the place in the list; twice the same."""
    path = bake("others", 0.3, "{extent: 3, sources: [segment]}", "[0.7, 0.42, 0.55]")
    status, out, err = call("plot", path, "-o", tmp_path, "--json")
    assert status == 0, err
    made = {picture["name"]: picture for picture in json.loads(out) if picture["name"].startswith("multiple")}
    assert list(made) == ["multiple_segment", "multiple_errors"]
    for name in made:
        assert (tmp_path / f"cloud_{name}.svg").stat().st_size < 3e6
        with open(tmp_path / f"cloud_{name}.csv", newline="") as file:
            head, *rows = csv.reader(file)
        numbers = np.array([[cell for cell in row if cell != "segment"] for row in rows], float)
        assert len(rows) >= 3 and np.isfinite(numbers).all() and len(head) >= 3
    again = next(multiple.pictures(read(path)))
    assert drawn(again, ("png",), title_of(read(path)))["png"] == (tmp_path / f"cloud_{again.name}.png").read_bytes()
    figure = Figure()
    again.draw(figure)
    assert "0.55 µm" in figure.get_suptitle()


def test_nothing_scattered_nothing_drawn(call, bake, tmp_path):
    path = bake("dark", 0, "{extent: 3}")
    status, out, err = call("plot", path, "-o", tmp_path)
    assert status == 0 and "multiple" not in out, err
