"""`--scene` as a user gives it: stages, knobs and reasons, in plans, bakes and renders."""

import json

import pytest

import bakery
from bakery.physics.shapes.radial import icosphere
from bakery.store import ply
from renderers.scene import assets, load
from tests import adversarial, exr

RECIPE = """\
bakery: 1
name: {name}
wavelengths: [0.55]
tolerance: 5%
medium: {{albedo: 0.9, mean_free_path: {path}, phase: {{type: hg, g: 0.2}}}}
"""
TABLES = "multiple_scattering: {tolerance: 5%}\n"
SCENE = """\
bakery_scene: 2
name: lit
tolerance: 20%
scene: {mitsuba: lit.xml, unit: 1 mm}
stop: {samples: 1}
method: vrl+tables
materials: [{where: {shape: ball}, recipe: wax.yaml}]
"""
AUTO = SCENE.replace("method: vrl+tables\n", "")
ENTRY = "{where: {shape: ball}, recipe: wax.yaml}"
FOG = """\
bakery_scene: 2
name: foggy
asset: wax.h5
picture: {mitsuba: lit.xml, unit: 1 mm, far: 80 mm}
fog: {density: {type: uniform}}
"""
SENSOR = """<sensor type="perspective"><float name="fov" value="34"/><transform name="to_world"><lookat origin="0, -19, 5"
target="0, 0, 0" up="0, 0, 1"/></transform><film type="hdrfilm"><integer name="width" value="8"/>
<integer name="height" value="6"/></film></sensor>"""
XML = f"""<scene version="3.0.0">{SENSOR}<shape type="ply" id="ball"><string name="filename" value="ball.ply"/><bsdf type="null"/>
</shape>LIGHT</scene>"""


@pytest.fixture
def place(tmp_path):
    """A ball of 10 mm under an even sky; a recipe that is 0.1 of a mean free path deep in it, and one that is 20."""
    vertices, faces = icosphere(80)
    (tmp_path / "ball.ply").write_bytes(ply.mesh(5 * vertices, faces, single=True))
    lit(tmp_path)
    for name, path in (("wax", "0.5 mm"), ("haze", "100 mm")):
        (tmp_path / f"{name}.yaml").write_text(RECIPE.format(name=name, path=path))
    (tmp_path / "s.yaml").write_text(SCENE)
    (tmp_path / "fog.yaml").write_text(FOG)
    return tmp_path


def lit(place, light='<emitter type="constant"><rgb name="radiance" value="1 1 1"/></emitter>'):
    (place / "lit.xml").write_text(XML.replace("LIGHT", light))


def needs(call, recipe, *words):
    """Stages of a plan, what scenes say of each, and of their knobs."""
    status, out, err = call("plan", recipe, *words, "--json")
    assert status == 0, err
    (plan,) = json.loads(out)
    return ([step["stage"] for step in plan["steps"]], {one["stage"]: one for one in plan["needs"]},
            {knob["key"]: knob["value"] for one in plan["needs"] for knob in one["knobs"]}, err)


def test_the_depth_of_a_body_decides(call, place):
    """Tables for a method that reads them; none without light, nor for `auto` where paths find all lights."""
    stages, said, knobs, err = needs(call, place / "wax.yaml", "--scene", place / "s.yaml")
    assert stages == ["medium", "multiple"] and "multiple, because" in err
    assert "optical depth" in said["multiple"]["why"] and knobs["multiple_scattering.orders"] == "16"
    (place / "wax.yaml").write_text((place / "wax.yaml").read_text() + TABLES)
    (place / "s.yaml").write_text(AUTO)
    stages, said, knobs, err = needs(call, place / "wax.yaml", "--scene", place / "s.yaml")
    assert stages == ["medium"] and not said["multiple"]["needed"] and "no multiple, paths find all lights" in err
    assert "leave  multiple not needed: paths find all lights" in call("plan", place / "wax.yaml", "--scene", place / "s.yaml")[1]
    point = '<emitter type="point"><point name="position" value="0, -9, 9"/><rgb name="intensity" value="9"/></emitter>'
    for boundary, tabled in (("null", False), ("dielectric", True)):
        lit(place, point)
        (place / "lit.xml").write_text((place / "lit.xml").read_text().replace('"null"', f'"{boundary}"'))
        assert needs(call, place / "wax.yaml", "--scene", place / "s.yaml")[1]["multiple"]["needed"] == tabled
    for light in ("", '<emitter type="constant"><rgb name="radiance" value="0"/></emitter>',
                  '<emitter type="point"><point name="position" value="0, -9, 9"/><rgb name="intensity" value="0"/></emitter>'):
        lit(place, light)
        stages, said, _, _ = needs(call, place / "wax.yaml", "--scene", place / "s.yaml")
        assert stages == ["medium"] and "black" in said["multiple"]["why"]
    assert call("render", place / "s.yaml")[0] == 0 and not exr.layers(place / "lit.exr")["G"].any()


@pytest.mark.slow
def test_several_scenes_and_what_is_set_by_hand(call, place):
    """The union; a value that is set wins; what no scene decides stays as the recipe has it, and the plan says so."""
    both = ("--scene", place / "s.yaml", "--scene", place / "fog.yaml")
    stages, said, knobs, _ = needs(call, place / "wax.yaml", *both)
    assert stages == ["medium", "multiple", "beam"] and 190 < float(knobs["beam.depth"]) < 210
    status, out, _ = call("plan", place / "wax.yaml", *both, "--set", "beam.depth=3", "--set", "multiple_scattering={orders: 8}")
    assert status == 0 and "as the recipe has it: beam.photons" in out and "needed: " in out
    assert said["multiple"]["why"].endswith(" (s.yaml)") and said["beam"]["why"].endswith(" (fog.yaml)")
    (place / "fog.yaml").write_text(FOG.replace("uniform", "uniform, scale: 100"))
    _, said, _, _ = needs(call, place / "wax.yaml", *both)
    assert "tables end at 1000" in said["beam"]["lacking"]


@pytest.mark.parametrize("tolerance, text, lacking", [("50%", "10%", ""), ("0.01%", "0.1%", "reaches 0.3 % at g = 0.9, ")])
def test_tolerances_at_the_ends(call, place, tolerance, text, lacking):
    (place / "s.yaml").write_text(SCENE.replace("20%", tolerance))
    _, said, knobs, _ = needs(call, place / "wax.yaml", "--scene", place / "s.yaml")
    assert knobs["multiple_scattering.tolerance"] == text and lacking in said["multiple"]["lacking"]
    assert bool(lacking) == bool(said["multiple"]["lacking"])


def test_a_scene_that_cannot_be_measured(call, place):
    """Its stages with the recipe's knobs; what is wrong is said."""
    (place / "s.yaml").write_text(SCENE.replace("shape: ball", "shape: bowl"))
    stages, said, knobs, err = needs(call, place / "wax.yaml", "--scene", place / "s.yaml")
    assert stages == ["medium", "multiple"] and not knobs and "found 'bowl', which is no mesh" in err
    assert "expected the id of one: ball" in err
    (place / "s.yaml").write_text(SCENE.replace("lit.xml", "gone.xml"))
    assert "there is no such file" in needs(call, place / "wax.yaml", "--scene", place / "s.yaml")[3]


@pytest.mark.parametrize("old, new, said", [
    ("stop:", "stopp: {}\nstop:", "unknown key"),
    ("tolerance: 20%", "tolerance: 120%", "at most 1"),
    ("tolerance: 20%", "tolerance: 1e-300", "at least 1e-06"),
    ("name: lit", "name: lit\nname: lit", "a second time")])
def test_a_scene_that_is_wrong_is_refused(call, place, old, new, said):
    """Where only files or keys are still to come the stages are baked; a mistake is told, as `bake render` tells it."""
    (place / "s.yaml").write_text(SCENE.replace(old, new, 1))
    for words in ((place / "wax.yaml", "-o", place / "wax.h5"), ("plan", place / "wax.yaml")):
        status, out, err = call(*words, "--scene", place / "s.yaml")
        assert status == 2 and said in err and "s.yaml:" in err and "Traceback" not in err, err
    assert not (place / "wax.h5").exists()


@pytest.mark.parametrize("name", ["lit.exr", "wax.h5", "", "."])
def test_what_is_no_scene_is_refused(call, place, name):
    (place / "lit.exr").write_bytes(b"v/1")
    (place / "wax.h5").write_bytes(b"HDF")
    status, _, err = call("plan", place / "wax.yaml", "--scene", place / name if name else "")
    assert status == 2 and "scene" in err and "NAME.yaml" in err


def test_a_scene_that_cannot_be_rendered_is_told_before_the_bake(call, place):
    (place / "lit.xml").write_text((place / "lit.xml").read_text().replace(SENSOR, ""))
    status, _, err = call("render", place / "s.yaml")
    assert status == 2 and "sensor" in err and not (place / "wax.h5").exists()


@pytest.mark.parametrize("scene, section", [
    ("where: {mesh: ball.ply, unit: 1 mm}, as: grains", "grains and no section packing"),
    ("where: {box: {lo: [0, 0, 0] m, hi: [1, 1, 1] m}}, as: particles", "discrete")])
def test_recipes_without_a_section_that_a_scene_needs(call, place, scene, section):
    (place / "s.yaml").write_text(AUTO.replace("where: {shape: ball}", scene))
    for words in (("plan", place / "wax.yaml", "--scene", place / "s.yaml"), ("render", place / "s.yaml")):
        status, _, err = call(*words)
        assert status == 2 and f"has no section {section}, which {place / 's.yaml'} needs" in err and "--set" not in err, err


def test_what_a_body_says_is_held_against_its_shape(call, place):
    """Before anything is baked: an index that its BSDF has not, and a shape that is another body's already."""
    (place / "s.yaml").write_text(SCENE.replace("{shape: ball}", "{shape: ball}, boundary: {index: 1.3}"))
    assert "found 1.3, and the BSDF of ball has 1; the same" in needs(call, place / "wax.yaml", "--scene", place / "s.yaml")[3]
    status, _, err = call("render", place / "s.yaml")
    assert status == 2 and "s.yaml:7: materials[0].boundary.index" in err and not (place / "wax.h5").exists()
    (place / "s.yaml").write_text(SCENE.replace(ENTRY, f"{ENTRY}, {ENTRY}"))
    status, _, err = call("render", place / "s.yaml")
    assert status == 2 and 'found "ball", which is materials[0] already' in err and "s.yaml:7" in err


def test_a_scene_of_another_material_is_taken_for_this_one(call, place):
    (place / "s.yaml").write_text(SCENE.replace("wax", "haze"))
    stages, _, _, err = needs(call, place / "wax.yaml", "--scene", place / "s.yaml")
    assert stages == ["medium", "multiple"] and f"no material uses {place / 'wax.yaml'}; it is taken for all" in err
    assert "taken for all" not in needs(call, place / "haze.yaml", "--scene", place / "s.yaml")[3]


def test_an_asset_that_a_scene_left_without_tables(call, place):
    """The recipe has the section: what helps is to bake it for the scene that needs the stage."""
    (place / "s.yaml").write_text(AUTO)
    assert call(place / "wax.yaml", "-o", place / "wax.h5", "--scene", place / "s.yaml")[0] == 0
    (place / "s.yaml").write_text(SCENE.replace("recipe: wax.yaml", "asset: wax.h5"))
    status, _, err = call("render", place / "s.yaml")
    assert status == 2 and f"bake RECIPE --scene SCENE -o {place / 'wax.h5'}" in err


@pytest.mark.parametrize("first, second", [("recipe: wax.yaml", "recipe: b/wax.yaml"), ("recipe: b/wax.yaml", "asset: wax.h5")])
def test_bodies_of_two_recipes_never_share_an_asset(call, place, first, second):
    """Both are called wax: each body has the medium of its own recipe, and the asset that stands stays."""
    (place / "b").mkdir()
    (place / "b" / "wax.yaml").write_text(RECIPE.format(name="wax", path="100 mm"))
    assert call(place / "wax.yaml", "-o", place / "wax.h5")[0] == 0
    before = (place / "wax.h5").read_bytes()
    ball = XML[XML.index("<shape"):XML.index("LIGHT")]
    two = (place / "lit.xml").read_text().replace("</scene>", ball.replace("ball", "other", 1) + "</scene>")
    (place / "lit.xml").write_text(two)
    both = f"{{where: {{shape: ball}}, {first}}}, {{where: {{shape: other}}, {second}}}"
    (place / "s.yaml").write_text(AUTO.replace(ENTRY, both))
    scene = assets.baked(load(place / "s.yaml"))
    paths = [0.1 if "b/" in one else 5e-4 for one in (first, second)]
    assert [1 / float(bakery.open(asset).medium.sigma_t[0]) for asset in scene.assets] == pytest.approx(paths)
    assert (place / "wax.h5").read_bytes() == before


PLUGIN = XML.replace("LIGHT", """<integrator type="bakery_translucent"><string name="ball" value="wax.h5"/></integrator>""")


def test_scenes_of_mitsuba_with_plugins(call, place):
    """Stages of the integrator's renderer; the asset that it names is baked again, and never counts as what the bake reads."""
    (place / "t.xml").write_text(PLUGIN)
    (place / "wax.h5").write_bytes(b"")
    words = (place / "wax.yaml", "-o", place / "wax.h5", "--scene", place / "t.xml", "--depfile", place / "wax.d", "--overwrite")
    for settings in ((), (), ("--set", "medium.albedo=0.5")):
        status, _, err = call(*words, *settings)
        assert status == 0, err
    assert set(bakery.open(place / "wax.h5").stages) == {"medium", "multiple"}
    assert "t.xml" in (place / "wax.d").read_text() and (place / "wax.d").read_text().count("wax.h5") == 1  # the target
    (place / "t.xml").write_text("<scene")
    status, _, err = call(*words)
    assert status == 2 and "t.xml: cannot be read as a Mitsuba scene" in err


def test_a_tolerance_by_hand_wins_over_the_scene(call, place):
    words = (place / "wax.yaml", "-o", place / "wax.h5", "--scene", place / "s.yaml", "--tolerance", "3%")
    (plan,) = json.loads(call("plan", *words, "--json")[1])
    assert not {knob["key"] for one in plan["needs"] for knob in one["knobs"]} & {"tolerance", "multiple_scattering.tolerance"}
    assert call(*words)[0] == 0 and bakery.open(place / "wax.h5").multiple.attributes["tolerance"] == 0.03


def test_machines_are_told_what_the_screen_says(call, place):
    """Needs, keys that stay as the recipe has them, and remarks, of plans and of bakes."""
    (place / "s.yaml").write_text(SCENE.replace("samples: 1", "samples: 1, noise: 19.9%"))
    words = (place / "wax.yaml", "-o", place / "wax.h5", "--scene", place / "s.yaml", "--json")
    (plan,) = json.loads(call("plan", *words)[1])
    status, out, err = call(*words)
    assert status == 0, err
    (baked,) = json.loads(out)
    assert baked["needs"] == plan["needs"] and baked["remarks"] == plan["remarks"]
    assert needs(call, place / "wax.yaml", "--scene", place / "fog.yaml")[1]["beam"]["as_recipe"] == ["beam.photons"]
    (remark,) = plan["remarks"]
    assert "noise (stop.noise) of 19.9 % leaves too little" in remark and remark in err


def test_what_is_set_by_hand_is_shown_as_such(call, place):
    words = (place / "wax.yaml", "--scene", place / "s.yaml", "--set", "multiple_scattering.orders=8")
    assert "multiple_scattering.orders 8: set by hand" in call("plan", *words)[1]
    (plan,) = json.loads(call("plan", *words, "--json")[1])
    knobs = {knob["key"]: knob for one in plan["needs"] for knob in one["knobs"]}
    assert knobs["multiple_scattering.orders"]["value"] == "8"


def test_depfiles_name_what_scenes_are_made_of(call, place):
    words = (place / "wax.yaml", "-o", place / "wax.h5", "--scene", place / "s.yaml", "--depfile", place / "wax.d")
    assert call(*words)[0] == 0
    named = {word.rsplit("/", 1)[-1] for word in (place / "wax.d").read_text().split()}
    assert named >= {"wax.yaml", "s.yaml", "lit.xml", "ball.ply"}
    status, _, err = call(place / "wax.yaml", "-o", place / "lit.xml", "--scene", place / "s.yaml", "--overwrite")
    assert status == 2 and "read by this very call" in err


def test_fog_says_what_its_tables_do_not_reach(call, place):
    """Kernels are within 1.4 % of transport whatever is asked for."""
    for asked, said in (("5%", ""), ("0.5%", "those of fog are within 1.4 %")):
        (place / "fog.yaml").write_text(FOG + f"tolerance: {asked}\n")
        lacking = needs(call, place / "wax.yaml", "--scene", place / "fog.yaml")[1]["beam"]["lacking"]
        assert said in lacking and bool(said) == bool(lacking)


@pytest.mark.slow
def test_a_missing_asset_is_baked_from_the_recipe_beside_it(call, place):
    """With what the scene requires; one that holds all that the recipe asks for is taken as it is."""
    (place / "s.yaml").write_text(AUTO.replace("recipe: wax.yaml", "asset: haze.h5"))
    (place / "haze.yaml").write_text((place / "haze.yaml").read_text() + TABLES)
    status, _, err = call("render", place / "s.yaml")
    assert status == 0, err
    assert set(bakery.open(place / "haze.h5").stages) == {"medium"}
    assert "no multiple, paths find all lights" in err and "auto is paths here" in err
    assert call(place / "haze.yaml", "-o", place / "haze.h5")[0] == 0
    assert call("render", place / "s.yaml")[0] == 0 and set(bakery.open(place / "haze.h5").stages) == {"medium", "multiple"}
    (place / "s.yaml").write_text(SCENE.replace("recipe: wax.yaml", "asset: gone.h5"))
    assert "there is no such file" in call("render", place / "s.yaml")[2]


@pytest.mark.slow
def test_a_changed_scene_bakes_what_it_must(call, place):
    asset = place / "wax.h5"
    words = (place / "wax.yaml", "-o", asset, "--scene", place / "s.yaml")
    assert call(*words)[0] == 0 and set(bakery.open(asset).stages) == {"medium", "multiple"}
    (place / "s.yaml").write_text(SCENE.replace("20%", "2%"))
    status, out, _ = call("plan", *words)
    assert status == 0 and "multiple_scattering.tolerance: 0.1 -> 0.0" in out and "reuse  medium" in out
    (place / "s.yaml").write_text(AUTO)
    assert call(*words)[0] == 0 and set(bakery.open(asset).stages) == {"medium", "multiple"}, "tables are nothing to throw away"
    assert call(*words, "--force")[0] == 2 and set(bakery.open(asset).stages) == {"medium", "multiple"}
    assert call(*words, "--force", "--overwrite")[0] == 0 and set(bakery.open(asset).stages) == {"medium"}


HARD = {"discrete": "one bright particle", "granular": "thin layer of grains"}
KNOB = {"discrete": "discrete.tolerance", "granular": "scatterometer.tolerance"}


@pytest.mark.slow
@pytest.mark.parametrize("renderer, tolerance, text, lacking", [
    ("discrete", "50%", "5.36%", ""), ("discrete", "0.01%", "0.1%", "47 times as much"),
    ("granular", "50%", "15.3%", ""), ("granular", "0.01%", "0.04%", "6.5 times as much")])
def test_tolerances_at_the_ends_of_grains_and_particles(call, tmp_path, renderer, tolerance, text, lacking):
    path = adversarial.write(adversarial.CASES[HARD[renderer]], tmp_path)
    path.write_text(path.read_text().replace("tolerance: 10%", f"tolerance: {tolerance}"))
    _, said, knobs, _ = needs(call, tmp_path / "material.yaml", "--scene", path)
    stage = {"discrete": "discrete", "granular": "grains"}[renderer]
    assert knobs[KNOB[renderer]] == text and lacking in said[stage]["lacking"] and bool(lacking) == bool(said[stage]["lacking"])


@pytest.mark.slow
@pytest.mark.parametrize("renderer, text", [("discrete", "30%"), ("granular", "50%")])
def test_without_light_the_least_is_asked_for(call, tmp_path, renderer, text):
    """An empty world: nothing shines, nothing is there but the material."""
    path = adversarial.write(adversarial.CASES[HARD[renderer]]._replace(world=""), tmp_path)
    _, _, knobs, _ = needs(call, tmp_path / "material.yaml", "--scene", path)
    assert knobs[KNOB[renderer]] == text


@pytest.mark.slow
def test_fog_in_an_empty_world(call, tmp_path):
    """Its depth is that of the way to `far`; the picture is black."""
    path = adversarial.write(adversarial.CASES["fog, grazing"]._replace(world=""), tmp_path)
    path.write_text(path.read_text().replace("type: height, scale: 4, base: -0.5 m, falloff: 0.1 m", "type: uniform"))
    assert needs(call, tmp_path / "material.yaml", "--scene", path)[2]["beam.depth"] == "18.75"
    status, out, err = call("render", path, "--json")
    assert status == 0 and json.loads(out)["mean"] == [0, 0, 0], err


@pytest.mark.slow
def test_each_of_three_recipes_goes_by_its_own_bodies(call, tmp_path):
    """Exact balls have no facets; the nearer of two heaps of boxes has more of them."""
    near_by = adversarial.CASES["distant heap"]._replace(view=adversarial.CASES["one grain"].view, fov=40, size=(120, 160))
    path = adversarial.write(near_by, tmp_path)
    own = (tmp_path / "material.yaml").read_text()
    for name, shape in (("balls", "sphere"), ("near", "box"), ("far", "box")):
        text = own.replace("name: material", f"name: {name}").replace("type: box", f"type: {shape}")
        (tmp_path / f"{name}.yaml").write_text(text)
    heaps = [f"{{where: {{mesh: ball.ply, unit: {unit}}}, recipe: {name}.yaml}}"
              for unit, name in (("1 m", "balls"), ("1.2 mm", "near"), ("10 m", "far"))]
    entry = "{where: {mesh: ball.ply, unit: 10 cm}, recipe: material.yaml}"
    assert entry in path.read_text()
    path.write_text(path.read_text().replace(entry, ", ".join(heaps)))
    asked = [needs(call, tmp_path / f"{name}.yaml", "--scene", path)[2] for name in ("balls", "near", "far")]
    assert "scatterometer.triangles" not in asked[0]
    assert int(asked[1]["scatterometer.triangles"]) > int(asked[2]["scatterometer.triangles"]) == 1300
