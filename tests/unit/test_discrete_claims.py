"""Scenes of separate particles that ship, and the graininess that docs/discrete-claims.md tells of."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.figures_discrete import stand
from renderers import scene
from tests.conftest import ROOT


@pytest.mark.parametrize("number, size", [(3e4, 8), (1e6, 8), (1e6, 1)])
def test_graininess_is_that_of_counts(number, size):
    """Poisson counts under a slope: 1/sqrt(mean count) to 6 standard errors of the scatter of correlated differences."""
    y, x = np.mgrid[0:64, 0:64] / 64
    counts = np.random.default_rng(1).poisson(number / 64**2 * (0.75 + 0.5 * x), (64, 64)).astype(float)
    blocks = (64 / size) ** 2
    assert stand.graininess(counts, size) == pytest.approx(np.sqrt(blocks / number), rel=6 * 1.5 / np.sqrt(2 * blocks))


@pytest.mark.parametrize("path", [path for path in sorted((ROOT / "assets" / "scenes").glob("*.yaml"))
                                  if path.read_text().count("where:") == path.read_text().count("where: {box") > 0],
                         ids=lambda path: path.stem)
def test_shipped_scenes_are_well_formed(path):
    found = scene.load(path)
    assert found.section == "discrete" and found.values.name == path.stem
    assert found.file(found.values.materials[0].recipe).is_file()
    assert f"pictures/{path.stem}.png" in (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
