"""Clouds between the members of a family: against bakes of their own."""

import numpy as np
import pytest

import bakery
from bakery.family.tree import optics_of
from bakery.physics.medium.between import difference, interpolated, tabulated

CLOUDS = """\
bakery: 1
name: clouds
wavelengths: [0.55]
tolerance: 1%
measure: integrated
particles:
  volume_fraction: 2e-7
  components:
    - name: droplets
      material: water
      size: {distribution: gamma, radius: 8 um, variance: 0.1}
"""
RADIUS, VARIANCE = (f"particles.components[0].size.{name}" for name in ("radius", "variance"))


@pytest.fixture
def baked(tmp_path):
    """The figures of a cloud from a bake of its own."""
    def bake(radius, variance=0.1):
        asset = bakery.bake(tmp_path / "clouds.yaml", tmp_path / "one.h5",
                            settings={RADIUS: f"{radius} m", VARIANCE: str(variance)})
        return optics_of(asset.tree["medium"])

    (tmp_path / "clouds.yaml").write_text(CLOUDS)
    return bake


@pytest.mark.slow
def test_clouds_by_radius(baked, tmp_path):
    """40 radii between the members are within the tolerance; a grid uniform in radius with twice the members is not."""
    family = bakery.bake(tmp_path / "clouds.yaml", tmp_path / "clouds.h5",
                         settings={f"sweep.{RADIUS}": "[2, 32] um", "sweep.tolerance": "2%"})
    count = len(family.members)
    assert count <= 12 and family.method == "cubic" and family.achieved_error <= 0.02
    found = [difference(optics_of(family.at(radius=radius).tree["medium"]), baked(radius), True)
             for radius in np.exp(np.random.default_rng(3).uniform(np.log(2e-6), np.log(32e-6), 40))]
    assert 0.003 < max(found) < 0.02
    nodes = np.linspace(2e-6, 32e-6, 2 * count)
    uniform = tabulated([np.log(nodes)], [baked(radius) for radius in nodes])
    middle = np.sqrt(nodes[0] * nodes[1])
    assert difference(interpolated(uniform, [np.log(middle)], "cubic"), baked(middle), True) > 0.02


@pytest.mark.slow
def test_clouds_by_radius_and_variance(baked, tmp_path):
    family = bakery.bake(tmp_path / "clouds.yaml", tmp_path / "clouds.h5",
                         settings={f"sweep.{RADIUS}": "[4, 20] um", f"sweep.{VARIANCE}": "[0.05, 0.2]", "sweep.tolerance": "3%"})
    rng = np.random.default_rng(5)
    found = [difference(optics_of(family.at(radius=radius, variance=variance).tree["medium"]), baked(radius, variance), True)
             for radius, variance in zip(np.exp(rng.uniform(np.log(4e-6), np.log(20e-6), 30)), rng.uniform(0.05, 0.2, 30),
                                         strict=True)]
    assert 0.003 < max(found) < 0.03
