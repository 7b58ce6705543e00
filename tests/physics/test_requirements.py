"""Pictures from what a scene asks for agree with pictures from the whole recipe, and the asset costs less."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from bakery.physics.shapes.radial import icosphere
from bakery.run import execute, prepare
from bakery.run.ensure import asked
from bakery.store import ply
from renderers import budget, colour, requirements, scene, translucent
from tests.exr import layers

TOLERANCE, BLOCK = 0.1, 4
WHOLE = """\
bakery: 1
name: wax
wavelengths: [0.55]
tolerance: 1%
medium: {albedo: 0.9, mean_free_path: 1 mm, phase: {type: hg, g: 0.8}}
multiple_scattering: {}
"""
SCENE = """\
bakery_scene: 1
name: lit
recipe: wax.yaml
tolerance: 10%
scene: {mitsuba: lit.xml, unit: 1 mm}
stop: {samples: 32, noise: 0.01%}
translucent: {bodies: [{shape: ball}]}
"""
XML = """<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="34"/><transform name="to_world">
<lookat origin="0, -19, 5" target="0, 0, 0" up="0, 0, 1"/></transform><film type="hdrfilm"><integer name="width" value="32"/>
<integer name="height" value="24"/></film></sensor>
<shape type="ply" id="ball"><string name="filename" value="ball.ply"/><bsdf type="null"/></shape>
<shape type="rectangle" id="panel"><transform name="to_world"><scale value="8"/><rotate x="1" angle="180"/>
<translate x="3" y="3" z="13"/></transform><emitter type="area"><rgb name="radiance" value="4 4 4"/></emitter></shape></scene>"""


@pytest.mark.slow
def test_tables_of_few_orders_give_the_same_picture(tmp_path):
    """A ball of five mean free paths under a panel, g = 0.8; other random numbers for each picture.

    Means over 4 x 4 pixels differ by noise and by the tables.  The mean of their 48 squares, of which noise is the larger part,
    has a relative standard deviation of about a quarter; 2.2 times what noise and the tables' share of the tolerance allow is
    five of them, odds of a false alarm of 1e-6.
    """
    vertices, faces = icosphere(320)
    (tmp_path / "ball.ply").write_bytes(ply.mesh(5 * vertices, faces, single=True))
    for name, text in (("lit.xml", XML), ("wax.yaml", WHOLE), ("s.yaml", SCENE)):
        (tmp_path / name).write_text(text)
    recipe, read = tmp_path / "wax.yaml", scene.load(tmp_path / "s.yaml")
    wanted = asked(recipe, {}, lambda values, medium: requirements.of_scene(read, values, medium))
    assert int(wanted.settings["multiple_scattering.orders"]) < 38  # what g = 0.8 takes
    plans = [prepare(recipe, tmp_path / f"{name}.h5", settings=settings, force=True)
             for name, settings in (("planned", wanted.settings), ("whole", {}))]
    pictures = [_rendered(read, execute(plan).output, tmp_path / f"{seed}.exr", seed) for seed, plan in enumerate(plans)]
    (a, noise_a), (b, noise_b) = pictures
    mean = b.mean()
    difference = np.sqrt(np.mean((a - b) ** 2)) / mean
    noise = np.sqrt(np.mean(noise_a + noise_b)) / mean
    assert noise < TOLERANCE and difference**2 < 2.2 * ((budget.TABLES * TOLERANCE) ** 2 + noise**2)
    assert plans[0].steps[-1].cost.seconds < 0.7 * plans[1].steps[-1].cost.seconds


def _rendered(read, asset, path, seed):
    """Luminance of blocks and the variance of each."""
    translucent.render(dataclasses.replace(read, asset=asset, assets=(asset,)), path, seed=seed)
    found = layers(path)
    picture = np.stack([found[c] for c in "RGB"], axis=-1).astype(float) @ colour.LUMINANCE
    return _blocks(picture), _blocks(found["noise.Y"].astype(float) ** 2) / BLOCK**2


def _blocks(image):
    height, width = image.shape
    return image.reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK).mean(axis=(1, 3))
