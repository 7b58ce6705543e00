"""Stage `beam`: kernels that an asset gives, against moments, brute force and each other."""

import numpy as np
import pytest

import bakery
from bakery.errors import RecipeError, StageError
from bakery.physics.beam import kernels, named, photons
from bakery.recipe import load
from bakery.stages.beam import stage as beam
from bakery.stages.conform import broken
from bakery.store.tree import Dataset, Group
from tests.oracles import beam as oracle

RECIPE = """\
bakery: 1
name: ray
wavelengths: [0.45, 0.55, 0.65]
tolerance: 5%
medium:
  albedo: [0.9, 0.5, 0]
  mean_free_path: 1 mm
  phase: {phase}
beam: {options}
"""


@pytest.fixture(scope="module")
def asset(tmp_path_factory):
    folder = tmp_path_factory.mktemp("beam")
    (folder / "ray.yaml").write_text(RECIPE.format(phase="{type: gaussian, spread: 15 deg}", options="{depth: 8}"))
    return bakery.open(bakery.bake(folder / "ray.yaml", output=folder / "ray.h5"))


@pytest.mark.slow
def test_kernels(asset):
    """A narrow lobe: all models are near each other, and the power is that of all scattered light, e^-tau_a (1 - e^-tau_s).

    Transport knows besides that slanted ways are longer: it loses some more where the medium absorbs.
    """
    r = np.geomspace(1e-4, 60, 4000)
    for depth in (0.5, 2.0):
        expected = np.exp(-np.array([0.1, 0.5]) * depth) * -np.expm1(-np.array([0.9, 0.5]) * depth)
        for measure, off in (("small_angle", 0.01), ("erf", 0.01), ("flux", 0.08)):
            kernel = asset.beam.kernel(depth, r, measure)
            power = np.trapezoid(2 * np.pi * r * kernel, r, axis=1)
            assert power[:2] == pytest.approx(expected, rel=off), (measure, depth)
            assert (kernel[2] == 0).all()
    assert asset.beam.kernel(1.0, 0.3).shape == (3,) and asset.beam.kernel([[1.0], [2.0]], [0.1, 0.2]).shape == (3, 2, 2)
    every, forward = asset.beam.kernel(1.0, r), asset.beam.kernel(1.0, r, "forward")
    assert (every >= forward * (1 - 1e-6) - 1e-9 * every.max()).all()
    assert asset.beam.m0[:2, -1] == pytest.approx(np.exp(-np.array([0.1, 0.5]) * 8) * -np.expm1(-np.array([0.9, 0.5]) * 8))


def test_error_is_told_by_photons(asset):
    assert asset.beam.attributes["achieved_error"] <= 0.06 and (asset.beam.fluence_rms[:2] < 0.03).all()
    assert (asset.beam.fluence_noise[:2] > 0).all() and asset.beam.choices["model"][int(asset.beam.model[0])] == "transport"


def test_the_stored_errors_cover_the_true_ones(asset):
    """Photons of another seed.  Their noise is 0.6 %, the stored error and noise some 3 %; seeded, so no false alarms later."""
    medium, planes, edges = asset.medium, 0.5 * np.arange(1, 11), np.linspace(0, 5, 51)
    for k, albedo in enumerate((0.9, 0.5)):
        row = medium["phase"][k]
        table = beam.tables_of(asset.tree["beam"], "fluence")[k]
        counted = oracle.count(albedo, medium["theta"], row, planes, edges, 100_000, seed=99)
        true = photons.rms(table.rings(planes, edges), counted, "fluence")[0]
        assert true < asset.beam.fluence_rms[k] + asset.beam.fluence_noise[k] <= asset.beam.attributes["achieved_error"]
        wrong = photons.rms(1.08 * table.rings(planes, edges), counted, "fluence")[0]
        assert wrong > asset.beam.attributes["achieved_error"]


def test_every_kernel_by_its_name(asset):
    depth, r = np.array([[0.0], [1e-8], [1.0], [8.0]]), np.geomspace(1e-6, 20, 7) * np.ones((4, 1))
    for name in named.KERNELS:
        value = asset.beam.kernel(depth, r, measure=name)
        assert value.shape == (3, 4, 7)
        assert np.isfinite(value).all(), name
        assert (value >= 0).all(), name
        assert (value[:, 0] == 0).all(), name
        assert (value[2] == 0).all(), name
        assert (value[:2, 2:, 0] > 0).all(), name
        assert (np.isinf(asset.beam.kernel(1.0, 0.0, name)[:2]) != (name in ("path_integral", "elek"))).all()
    once, every = (asset.beam.kernel(depth[2:], np.geomspace(0.01, 20, 9), name) for name in ("single", "fluence"))
    assert (once <= 1.01 * every).all()
    less, more = (asset.beam.kernel(1.0, np.geomspace(1e-3, 2, 50), name) for name in ("small_angle_absorbing", "small_angle"))
    assert (less[0] < more[0]).all()


def test_closed_forms_have_the_stored_constants_and_moments(asset):
    z, r = asset.beam.depth, np.array([0.01, 0.5, 3.0])
    alpha, beta = (asset.beam[name][:2, :, None] for name in ("alpha", "beta"))
    assert asset.beam.kernel(z[:, None], r, "erf")[:2] == pytest.approx(kernels.erf_kernel(alpha, beta, r), rel=1e-9)
    at = np.geomspace(1e-4, 40, 4000)
    for name in ("erf", "path_integral", "elek"):
        power = np.trapezoid(2 * np.pi * at * asset.beam.kernel(z[-1], at, name), at, axis=1)
        assert power == pytest.approx(asset.beam.m0[:, -1], rel=2e-3, abs=1e-12), name


def test_layers(asset):
    r = np.geomspace(0.01, 5, 6).reshape(2, 3)
    for name in named.LAYERED:
        layered = asset.beam.layered([0.5, 1.5, 1.0], [1, 1, 1], r, name)
        assert layered.shape == (3, 2, 3)
        alike = asset.beam.kernel(3.0, r, name)
        if name != "single":  # which has no light that comes back from behind the plane
            assert np.abs(r * (layered - alike))[:2].max() < 1e-3 * (r * alike)[:2].max(), name
        # twice the density on half of the way is the same in other units, emptiness before the medium changes nothing
        dense = asset.beam.layered([0.25, 0.75, 0.5], [2, 2, 2], r / 2, name)
        assert dense == pytest.approx(4 * layered, rel=2e-3, abs=1e-9), name
        assert asset.beam.layered([7.0, 3.0], [0, 1], r, name) == pytest.approx(layered, rel=2e-3, abs=1e-9), name
        assert (asset.beam.layered([3.0], [0.0], r, name) == 0).all()
    near, far = (asset.beam.layered([1, 1], density, 0.05)[0] for density in ((0.5, 2), (2, 0.5)))
    assert near > 1.5 * far  # what is scattered shortly before the plane is hardly spread


@pytest.mark.parametrize(("thickness", "density", "r", "measure", "said"), [
    ([1, 1], [1], 1.0, "forward", "one thickness and one density each"), ([1, -1], [1, 1], 1.0, "flux", "thickness above 0"),
    ([1], [np.nan], 1.0, "flux", "both finite"), ([3], [3], 1.0, "flux", "lie between 0 and 8.*beam.depth"),
    ([1], [1], 0.0, "forward", "above 0"), ([1], [1], 1.0, "fluence", "forward, flux, single, small_angle and erf are there")])
def test_what_layers_cannot_be(asset, thickness, density, r, measure, said):
    with pytest.raises(ValueError, match=said):
        asset.beam.layered(thickness, density, r, measure)


def test_what_is_not_there(asset):
    for name in named.KERNELS:
        for depth, r in ((9.0, 1.0), (-1.0, 1.0), (np.nan, 1.0), (1.0, -1.0), (1.0, np.nan)):
            with pytest.raises(ValueError, match="lie between 0 and 8 mean free paths.*beam.depth|distance from the axis"):
                asset.beam.kernel(depth, r, name)
    with pytest.raises(ValueError, match="fluence, forward, flux, single, small_angle, .* path_integral and elek are there"):
        asset.beam.kernel(1.0, 1.0, "best")
    with pytest.raises(AttributeError, match="holds no 'kernel'"):
        asset.medium.kernel(1.0, 1.0)


def test_advice_that_helps(tmp_path):
    """A larger tolerance where there is one, more photons where theirs is the error, and neither for a narrow backward peak."""
    for error, noise, advice in ((0.14, 0.02, "a larger beam.tolerance would do"), (0.1, 0.2, "or more beam.photons would do")):
        assert advice in beam._missed(np.array([0.01, error]), np.array([0.01, noise]))
    path = tmp_path / "ray.yaml"
    path.write_text(RECIPE.format(phase="{type: hg, g: -0.9999}", options="{depth: 8, photons: 20000, tolerance: 50%}"))
    with pytest.raises(StageError, match="narrow backward peak, and a phase function without one would do") as missed:
        bakery.bake(path, output=tmp_path / "ray.h5")
    assert "larger" not in str(missed.value) and "more" not in str(missed.value)


def test_rules_and_measures(asset):
    group = asset.tree["beam"]
    assert not list(beam.check(group)) and beam.measures(group, group)["error"] == 0
    wrong = {name: Dataset(-member.data, member.units, member.description) if name == "fluence" else member
             for name, member in group.members.items()}
    assert any(fault.startswith("beam/fluence: holds") for fault in broken(beam.STAGE, Group(wrong)))


def test_bad_recipe(tmp_path):
    path = tmp_path / "ray.yaml"
    path.write_text(RECIPE.format(phase="{type: isotropic}", options="{depth: 0}"))
    with pytest.raises(RecipeError, match="ray.yaml:9: beam.depth"):
        load(path)
    path.write_text("bakery: 1\nname: t\npacking: {fraction: 0.3}\nbeam: {depth: 3}\n")
    with pytest.raises(RecipeError, match="beam without anything that scatters"):
        load(path)
