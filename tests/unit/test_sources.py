"""What an asset's tables answer by coordinates, in space and along lines of sight, in the medium's mean free paths."""

import numpy as np
import pytest

import bakery
from bakery.stages.members import MissingStage

RECIPE = """\
bakery: 1
name: cloud
wavelengths: [0.45, 0.65]
tolerance: 10%
medium:
  albedo: [0.9, 0.6]
  mean_free_path: [1, 2] mm
  phase: {type: hg, g: 0.75}
multiple_scattering: {extent: 6, orders: 12, sources: SOURCES}
"""


@pytest.fixture(scope="module")
def bake(tmp_path_factory):
    def run(sources):
        folder = tmp_path_factory.mktemp("sources")
        (folder / "cloud.yaml").write_text(RECIPE.replace("SOURCES", sources))
        return bakery.open(bakery.bake(folder / "cloud.yaml", output=folder / "cloud.h5")).multiple

    return run


@pytest.fixture(scope="module")
def light(bake):
    found = bake("[point, segment]")
    assert (found.extinction < 0.98).all()  # a peak was left out: the tables' mean free paths are longer than the medium's
    return found


TURN = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]  # any orientation in space
RHO, Z, THETA, PHI = 0.7, 0.4, 1.1, 0.6
ORIGIN = np.array([3.0, -1.0, 2.0])
OUT = TURN @ [np.sin(THETA) * np.cos(PHI), np.sin(THETA) * np.sin(PHI), np.cos(THETA)]
TARGET = ORIGIN + TURN @ [RHO, 0, Z]
AHEAD = TURN @ [0.0, 0.0, 1.0]


def test_in_space_it_is_what_the_coordinates_say(light):
    assert light.point_to_point(ORIGIN, AHEAD, TARGET, OUT) == pytest.approx(light.point(RHO, Z, THETA, PHI), rel=1e-9)
    assert light.segment_to_point(ORIGIN, AHEAD, 0.5, TARGET, OUT) == pytest.approx(
        light.segment(RHO, Z, THETA, PHI, length=0.5), rel=1e-9)


def test_a_line_of_sight_is_the_weakened_integral(light):
    """Light is weakened as the tables' events say: by the extinction without the peak."""
    eye, view = ORIGIN + TURN @ [2.0, 0.3, -1.0], TURN @ [-0.8, 0.0, 0.6]
    t = np.linspace(0, 3, 1201)
    at = eye + t[:, None] * view
    weak = np.exp(-light.extinction[:, None] * t)
    for seen, there in ((light.point_to_segment(ORIGIN, AHEAD, eye, view, 3.0), light.point_to_point(ORIGIN, AHEAD, at, -view)),
                        (light.segment_to_segment(ORIGIN, AHEAD, 1.5, eye, view, 3.0),
                         light.segment_to_point(ORIGIN, AHEAD, 1.5, at, -view))):
        assert seen.shape == (2,) and seen == pytest.approx(np.trapezoid(there * weak, t, axis=1), rel=2e-3)


def test_a_source_that_was_not_baked_is_named(bake):
    found = bake("[point]")
    with pytest.raises(MissingStage, match="no segment source"):
        found.segment_to_point(ORIGIN, AHEAD, 0.5, TARGET, OUT)
    assert found.phase(0.1).shape == (2,)
