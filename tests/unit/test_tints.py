"""Colours of lights and surfaces that the wavelengths of an asset cannot hold are told."""

from types import SimpleNamespace

import numpy as np
import pytest

from renderers.mitsuba import tints
from renderers.mitsuba.world import World
from renderers.pictures.passes import discoloured

WALL = """<shape type="rectangle"><bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="{}"/></bsdf></bsdf>
    </shape>"""
SUN = '<emitter type="directional"><rgb name="irradiance" value="{}"/></emitter>'
SKY = '<emitter type="sunsky"><float name="sun_scale" value="0"/></emitter>'
VIEW = {"origin": (0, 0, 9), "target": (0, 0, 0), "up": (0, 1, 0), "fov": 1.0}
FIVE = [0.45, 0.5, 0.55, 0.6, 0.65]


def world(tmp_path, *parts):
    (tmp_path / "scene.xml").write_text(f'<scene version="3.0.0">{"".join(parts)}</scene>')
    return World(tmp_path / "scene.xml", view=VIEW, size=(2, 2))


@pytest.mark.parametrize("wavelength, wall, sun, error", [
    ([0.55], "0.5", "3", 0.0), ([0.55], "0.5", "3 0 0", 0.787), ([0.55], "0 0.9 0", "3", 0.715), (FIVE, "0.5", "0 2 0", 0.087),
    ([0.61, 0.55, 0.465], "0.9 0 0", "0 0 3", 0.0)])
def test_largest_error_of_a_colour(tmp_path, wavelength, wall, sun, error):
    """Of one wavelength, the luminance (ITU-R BT.709): 1 - 0.2126 of red, 0.7152 of green."""
    assert abs(tints.lost(world(tmp_path, WALL.format(wall), SUN.format(sun)), np.array(wavelength)) - error) < 1e-3


def test_skies_have_a_colour_and_grey_scenes_no_doubt(tmp_path):
    scene = SimpleNamespace(materials=[SimpleNamespace(kind="medium", method="auto")],
                            values=SimpleNamespace(film=SimpleNamespace(wavelengths="asset"), tolerance=0.05))
    assets = [SimpleNamespace(wavelength=np.array([0.55]))]
    (sentence,) = discoloured(scene, assets, world(tmp_path, WALL.format("0.5"), SKY))
    assert "the picture is grey" in sentence
    assert discoloured(scene, assets, world(tmp_path, WALL.format("0.5"), SUN.format("3"))) == []
