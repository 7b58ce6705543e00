"""Boundaries that refract by normals which are means over sharp edges, or that lie on glass, are told."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from bakery.store import ply
from renderers.materials.bodies import bodies
from renderers.mitsuba import variants
from renderers.mitsuba.shapes import Shape, leaning, lying_on
from tests.odds import SIGMAS


def shape(mesh, normals):
    return Shape("it", np.asarray(mesh.vertices), np.asarray(mesh.faces), np.asarray(mesh.bounds), 1.5, True, normals)


def test_the_share_that_leans():
    """Of a cube with means over its edges all, by acos(1/sqrt(3)) = 54.7 degrees; of a column with the normals of its ends its
    sides."""
    cube = trimesh.creation.box()
    means = np.sign(cube.vertices) / math.sqrt(3)
    assert leaning(shape(cube, means), math.radians(54.0)) == pytest.approx(1)
    assert leaning(shape(cube, means), math.radians(55.5)) == leaning(shape(cube, None), 0.1) == 0
    cube.vertices *= [1, 1, 9]  # sides of 4 x 9, ends of 1 each
    of_ends = np.array([[0, 0, np.sign(z)] for z in cube.vertices[:, 2]])
    assert leaning(shape(cube, of_ends), math.radians(40)) == pytest.approx(36 / 38)


@pytest.mark.parametrize("matched, normals, told", [(False, True, True), (True, True, False), (False, False, False)])
def test_it_is_told_of_boundaries_that_refract(matched, normals, told):
    cube = trimesh.creation.box()
    world = SimpleNamespace(shapes=lambda: [shape(cube, np.sign(cube.vertices) / math.sqrt(3) if normals else None)])
    said = bodies.leans(world, [SimpleNamespace(name="it", matched=matched)])
    assert len(said) == told and all("100 % of it lean by more than 40 degrees" in sentence for sentence in said)


def test_it_is_told_of_glass_around_bodies():
    """A tumbler with means over its rim bends what is seen of the milk in it."""
    cube = trimesh.creation.box()
    glass = shape(cube, np.sign(cube.vertices) / math.sqrt(3))
    shapes = [glass._replace(name="glass"), glass._replace(name="clay", index=None), shape(cube, None)]
    world = SimpleNamespace(shapes=lambda: shapes)
    (said,) = bodies.leans(world, [SimpleNamespace(name="it", matched=False)])
    assert "100 % of glass lean" in said


@pytest.mark.parametrize("gap, share", [(0, 1 / 6), (1e-5, 1 / 6), (1e-3, 0)])
def test_milk_that_lies_on_glass(gap, share):
    """A cube whose one side lies on that of another, of other triangles: with no gap, and with one below Mitsuba's epsilon."""
    variants.activate("rgb")
    cube, glass = trimesh.creation.box(), trimesh.creation.box((3, 3, 3)).subdivide()
    glass.apply_translation([0, 0, 2 + gap])
    milk, pane = shape(cube, None), shape(glass, None)._replace(name="pane")
    assert lying_on(milk, pane, 1.0) == pytest.approx(share) and lying_on(milk._replace(
        vertices=0.01 * milk.vertices), pane._replace(vertices=0.01 * pane.vertices), 0.01) == pytest.approx(share)
    said = bodies.lies_on_glass(SimpleNamespace(shapes=lambda: [milk, pane], unit=1.0), [SimpleNamespace(name="it")])
    assert len(said) == (share > 0) and all("17 % of the boundary of it lie on pane" in sentence for sentence in said)


def in_an_even_sky(folder, size, sharp, method):
    """A box of a white medium and glass, `Rendering`; sharp : normals of `bake new`, else means over its edges"""
    from bakery.starting.studio import _mesh
    from renderers.pictures.passes import Rendering
    from renderers.pictures.running import Render

    box = trimesh.creation.box(size)
    (folder / "box.ply").write_bytes(_mesh(box.vertices, box.faces, "mm") if sharp else ply.mesh(box.vertices, box.faces))
    (folder / "white.yaml").write_text("""bakery: 1
name: white
wavelengths: rgb
medium: {albedo: [1, 1, 1], mean_free_path: "[4, 4, 4] mm", phase: {type: isotropic}}
""")
    (folder / "box.xml").write_text("""<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="14"/>
<transform name="to_world"><lookat origin="-30, -90, 45" target="0, 0, 0" up="0, 0, 1"/></transform></sensor>
<shape type="ply" id="box"><string name="filename" value="box.ply"/><bsdf type="dielectric"/></shape>
<emitter type="constant"/></scene>""")
    (folder / "box.yaml").write_text(f"""bakery_scene: 2
name: box
scene: {{mitsuba: box.xml, unit: 1 mm}}
film: {{width: 16, height: 16}}
stop: {{samples: 256}}
materials: [{{where: {{shape: box}}, recipe: white.yaml, method: {method}}}]
""")
    return Rendering(Render(folder / "box.yaml", folder / "box.png"), seed=1)


@pytest.mark.slow
@pytest.mark.parametrize("sharp", [True, False])
def test_no_bias_is_stated_of_it(sharp, tmp_path):
    """Methods by beams are 10 % brighter than paths in a cube with means over its edges, which no layer of theirs tells."""
    method, even = in_an_even_sky(tmp_path, (20, 20, 20), sharp, "beams").method, np.ones((16, 16, 3))
    changed = SimpleNamespace(layers={"sharper": 0.1 * even})
    bias = method.after(SimpleNamespace(means={"joined": changed}, rgb=even))["bias"]
    assert bias == (pytest.approx(0.4 / 3) if sharp else None) and method.unmeasured != sharp


@pytest.mark.slow
@pytest.mark.parametrize("sharp", [True, False])
def test_a_slab_in_an_even_sky_is_as_bright(sharp, tmp_path):
    """Nothing absorbs: with the normals of `bake new` it shows 1, with means over its edges less.  False alarm: 1e-7."""
    rendering = in_an_even_sky(tmp_path, (40, 4, 40), sharp, "paths")
    rendering.run()
    report = rendering.finish()
    assert any("lean by more than" in reason for reason in report["reasons"]) != sharp
    error = report["mean_error"][1]
    assert error < 0.01 and (abs(report["mean"][1] - 1) < SIGMAS * error + 0.004) == sharp
