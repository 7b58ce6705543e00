"""Stage `beam`: kernels that an asset gives, against moments, brute force and each other."""

from __future__ import annotations

import numpy as np
import pytest

import bakery
from bakery.errors import RecipeError
from bakery.recipe import load
from bakery.stages import beam
from bakery.store.tree import Dataset, Group

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


def test_what_is_not_there(asset):
    with pytest.raises(ValueError, match="lie between"):
        asset.beam.kernel(9.0, 1.0)
    with pytest.raises(ValueError, match="fluence, forward, flux, small_angle and erf"):
        asset.beam.kernel(1.0, 1.0, "best")
    with pytest.raises(AttributeError, match="holds no 'kernel'"):
        asset.medium.kernel(1.0, 1.0)


def test_rules_and_measures(asset):
    group = asset.tree["beam"]
    assert not list(beam.check(group)) and beam.measures(group, group)["error"] == 0
    wrong = {name: Dataset(-member.data, member.units, member.description) if name == "fluence" else member
             for name, member in group.members.items()}
    assert "fluence below 0" in list(beam.check(Group(wrong)))


def test_bad_recipe(tmp_path):
    path = tmp_path / "ray.yaml"
    path.write_text(RECIPE.format(phase="{type: isotropic}", options="{depth: 0}"))
    with pytest.raises(RecipeError, match="ray.yaml:9: beam.depth"):
        load(path)
    path.write_text("bakery: 1\nname: t\npacking: {fraction: 0.3}\nbeam: {depth: 3}\n")
    with pytest.raises(RecipeError, match="beam without anything that scatters"):
        load(path)
