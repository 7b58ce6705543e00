"""Layer depth.Z: along the camera's axis to the first surface or grain, of scenes of every kind of entry."""

import numpy as np
import pytest

from tests.conftest import slow
from tests.exr import layers

WORLD = """<scene version="3.0.0"><integrator type="path"/>
<sensor type="perspective"><float name="fov" value="60"/><transform name="to_world">
<lookat origin="0, 0, 10" target="0, 0, 0" up="0, 1, 0"/></transform>
<film type="hdrfilm"><integer name="width" value="9"/><integer name="height" value="7"/></film></sensor>
<shape type="rectangle" id="floor"><transform name="to_world"><scale value="3"/></transform></shape>%s
<emitter type="constant"/></scene>"""
CUBE = '<shape type="cube" id="body"><transform name="to_world"><scale value="0.9"/><translate z="1"/></transform>%s</shape>'
BODY = "bakery: 1\nname: body\nwavelengths: rgb\nmedium: {albedo: 0.9, mean_free_path: 5 mm, phase: {type: isotropic}}\n"
GRAINS = """bakery: 1
name: grains
wavelengths: rgb
tolerance: 10%
grains:
  radius: 0.2 mm
  components:
    - {name: ball, shape: {type: sphere}, surface: {type: diffuse, reflectance: 0.5}}
packing: {fraction: 0.5, count: 200}
"""


def depths(call, tmp_path, entries, shapes=""):
    """Of a floor 10 mm below a camera that looks straight down: it is at one depth, though not at one distance."""
    (tmp_path / "world.xml").write_text(WORLD % shapes)
    listed = "\n".join(f"  - {entry}" for entry in entries)
    (tmp_path / "scene.yaml").write_text("bakery_scene: 2\nname: scene\nscene: {mitsuba: world.xml, unit: 1 mm}\n"
                                         f"stop: {{samples: 1}}\nmaterials:\n{listed}\n")
    status, _, err = call("render", tmp_path / "scene.yaml")
    assert status == 0, err
    return layers(tmp_path / "scene.exr")["depth.Z"]


@pytest.mark.parametrize("bsdf", [slow('<bsdf type="null"/>'),
                                  '<bsdf type="dielectric"><float name="int_ior" value="1.4"/></bsdf>'])
def test_bodies_are_as_far_as_their_boundary(bsdf, call, tmp_path):
    pytest.importorskip("renderers.mitsuba")
    (tmp_path / "body.yaml").write_text(BODY)
    depth = depths(call, tmp_path, ["{where: {shape: body}, recipe: body.yaml}"], CUBE % bsdf)
    assert depth[3, 4] == pytest.approx(8.1e-3, rel=1e-5) and depth[1, 3] == pytest.approx(10e-3, rel=1e-5)
    assert depth.shape == (7, 9) and np.isinf(depth[0, 0])  # beside the floor there is the sky


def mesh(path):
    from bakery.store import ply

    corners = np.array([[x, y, z] for x in (-1.0, 1) for y in (-1.0, 1) for z in (0.5, 2.0)])
    faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4),
             (1, 5, 7), (1, 7, 3)]
    path.write_bytes(ply.mesh(corners, np.array(faces)))


@pytest.mark.parametrize(("method", "more"), [("ept", ()), slow("vpt", ()),
                                              slow("ept", ["{where: everywhere, recipe: body.yaml}"])])
def test_grains_are_nearer_than_the_floor(method, more, call, tmp_path):
    """Grains of 0.2 mm stick out of a block that is 2 mm high by at most a radius; one medium stands for them in the block."""
    pytest.importorskip("renderers.mitsuba")
    mesh(tmp_path / "block.ply")
    (tmp_path / "body.yaml").write_text(BODY)
    (tmp_path / "grains.yaml").write_text(GRAINS)
    entries = [f"{{where: {{mesh: block.ply, unit: 1 mm}}, recipe: grains.yaml, method: {method}}}", *more]
    depth = depths(call, tmp_path, entries)
    assert depth[1, 3] == pytest.approx(10e-3, rel=1e-5) and np.isinf(depth[0, 0])
    if method == "vpt":
        assert depth[3, 4] == pytest.approx(8e-3, rel=1e-5)
    else:
        assert 7.8e-3 <= depth[3, 4] < 9.4e-3 and abs(depth[3, 4] - 8e-3) > 1e-6
