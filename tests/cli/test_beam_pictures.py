"""`bake plot` of narrow beams: what is drawn is what the asset holds."""

import csv

import numpy as np
import pytest

import bakery
from bakery.cli import status_of
from bakery.draw.files import csv_text
from bakery.draw.picture import drawn
from bakery.report import figures
from bakery.stages.beam import pictures as beam
from bakery.store.read import read

RECIPE = """\
bakery: 1
name: ray
wavelengths: {wavelengths}
tolerance: 5%
medium: {{albedo: {albedo}, mean_free_path: 1 mm, phase: {{type: gaussian, spread: {spread} deg}}}}
beam: {{depth: {depth}, photons: 20000}}
"""
NAMES = ["beam_maps", "beam_sections", "beam_errors"]
TABLES = (("all directions", "fluence"), ("forward, fluence", "forward"), ("forward, flux", "flux"),
          ("small-angle model", "small_angle"))


@pytest.fixture(scope="module")
def bake(tmp_path_factory):
    def baked(albedo="[0.9, 0.5, 0]", wavelengths="[0.45, 0.55, 0.65]", spread=20, depth=6):
        folder = tmp_path_factory.mktemp("ray")
        recipe = RECIPE.format(albedo=albedo, wavelengths=wavelengths, spread=spread, depth=depth)
        (folder / "ray.yaml").write_text(recipe)
        assert status_of([str(folder / "ray.yaml"), "-o", str(folder / "ray.h5"), "--quiet"]) in (0, 3)
        return folder / "ray.h5"
    return baked


@pytest.fixture(scope="module")
def ray(bake):
    return bake()


@pytest.fixture(scope="module")
def found(ray):
    return {picture.name: picture for picture in beam.pictures(read(ray))}


def columns(picture):
    return {name: np.asarray(values) for name, values in picture.columns}


def test_the_maps_show_the_tables(found, ray):
    """At 0.55 um, the middle one of those that scatter: rings in the middle of the map are as wide as they are smooth."""
    asset = bakery.open(ray)
    for name in ("beam_maps", "beam_sections"):
        data = columns(found[name])
        z, r = data["z [mfp]"], data["r [mfp]"]
        assert z.max() == pytest.approx(5) and r.max() == pytest.approx(4.95)
        away = (r > 0.4) & (z > 0.9)
        for label, table in TABLES:
            exact = 2 * np.pi * r * asset.beam.kernel(z, r, table)[1]
            assert np.abs(data[f"{label} [1/mfp]"] - exact)[away].max() < 0.03 * exact[away].max(), label


def test_the_errors_are_those_of_the_bake(found, ray):
    data, group = columns(found["beam_errors"]), read(ray)["beam"]
    assert data["wavelength [um]"].tolist() == [0.45, 0.55]  # at 0.65 um nothing is scattered
    for label, table in TABLES[:3]:
        for word, end in (("error", "rms"), ("noise", "noise")):
            assert data[f"{label} {word} [%]"].tolist() == (100 * group[f"{table}_{end}"].data[:2]).tolist()


def test_each_picture_with_its_data(found, ray):
    """They are among those of the asset, are drawn, come with their numbers, and are the same on every run."""
    again = {picture.name: picture for picture in figures.pictures(read(ray)) if picture.name.startswith("beam")}
    assert list(again) == list(found) == NAMES
    for name in NAMES:
        picture = found[name]
        svg = drawn(picture, ("svg",))["svg"]
        assert 1e4 < len(svg) < 3e5
        head, *rows = csv.reader(csv_text(picture.columns).splitlines())
        assert len(rows) >= 2 and len(head) == len(rows[0]) >= 5
        assert rows == list(csv.reader(csv_text(again[name].columns).splitlines()))[1:]
    assert drawn(again["beam_errors"], ("svg",))["svg"] == svg


def test_too_narrow_for_transport_and_too_thin(bake):
    """Half a degree: rings follow the light."""
    root = read(bake(albedo=0.8, wavelengths="[0.5]", spread=0.2, depth=0.02))
    data = columns(next(beam.pictures(root)))
    assert data["z [mfp]"].max() == pytest.approx(0.02) and data["r [mfp]"].max() < 3e-4


def test_nothing_scattered_nothing_drawn(bake):
    assert not list(beam.pictures(read(bake(albedo=0, wavelengths="[0.5]"))))
