"""Assets as xarray's labelled arrays: what those hold, and that the way back gives the same asset."""

import sys
import warnings

import numpy as np
import pytest

import bakery
from bakery.asset import compare
from bakery.errors import AssetError, UsageError
from bakery.store.hashes import root_hash
from bakery.store.write import write
from tests.samples import small_asset

GRAINS = """bakery: 1
name: grains
wavelengths: [0.55, 0.45]
tolerance: 10%
grains:
  radius: 0.5 mm
  components:
    - {name: glass, shape: {type: sphere}, surface: {type: dielectric, material: {n: 1.5}}}
packing: {fraction: 0.3, count: 20}
"""


@pytest.fixture(scope="module")
def xarray():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what it imports
        return pytest.importorskip("xarray", reason="xarray is not installed: pip install '.[xarray]'")


@pytest.fixture(scope="module")
def fog(tmp_path_factory):
    path = tmp_path_factory.mktemp("labelled") / "fog.h5"
    write(path, small_asset())
    return bakery.open(path)


def same(a, b):
    return root_hash(a.tree) == root_hash(b.tree) and compare.compare(a.tree, b.tree) == []


def test_a_group_has_names_units_and_errors(xarray, fog):
    medium = fog.medium.to_xarray()
    assert medium.sigma_t.dims == ("wavelength",) and medium.phase.dims == ("wavelength", "theta")
    assert medium.sigma_t.attrs["units"] == "1/m" and medium.sigma_t.attrs["long_name"] == "extinction coefficient"
    assert medium.phase.attrs["ancillary_variables"] == "phase_bias"
    assert medium.phase.attrs["largest_error"] == fog.medium["phase_bias"].max()
    assert medium.wavelength.attrs["standard_name"] == "radiation_wavelength" and medium.wavelength.attrs["units"] == "um"
    assert medium.theta.attrs["standard_name"] == "scattering_angle"
    assert medium.attrs["Conventions"] == "CF-1.11" and medium.attrs["achieved_error"] == 0.004
    assert float(medium.phase.sel(wavelength=0.465, theta=0.0)) == fog.medium["phase"][1, 0]
    drops = fog.optics["droplets"].to_xarray()
    assert drops.extinction.dims == ("wavelength", "radius") and drops.phase.dims == ("wavelength", "theta")
    assert drops.method.attrs["flag_meanings"] == "rayleigh mie goa" and drops.method.attrs["flag_values"].tolist() == [0, 1, 2]


def test_assets_come_back(xarray, fog, tmp_path):
    again = bakery.from_xarray(fog.to_xarray())
    assert same(again, fog) and again.recipe == fog.recipe and np.array_equal(again.medium.phase(1.0), fog.medium.phase(1.0))
    stored = bakery.from_xarray(fog.to_xarray(), tmp_path / "again.h5")
    assert same(bakery.open(stored), fog)
    with pytest.raises(UsageError, match="not an asset"):
        (tmp_path / "other.h5").write_text("somebody's")
        bakery.from_xarray(fog.to_xarray(), tmp_path / "other.h5")


def test_netcdf_holds_all_of_it(xarray, fog, tmp_path):
    pytest.importorskip("h5netcdf", reason="h5netcdf is not installed: pip install '.[xarray]'")
    fog.to_xarray().to_netcdf(tmp_path / "fog.nc", engine="h5netcdf")
    with xarray.open_datatree(tmp_path / "fog.nc", engine="h5netcdf") as arrays:
        assert same(bakery.from_xarray(arrays), fog)


def test_a_dataset_gives_its_arrays(xarray, fog):
    medium = fog.medium.to_xarray()
    medium["sigma_t"] = medium.sigma_t * 2
    medium["new"] = ("wavelength", [1.0, 2.0], {"units": "K", "long_name": "temperature"})
    members = bakery.from_xarray(medium)
    assert np.array_equal(members.new, [1, 2]) and members.units["new"] == "K" and "wavelength" not in members
    assert np.array_equal(members.phase(0.5), fog.medium.phase(0.5)) and members.attributes["tolerance"] == 0.01
    with pytest.raises(UsageError, match="expected the tree of a whole asset"):
        bakery.from_xarray(medium, "a.h5")


def test_trees_that_are_no_assets_are_refused(xarray, fog):
    arrays = fog.to_xarray()
    arrays["medium"] = arrays["medium"].to_dataset(inherit=False).drop_vars("phase")
    with pytest.raises(AssetError, match="medium"):
        bakery.from_xarray(arrays)
    with pytest.raises(AssetError, match="holds no recipe"):
        bakery.from_xarray(xarray.DataTree())


def test_media_between_wavelengths_have_labels_too(xarray, fog):
    medium = fog.medium.at([0.5, 0.6]).to_xarray()
    assert medium.wavelength.values.tolist() == [0.5, 0.6] and medium.g.dims == ("wavelength",)


@pytest.mark.slow
@pytest.mark.parametrize("recipe", ["grains", "family", "multiple", "surface", "discrete"])
def test_every_group_has_labels(xarray, recipe, tmp_path):
    """Of every stage: each group alone, and the whole there and back."""
    milk = {"bakery": 1, "name": "milk", "wavelengths": [0.55, 0.45], "tolerance": "10%",
            "medium": {"sigma_s": "1 /mm", "sigma_a": "[0.1, 0.2] /mm", "phase": {"type": "hg", "g": 0.5}}}
    particles = {"bakery": 1, "name": "drops", "wavelengths": [0.55, 0.45], "tolerance": "10%", "particles": {
        "number_density": "1e6 /m^3", "components": [{"name": "drops", "material": "water", "size": {
            "distribution": "lognormal", "radius": "5 um", "sigma": 1.2}}]}, "discrete": {"box": ["2 cm", "2 cm", "2 cm"]}}
    recipes = {"grains": GRAINS, "family": milk | {"sweep": {"medium.phase.g": [0.1, 0.5]}}, "discrete": particles,
               "multiple": milk | {"multiple_scattering": {}, "beam": {}},
               "surface": milk | {"surface": {"thickness": "[1, 5] mm"}}}
    asset = bakery.bake(recipes[recipe], tmp_path / "asset.h5")
    arrays = asset.to_xarray()
    assert same(bakery.from_xarray(arrays), asset)
    for name, group in asset.tree.members.items():
        if hasattr(group, "members"):
            assert set(arrays[name].children) == {key for key, member in group.members.items() if hasattr(member, "members")}
    for name in asset.stages:
        labels = getattr(asset, name).to_xarray()
        assert len(labels.variables) >= sum(not hasattr(member, "members") for member in asset.tree[name].members.values())


def test_without_xarray_it_says_what_to_do(fog, monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    for labels in (fog.to_xarray, fog.medium.to_xarray):
        with pytest.raises(UsageError, match=r'xarray: .* get it by: pip install "\.\[xarray\]"'):
            labels()
