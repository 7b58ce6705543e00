"""`bake render` of scenes whose materials are baked surfaces (method surface)."""

import json
import math
import shutil

import numpy as np
import pytest

import bakery
from renderers.scene.meshes import length
from tests.exr import layers

pytest.importorskip("renderers.mitsuba", exc_type=ImportError)

WHITE = """\
bakery: 1
name: white
wavelengths: [0.55]
tolerance: 1%
medium: {albedo: 1, mean_free_path: 1 mm, phase: {type: hg, g: 0.3}}
surface: {thickness: "[1, 8] mm"}
"""
FURNACE = """<scene version="3.0.0">
    <emitter type="constant"> <float name="radiance" value="1"/> </emitter>
    <shape type="sphere" id="ball"> <bsdf type="diffuse"> <float name="reflectance" value="0"/> </bsdf> </shape>
    <shape type="sphere" id="other"> <point name="center" x="20" y="0" z="0"/> </shape></scene>"""
SCENE = """\
bakery_scene: 2
name: furnace
materials: [{where: {shape: ball}, asset: white.h5, method: surface, layer: 1}]
scene: {mitsuba: furnace.xml}
camera: {origin: [0, -5, 0] m, target: [0, 0, 0] m, fov: 18 deg}
film: {width: 24, height: 24}
stop: {samples: 64}
"""


@pytest.fixture(scope="module")
def white(tmp_path_factory):
    """The asset of the recipe."""
    folder = tmp_path_factory.mktemp("white")
    (folder / "white.yaml").write_text(WHITE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BAKERY_CACHE", str(folder / "cache"))
        return bakery.bake(folder / "white.yaml", folder / "white.h5")


@pytest.fixture
def scene(white, tmp_path):
    for name, content in (("white.yaml", WHITE), ("furnace.xml", FURNACE), ("furnace.yaml", SCENE)):
        (tmp_path / name).write_text(content)
    shutil.copy(white, tmp_path)
    return tmp_path / "furnace.yaml"


def test_a_lossless_surface_vanishes_in_even_light(scene, call):
    """What the layer sends back and lets through add up: both sides of a ball of it are as bright as the sky."""
    status, out, err = call("render", scene, "--json")
    report = json.loads(out)
    assert status == 0, err
    picture = layers(scene.with_name("furnace.exr"))
    values = np.stack([picture[channel] for channel in "RGB"])
    # the layer's own error and six standard errors: 2e-9
    assert abs(values.mean() - 1) < 1e-3 + 6 * report["noise"] / 24
    material, = report["materials"]
    assert report["bias"] is None and material["method"] == "surface" and material["bias"] is None
    assert any("light leaves where it came in" in reason for reason in report["reasons"])
    assert any("a pixel is" in reason for reason in report["reasons"])
    # of the layer's own walks; between the spread of the thinner layer and that of a half space
    far = math.sqrt(bakery.open(scene.with_name("white.h5")).surface["mean_square"][0, 1]) / 1e3
    assert 3 < far < 20 and any(f"light leaves it up to {length(far / 1e3)} (root mean square, by walks)" in reason
                                for reason in report["reasons"])


@pytest.mark.slow
def test_a_lossless_surface_under_facets_vanishes_too_and_says_that_paths_would_not(scene, call):
    """Table's error, 0.2 %, and six standard errors: 2e-9.  By `paths`, through Mitsuba's `roughdielectric`, 0.70 is left."""
    facets = WHITE.replace('{thickness: "[1, 8] mm"}', "{boundary: {index: 1.4, roughness: 0.3}}")
    (scene.parent / "white.yaml").write_text(facets)
    (scene.parent / "white.h5").unlink()
    assert call(scene.parent / "white.yaml", "-o", scene.parent / "white.h5")[0] == 0
    status, out, err = call("render", scene, "--json", "--set", "materials[0].layer=0")
    assert status == 0, err
    report = json.loads(out)
    picture = layers(scene.with_name("furnace.exr"))
    assert abs(np.mean([picture[channel] for channel in "RGB"]) - 1) < 2e-3 + 6 * report["noise"] / 24
    assert any("several facets of its rough boundary" in reason for reason in report["reasons"])


@pytest.mark.parametrize(("settings", "asset", "message"), [
    ({"materials[0].layer": "2"}, WHITE, "materials[0].layer: found no layer 2; "),
    ({"materials[0].asset": "furnace.xml"}, WHITE, "materials[0].asset: "),
    ({"materials[0].where.shape": "bowl"}, WHITE, "found 0 shapes of the id bowl; it has ball, other"),
    ({}, WHITE[:WHITE.index("surface")], "no stage surface; use a section surface: {thickness: infinite} in its recipe"),
])
def test_what_cannot_be_a_surface_is_told(scene, call, settings, asset, message):
    (scene.parent / "white.yaml").write_text(asset)
    if "surface" not in asset:
        (scene.parent / "white.h5").unlink()
        assert call(scene.parent / "white.yaml", "-o", scene.parent / "white.h5")[0] == 0
    status, _, err = call("render", scene, *(part for key, value in settings.items() for part in ("--set", f"{key}={value}")))
    assert status in (2, 4) and message in err and "Traceback" not in err


def test_a_layer_that_the_recipe_lacks_is_told_before_it_is_baked(scene, call):
    scene.with_name("white.h5").unlink()
    scene.write_text(SCENE.replace("asset: white.h5", "recipe: white.yaml").replace("layer: 1", "layer: 7"))
    status, _, err = call("render", scene)
    said, = err.splitlines()
    assert status == 2 and "furnace.yaml:3: materials[0].layer: found no layer 7; " in said and said.endswith("has 2: 0 to 1")


@pytest.mark.parametrize(("entry", "message"), [
    ("method: surface, boundary: {index: 1.4}", "materials[0].boundary: found boundary, and that of a surface is baked"),
    ("method: paths, layer: 1", "materials[0].layer: found layer, which method paths does not use; expected it with method: "
     "auto, surface or paths+surface"),
    ("method: surface, surface_from: 2 m", "materials[0].surface_from: found surface_from, which method surface does not use; "
     "expected it with method: auto or paths+surface"),
    ("method: paths+surface", "materials[0].where.shape: ball is no mesh; a closed mesh would do"),
])
def test_keys_that_have_no_meaning_are_told(scene, call, entry, message):
    scene.write_text(SCENE.replace("method: surface, layer: 1", entry))
    status, _, err = call("render", scene)
    assert status == 2 and message in " ".join(err.split())
