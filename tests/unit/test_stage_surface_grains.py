"""Stage `surface` of packed grains: what is baked, looked up, exported and refused."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

import bakery
from bakery.errors import RecipeError
from bakery.kernels import surface_transmittance
from bakery.physics.granular.goniometer import BINS, LEAST
from bakery.physics.surfaces.corrected import middles
from bakery.recipe import load
from bakery.stages import conform
from bakery.stages.members import MissingStage
from bakery.stages.surface import grains
from bakery.stages.surface.files import csv_tables
from bakery.stages.surface.view import BETWEEN_CELLS
from bakery.store.tree import Dataset, Group

RECIPE = """\
bakery: 1
name: heap
wavelengths: [0.45, 0.65]
tolerance: 10%
grains:
  radius: 0.5 mm
  components:
    - name: bead
      weight: 0.7
      shape: {type: sphere}
      surface: {type: dielectric, material: {n: 1.5}}
      interior: {absorption: "[0.2, 2] 1/mm"}
    - {name: cube, weight: 0.3, shape: {type: box, size: [1, 1, 1]}, surface: {type: diffuse, reflectance: [0.9, 0.5]}}
scatterometer: {triangles: 300}
packing: {fraction: 0.5, count: 100}
effective_medium: {sigma_t: mean_flight, walks: 10000}
surface: {options}
"""
THETA = np.radians([0.0, 20.0, 50.0, 75.0, 89.9])


@pytest.fixture(scope="module")
def bake(tmp_path_factory):
    folder = tmp_path_factory.mktemp("heap")

    def bake(name, options):
        (folder / "heap.yaml").write_text(RECIPE.replace("{options}", options))
        return bakery.open(bakery.bake(folder / "heap.yaml", output=folder / f"{name}.h5"))

    return bake


@pytest.fixture(scope="module")
def heap(bake):
    return bake("heap", "{}")


@pytest.mark.slow
def test_what_is_offered_is_that_of_plane_layers(heap):
    surface = heap.surface
    assert surface.reflectance(THETA[:, None], THETA, 1.0).shape == (2, 5, 5) and surface.albedo(THETA).shape == (2, 5)
    assert np.shape(surface.spherical_albedo) == (2, 1) and (surface.transmittance(0.1, 0.2, 0.3) == 0).all()
    np.testing.assert_allclose(surface.reflectance(THETA[:, None], THETA, 0.7), surface.reflectance(THETA, THETA[:, None], 0.7))
    orders = surface.by_order(THETA[:, None], THETA, 0.7)
    assert orders.shape == (3, 2, 5, 5) and (orders >= 0).all()
    np.testing.assert_allclose(orders.sum(axis=0), surface.reflectance(THETA[:, None], THETA, 0.7))
    answer = heap.query("surface/reflected", theta_in="30 deg", theta_out="[0, 60] deg", phi="180 deg")
    np.testing.assert_array_equal(answer.values, surface.reflectance(np.radians(30), np.radians([0, 60]), math.pi))
    relative = answer.error / answer.values
    np.testing.assert_allclose(relative, surface.relative_error(np.radians(30), np.radians([0, 60]), math.pi))
    assert relative.shape == (2, 2) and (relative > BETWEEN_CELLS).all() and (relative < 1).all()
    straight_back = surface.relative_error(*np.full((2, 1), 0.5), math.pi)[0, 0]  # at the middle of a cell its own noise
    assert straight_back > surface.relative_error(0.5, 0.9, 1.5)[0]


@pytest.mark.slow
def test_lobes_add_up_to_albedos(heap):
    """Within the tolerance, at normal incidence, too, which lies beyond the middles of all bins."""
    x, weight = np.polynomial.legendre.leggauss(40)
    mu, phi = (0.5 * (1 + x)) ** 2, math.pi * (np.arange(40) + 0.5) / 40
    for theta in THETA[:4]:
        lobe = heap.surface.reflectance(theta, np.arccos(mu)[:, None], phi)
        np.testing.assert_allclose(lobe.mean(axis=-1) @ (2 * mu * 0.5 * (1 + x) * weight), heap.surface.albedo(theta), rtol=0.03)


@pytest.mark.slow
def test_errors_are_those_asked_for(heap):
    group = heap.tree["surface"]
    assert group.attributes["achieved_error"] <= 0.1 and group["noise"].data.shape == (2, 12, 8, 8)
    assert not list(grains.check(group))
    files, told = csv_tables(heap.tree)
    assert set(files) == {"surface_reflected.csv", "surface_albedo.csv"} and "surface/reflected" in told


@pytest.mark.slow
def test_a_part_that_is_missing_is_told(heap):
    group = heap.tree["surface"]
    without = Group({name: member for name, member in group.members.items() if name != "scale"}, dict(group.attributes))
    assert conform.broken(grains.OF_GRAINS, without) == ["surface/scale: missing beside first"]
    more = Dataset(group["order_albedo"].data + 0.5, "1", "more")
    assert list(grains.check(Group({**group.members, "order_albedo": more}, dict(group.attributes))))


@pytest.mark.slow
def test_what_is_told_to_be_a_medium_is_one(bake):
    flat = bake("flat", "{method: medium, tolerance: 5%}")
    assert "first" not in flat.surface
    with pytest.raises(MissingStage, match="kept apart"):
        flat.surface.by_order(0.1, 0.2)


@pytest.mark.slow
def test_layers_of_a_thickness(bake):
    """Thinner than a grain, of several grains, and of none: values, orders, tables and files of each side."""
    layer = bake("layer", '{thickness: "[0, 0.3, 2] mm", tolerance: 20%}')
    surface, group = layer.surface, layer.tree["surface"]
    assert not list(grains.check(group)) and group["layers/noise"].data.shape == (2, 3, 2, 12, 8, 8)
    below = surface.transmittance(THETA[:, None], THETA, 0.7)
    assert below.shape == (2, 3, 5, 5) and (below[:, 0] == 0).all() and (below[:, 1:] > 0).all()
    np.testing.assert_allclose(below, np.swapaxes(below, 2, 3))
    np.testing.assert_allclose(surface.by_order(THETA[:, None], THETA, 0.7, below=True).sum(axis=0), below)
    albedo, passed = surface.albedo(THETA), np.asarray(surface["passed"])
    assert (albedo[:, 0] == 0).all() and (passed[:, 0] == 1).all()
    assert (np.diff(passed, axis=1) < 0).all() and (np.diff(surface["spherical_albedo"], axis=1) > 0).all()
    table, errors = surface.table(2)
    assert table.free and errors.mean_square < 0.3
    at = np.array([0.3, 0.6, 0.9]), np.array([0.8, 0.5, 0.4]), np.array([0.5, -0.5, 0.9])
    exact = surface.transmittance(np.arccos(at[1]), np.arccos(at[0]), np.arccos(at[2]))[:, 2]
    values = [[surface_transmittance(table, wave, *pair) for pair in zip(*at, strict=True)] for wave in (0, 1)]
    np.testing.assert_allclose(values, exact, rtol=0.05)
    files, told = csv_tables(layer.tree)
    assert "surface_transmitted.csv" in files and "surface/transmitted" in told
    with pytest.raises(RecipeError, match="layer of grains of a thickness over air"):
        bake("covered", "{thickness: 1 mm, base: {asset: layer.h5, layer: 2}}")
    without = Group({**group.members, "layers": Group({name: member for name, member in group["layers"].members.items()
                                                       if name != "straight"}, {})}, dict(group.attributes))
    assert any("two" in fault for fault in grains.sound(without))


@pytest.mark.slow
def test_layers_on_a_base(bake):
    """A white plane is seen between grains, and none is looked up from below it."""
    surface = bake("based", '{thickness: "[0, 1] mm", base: {albedo: [0, 100%]}, tolerance: 20%}').surface
    assert "transmitted" not in surface and (surface.transmittance(0.1, 0.2, 0.3) == 0).all()
    albedo = surface.spherical_albedo
    np.testing.assert_allclose(albedo[:, 0], [0, 1], atol=1e-9)
    assert 0 < albedo[0, 1] < 0.4 and 0.1 < albedo[1, 1] < 1
    with pytest.raises(MissingStage, match="no light leaves below"):
        surface.by_order(0.1, 0.2, below=True)


def test_wavelengths_share_walks_where_indices_do():
    index = np.array([1.52, 1.5201, 1.53, 1.52])
    parts = [{"type": "dielectric", "index": index + 0j}, {"type": "diffuse", "index": None}]
    assert grains.alike(parts, 4, 0.001) == [[0, 1, 3], [2]]
    near = [{"type": "dielectric", "index": index - 0.5 + 0j}]  # what is reflected changes by much more
    assert grains.alike(near, 4, 0.001) == [[0, 3], [1], [2]]
    assert grains.alike(parts[1:], 4, 0.001) == [[0, 1, 2, 3]]
    assert max(map(len, grains.alike(parts[1:], 40, 0.001))) == 16


@pytest.mark.parametrize("text, says", [
    (RECIPE.replace("{options}", "{method: grains, thickness: 1 mm, base: {recipe: soil.yaml}}"), "on another asset or recipe"),
    (RECIPE.replace("{options}", "{method: grains, boundary: {index: 1.3}}"), "under a boundary"),
    ("bakery: 1\nname: a\nwavelengths: [0.5]\nmedium: {albedo: 1, mean_free_path: 1 mm, phase: {type: isotropic}}\n"
     "surface: {method: grains}\n", "of which this recipe has none"),
])
def test_recipes_that_are_refused(tmp_path, text, says):
    (tmp_path / "heap.yaml").write_text(text)
    with pytest.raises(RecipeError, match=says):
        load(tmp_path / "heap.yaml")


def test_noise_of_bins_is_not_carried_on_to_the_normal():
    """Beyond the middle of the last bin the share is the medium's: a polynomial was 10 % off by bins that scatter by 4 %."""
    air = np.linspace(0.002, 1, 60)
    medium = 0.3 + 0.2 * (1 - air)
    at, random = middles(BINS, LEAST), np.random.default_rng(5)
    bins = np.interp(at**2, air, medium)
    noisy = [SimpleNamespace(albedo=(bins * (1 + 0.04 * random.normal(size=BINS)))[None]) for _ in range(200)]
    assert np.std([grains._smoothed(each, air, medium)[-1] / medium[-1] for each in noisy]) < 0.05
    # elsewhere it is the polynomial
    exact = grains._smoothed(SimpleNamespace(albedo=bins[None]), air, 2 * medium)
    np.testing.assert_allclose(exact, medium, rtol=1e-3)
