"""Bodies that are surfaces far from the camera: what is white stays white, and pictures are those of both, mixed by the chance.

Comparisons with chance go wrong once in 1e7 seeds; seeds are fixed.
"""

import numpy as np
import pytest

from renderers.mitsuba import variants
from renderers.mitsuba.world import World
from renderers.transport import far, passes
from renderers.transport.far import Far
from tests.odds import sigmas
from tests.physics.test_translucent import BOUNDARIES, shape
from tests.physics.test_transport import box
from tests.physics.test_transport_media import BALL, RGB, body, cube, sensor

import mitsuba as mi  # isort: skip  behind renderers.mitsuba, which finds LLVM

WALLS = cube((-12, -22, -9), (12, 12, 9), '<boolean name="flip_normals" value="true"/><bsdf type="diffuse">'
             '<rgb name="reflectance" value="0.3 0.3 0.3"/></bsdf><emitter type="area"><rgb name="radiance" value="0.7 0.7 0.7"/>'
             '</emitter>', "walls")


def pictures(folder, scene, entries, numbers, near=None, reflectance=(1.0, 1.0, 1.0)):
    """Passes of the loop over surfaces and lights, XML; near : m, of all entries, which are diffuse from there on."""
    (folder / "scene.xml").write_text(f'<scene version="3.0.0">{scene}</scene>')
    world = World(folder / "scene.xml")
    white = mi.load_dict({"type": "diffuse", "reflectance": {"type": "rgb", "value": list(reflectance)}})
    changes = {} if near is None else {number: Far(white, near) for number in range(len(entries))}
    part = passes.part("paths", world, entries, RGB, 0, far=changes)
    return np.array([part.render(number)[""] for number in numbers])


def of_means(images):
    """Mean of the means of pictures, and its standard error."""
    means = images.mean(axis=(1, 2, 3))
    return means.mean(), means.std(ddof=1) / len(means)**0.5


def test_the_chance_is_of_the_distance_alone():
    distance = np.array([0.0, 1.0, 2.0, 2.0 * 2**0.5, 4.0, 1e30])
    with np.errstate(divide="ignore"):
        assert far.chance(distance, 2.0, np) == pytest.approx([0, 0, 0, 0.5, 1, 1], abs=1e-12)
    variants.activate()
    assert np.array(far.chance(mi.Float(distance), 2.0)) == pytest.approx([0, 0, 0, 0.5, 1, 1], abs=1e-6)


@pytest.mark.slow
def test_nothing_is_lost_where_bodies_change_into_surfaces(tmp_path):
    """Matched, of smooth and of rough glass, side by side across the change, without absorption, in a white room whose walls
    shine: light samples and chance have to agree on what goes into bodies."""
    middles = {"matched": (0, -2, 0), "behind": (0.6, 1, 0), "smooth": (2.8, 0, 0), "rough": (-2.8, 0, 0)}
    balls = {name: (0.45 * BALL[0] + np.array(middle, float), BALL[1]) for name, middle in middles.items()}
    indices = {"matched": 1.0, "behind": 1.0, "smooth": 1.4, "rough": 1.5}
    xml = sensor("0, -8, 1", size=12) + WALLS + "".join(shape(tmp_path, name, ball, BOUNDARIES[indices[name]])
                                                         for name, ball in balls.items())
    entries = [body(name, ball, indices[name], [1.0] * 3, 0.4, (0.7, 1.0, 1.5)) for name, ball in balls.items()]
    mean, error = of_means(pictures(tmp_path, xml, entries, range(8), near=5.5))
    assert error < 0.003 and abs(mean - 1) < sigmas(8) * error


@pytest.mark.slow
def test_radiance_is_that_of_the_surface_and_of_the_body_mixed(tmp_path):
    """A red surface on a block of another colour, which fills the picture: row by row, as nothing else is lit.  Were the change
    abrupt, rows would tell: the middle one by more than ten standard errors."""
    block = box((-60, -60, -9), (60, 60, 0))
    xml = sensor("0, -8, 3", size=12) + shape(tmp_path, "block", block, BOUNDARIES[1.0]) + '<emitter type="constant"/>'
    entries = [body("block", block, 1.0, [0.5, 0.8, 0.9], 0.0, (0.3, 0.2, 0.1))]
    only_body, mixed, only_surface = (pictures(tmp_path, xml, entries, range(24), near, (0.8, 0.1, 0.05))
                                      for near in (None, 6.0, 0.0))
    camera = World(tmp_path / "scene.xml").camera
    direction = camera.refitted(12, 12, 96, 96).rays(96, 96)
    distance = -camera.origin[2] / direction[..., 2]  # to the top of the block

    def rows(chance):
        share = chance.reshape(12, 8, 12, 8).mean(axis=(1, 3))[..., None]
        off = (mixed - share * only_surface - (1 - share) * only_body).mean(axis=2)
        return off.mean(axis=0) / (off.std(axis=0, ddof=1) / len(off)**0.5 + 1e-6)  # far off both are the same to the last bit

    assert np.all(abs(rows(far.chance(distance, 6.0, np))) < sigmas(24, comparisons=36))
    assert np.max(abs(rows(distance > 6.0 * 2**0.5))) > 10
