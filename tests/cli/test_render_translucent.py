"""`bake render SCENE.yaml` of translucent bodies as a user calls it: report, layers, resuming, and ways to fail."""

from __future__ import annotations

import json

import numpy as np
import pytest

from bakery.cli import status_of
from bakery.physics.shapes.radial import icosphere
from bakery.store import ply
from renderers import scene
from tests.conftest import ROOT
from tests.exr import layers

RECIPE = """\
bakery: 1
name: {name}
wavelengths: [0.55]
tolerance: 5%
medium: {{albedo: 0.9, mean_free_path: 1 mm, phase: {{type: hg, g: 0}}}}
multiple_scattering: {{extent: {extent}, tolerance: 5%, sources: {sources}}}
"""
SCENE = """\
bakery_scene: 1
name: lit
asset: wax.h5
scene: {mitsuba: lit.xml, unit: 1 mm}
film: {width: 20, height: 16}
stop: {samples: 2, noise: 0.01%}
translucent: {bodies: [{shape: ball}]}
"""
SENSOR = """<sensor type="perspective"><float name="fov" value="34"/><transform name="to_world"><lookat origin="0, -19, 5"
target="0, 0, 0" up="0, 0, 1"/></transform><film type="hdrfilm"><integer name="width" value="20"/>
<integer name="height" value="16"/></film></sensor>"""
XML = f"""<scene version="3.0.0">{SENSOR}
<shape type="ply" id="ball"><string name="filename" value="ball.ply"/><bsdf type="null"/></shape>
<shape type="ply" id="far"><string name="filename" value="far.ply"/><bsdf type="null"/></shape>
<shape type="ply" id="open"><string name="filename" value="open.ply"/><bsdf type="null"/></shape>
<shape type="ply" id="matt"><string name="filename" value="far.ply"/><bsdf type="diffuse"/></shape>
<shape type="sphere" id="round"><point name="center" x="0" y="90" z="0"/><bsdf type="null"/></shape>
<shape type="rectangle" id="panel"><transform name="to_world"><scale value="5"/><rotate x="1" angle="180"/>
<translate x="3" y="-3" z="13"/></transform><emitter type="area"><rgb name="radiance" value="4 4 4"/></emitter></shape></scene>"""


@pytest.fixture(scope="module")
def assets(tmp_path_factory):
    folder = tmp_path_factory.mktemp("assets")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BAKERY_CACHE", str(folder / "cache"))
        for name, extent, sources, more in (("wax", 12, "[point, segment]", ()), ("short", 2, "[point, segment]", ()),
                                            ("points", 2, "[point]", ()), ("bare", 2, "[point]", ("--stage", "medium"))):
            (folder / f"{name}.yaml").write_text(RECIPE.format(name=name, extent=extent, sources=sources))
            assert status_of([str(folder / f"{name}.yaml"), "-o", str(folder / f"{name}.h5"), "--quiet", *more]) == 0
    return folder


@pytest.fixture
def place(assets, tmp_path):
    for name in ("wax.h5", "short.h5", "points.h5", "bare.h5"):
        (tmp_path / name).symlink_to(assets / name)
    vertices, faces = icosphere(80)
    (tmp_path / "ball.ply").write_bytes(ply.mesh(5 * vertices, faces, single=True))
    (tmp_path / "far.ply").write_bytes(ply.mesh(vertices + [0, 90, 0], faces, single=True))
    (tmp_path / "open.ply").write_bytes(ply.mesh(vertices + [0, 90, 0], faces[:-1], single=True))
    (tmp_path / "s.yaml").write_text(SCENE)
    (tmp_path / "lit.xml").write_text(XML)
    return tmp_path


def rendered(call, place, name, *settings, options=()):
    """Report and layers of a render that works."""
    status, out, err = call("render", place / "s.yaml", "-o", place / f"{name}.png", "--json", *options,
                            *(part for setting in settings for part in ("--set", setting)))
    assert status == 0, err
    return json.loads(out), layers(place / f"{name}.exr")


def picture(found, name=""):
    return np.stack([found[f"{name}{c}"] for c in "RGB"], axis=-1).astype(float)


def test_report_and_layers(call, place):
    report, found = rendered(call, place, "a", "asset=short.h5")
    assert report["renderer"] == "translucent" and report["method"] == "vrl+tables" and report["size"] == [20, 16]
    assert report["passes"] == {"few": 2, "beams": 2} and {"scene", "preparation", "passes", "total"} <= report["seconds"].keys()
    assert any("the tables of ball end at 2 mean free paths, and it is 1" in said for said in report["reasons"])
    orders = [picture(found, f"{name}.") for name in ("order0", "order1", "order2", "orders")]
    assert np.allclose(sum(orders), picture(found), rtol=1e-5, atol=1e-6) and all(one.any() for one in orders[1:])
    assert np.isfinite(picture(found)).all() and (found["noise.Y"] >= 0).all() and "closer.R" in found


@pytest.mark.slow
@pytest.mark.parametrize("method", ["paths", "vrl", "vrl+tables"])
def test_going_on_is_as_not_having_stopped(call, place, method):
    method = f"translucent.method={method}"
    more = "stop={samples: 64, noise: 0.01%}" if "=paths" in method else "stop={samples: 4, noise: 0.01%}"
    straight = picture(rendered(call, place, "a", method, more)[1])
    begun = rendered(call, place, "b", method)[0]
    report, resumed = rendered(call, place, "b", method, more, options=("--resume",))
    assert report["samples"] == 2 * begun["samples"]
    assert np.allclose(picture(resumed), straight, rtol=1e-5, atol=1e-6)
    other = picture(rendered(call, place, "c", method, options=("--seed", "1"))[1])
    assert not np.array_equal(other, picture(rendered(call, place, "d", method)[1]))


@pytest.mark.parametrize("setting, said", [
    ("translucent.bodies[0].shape=wax", "expected the id of a shape of the Mitsuba scene: ball, far, matt, open, panel, round"),
    ("translucent.bodies[0].shape=round", "round is no mesh; a closed mesh would do"),
    ("translucent.bodies[0].shape=open", "open is no closed mesh: "),
    ("translucent.bodies[0].shape=matt", "the BSDF of matt lets no light in; dielectric, roughdielectric or null would do"),
    ("translucent.bodies[0].boundary={index: 1.4}", "boundary.index: found 1.4, and the BSDF of ball has 1"),
    ("translucent={bodies: [{shape: ball}], method: paths, boundary: none}", "found a boundary of tables, which method paths"),
    ("translucent.method=magic", "expected auto, paths"),
    ("asset=bare.h5", "no stage 'multiple'"),
    ("asset=points.h5", "no tables of segments"),
    ("translucent.bodies=[{shape: ball, recipe: gone.yaml}]", 'recipe: found "gone.yaml"'),
    ("translucent.bodies=[]", "at least 1"),
    ("film.wavelengths=rgb", "found a key that translucent does not use"),
])
def test_what_is_refused(call, place, setting, said):
    status, out, err = call("render", place / "s.yaml", "-o", place / "x.png", "--set", setting)
    assert status and not out and said in err and "Traceback" not in err and not (place / "x.png").exists(), err


def test_an_open_mesh_is_named_with_its_place(call, place):
    err = call("render", place / "s.yaml", "-o", place / "x.png", "--set", "translucent.bodies[0].shape=open")[2]
    assert "face" in err and "edge" in err


SHIPPED = sorted(path for path in (ROOT / "assets/scenes").glob("*.yaml") if "\ntranslucent:" in path.read_text())


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_scenes_are_understood(path):
    loaded = scene.load(path)
    assert loaded.section == "translucent" and loaded.values.stop.time and loaded.values.translucent.bodies


INTEGRATOR = """<integrator type="bakery_translucent"><string name="body.ball" value="wax.h5"/>
<float name="unit" value="0.001"/></integrator>"""


@pytest.mark.slow
def test_the_integrator_makes_the_same_picture(call, place):
    """With the scene in YAML and its seed: what `mi.render` gives, and what the film holds."""
    import renderers.translucent.plugin  # noqa: F401
    import mitsuba as mi  # isort: skip

    (place / "plugin.xml").write_text(XML.replace("</scene>", f"{INTEGRATOR}</scene>"))
    expected = picture(rendered(call, place, "a", options=("--seed", "3"))[1])
    mi.set_variant("llvm_ad_rgb")
    loaded = mi.load_file(str(place / "plugin.xml"), optimize=False)
    found = np.array(mi.render(loaded, spp=2, seed=3))
    assert np.array_equal(found, expected.astype(np.float32))
    assert np.array_equal(np.array(loaded.sensors()[0].film().bitmap())[..., :3], found)


@pytest.mark.parametrize("old, new, said", [
    ('<string name="body.ball" value="wax.h5"/>', "", 'no body; <string name="body.ID"'),
    ("wax.h5", "bare.h5", "no stage 'multiple'"),
    ("body.ball", "body.wax", "body.wax: found 'wax'; expected the id of a shape"),
    ('<float name="unit" value="0.001"/>', '<string name="method" value="magic"/>', 'method: found "magic", expected auto'),
    ('"0.001"', '"-1"', "unit: found -1"),
])
def test_what_the_integrator_refuses(call, place, old, new, said):
    (place / "plugin.xml").write_text(XML.replace("</scene>", f"{INTEGRATOR.replace(old, new)}</scene>"))
    status, out, err = call("render", place / "plugin.xml", "-o", place / "x.png")
    assert status and not out and said in err and "Traceback" not in err and not (place / "x.png").exists(), err


@pytest.mark.slow
def test_what_is_the_quickest(call, place):
    """Of a ball of ten mean free paths: paths and tables agree in the mean, noise of paths falls as their rate says, and a second
    call renders nothing."""
    words = ("trade", place / "s.yaml", "--json", "--methods", "paths,vrl+tables,dipole", "--tolerance", "10%")
    status, out, err = call(*words, "--budget", "0.2")
    assert status == 0, err
    found = json.loads(out)
    paths, *others = found["methods"]
    assert next(one["stated_bias"] for one in others if one["name"] == "dipole") is None  # which nobody states
    assert found["reference"] == paths["name"] == "paths" and {one["name"] for one in others} == {"vrl+tables", "dipole"}
    tables = next(one["difference"] for one in others if one["name"] == "vrl+tables")
    assert abs(tables["bias"]) < 4.5 * tables["bias_error"] + 0.05  # 7e-6, and the tables' own error
    assert paths["pace"]["rate"] == pytest.approx(paths["noise"] ** 2 * paths["pace"]["passes"])
    assert found["trade"]["advised"]["name"] in ("paths", "vrl+tables", "dipole")
    status, out, err = call(*words, "--budget", "0.2")
    again = json.loads(out)
    assert status == 0 and all(one["taken"] for one in again["methods"]) and again["trade"] == found["trade"]
