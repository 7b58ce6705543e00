"""Small lamps in smooth grains as discs: their power, rooms that stay white, and a lamp that is as wide for Mitsuba.

Comparisons with chance go wrong once in 1e7 seeds; seeds are fixed.
"""

import math

import numpy as np
import pytest

from renderers.materials.grains import methods, transport
from renderers.mitsuba.world import World
from renderers.transport import regularised
from tests.odds import ODDS, SIGMAS
from tests.physics.particles import Sky, blocks, camera, same
from tests.physics.test_aggregate import bumpy, tile
from tests.physics.test_granular_render import COLOURS, GLASS, SCENE, STEEL, STONE, Kind, explicit, grains, passes, place

ANGLE = math.radians(12.0)
PASSES, SAMPLES = 12, 256
FAR_AWAY = 2e4  # of a lamp that is a disc at infinity


def how(world, packed, angle=ANGLE, chord=0.0):
    """Paths from grain to grain of one body that show lamps wider."""
    return transport.Transport((transport.Body(place(packed, world), None, 1.0),), COLOURS, angle=angle, chord=chord)


def under(scene, lamp, towards=(4.0, -14.0, 14.0)):
    """A scene of Mitsuba without its floor and lights, under a lamp of irradiance 3: `sun`, in one direction, or a `disc`."""
    x, y, z = np.array(towards) / np.linalg.norm(towards)
    cone = 2 * math.pi * (1 - math.cos(ANGLE))
    light = {"sun": f'''<emitter type="directional"><vector name="direction" x="{-x}" y="{-y}" z="{-z}"/>
                      <rgb name="irradiance" value="3"/></emitter>''',
             "disc": f'''<shape type="disk"><transform name="to_world"><scale value="{FAR_AWAY * math.tan(ANGLE)}"/>
                       <lookat origin="{x * FAR_AWAY}, {y * FAR_AWAY}, {z * FAR_AWAY}" target="0, 0, 0" up="0, 0, 1"/></transform>
                       <emitter type="area"><rgb name="radiance" value="{3 / cone}"/></emitter></shape>'''}[lamp]
    scene = scene.replace('name="fov" value="26"', 'name="fov" value="12"')
    return scene[:scene.index('<shape type="rectangle">')] + light + scene[scene.index('<bsdf type="dielectric" id="glass">'):]


def test_lamps_shrink_with_samples():
    """As n^(-1/6), and by as much as pixels tell: the disc of a lamp in a ball 50 pixels wide is no wider than a pixel."""
    assert regularised.chord(ANGLE, 1) == pytest.approx(2 * math.sin(ANGLE / 2))
    assert regularised.chord(ANGLE, 64) == pytest.approx(regularised.chord(ANGLE, 1) / 2) and regularised.chord(0.0, 5) == 0
    assert regularised.angle_of(0.0) == regularised.MOST and 50 / 4 * regularised.angle_of(50.0) < 1


def test_light_from_everywhere_stays_one():
    """A cone of 60 degrees takes a fifth of an even sky by light samples, and chance brings the rest: smooth grains are white."""
    packed = grains([Kind(GLASS), Kind(STEEL, STONE), Kind(GLASS, STONE)], bumpy(6.0))
    where = transport.Transport((transport.Body(place(packed), None, 1.0),), COLOURS, chord=1.0)
    view = camera((24, 24), (0.0, -40.0, 3.0), (0.0, 0.0, 0.0), 14)
    pictures = passes(Sky(above=1, below=1), where, view, (24, 24), range(16))
    means = pictures.mean(axis=(1, 2, 3))
    error = means.std(ddof=1) / 4
    assert 1e-4 < error < 4e-3 and abs(means.mean() - 1) < SIGMAS * error


@pytest.mark.slow
def test_light_from_everywhere_stays_one_by_shapes(tmp_path, monkeypatch):
    """The same in the loop of Dr.Jit."""
    (tmp_path / "scene.xml").write_text('<scene version="3.0.0"><emitter type="constant"/></scene>')
    view = {"origin": (0.0, -40.0, 3.0), "target": (0.0, 0.0, 0.0), "up": (0.0, 0.0, 1.0), "fov": 14.0}
    world = World(tmp_path / "scene.xml", view=view, size=(24, 24))
    monkeypatch.setattr(regularised, "_SHRINKS", 0.0)
    part = methods.part(world, how(world, grains([Kind(GLASS), Kind(STEEL, STONE)], bumpy(5.0)), 1.0), "ept", 0)
    assert part.samples > 16, "by shapes"
    means = np.array([part.render(number)[""].mean() for number in range(12)])
    error = means.std(ddof=1) / 12**0.5
    assert 1e-5 < error < 1e-3 and abs(means.mean() - 1) < SIGMAS * error


@pytest.mark.slow
def test_a_lamp_without_extent_is_a_disc(tmp_path, monkeypatch):
    """Pixel by pixel: balls of glass in the sun, as Mitsuba sees every one of them under a disc of the same power; by wavefronts
    and by shapes."""
    import mitsuba as mi

    mesh = bumpy(3.0)
    packed = grains([Kind(GLASS)], mesh, tile(0.55, 40))
    assert 10 < explicit(tmp_path, packed, [Kind(GLASS)], ["glass"], mesh) < 100
    (tmp_path / "wide.xml").write_text(under((tmp_path / "explicit.xml").read_text(), "disc"))
    (tmp_path / "scene.xml").write_text(under(SCENE.replace("MORE", ""), "sun"))
    world, size = World(tmp_path / "scene.xml", size=(18, 24)), (18, 24)
    theirs, scene = [], mi.load_file(str(tmp_path / "wide.xml"))
    for seed in range(PASSES):
        theirs.append(np.array(mi.render(scene, seed=seed, spp=2 * SAMPLES))[..., :3])
    theirs = blocks(np.array(theirs), (3, 3))
    monkeypatch.setattr(regularised, "_SHRINKS", 0.0)
    waves = [transport.one_pass(world, how(world, packed, chord=regularised.chord(ANGLE, 1)), world.camera, size, number, 0,
                                samples=SAMPLES).by_order.sum(axis=0).reshape(*size, 3) for number in range(PASSES)]
    part = methods.part(world, how(world, packed), "ept", 0).fewer(SAMPLES)
    for ours in (waves, [part.render(number)[""] for number in range(PASSES)]):
        ours = blocks(np.array(ours), (3, 3))
        assert same(ours, theirs) > ODDS and same(1.25 * ours, theirs) < ODDS


LIGHTS = {"sun": '<emitter type="sunsky"><vector name="sun_direction" value="0.5, -0.6, 0.7"/></emitter>',
          "sky": '<emitter type="constant"/>',
          "window": '<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="180"/><translate z="4"/></transform>'
                    '<emitter type="area"/></shape>',
          "bulb": '<shape type="sphere"><point name="center" x="0" y="0" z="9"/><float name="radius" value="0.1"/>'
                  '<emitter type="area"/></shape>'}


@pytest.mark.parametrize("lights, least, most, noise", [
    (["sun"], 0.5, 0.9, 267), (["sky"], 0.0, 1e-3, 1), (["window"], 0.0, 0.02, 7.3), (["bulb"], 0.7, 1.0, 180),
    (["bulb", "sky"], 0.0, 1e-3, 1), ([], 0.0, 0.0, 0)])
def test_how_much_light_is_of_small_lamps(tmp_path, lights, least, most, noise):
    """Of the sun and its sky most, of a bulb all but what is wider than a degree; of a bulb in a bright room next to nothing.  By
    chance a bulb of 0.1 nine away has a noise of 2 * 9 / 0.1, a window of 0.22 sr of 7.5, a sky of 1."""
    (tmp_path / "scene.xml").write_text('<scene version="3.0.0">' + "".join(LIGHTS[light] for light in lights)
                                        + '<sensor type="perspective"/></scene>')
    world = World(tmp_path / "scene.xml")
    assert least <= world.small_share <= most and world.noise_by_chance == pytest.approx(noise, rel=0.15)
