"""Environments with a small bright part, a sun, through smooth boundaries: white skies, and paths that meet them by chance.

Comparisons with chance go wrong once in 1e7 seeds; seeds are fixed.
"""

import numpy as np
import pytest

import renderers.mitsuba  # noqa: F401  before Dr.Jit: it finds LLVM
from renderers.transport import solid_angles
from renderers.transport.scene import Scene
from renderers.transport.skies import Sky
from tests.physics import test_transport as loops
from tests.physics.test_translucent import BALL, FLOOR, SKY, shape
from tests.physics.test_transport_lamps import FORWARD, GREY, as_by_chance, coarse, every, white  # noqa: F401
from tests.physics.test_transport_panes import IN_GLASS, SHELL, WALL

import drjit as dr  # isort: skip  behind renderers.mitsuba, which finds LLVM
import mitsuba as mi  # isort: skip  behind renderers.mitsuba, which finds LLVM

# of sun and sky as Mitsuba has them, the sun so many degrees wide; it stands above the camera
SUNSKY = ('<emitter type="sunsky"><vector name="sun_direction" value="-0.5, -0.4, 0.7"/><float name="sun_aperture" value="{}"/>'
          '<float name="sun_scale" value="0.05"/></emitter>')
WHITE = '<emitter type="constant"><rgb name="radiance" value="1"/></emitter>'


def sunny(tmp_path, sun, side):
    """An environment with a sun, `side` pixels of 128 wide."""
    picture = np.full((64, 128, 3), 0.3, np.float32)
    picture[8:8 + side, 30:30 + side] = sun
    mi.Bitmap(picture).write(str(tmp_path / "sky.exr"))
    return (f'<emitter type="envmap"><string name="filename" value="{tmp_path / "sky.exr"}"/>'
            '<transform name="to_world"><rotate x="1" angle="90"/></transform></emitter>')


def lamps_of(how):
    return Scene(how.world, how.bodies, how.colours).lamps


@pytest.mark.slow
def test_which_environments_are_drawn(tmp_path, coarse):  # noqa: F811
    """One with a sun; not one that shines evenly."""
    loops.transport(tmp_path, {"ball": (BALL, GREY)}, SKY, [1.4])  # sets the variant
    sun = loops.transport(tmp_path, {"ball": (BALL, GREY)}, sunny(tmp_path, 200.0, 3), [1.4])
    even = loops.transport(tmp_path, {"ball": (BALL, GREY)}, SKY, [1.4])
    assert isinstance(lamps_of(sun).small._sky, Sky) and lamps_of(even) is None


@pytest.mark.slow
def test_the_sun_through_panes(tmp_path, coarse, monkeypatch):  # noqa: F811
    """Walks begin with the index of the body over that around the sun, which is air; else 16 of 100 end, and half have to."""
    loops.transport(tmp_path, {"ball": (BALL, GREY)}, SKY, [1.4])  # sets the variant
    monkeypatch.setitem(loops.bodies.BOUNDARIES, 1.4, IN_GLASS)
    how = loops.transport(tmp_path, {"ball": (BALL, GREY)}, SUNSKY.format(0.5358) + shape(tmp_path, "shell", SHELL, WALL), [1.4])
    scene = Scene(how.world, how.bodies, how.colours)
    ball, shell = (next(mesh for mesh in how.world.scene.shapes() if mesh.id() == name) for name in ("ball", "shell"))
    assert solid_angles.index_around(scene, ball, [shell], [Sky(scene)]) == pytest.approx(1.5, rel=1e-6)
    assert scene.lamps.small._sky and scene.lamps.small.success() > 0.6


def test_the_rim_of_the_sun(tmp_path, coarse):  # noqa: F811
    """What a point of the sky stands for is as often drawn as it is bright, also at the rim."""
    how = loops.transport(tmp_path, {"ball": (BALL, GREY)}, SUNSKY.format(0.5358), [1.4])
    sky, random = Sky(Scene(how.world, how.bodies, how.colours)), mi.PCG32(1 << 16)
    x = mi.Point3f(*(8 * random.next_float32() - 4 for _ in range(3)))
    drawn = dr.normalize(sky.drawn(x, mi.Point2f(random.next_float32(), random.next_float32()), True) - x)
    y = sky.reached(x, drawn)
    bright, dense = (np.array(values) for values in (dr.mean(sky.radiance(dr.normalize(y - x), True)), sky.solid_density(x, y)))
    of_sun = bright > 0.5 * bright.max()
    assert np.array_equal(of_sun, dense > 0.5 * dense.max()) and 0.02 < np.mean(of_sun) < 0.9


@pytest.mark.parametrize("in_glass", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_white_sky(tmp_path, every, coarse, monkeypatch, in_glass):  # noqa: F811
    """What loses no light is 1."""
    around = WHITE
    if in_glass:
        monkeypatch.setitem(loops.bodies.BOUNDARIES, 1.4, IN_GLASS)
        around += shape(tmp_path, "shell", SHELL, WALL)
    how = loops.transport(tmp_path, {"ball": (BALL, loops.asset(1.0, 0.5, (0.9, 0.7, 1.1)))}, around, [1.4], size=8)
    assert lamps_of(how).small._sky
    assert white(how, 0.007)


@pytest.mark.slow
@pytest.mark.parametrize("in_glass, body, sunsky", [(False, FORWARD, False), (True, GREY, False), (True, GREY, True)])
def test_as_paths_that_meet_the_sky_by_chance(tmp_path, every, monkeypatch, in_glass, body, sunsky):  # noqa: F811
    """By blocks of the picture and orders, beside a floor; a sun of `sunsky` so wide that chance finds it, too."""
    loops.transport(tmp_path, {"ball": (BALL, GREY)}, SKY, [1.4])  # sets the variant
    around = (SUNSKY.format(40) if sunsky else sunny(tmp_path, 10.0, 16)) + FLOOR
    if in_glass:
        monkeypatch.setitem(loops.bodies.BOUNDARIES, 1.4, IN_GLASS)
        around += shape(tmp_path, "shell", SHELL, WALL)
    as_by_chance(tmp_path, monkeypatch, {"ball": (BALL, body)}, around, [1.4])
