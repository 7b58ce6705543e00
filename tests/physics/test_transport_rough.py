"""Light samples of lamps through rough boundaries in the loop of Dr.Jit: a white room, and paths without them.

Comparisons with chance go wrong once in 1e7 seeds; seeds are fixed.
"""

import numpy as np
import pytest

from renderers.mitsuba.world import World
from renderers.transport import passes, rough, samples
from renderers.transport.guides import _blurred
from renderers.transport.regions import Box, Everywhere
from renderers.transport.scene import Scene
from tests.conftest import slow
from tests.odds import ODDS, sigmas
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
    monkeypatch.setattr(samples, "_CONTRAST_OF_ROUGH", 0.0)


def of_roughness(monkeypatch, alpha):
    monkeypatch.setitem(loops.bodies.BOUNDARIES, FROST, BOUNDARIES[FROST].replace("0.15", str(alpha)))


@pytest.mark.slow
@pytest.mark.parametrize("counted, space", [slow(True, (3.0, 8)), (True, (0.3, 1)), slow(False, (3.0, 8))])
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
    assert white(how, 0.008 if counted else 0.012) == counted


@pytest.mark.slow
def test_where_lights_are_looked_for(tmp_path):
    """Through rough boundaries in lights that come from few directions, and not where none is rough."""
    for around, index, looks in ((POINT, FROST, True), (SKY, FROST, False), (LAMP, GLASS, False)):
        how = loops.transport(tmp_path, {"ball": (BALL, GREY)}, around, [index])
        lamps = Scene(how.world, how.bodies, how.colours).lamps
        assert bool(lamps and lamps.rough) == looks, (around, index)


def test_blur_keeps_light():
    """Light moves to neighbours along each axis, and around along the last one; none is lost."""
    light = np.zeros((3, 4, 5, 6, 8))
    light[1, 1, 1, 1, 7] = 1.0
    moved = _blurred(light, 0.1)
    assert moved.sum() == pytest.approx(1) and moved[1, 1, 1, 1, 0] == pytest.approx(0.8**4 * 0.1) and (moved > 0).sum() == 3**5


@pytest.mark.slow
def test_light_of_lamps_is_theirs(tmp_path):
    """Layers of lights add up to the picture."""
    how = loops.transport(tmp_path, {"ball": (BALL, GREY)}, LAMP + POINT, [FROST], size=8)
    layers = passes.part("paths", how.world, how.bodies, how.colours, 0, by_light=True).render(0)
    lights = [layers[f"light.{name}"] for name in how.world.light_names]
    assert np.allclose(sum(lights), layers[""], rtol=1e-4) and all(light.mean() > 0.001 for light in lights)


@pytest.mark.slow
def test_lamps_are_not_noisy(tmp_path, monkeypatch):
    """Variance is less than a tenth of that of paths that find the lamp by chance.  `benchmarks/lamps.py` finds 0.01; of few
    passes that is uncertain, and lanes of small pictures have less room for records."""
    def variance():
        how = loops.transport(tmp_path, {"ball": (BALL, GREY)}, LAMP, [FROST], size=32)
        return np.var(loops.passes(how, range(4), "orders"), axis=0, ddof=1).mean()

    drawn = variance()
    without(monkeypatch)
    assert drawn < 0.1 * variance()


@pytest.mark.slow
@pytest.mark.parametrize("meshes, indices, around", [
    ({"bumpy": (bumpy(5.0), FORWARD)}, [FROST], PANEL + SKY),
    ({"cube": (CUBE, asset([0.0, 1.0, 0.5], 0.0, (1e-2, 1.0, 1e9)))}, [FROST], POINT + SUN + PANEL),
    ({"outer": (BALL, GREY), "inner": ((0.5 * BALL[0], BALL[1]), asset(0.9, 0.0))}, [FROST, 1.0], PANEL + FLOOR),
    ({"rough": (loops.box((-4, -2, -2), (0, 2, 2)), GREY), "smooth": (loops.box((1, -2, -2), (4, 2, 2)), GREY)}, [FROST, GLASS],
     PANEL + FLOOR),
], ids=["bumpy", "points-extremes", "matched-in", "beside-smooth"])
def test_as_paths_that_find_lamps_by_chance(tmp_path, every, monkeypatch, meshes, indices, around):
    """By blocks of the picture and orders."""
    as_by_chance(tmp_path, monkeypatch, meshes, around, indices)


@pytest.mark.slow
def test_a_sun_over_fog_that_reaches_further_than_surfaces(tmp_path):
    """Scattered once in a rough ball of 5 cm: black fog of 1 / 4 m, in a box 8 m wide, leaves exp(-1.04) of it on 4 m to the
    ball and 0.16 m to the eye; exp(-0.05) if only what is near surfaces counts."""
    ball, sun = (BALL[0] * 0.01, BALL[1]), SUN.replace('"-0.3" y="0.4" z="-0.8"', '"0" y="0" z="-1"')
    around = regions.sensor("0, -0.2, 0", size=8) + sun + shape(tmp_path, "ball", ball, BOUNDARIES[FROST])
    grains = regions.body("ball", ball, FROST, [0.9] * 3, 0.0, (0.02,) * 3)

    def pictures(middle):
        box = Box(np.full(3, middle - 4.0), np.full(3, middle + 4.0))
        return regions.pictures(tmp_path, around, [regions.medium(box, 0.0, 0.0, (4.0,) * 3), grains], range(32), "order1")

    clear, dimmed = (rendered.mean(axis=(1, 2, 3)) for rendered in (pictures(90.0), pictures(0.0)))
    error = np.hypot(*(rendered.std(ddof=1) / rendered.mean() / 32**0.5 for rendered in (clear, dimmed)))
    assert error < 0.08 and abs(np.log(dimmed.mean() / clear.mean()) + 1.04) < 0.02 + sigmas(32) * error


@pytest.mark.slow
def test_a_body_in_fog(tmp_path, every, monkeypatch):
    """The same of a rough ball that stands in fog everywhere and in a box of it."""
    entries = [regions.medium(Everywhere(), *regions.FOG), regions.medium(Box((-7, -7, -4), (7, 7, 7)), *regions.FOG),
               regions.body("ball", BALL, FROST, [0.95, 0.9, 0.8], 0.0, (1.0, 1.2, 1.5))]
    around = regions.sensor(size=8) + PANEL + FLOOR + shape(tmp_path, "ball", BALL, BOUNDARIES[FROST])
    (tmp_path / "scene.xml").write_text(f'<scene version="3.0.0">{around}</scene>')

    def pictures(numbers):
        part = passes.part("paths", World(tmp_path / "scene.xml"), entries, regions.RGB, 0)
        return [part.render(number) for number in numbers]

    drawn = pictures(range(16))
    without(monkeypatch)
    by_chance = pictures(range(16, 56))
    for layer in ("order0", "order1", "order2", "orders"):
        assert same(*(blocks(np.array([each[layer] for each in images]), (2, 2)) for images in (drawn, by_chance))) > ODDS, layer
