"""Light samples of lamps through rough boundaries in the loop of Dr.Jit: a white room, and paths without them.

Comparisons with chance go wrong once in 1e7 seeds; seeds are fixed.
"""

from __future__ import annotations

import numpy as np
import pytest

from renderers.transport import passes, rough, samples
from renderers.transport.guides import _blurred
from renderers.transport.regions import Box, Everywhere
from renderers.transport.scene import Scene
from tests.odds import ODDS
from tests.physics import test_transport as loops
from tests.physics import test_transport_media as regions
from tests.physics.particles import blocks, same
from tests.physics.test_aggregate import bumpy
from tests.physics.test_translucent import BALL, BOUNDARIES, FLOOR, PANEL, SKY, shape
from tests.physics.test_transport import POINT, asset
from tests.physics.test_transport_lamps import CUBE, FORWARD, GREY, LAMP, as_by_chance, walls, white, without

FROST, GLASS = 1.5, 1.4  # indices of `BOUNDARIES`: roughness 0.15, and smooth
SUN = '<emitter type="directional"><vector name="direction" x="-0.3" y="0.4" z="-0.8"/>' \
    '<rgb name="irradiance" value="5"/></emitter>'


@pytest.fixture
def every(monkeypatch):
    """Lights are looked for however wide they are."""
    monkeypatch.setattr(samples, "_CONTRAST", 0.0)


def of_roughness(monkeypatch, alpha):
    monkeypatch.setitem(loops.bodies.BOUNDARIES, FROST, BOUNDARIES[FROST].replace("0.15", str(alpha)))


@pytest.mark.parametrize("counted, space", [(True, (3.0, 8)), (True, (0.3, 1)), pytest.param(False, (3.0, 8),
                                                                                          marks=pytest.mark.slow)])
def test_a_white_room_of_lamps(tmp_path, every, monkeypatch, counted, space):
    """What loses no light is 1, also where lanes have no room for records; not so if light by chance counts in full as well.

    Of roughness 0.02, as light that a rough boundary reflects twice is lost: less than 0.001 there.
    """
    of_roughness(monkeypatch, 0.02)
    monkeypatch.setattr(rough, "SPACE", space)
    if not counted:
        monkeypatch.setattr(rough.Rough, "meets", lambda self, path, light: light)
    how = loops.transport(tmp_path, {"ball": (BALL, asset(1.0, 0.5, (0.9, 0.7, 1.1)))}, walls(), [FROST], size=8)
    assert Scene(how.world, how.bodies, how.colours).lamps.rough
    assert white(how, 0.008) == counted


def test_where_lights_are_looked_for(tmp_path):
    """Through rough boundaries in lights that come from few directions, and not where none is rough."""
    for around, index, looks in ((LAMP, FROST, True), (POINT, FROST, True), (SKY, FROST, False), ("", FROST, False),
                                 (LAMP, 1.0, False), (LAMP, GLASS, False)):
        how = loops.transport(tmp_path, {"ball": (BALL, GREY)}, around, [index])
        lamps = Scene(how.world, how.bodies, how.colours).lamps
        assert bool(lamps and lamps.rough) == looks, (around, index)


def test_blur_keeps_light():
    """Light moves to neighbours along each axis, and around along the last one; none is lost."""
    light = np.zeros((3, 4, 5, 6, 8))
    light[1, 1, 1, 1, 7] = 1.0
    moved = _blurred(light, 0.1)
    assert moved.sum() == pytest.approx(1) and moved[1, 1, 1, 1, 0] == pytest.approx(0.8**4 * 0.1) and (moved > 0).sum() == 3**5


def test_light_of_lamps_is_theirs(tmp_path):
    """Layers of lights add up to the picture."""
    how = loops.transport(tmp_path, {"ball": (BALL, GREY)}, LAMP + POINT, [FROST], size=8)
    layers = passes.part("paths", how.world, how.bodies, how.colours, 0, by_light=True).render(0)
    lights = [layers[f"light.{name}"] for name in how.world.light_names]
    assert np.allclose(sum(lights), layers[""], rtol=1e-4) and all(light.mean() > 0.001 for light in lights)


def test_lamps_are_not_noisy(tmp_path, monkeypatch):
    """Variance is less than a tenth of that of paths that find the lamp by chance.  `benchmarks/lamps.py` finds 0.01."""
    def variance():
        how = loops.transport(tmp_path, {"ball": (BALL, GREY)}, LAMP, [FROST])
        return np.var(loops.passes(how, range(8), "orders"), axis=0, ddof=1).mean()

    drawn = variance()
    without(monkeypatch)
    assert drawn < 0.1 * variance()


@pytest.mark.slow
@pytest.mark.parametrize("meshes, indices, around", [
    ({"ball": (BALL, GREY)}, [FROST], PANEL + FLOOR),
    ({"bumpy": (bumpy(5.0), FORWARD)}, [FROST], PANEL + SKY),
    ({"cube": (CUBE, GREY)}, [FROST], POINT + SUN + FLOOR),
    ({"outer": (BALL, GREY), "inner": ((0.5 * BALL[0], BALL[1]), asset(0.9, 0.0))}, [FROST, 1.0], PANEL + FLOOR),
    ({"outer": ((1.3 * BALL[0], BALL[1]), asset(0.9, 0.0, (5.0, 5.0, 5.0))), "inner": (BALL, GREY)}, [FROST, FROST],
     PANEL + FLOOR),
    ({"rough": (loops.box((-4, -2, -2), (0, 2, 2)), GREY), "smooth": (loops.box((1, -2, -2), (4, 2, 2)), GREY)}, [FROST, GLASS],
     PANEL + FLOOR),
    ({"ball": (BALL, asset([0.0, 1.0, 0.5], 0.0, (1e-2, 1e3, 1e9)))}, [FROST], PANEL + FLOOR),
], ids=["ball", "bumpy", "points", "matched-in", "rough-in", "beside-smooth", "extremes"])
def test_as_paths_that_find_lamps_by_chance(tmp_path, every, monkeypatch, meshes, indices, around):
    """By blocks of the picture and orders."""
    as_by_chance(tmp_path, monkeypatch, meshes, around, indices)


@pytest.mark.slow
@pytest.mark.parametrize("region", [Everywhere(), Box((-7, -7, -4), (7, 7, 7))], ids=["everywhere", "box"])
def test_bodies_in_fog(tmp_path, every, monkeypatch, region):
    """The same of a rough ball that stands in fog, by orders."""
    ball = regions.body("ball", BALL, FROST, [0.95, 0.9, 0.8], 0.0, (1.0, 1.2, 1.5))
    entries = [regions.medium(region, *regions.FOG), ball]
    around = regions.sensor() + PANEL + FLOOR + shape(tmp_path, "ball", BALL, BOUNDARIES[FROST])
    layers = ("order0", "order1", "order2", "orders")
    drawn = [regions.pictures(tmp_path, around, entries, range(12), layer) for layer in layers]
    without(monkeypatch)
    by_chance = [regions.pictures(tmp_path, around, entries, range(12, 36), layer) for layer in layers]
    for layer, *both in zip(layers, drawn, by_chance):
        assert same(*(blocks(pictures, (2, 2)) for pictures in both)) > ODDS, layer
