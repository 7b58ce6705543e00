"""`bake render SCENE.yaml` of several materials as a user calls it: report, layers, the same bytes, resuming, what is refused."""

import gc
import json
import re
import weakref

import numpy as np
import pytest

from bakery.cli import status_of
from bakery.physics.shapes.radial import icosphere
from bakery.store import ply
from renderers import choice
from renderers.mitsuba.world import World
from renderers.pictures import denoise
from renderers.pictures.passes import LENS
from renderers.scene import load
from tests.conftest import slow
from tests.exr import layers

RECIPES = {
    "mist": 'medium: {albedo: [0.9, 0.8, 0.7], mean_free_path: "[90, 80, 70] cm", phase: {type: hg, g: 0.7}}',
    "jelly": 'medium: {albedo: [0.9, 0.8, 0.7], mean_free_path: "[3, 2, 1] mm", phase: {type: hg, g: 0.3}}',
    "drops": """tolerance: 20%
particles:
  host: air
  number_density: 4e5 /m^3
  components: [{name: drops, material: water, size: {distribution: single, radius: 400 um}}]
discrete: {count: 2000, box: [20 cm, 20 cm, 20 cm], seed: 3, method: procedural}""",
    "spray": """tolerance: 20%
particles:
  host: air
  number_density: 4e8 /m^3
  components: [{name: drops, material: water, size: {distribution: single, radius: 40 um}}]
discrete: {count: 3200000, box: [20 cm, 20 cm, 20 cm], seed: 3, method: procedural}""",
    "beads": """tolerance: 20%
grains:
  radius: 3 mm
  components: [{name: bead, shape: {type: sphere}, surface: {type: diffuse, reflectance: [0.7, 0.6, 0.5]}}]
packing: {fraction: 0.5, count: 60}
effective_medium: {sigma_t: mean_flight}""",
}
SCENE = """\
bakery_scene: 2
name: all
scene: {mitsuba: room.xml, unit: 1 m}
stop: {samples: 1}
film: {width: 24, height: 18}
materials:
  - {where: everywhere, recipe: mist.yaml}
  - {where: {box: {lo: [-10, -10, 1] cm, hi: [10, 10, 21] cm}}, recipe: drops.yaml}
  - {where: {mesh: heap.ply, unit: 1 m}, recipe: beads.yaml}
  - {where: {shape: jelly}, recipe: jelly.yaml, boundary: {index: 1.35}}
"""
XML = """<scene version="3.0.0">
<sensor type="perspective"><float name="fov" value="30"/><transform name="to_world"><lookat origin="0, -0.5, 0.15"
target="0, 0, 0.03" up="0, 0, 1"/></transform><film type="hdrfilm"/></sensor>
<shape type="rectangle" id="floor"><bsdf type="diffuse"/></shape>
<shape type="ply" id="jelly"><string name="filename" value="ball.ply"/><transform name="to_world"><translate x="0.06" y="0.05"
z="0.031"/></transform><bsdf type="dielectric"><float name="int_ior" value="1.35"/></bsdf></shape>
<shape type="rectangle" id="panel"><transform name="to_world"><scale value="0.2"/><rotate x="1" angle="180"/><translate z="0.5"/>
</transform><emitter type="area"><rgb name="radiance" value="3 3 3"/></emitter></shape></scene>"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("mixed")
    for name, text in RECIPES.items():
        (made / f"{name}.yaml").write_text(f"bakery: 1\nname: {name}\nwavelengths: rgb\n{text}\n")
    (made / "all.yaml").write_text(SCENE)
    (made / "room.xml").write_text(XML)
    vertices, faces = icosphere(320)
    (made / "ball.ply").write_bytes(ply.mesh(0.03 * vertices, faces))
    (made / "heap.ply").write_bytes(ply.mesh(0.03 * vertices + [-0.05, 0, 0.03], faces))
    return made


@pytest.fixture
def call(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    monkeypatch.setenv("BAKERY_CACHE", str(folder / "cache"))

    def called(*arguments, scene="all.yaml"):
        status = status_of(["render", scene, "--json", *arguments])
        output = capsys.readouterr()
        return status, json.loads(output.out) if output.out.startswith("{") else None, output.err

    return called


def rendered(call, output, *arguments, scene="all.yaml"):
    status, report, error = call("-o", output, *arguments, scene=scene)
    assert status == 0, error
    return report, layers(output.replace(".png", ".exr"))


def some(folder, *recipes, xml="room.xml"):
    """A scene of these materials alone."""
    lines = [line for line in SCENE.splitlines() if any(f"recipe: {recipe}.yaml" in line for recipe in recipes)]
    (folder / "some.yaml").write_text(SCENE[:SCENE.index("  - ")].replace("room.xml", xml) + "\n".join(lines))
    return "some.yaml"


def test_a_sky_and_media_of_the_mitsuba_file_are_left_out_and_that_is_said(call, folder):
    """No sky shines into a medium without an end; materials say what is in the scene.  Each is told of the file that has it."""
    (folder / "sky.xml").write_text(XML.replace("</scene>", '<emitter type="constant"/></scene>'))
    (folder / "smoke.xml").write_text(XML.replace("</scene>", """<shape type="cube" id="smoke"><transform name="to_world"><scale
value="0.01"/></transform><bsdf type="null"/><medium name="interior" type="homogeneous"/></shape></scene>"""))
    sky = "materials[0]: light at infinity (sky, sun) does not get into a medium that is everywhere"
    media = "media of the Mitsuba file, at smoke, are left out: materials say what is in the scene"
    for xml in ("sky.xml", "smoke.xml"):
        reasons = rendered(call, "sky.png", "--overwrite", scene=some(folder, "mist", xml=xml))[0]["reasons"]
        assert any(line.startswith(sky) for line in reasons) == (xml == "sky.xml")
        assert (media in reasons) == (xml == "smoke.xml")
    # the shape that is nothing without its medium would hide lamps; that of an entry stays
    scene = load(folder / some(folder, "mist", "jelly", xml="smoke.xml"))
    assert [shape.name for shape in World.of(scene).shapes()] == ["floor", "jelly", "panel"]


def test_what_a_plugin_of_mitsuba_refuses_while_it_renders_is_one_line(call, folder):
    """Bumps of a texture that has no slope load, and fail in the first pass."""
    bumps = '<bsdf type="bumpmap"><texture type="checkerboard"/><bsdf type="diffuse"/></bsdf>'
    (folder / "bumps.xml").write_text(XML.replace('<bsdf type="diffuse"/>', bumps))
    status, _, error = call("-o", "bumps.png", "--quiet", scene=some(folder, "mist", xml="bumps.xml"))
    assert status == 2 and "Traceback" not in error and not (folder / "bumps.png").exists()
    assert "Mitsuba cannot render a surface, light or texture of this scene: [Texture] Texture::eval_1_grad()" in error


def test_report_and_layers(call):
    report, found = rendered(call, "one.png")
    entries = [(entry["kind"], entry["method"], entry["bias"]) for entry in report["materials"]]
    assert entries == [("medium", "paths", 0), ("particles", "particles", 0), ("grains", "ept", 0), ("body", "paths", 0)]
    assert report["renderer"] == "mixed" and report["bias"] == 0
    orders = sum(found[f"{name}.G"].astype(float) for name in ("order0", "order1", "order2", "orders"))
    assert np.allclose(orders, found["G"], rtol=1e-3, atol=1e-6) and np.allclose(found["light.panel.G"], found["G"], atol=1e-5)
    assert {0, 2, 3} <= set(np.unique(found["material"])), "the entry that most paths of a pixel first scatter in"


@pytest.mark.slow
def test_particles_in_a_mesh_are_inside_of_a_medium_in_a_larger_one(call, folder):
    """A cone of drops in one of mist, of 1.33 times its volume; voxels by which drops are looked for hold 1.6 times."""
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ring = np.stack([0.03 * np.cos(turn), 0.03 * np.sin(turn), np.full(24, -0.02)], axis=1)
    cone = np.concatenate([ring, [[0, 0, -0.02], [0, 0, 0.06]]])  # around its middle
    k = np.arange(24)
    faces = np.concatenate([np.stack([k, (k + 1) % 24, np.full(24, 25)], 1), np.stack([(k + 1) % 24, k, np.full(24, 24)], 1)])
    for name, scale in (("cone", 1.0), ("wider", 1.1)):
        (folder / f"{name}.ply").write_bytes(ply.mesh(scale * cone + [0, 0, 0.05], faces))
    dense = RECIPES["spray"].replace("4e8", "4e9").replace("3200000", "32000000")
    (folder / "dense.yaml").write_text(f"bakery: 1\nname: dense\nwavelengths: rgb\n{dense}\n")
    near = "camera: {origin: [0, -0.5, 0.07] m, target: [0, 0, 0.07] m, fov: 10 deg}\nmaterials:\n"
    (folder / "cones.yaml").write_text(SCENE[:SCENE.index("  - ")].replace("materials:\n", near) + """\
  - {where: {mesh: cone.ply}, recipe: dense.yaml, method: particles}
  - {where: {mesh: wider.ply}, recipe: mist.yaml}
""")
    status, _, error = call("-o", "cones.png", scene="cones.yaml")
    assert status == 0, error
    assert np.sum(layers("cones.exr")["material"] == 0) > 10


@pytest.mark.slow
def test_particles_wider_than_pixels_are_filtered_each_by_itself(call):
    """Drops three pixels wide in a box of 20 cm: a disc is as bright everywhere, so that what differs in it is noise."""
    if denoise.fault():
        pytest.skip("mitsuba-oidn is not installed")
    near = "camera={origin: [0, -0.5, 0.12] m, target: [0, 0, 0.11] m, fov: 2 deg}"
    report, found = rendered(call, "near.png", "--denoise", "--set", near, "--set", "film.width=48", "--set", "film.height=36",
                             "--set", "stop.samples=4")
    assert report["denoising"]["grains"] is True and report["denoising"]["apart"] == ["paths"]
    facing = np.stack([found[f"normal.{axis}"] for axis in "XYZ"], axis=-1)
    drops = np.linalg.norm(facing, axis=-1) > 0.999  # of all four places in a pixel
    assert 20 < drops.sum() < 400 and (facing[drops] @ [0, 1, 0] < -0.99).all()
    assert ((found["distance.Z"][drops] > 0.39) & (found["distance.Z"][drops] < 0.61)).all()
    noisy, clean = (found[name][drops].astype(float) for name in ("G", "denoised.G"))
    assert clean.std() < 0.6 * noisy.std() and clean.mean() == pytest.approx(noisy.mean(), rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("entries", [(0, 3), (1, 3), (1,), (2,)], ids=["media", "particles", "particles alone", "grains alone"])
def test_light_that_smooth_glass_keeps_from_points_is_left_out(call, folder, entries):
    """No ray meets a point behind glass, and no light sample gets through: said, and nobody claims to know how much it is."""
    point = '<emitter type="point"><point name="position" x="0.1" y="-0.2" z="0.4"/></emitter></scene>'
    (folder / "dim.xml").write_text(re.sub('<shape type="rectangle" id="panel">.*', point, XML, flags=re.DOTALL))
    kept = [line for number, line in enumerate(line for line in SCENE.splitlines() if "  - " in line) if number in entries]
    text = SCENE[:SCENE.index("  - ")].replace("room.xml", "dim.xml") + "\n".join(kept)
    (folder / "dim.yaml").write_text(text.replace("drops.yaml", "drops.yaml, method: particles"))
    status, report, error = call("-o", "dim.png", scene="dim.yaml")
    assert status == 0, error
    assert "smooth glass (jelly) is left out" in report["left_out"][0] and report["left_out"][0] in report["reasons"]
    assert report["bias"] is None


def test_light_that_single_precision_loses_is_left_out(call, folder):
    """Of a body in a medium, 30 km from the origin, as of one by itself."""
    (folder / "distant.xml").write_text(XML.replace('x="0.06"', 'x="30000"'))
    report, _ = rendered(call, "distant.png", scene=some(folder, "mist", "jelly", xml="distant.xml"))
    assert "jelly reaches 3e+04 m from the origin, where single precision" in report["left_out"][0] and report["bias"] is None


@pytest.mark.slow
def test_of_leaning_normals_nobody_claims_that_they_are_exact(call, folder):
    """A slab whose normals are means over its edges sends on too much light, some per cent of it."""
    vertices = 0.03 * np.array(list(np.ndindex(2, 2, 2)), float) - 0.015
    sides = (0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)
    faces = [triangle for a, b, c, d in sides for triangle in ((a, b, c), (a, c, d))]
    (folder / "slab.ply").write_bytes(ply.mesh(vertices, np.array(faces)))
    (folder / "slab.xml").write_text(XML.replace("ball.ply", "slab.ply"))
    report, _ = rendered(call, "slab.png", scene=some(folder, "mist", "jelly", xml="slab.xml"))
    assert any("normals on 100 % of jelly lean" in reason for reason in report["reasons"]) and report["bias"] is None


@pytest.mark.parametrize("entries", [slow((2,)), (2, 3)], ids=["alone", "beside a body"])
def test_a_mesh_without_room_for_a_grain_is_told(call, folder, entries):
    """As where.unit gives one that is meant in other units."""
    kept = [line for line in SCENE.splitlines() if "  - " in line]
    text = SCENE[:SCENE.index("  - ")] + "\n".join(kept[number] for number in entries)
    (folder / "tiny.yaml").write_text(text.replace("unit: 1 m}, recipe: beads", "unit: 1 mm}, recipe: beads"))
    status, report, error = call("-o", "tiny.png", scene="tiny.yaml")
    # some 4/3 pi (30 um)^3 at half the volume of balls of 3 mm
    assert status == 0 and any("the mesh has room for 5e-07 grains" in reason for reason in report["reasons"]), error


@pytest.mark.slow
def test_a_lens_and_clipping_planes_are_said_to_be_left_out(call, folder):
    lens = '"thinlens"><float name="aperture_radius" value="0.05"/><float name="focus_distance" value="0.5"/>'
    near = '"perspective"><float name="near_clip" value="0.45"/>'  # the floor begins 0.25 m ahead
    said = []
    for name, kind in (("sharp", '"perspective">'), ("lens", lens), ("near", near)):
        (folder / f"{name}.xml").write_text(XML.replace('"perspective">', kind))
        report, found = rendered(call, f"{name}.png", scene=some(folder, "mist", "jelly", xml=f"{name}.xml"))
        said.append((LENS in report["reasons"], any("clipping planes, 0.45 m and 1e+04 m" in line for line in report["reasons"])))
    assert (found["depth.Z"] < 0.45).any() and said == [(False, False), (True, False), (False, True)]


@pytest.mark.slow
def test_smooth_grains_show_small_lamps_wider(call, folder):
    """Beads of glass in the light of a point, which they show by no other method."""
    matt, glass = "{type: diffuse, reflectance: [0.7, 0.6, 0.5]}", "{type: dielectric, material: {n: 1.5, k: 0}}"
    beads = RECIPES["beads"].replace(matt, glass)
    (folder / "glass.yaml").write_text(f"bakery: 1\nname: glass\nwavelengths: rgb\n{beads}\n")
    panel = XML[XML.index('<shape type="rectangle" id="panel">'):]
    (folder / "point.xml").write_text(XML.replace(panel, '<emitter type="point"><point name="position" x="0.1" y="-0.2" z="0.3"/>'
                                                         '</emitter></scene>'))
    scene = some(folder, "drops", "beads", xml="point.xml")
    alone = "--set", "materials[1].recipe=glass.yaml", "--set", "stop.samples=8"
    exact, _ = rendered(call, "exact.png", *alone, "--set", "materials[1].method=ept", scene=scene)
    discs = "--set", "materials[1].method=ept+wide", "--set", "materials[1].widen=9 deg"
    wide, _ = rendered(call, "wide.png", *alone, *discs, scene=scene)
    entries = [report["materials"][1] for report in (exact, wide, rendered(call, "auto.png", *alone, scene=scene)[0])]
    assert [(entry["method"], entry["bias"]) for entry in entries] == [("ept", None), ("ept+wide", None), ("ept+wide", None)]
    assert "method: ept+wide shows them as discs" in " ".join(exact["reasons"])
    assert "small lamps as discs of 9 degrees" in " ".join(wide["reasons"])
    assert wide["mean"][1] > exact["mean"][1]
    other = "--set", "materials[0]={where: {mesh: heap.ply, unit: 10 m}, recipe: glass.yaml, method: ept}"
    beside, _ = rendered(call, "beside.png", *alone, *other, *discs, scene=scene)
    assert beside["materials"][0]["bias"] is None, "all smooth grains of a scene show lamps as discs"
    assert " ".join(beside["reasons"]).count("small lamps as discs of 9 degrees") == 2


@pytest.mark.slow
def test_same_seed_same_bytes_and_resumed(call):
    """Two passes of 16 samples of a pixel, through all four materials, and a third that goes on: two thirds of it are there."""
    two, three = ("--set", "stop.samples=32"), ("--set", "stop.samples=48")
    first, again = (rendered(call, f"{name}.png", *two)[1] for name in ("first", "again"))
    assert changed(first, again) == {}
    report, resumed = rendered(call, "again.png", *three, "--resume")
    third = 3 * resumed["G"].astype(float) - 2 * first["G"]
    assert report["samples"] == 48 and (third > -1e-5).all() and third.mean() == pytest.approx(first["G"].mean(), rel=0.2)
    assert "G" in changed(first, resumed)
    # sums are kept in single precision
    assert all(most < 1e-6 for _, most in changed(rendered(call, "straight.png", *three)[1], resumed).values())


def test_scenes_before_are_gone_when_passes_begin(call, folder):
    """Kernels are compiled for the surfaces and lights of all scenes of a process, also of those that wait to be collected."""
    gc.disable()
    try:
        waits = [World("room.xml")]
        waits.append(waits)
        alive = weakref.ref(waits[0])
        del waits
        assert alive() is not None
        rendered(call, "beside.png", scene=some(folder, "mist", "jelly"))
        assert alive() is None
    finally:
        gc.enable()


def changed(picture, other) -> dict:
    """Layers in which two pictures differ: number of pixels, and the largest difference."""
    return {name: (int((picture[name] != other[name]).sum()), float(abs(picture[name] - other[name]).max()))
            for name in picture if not np.array_equal(picture[name], other[name])}


@pytest.mark.slow
def test_where_all_is_continuous_one_loop_renders(call):
    report, found = rendered(call, "loop.png", "--set", "materials[1].method=continuous", "--set", "materials[2].method=vpt")
    assert [entry["bias"] for entry in report["materials"]] == [0, None, None, 0] and report["bias"] is None
    assert any("no particle is told apart" in reason for reason in report["materials"][1]["reasons"])
    assert set(np.unique(found["material"])) <= {-1, 0, 1, 2, 3} and 3 in found["material"]


@pytest.fixture
def measured(monkeypatch):
    """Pilots of pictures as small as these."""
    for name, value in (("_LEAST_PIXELS", 1), ("_LEAST_SAMPLES", 1), ("_SHARE", 1e6), ("_LONGEST", 0.1), ("_LONGER", 1)):
        monkeypatch.setattr(choice, name, value)


SPRAY = "--set", "materials[1].recipe=spray.yaml"


@pytest.mark.slow
def test_auto_measures_and_remembers(call, folder, measured, monkeypatch, capsys):
    """Drops that nobody can tell apart may become a medium, beads that are seen stay beads; plan, render and resume agree."""
    report, _ = rendered(call, "auto.png", *SPRAY)
    table = {row["method"]: row for row in report["materials"][1]["pilot"]}
    first, both, spray, beads, wide = (f"materials[1] by {one}; materials[2] by {other}" for one, other in (
        ("particles", "ept"), ("continuous", "vpt"), ("continuous", "ept"), ("particles", "vpt"), ("particles", "ept+wide")))
    assert table.keys() == {first, both, spray, beads, wide} and not table[wide]["chosen"]  # the beads are matt
    assert all("single particles and grains are seen" in table[name]["why"] for name in (both, beads))
    assert table[first]["seconds"] > 0 and table[spray]["seconds"] > 0 and table[first]["bias"] == 0 and table[spray]["error"] > 0
    entries, taken = report["materials"], next(name for name in table if table[name]["chosen"])
    assert f"materials[1] by {entries[1]['method']}; materials[2] by {entries[2]['method']}" == taken
    assert [entry["pilot"] is None for entry in entries] == [True, False, False, True]
    assert any("auto is" in line and "by pilots" in line for line in report["reasons"])
    monkeypatch.setattr(choice, "_Pilots", None)
    again, _ = rendered(call, "found.png", *SPRAY)
    assert any("of an earlier render" in line for line in again["reasons"])
    assert (folder / "auto.exr").read_bytes() == (folder / "found.exr").read_bytes()
    more, _ = rendered(call, "auto.png", *SPRAY, "--set", "stop.samples=64", "--resume")
    assert more["method"] == report["method"] and more["samples"] > report["samples"]
    assert status_of(["plan", "all.yaml", "--json", *SPRAY]) == 0
    (plan,) = json.loads(capsys.readouterr().out)
    assert plan["render"]["choice"][0].startswith(f"auto is {taken} here, by pilots")
    # nor does what a plan renders on a small scale choose again, where a medium was chosen that has something to be compared with
    found = choice.of_scene
    monkeypatch.setattr(choice, "of_scene", lambda *about: found(*about)._replace(
        method=spray, methods=[entries[0]["method"], "continuous", "ept", entries[3]["method"]]))
    assert status_of(["plan", "all.yaml", "--json", *SPRAY]) == 0


@pytest.mark.slow
def test_how_far_media_that_are_asked_for_are_off(call, measured):
    """By the same pilots, of what they stand for; beads of 6 mm, seen, are off by much more than their medium states."""
    report, _ = rendered(call, "asked.png", *SPRAY, "--set", "materials[1].method=particles", "--set", "materials[2].method=vpt")
    beads = report["materials"][2]
    asked, explicit = beads["pilot"]
    assert beads["method"] == "vpt" and asked["chosen"] and "other methods are asked for" in explicit["why"]
    assert explicit["bias"] == 0 and asked["error"] > 0 and report["materials"][1]["bias"] == 0
    assert any("as asked for, by pilots" in line for line in report["reasons"])


@pytest.mark.parametrize("setting, message", [
    ("materials[1].method=query", "materials[1].method: found query beside other materials; expected auto, particles or"),
    ("materials[3].method=dipole", "materials[3].method: found dipole beside other materials; expected auto, paths, surface or "
     "paths+surface"),
    ("materials[2]={where: {mesh: heap.ply}, recipe: beads.yaml, method: vpt, widen: 5 deg}",
     "found widen, which method vpt does not use; expected it with method: auto or ept+wide"),
    ("materials[2].spread=2", "materials[2].spread: found spread, and no method here switches from grains to their"),
    ("materials[3].boundary.tables=none", "found tables, and method paths reads no tables beside other materials"),
    ("materials[3].where.shape=floor", "materials[3].where.shape: floor is no closed mesh"),
    ("materials[0].where={mesh: heap.ply}", "materials[2].where: found the mesh of materials[0], so that neither is inside"),
    ("materials[0].where={box: {lo: [-10, -10, 1] cm, hi: [10, 10, 21] cm}}", "materials[1].where: found the box of materials"),
    ("materials[1].where={mesh: heap.ply}", "materials[2].where: found the mesh of materials[1], so that neither is inside"),
    ("film.wavelengths=rgb", "materials are rendered at the wavelengths of their assets"),
])
def test_what_is_refused(call, setting, message):
    status, _, error = call("--set", setting, "-o", "none.png")
    assert status == 2 and message in error, error


@pytest.mark.parametrize("recipe, needs", [
    ("mist", {"medium": []}), ("jelly", {"medium": []}),
    ("drops", {"optics": ["tolerance", "measure", "phase.method"], "medium": [], "discrete": ["discrete.tolerance"]}),
    ("beads", {"packing": [], "grains": ["scatterometer.tolerance"], "medium": ["tolerance"]})])
def test_of_each_recipe_what_its_kind_needs(folder, monkeypatch, capsys, recipe, needs):
    """Bodies by paths need no tables, grains that are traced no statistics of their light."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv("BAKERY_CACHE", str(folder / "cache"))
    assert status_of(["plan", f"{recipe}.yaml", "--scene", "all.yaml", "--json"]) == 0
    (plan,) = json.loads(capsys.readouterr().out)
    assert {need["stage"]: [knob["key"] for knob in need["knobs"]] for need in plan["needs"] if need["needed"]} == needs
