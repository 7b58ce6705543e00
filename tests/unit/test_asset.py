"""`bakery.open`: what a user of an asset sees."""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

import bakery
from bakery.asset.verify import verify
from bakery.physics.medium.phase import areas, mean_cosine
from bakery.stages.coordinates import standard_error, stated_error
from bakery.store.read import read
from bakery.store.tree import Dataset, Group
from bakery.store.write import write
from tests.samples import small_asset, with_member


@pytest.fixture(scope="module")
def asset(tmp_path_factory):
    path = tmp_path_factory.mktemp("asset") / "fog.h5"
    root = with_member(small_asset(), "foreign", Group({
        "centers": Dataset(np.zeros((2, 3)), "1", "centres"),
        "fraction": Dataset(np.array([0.6]), "1", "share"), "fraction_error": Dataset(np.array([0.01]), "1", "its error"),
        "pair_correlation": Group({"r": Dataset(np.ones(4), "1", "distance")})}, {"stage": "foreign"}))
    write(path, root)
    return bakery.open(path)


def test_what_the_interface_promises(asset):
    root = small_asset()
    assert asset.name == "fog" and asset.recipe.startswith("bakery: 1\n") and len(asset.content_hash) == 64
    assert asset.wavelength.tolist() == [0.61, 0.465]
    for name in ("sigma_t", "sigma_s", "sigma_a", "albedo", "g", "theta", "cdf"):
        assert np.array_equal(getattr(asset.medium, name), root[f"medium/{name}"].data)
    drops = asset.optics["droplets"]
    assert np.array_equal(drops.radius, root["optics/droplets/radius"].data)
    assert np.array_equal(drops.error["scattering"], root["optics/droplets/scattering_error"].data)
    assert np.array_equal(drops.bias["phase"], root["optics/droplets/phase_bias"].data) and "phase" not in drops.error
    assert drops.choices["method"][drops.method[0, 0]] == "mie"
    assert drops.units["extinction"] == "um^2" and drops.description["radius"] == "radii of the quadrature"
    assert asset.optics["droplets/radius"] is drops.radius
    assert asset.stages["medium"]["achieved_error"] == 0.004 and list(asset.stages) == ["optics", "medium", "foreign"]
    assert asset.provenance.attributes["command"] == "bake fog.yaml" and asset.provenance["optics"].notes == "none"
    assert asset.foreign.centers.shape == (2, 3) and asset.foreign.pair_correlation.r.shape == (4,)


def test_standard_error_and_bias_together_are_the_stated_error():
    root = small_asset()
    sigma_t = root["medium/sigma_t"]
    assert stated_error(root, "medium/sigma_t") is None
    root = with_member(root, "medium/sigma_t_error", replace(sigma_t, data=0.03 * sigma_t.data))
    assert stated_error(root, "medium/sigma_t") == pytest.approx(0.03 * sigma_t.data)
    root = with_member(root, "medium/sigma_t_bias", replace(sigma_t, data=0.04 * sigma_t.data))
    assert stated_error(root, "medium/sigma_t") == pytest.approx(0.05 * sigma_t.data)
    assert np.array_equal(standard_error(root, "medium/sigma_t"), 0.03 * sigma_t.data)


@pytest.mark.usefixtures("verified_here")
def test_assets_of_the_first_version_open(tmp_path):
    """There the estimated errors of particles are called like standard errors."""
    root = small_asset()
    for path in ("medium/phase", "optics/droplets/phase", "optics/droplets/mean_absorption"):
        root = with_member(with_member(root, f"{path}_error", root[f"{path}_bias"]), f"{path}_bias", None)
    write(tmp_path / "old.h5", root)
    medium = bakery.open(tmp_path / "old.h5").medium
    assert not verify(tmp_path / "old.h5")
    assert np.array_equal(medium.error["phase"], small_asset()["medium/phase_bias"].data)


def test_one_number_passes_for_a_number(asset):
    fraction = asset.foreign.fraction
    assert fraction.shape == (1,) and fraction[0] == 0.6 and float(fraction) == 0.6 and f"{fraction:.2f}" == "0.60"
    assert float(2 * fraction) == 1.2 and float(asset.foreign.error["fraction"]) == 0.01 and np.isclose(fraction, 0.6)
    with pytest.raises(ValueError, match="read-only"):
        fraction[0] = 0.5


def test_phase_is_the_interpolant_in_the_cosine(asset):
    """Against np.interp over 1 - cos theta where that is exact enough, at the nodes, and as an integral."""
    medium = asset.medium
    table, nodes = medium["phase"], medium.theta
    assert np.array_equal(medium.phase(nodes), table)
    theta = np.random.default_rng(2).uniform(0.1, math.pi, (7, 5))
    value = medium.phase(theta)
    assert value.shape == (2, 7, 5)
    for row in range(2):
        expected = np.interp(1 - np.cos(theta), 1 - np.cos(nodes), table[row])
        assert np.allclose(value[row], expected, rtol=1e-9)  # 1e-9: what cosines leave of cells of 0.01 rad
    assert medium.phase(0.0).shape == (2,)
    cosine = np.cos(np.linspace(0, math.pi, 400_001))
    assert np.allclose(-2 * math.pi * np.trapezoid(medium.phase(np.arccos(cosine)), cosine), 1, rtol=1e-4)
    assert np.array_equal(np.asarray(medium.phase), table) and np.shares_memory(medium.phase.theta, nodes)
    assert asset.optics["droplets"].phase(0.3).shape == (2,)  # on the angles of the medium


def test_a_medium_without_its_forward_delta(asset, tmp_path):
    """What is absorbed and what is deflected stay; the table's first cell has lost its peak."""
    plain = asset.medium.without_delta()
    assert np.array_equal(plain.sigma_t, asset.medium.sigma_t) and np.array_equal(plain.phase.table, asset.medium["phase"])
    theta, table = np.asarray(asset.medium.theta), np.asarray(asset.medium["phase"])
    peaked = 0.7 * table
    peaked[:, 0] += 0.3 / (2 * np.pi * areas(theta)[0])
    root = with_member(small_asset(), "medium/phase", Dataset(peaked, "1/sr", "phase function"))
    write(tmp_path / "peak.h5", with_member(root, "medium/forward_delta", Dataset(np.full(2, 0.3), "1", "delta")))
    medium = bakery.open(tmp_path / "peak.h5").medium
    rest = medium.without_delta()
    sigma_t, sigma_s = np.asarray(medium.sigma_t), np.asarray(medium.sigma_s)
    assert rest.sigma_t * (1 - rest.albedo) == pytest.approx(sigma_t - sigma_s, rel=1e-9)
    assert rest.sigma_t * rest.albedo == pytest.approx(0.7 * sigma_s, rel=1e-12)
    np.testing.assert_allclose(rest.phase.table, table, rtol=1e-6)  # the peak is 1e9 times as high
    deflected = (1 - mean_cosine(theta, peaked)) * sigma_s
    assert (1 - mean_cosine(theta, rest.phase.table)) * rest.albedo * rest.sigma_t == pytest.approx(deflected, rel=1e-5)


@pytest.mark.parametrize("theta", [-1e-9, 3.2, np.nan, [0.1, 4.0]])
def test_angles_that_are_none(asset, theta):
    with pytest.raises(ValueError, match="0 .forward. to pi .backward. would do"):
        asset.medium.phase(theta)


def test_read_only(asset):
    for array in (asset.medium.sigma_t, asset.wavelength, asset.medium.phase.table):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0
    with pytest.raises(TypeError):
        asset.stages["medium"]["tolerance"] = 1


def test_what_is_not_there(asset):
    words = r"no stage 'grains' \(it holds optics, medium, foreign\).*section `grains`.*`bake RECIPE"
    with pytest.raises(bakery.AssetError, match=words):
        _ = asset.grains
    assert not hasattr(asset, "multiple") and getattr(asset, "beam", None) is None and not hasattr(asset, "colour")
    with pytest.raises(AttributeError, match="medium holds no 'sigma'; it holds sigma_t"):
        _ = asset.medium.sigma
    with pytest.raises(KeyError):
        asset.optics["ice"]


def test_repr_says_units_shapes_and_errors(asset):
    said = repr(asset)
    assert "'fog', wavelength 0.61 0.465 um" in said
    assert "medium  error 0.004 of 0.01: sigma_t 0.1" in said and " 1/m, albedo" in said
    # in a few lines, without what the error measures
    assert len(said.splitlines()) == 1 + len(asset.stages)
    assert asset.medium.attributes["error_measure"] not in said + repr(asset.medium)
    assert "sigma_t (2,) 1/m" in repr(asset.medium)
    assert f"(2, {len(asset.medium.theta)}) 1/sr" in repr(asset.medium.phase)
    assert "extinction (2, 60) um^2" in repr(asset.optics["droplets"]) and "+-" in repr(asset.optics["droplets"])
    assert "sigma_t" in dir(asset.medium) and "medium" in dir(asset)


def test_arrays_know_their_units(asset):
    """Slices, copies and pickles keep the unit, arithmetic gives plain arrays: a wrong unit would be worse than none."""
    sigma_t = asset.medium.sigma_t
    assert (sigma_t.units, asset.medium.theta.units, asset.wavelength.units, asset.medium.g.units) == ("1/m", "rad", "um", "1")
    assert asset.optics["droplets/mean_volume"].units == "um^3" and float(asset.optics["droplets/mean_volume"]) > 0
    for kept in (sigma_t[:1], sigma_t.copy(), sigma_t.reshape(2, 1), pickle.loads(pickle.dumps(sigma_t)), np.sort(sigma_t)):
        assert kept.units == "1/m" and repr(kept).endswith(" 1/m")
    for plain in (2 * sigma_t, sigma_t * sigma_t, 1 / sigma_t, np.exp(sigma_t), np.asarray(sigma_t), sigma_t[None].sum(axis=0)):
        assert type(plain) is np.ndarray
    assert isinstance(sigma_t.sum(), float) and isinstance(sigma_t[0], float)
    assert repr(asset.medium.g) == repr(np.asarray(asset.medium.g))
    one = asset.optics["droplets/mean_volume"]
    assert f"{one * 2:.3f}" == f"{2 * one.item():.3f}" and pickle.loads(pickle.dumps(one)).units == "um^3"


def test_tree_is_what_read_gives(asset):
    assert asset.tree.attributes == read(asset.path).attributes
