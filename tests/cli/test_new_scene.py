"""`bake new MATERIAL --mesh` and `--mitsuba`: scenes of what people have, and the scenes that ship; the page that shows it."""

import importlib.util
import json
import re
import shlex

import numpy as np
import pytest
import trimesh

from bakery.kernels import closed_mesh
from bakery.recipe import load
from bakery.starting.shipped import scenes
from bakery.store import ply
from tests.conftest import ROOT, slow

CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
STREET = """<scene version="3.0.0"><integrator type="path"/>
<sensor type="perspective"><transform name="to_world"><lookat origin="0, -10, 2" target="0, 0, 2" up="0, 0, 1"/></transform>
<film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="12"/></film></sensor>
<shape type="cube"><transform name="to_world"><scale value="20, 1, 20"/><translate y="5"/></transform></shape>
<emitter type="%s"/></scene>"""


def needs_mitsuba():
    if importlib.util.find_spec("mitsuba") is None:  # not imported here: the renderers choose its LLVM before that
        pytest.skip('pip install ".[mitsuba,llvm]"')


def mesh(path, corners=CORNERS, faces=TETRAHEDRON, comments=()):
    path.write_bytes(ply.mesh(np.asarray(corners, float), faces, comments))
    return path


def written(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize(("comments", "options", "centimetres", "said"), [
    ((), ("--height", "12 cm"), 12, "12 cm high, as asked"),
    ((), ("--unit", "m"), 5000, "50 m across: one unit is 1 m, as asked"),
    (("unit: mm",), (), 5, "5 cm across: one unit is 1 mm, as the file says"),
    (("File units = centimeters",), (), 50, "one unit is 1 cm, as the file says"),
    (("units: inches",), ("--unit", "cm"), 50, "one unit is 1 cm, as asked"),
    ((), (), 5, "5 cm across: GUESSED, because the file has no unit: at 1 mm a unit it is nearest to the usual 10 cm"),
])
def test_the_size_of_a_mesh_is_said(comments, options, centimetres, said, call, tmp_path):
    """50 units high; of milk 5 cm (mm) is nearer to 10 cm than 50 cm and 50 m are."""
    status, out, err = call("new", "milk", "--mesh", mesh(tmp_path / "mine.ply", 50 * CORNERS, comments=comments), *options,
                            "-o", tmp_path / "drink.yaml")
    names = ["drink.scene.ply", "drink.scene.xml", "drink.scene.yaml", "drink.yaml"]
    assert status == 0 and sorted(out.split()) == [str(tmp_path / name) for name in names]
    scene = (tmp_path / "drink.scene.yaml").read_text()
    assert said in err and f"# - {err.splitlines()[0]}" in scene and load(tmp_path / "drink.yaml").name == "drink"
    vertices, faces = closed_mesh((tmp_path / "drink.scene.ply").read_bytes(), "ply")
    unit = 0.1 if "unit: 1 mm}" in scene else 100
    assert vertices[:, 2].max() * unit == pytest.approx(centimetres, rel=1e-6) and vertices[:, 2].min() == 0 and len(faces) == 4
    assert np.ptp(vertices, axis=0) == pytest.approx(vertices[:, 2].max()) and "boundary: {index: 1.35}" in scene


def test_the_camera_sees_all_of_the_mesh(call, tmp_path):
    """Corners of a flat, of a tall and of a plump body: the farthest from the middle is where the frame is 80 % full."""
    for stretch in ([1, 1, 0.05], [0.1, 0.1, 1], [1, 1, 1]):
        path = mesh(tmp_path / "mine.ply", CORNERS * stretch)
        assert call("new", "wax", "--mesh", path, "--unit", "m", "-o", tmp_path / "one.yaml", "--overwrite")[0] == 0
        xml = (tmp_path / "one.scene.xml").read_text()
        lookat = re.search(r'origin="([^"]*)" target="([^"]*)"', xml).groups()
        origin, target = (np.array(text.split(","), float) for text in lookat)
        points = closed_mesh((tmp_path / "one.scene.ply").read_bytes(), "ply")[0] - origin
        ahead = (target - origin) / np.linalg.norm(target - origin)
        right = np.cross(ahead, [0, 0, 1])
        right /= np.linalg.norm(right)
        depth = points @ ahead
        seen = np.abs(np.stack([points @ right, points @ np.cross(right, ahead)]) / depth) / np.tan(np.radians(17))
        assert depth.min() > 0 and seen.max() == pytest.approx(0.8, abs=0.002)


def test_sharp_edges_of_a_mesh_stay_sharp(call, tmp_path):
    """Normals of a cube are those of its faces; those of a ball lean from its triangles, and no vertex is there twice."""
    for body, most, count in ((trimesh.creation.box(), 0.0, 24), (trimesh.creation.icosphere(3), 6.0, 642)):
        path = mesh(tmp_path / "mine.ply", body.vertices, body.faces)
        assert call("new", "wax", "--mesh", path, "--unit", "cm", "-o", tmp_path / "one.yaml", "--overwrite")[0] == 0
        shown = trimesh.load(tmp_path / "one.scene.ply", process=False)
        leans = np.degrees(np.arccos(np.clip(np.sum(shown.vertex_normals[shown.faces] * shown.face_normals[:, None], axis=2),
                                             -1, 1)))
        assert len(shown.vertices) == count and leans.max() == pytest.approx(most, abs=1.0)
        assert len(closed_mesh((tmp_path / "one.scene.ply").read_bytes(), "ply")[0]) == len(body.vertices)


def test_the_unit_of_the_file_and_an_axis_that_points_up(call, tmp_path):
    mesh(tmp_path / "mine.ply", 2 * CORNERS * [1, 2, 1], comments=("units: inch",))
    status, _, err = call("new", "soap", "--mesh", tmp_path / "mine.ply", "--up", "y", "-o", tmp_path / "bar.yaml")
    assert status == 0 and "10.2 cm across: one unit is 1 in, as the file says" in err
    corners = closed_mesh((tmp_path / "bar.scene.ply").read_bytes(), "ply")[0]
    assert np.ptp(corners, axis=0) == pytest.approx([50.8, 50.8, 101.6])


def test_grains_keep_their_size(call, tmp_path):
    """Of a tetrahedron of 1/6 edge^3, filled to 60 % with spheres of 0.25 mm; 3 mm have 41, 3 m have 41 billion."""
    for edge, said in (("3 mm", "some 41 grains, 500 um wide as in the recipe; so few"), ("2 cm", "some 12,000 grains"),
                       ("3 m", "some 41,000 million grains, 500 um wide"),
                       ("1 m", "some 1,500 million grains, 500 um wide as in the recipe; so many")):
        args = "--mesh", mesh(tmp_path / "mine.ply"), "--height", edge, "-o", tmp_path / "heap.yaml", "--overwrite"
        status, _, err = call("new", "sand", *args)
        assert status == 0 and said in err and load(tmp_path / "heap.yaml").grains.radius == 250
    assert "{where: {mesh: heap.scene.ply, unit: 1 m}, recipe: heap.yaml}" in (tmp_path / "heap.scene.yaml").read_text()


@pytest.mark.parametrize(("source", "said", "entry"), [
    ("coefficients", "refractive index 1.33 against air, smooth, ASSUMED",
     "shape: body}, recipe: ../own.yaml, boundary: {index: 1.33}"),
    ("bubbles", "refractive index 1.33", "shape: body}, recipe: ../own.yaml, boundary: {index: 1.33"),
    ("soot", "without a surface, as it floats in air", "mesh: cup.scene.ply, unit: 1 mm}, recipe: ../own.yaml}"),
    ("salt", "grains, ", "mesh: cup.scene.ply, unit: 1 mm}, recipe: ../own.yaml}"),
])
def test_a_recipe_of_ones_own_fills_a_mesh(source, said, entry, call, tmp_path):
    """It stays as it is, and the scene, in another folder, refers to it."""
    assert call("new", source, "-o", tmp_path / "own.yaml")[0] == 0
    before = (tmp_path / "own.yaml").read_bytes()
    (tmp_path / "scenes").mkdir()
    status, out, err = call("new", tmp_path / "own.yaml", "--mesh", mesh(tmp_path / "mine.ply"), "--height", "12 cm",
                            "-o", tmp_path / "scenes" / "cup.yaml")
    assert status == 0 and said in err and entry in (tmp_path / "scenes" / "cup.scene.yaml").read_text(), err
    assert written(tmp_path / "scenes") == ["cup.scene.ply", "cup.scene.xml", "cup.scene.yaml"]
    assert (tmp_path / "own.yaml").read_bytes() == before and len(out.split()) == 3


@pytest.mark.parametrize(("args", "said"), [
    (("tile.yaml", "--mesh", "good.ply"), "tile.yaml: found a recipe without a medium, particles or packed grains"),
    (("milk", "--mesh", "missing.ply"), "missing.ply: cannot be read: No such file"),
    (("milk", "--mesh", "empty.obj"), "empty.obj: the file is empty"),
    (("milk", "--mesh", "open.ply"), "open.ply: no closed mesh: not closed: face"),
    (("milk", "--mesh", "point.ply"), "whose vertices are all in one place"),
    (("milk", "--mesh", "nan.ply"), "no finite numbers"),
    (("milk", "--mesh", "inf.ply"), "no finite numbers"),
    (("milk", "--mesh", "mine.txt"), "found a name that ends in .txt; expected a mesh in a file of PLY"),
    (("milk", "--mesh", "good.ply", "--unit", "km", "--height", "2 m"), "each sets the size of the mesh"),
    (("milk", "--mesh", "good.ply", "--unit", "yard"), '--unit: found "yard"; expected um, mm, cm, m, km, in, ft'),
    (("milk", "--mesh", "good.ply", "--height", "12"), "has no unit"),
    (("milk", "--mesh", "good.ply", "--height", "0 m"), "a length above 0"),
    (("milk", "--mesh", "good.ply", "--height", "1 um"), "found a mesh 1 um across; expected 100 um to 10 km"),
    (("milk", "--mesh", "huge.ply", "--unit", "km"), "expected 100 um to 10 km"),
    (("milk", "--mesh", "huge.ply"), "found a mesh 1e+06 units across and no unit"),
    (("sand", "--mesh", "good.ply", "--height", "0.4 mm"), "at its narrowest, and grains are 500 um wide"),
    (("mlk", "--mesh", "good.ply"), "which fills no mesh (milk?)"),
    (("fog", "--mesh", "good.ply"), "which fills no mesh: fog takes --mitsuba SCENE.xml"),
    (("milk", "--mitsuba", "street.xml"), "milk takes --mesh FILE"),
    (("fog", "--mitsuba", "missing.xml"), "there is no such .xml file"),
    (("fog", "--mitsuba", "good.ply"), "there is no such .xml file"),
    (("fog", "--mitsuba", "a.xml", "--mesh", "good.ply"), "found both"),
    (("milk", "--unit", "mm"), "--unit: found without --mesh"),
    (("--mesh", "good.ply"), "found no KIND"),
    (("wax", "--mesh", "good.ply"), "wax.scene.yaml: exists already"),
])
def test_what_cannot_start_a_scene_is_told(args, said, call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mesh(tmp_path / "good.ply")
    mesh(tmp_path / "open.ply", faces=TETRAHEDRON[:3])
    mesh(tmp_path / "huge.ply", 1e6 * CORNERS)
    mesh(tmp_path / "point.ply", 0 * CORNERS)
    mesh(tmp_path / "nan.ply", CORNERS * np.nan)
    mesh(tmp_path / "inf.ply", [[np.inf, 0, 0], *CORNERS[1:]])
    for name in ("empty.obj", "mine.txt", "wax.scene.yaml"):
        (tmp_path / name).write_text("")
    (tmp_path / "tile.yaml").write_text((ROOT / "recipes" / "tile.yaml").read_text())
    before = written(tmp_path)
    status, out, err = call("new", *args)
    assert status == 2 and not out and said in err and len(err.splitlines()) == 1 and written(tmp_path) == before


@pytest.mark.parametrize(("light", "where"), [("constant", "{box: {lo: ["), ("point", "everywhere")])
def test_fog_is_as_thick_as_a_scene_is_deep(light, where, call, tmp_path, monkeypatch):
    """A wall 14 units of 2.54 cm away: half of its contrast is left, but fog is never thicker than for 10 m of visibility."""
    needs_mitsuba()
    monkeypatch.chdir(tmp_path)
    second = '<sensor type="perspective"/>' * (light == "point")
    (tmp_path / "street.xml").write_text((STREET % light).replace("</scene>", f"{second}</scene>"))
    for unit, visibility in (("m", "8"), ("in", "10 m")):
        status, _, err = call("new", "fog", "--mitsuba", "street.xml", "--unit", unit, "-o", "mist.yaml", "--overwrite")
        assert status == 0 and f"visibility {visibility}" in err and ("of its 2 sensors the first" in err) == bool(second)
    scene = (tmp_path / "mist.scene.yaml").read_text()
    assert f"where: {where}" in scene and "scene: {mitsuba: street.xml, unit: 25.4 mm}" in scene
    assert written(tmp_path) == ["mist.scene.yaml", "mist.yaml", "street.xml"]


@pytest.mark.parametrize("name", [name if name in ("candle", "winter_evening") else slow(name) for name in scenes()])
def test_scenes_that_ship_are_copied_whole(name, call, tmp_path):
    """What is copied can be loaded far from the sources, recipes, meshes and grids too."""
    from renderers.scene import load as load_scene

    needs_mitsuba()
    assert call("new", name, "-o", tmp_path / "mine.yaml")[0] == 0
    assert call("new", name, "-o", tmp_path / "again.yaml")[0] == 0  # files that both need are there already
    texts = [path.read_text() for path in tmp_path.iterdir() if path.suffix in (".yaml", ".xml")]
    assert not any("../" in re.sub("(?m)^#.*$", "", text) for text in texts)
    scene = load_scene(tmp_path / "mine.yaml")
    assert all(load(scene.file(entry.recipe)).name for entry in scene.materials if entry.recipe)
    named = set(re.findall(r'filename" value="([^"]*)"', "".join(texts)))
    assert named <= set(written(tmp_path))


def test_the_list_has_scenes(call):
    listed = {each["name"]: each for each in json.loads(call("new", "--list", "--json")[1])}
    assert listed["candle"]["scene"] and listed["candle"]["about"] == "A candle that burns." and not listed["wax"]["scene"]
    out = call("new", "--list")[1]
    assert "\n  beach " in out and "milk, whole_milk" in out and out == call("new")[1]


def blocks(kind):
    page = (ROOT / "docs" / "my-mesh.md").read_text()
    return [text for language, text in re.findall(r"^```(\w*)\n(.*?)^```$", page, re.MULTILINE | re.DOTALL) if language == kind]


@pytest.mark.parametrize("render", [False, slow(True)])
def test_the_page_runs(render, call, tmp_path, monkeypatch):
    """Every command of docs/my-mesh.md, in its order; pictures are 16 pixels wide, and quick runs only write the scenes."""
    needs_mitsuba()
    monkeypatch.chdir(tmp_path)
    for text in blocks("python"):
        exec(compile(text, "my-mesh.md", "exec"), {})
    ran = 0
    for block in blocks(""):
        for command, printed in re.findall(r"^\$ bake (.*)\n((?:[^$].*\n)*)", block, re.MULTILINE):
            args = shlex.split(command)
            if args[0] == "render":
                if not render:
                    continue
                size = ["--set", "film.width=16", "--set", "film.height=12", "--set", "stop.time=1 s"]
                status, out, err = call(*args, *size)
                assert status == 0 and "mean" in call(*args, *size, "--json", "--overwrite")[1], err
            else:
                status, out, err = call(*args)
                assert status == (2 if "already" in printed else 0), err
            assert all(line in (out + err).splitlines() for line in printed.splitlines()), out + err
            ran += 1
    assert ran == (10 if render else 7)
