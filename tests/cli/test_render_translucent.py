"""`bake render SCENE.yaml` of translucent bodies as a user calls it: report, layers, resuming, and ways to fail."""

import dataclasses
import json
import re

import numpy as np
import pytest

from bakery.cli import status_of
from bakery.physics.shapes.radial import icosphere
from bakery.store import ply
from renderers import choice
from renderers.scene import candidates, entries
from tests.conftest import slow
from tests.renders import picture, refused, rendered

RECIPE = """\
bakery: 1
name: {name}
wavelengths: [0.55]
tolerance: 5%
medium: {{albedo: 0.9, mean_free_path: 1 mm, phase: {{type: hg, g: 0}}}}
multiple_scattering: {{extent: {extent}, tolerance: 5%, sources: {sources}}}
"""
SCENE = """\
bakery_scene: 2
name: lit
scene: {mitsuba: lit.xml, unit: 1 mm}
film: {width: 20, height: 16}
stop: {samples: 2}
materials:
  - {where: {shape: ball}, asset: wax.h5}
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


@pytest.mark.slow
def test_no_bias_is_without_a_reason(call, place):
    """Of a method without an error of its own it is 0; without pixels that share, it is unknown with tables, and that is said."""
    settings = "materials[0].asset=short.h5", "film.width=1", "stop={samples: 1}"
    report, _ = rendered(call, place, "a", "materials[0].method=paths", *settings)
    assert report["bias"] == 0 and not report["left_out"]
    report, _ = rendered(call, place, "b", "materials[0].method=vrl+tables", *settings)
    assert report["bias"] is None and any("by which the bias of vrl+tables is measured" in said for said in report["reasons"])


def test_report_and_layers(call, place):
    report, found = rendered(call, place, "a", "materials[0].asset=short.h5", "materials[0].method=vrl+tables")
    assert report["renderer"] == "translucent" and report["method"] == "vrl+tables" and report["size"] == [20, 16]
    assert report["passes"] == {"few": 2, "beams": 2} and {"scene", "preparation", "passes", "total"} <= report["seconds"].keys()
    assert any("the tables of ball end at 2 mean free paths, and it is 1" in said for said in report["reasons"])
    orders = [picture(found, f"{name}.") for name in ("order0", "order1", "order2", "orders")]
    estimate = picture(found, "signed." if "signed.R" in found else "")
    assert np.allclose(sum(orders), estimate, rtol=1e-5, atol=1e-6) and all(one.any() for one in orders[1:])
    assert np.isfinite(picture(found)).all() and (found["noise.Y"] >= 0).all() and "closer_even.R" in found


@pytest.mark.slow
def test_auto_measures_and_remembers(call, place, monkeypatch):
    """Pilots of both, whose choice the same scene finds again, with the same bytes, and a picture that is gone on with."""
    declared = entries.declared("body")
    auto = dataclasses.replace(declared["auto"], candidates=("paths", "vrl+tables"))
    monkeypatch.setattr(candidates.entries, "declared", lambda kind: declared | {"auto": auto})
    for name, value in (("_LEAST_PIXELS", 1), ("_LEAST_SAMPLES", 1), ("_SHARE", 1e6), ("_LONGEST", 0.1)):
        monkeypatch.setattr(choice, name, value)
    report, _ = rendered(call, place, "a")
    (first, second), (entry,) = entry_pilots(report), report["materials"]
    assert (first["method"], second["method"]) == ("paths", "vrl+tables") and first["seconds"] > 0 and second["seconds"] > 0
    assert first["bias"] == 0 and second["error"] > 0 and first["chosen"] != second["chosen"]
    assert entry["method"] == report["method"] == next(row["method"] for row in (first, second) if row["chosen"])
    assert any("auto is" in line and "by pilots" in line for line in report["reasons"])
    monkeypatch.setattr(choice.trial, "of", None)
    again, _ = rendered(call, place, "b")
    assert entry_pilots(again) == [first, second] and any("of an earlier render" in line for line in again["reasons"])
    assert (place / "a.exr").read_bytes() == (place / "b.exr").read_bytes()
    more, _ = rendered(call, place, "a", "stop={samples: 48, noise: 0.01%}", options=("--resume",))
    assert more["method"] == report["method"] and more["samples"] > report["samples"]


def entry_pilots(report):
    return report["materials"][0]["pilot"]


@pytest.mark.slow
def test_beams_of_negative_power_leave_no_picture_below_0(call, place):
    """Behind glass: 0 in the picture where the estimate is below, which its layer keeps; of 12 seeds the scatter of the means is
    what two passes state, within a factor that 11 and 12 to 24 degrees of freedom leave once in 10,000 runs."""
    (place / "lit.xml").write_text(XML.replace('<bsdf type="null"/>', '<bsdf type="dielectric"/>', 1))
    means, stated, below = [], [], 0
    for seed in range(12):
        report, found = rendered(call, place, "a", "materials[0].method=vrl+tables", options=("--seed", str(seed), "--overwrite"))
        shown = picture(found)
        kept = picture(found, "signed.") if report["below_zero"] else shown  # of few pixels all may be above 0
        below += (kept < 0).any()
        assert np.array_equal(shown, np.maximum(kept, 0))
        assert (kept < 0).any() == bool(report["below_zero"]) and (not report["below_zero"] or report["below_zero"]["raised"] > 0)
        assert (np.stack([found[f"noise.{c}"] for c in "RGB"], axis=-1) >= shown - kept).all()
        means.append(np.mean(kept @ [0.2126, 0.7152, 0.0722]))
        stated.append(report["noise_mean"])
        assert report["noise"] > report["noise_region"] > 0
    assert below > 5
    ratio = np.std(means, ddof=1) / np.mean(means) / np.sqrt(np.mean(np.square(stated)))
    assert 0.15 < ratio < 2.5


@pytest.mark.parametrize("method", ["vrl+tables",
                                    *map(slow, ("auto", "paths", "shells", "vrl", "beams", "dipole", "metropolis",
                                                "metropolis+tables"))])
def test_a_scene_without_light_is_black_and_says_so(call, place, method):
    """Also where a recipe is baked for it, of which no light tells what tables are needed."""
    (place / "lit.xml").write_text(re.sub("<emitter.*?</emitter>", "", XML, flags=re.DOTALL))
    (place / "plain.yaml").write_text(RECIPE.format(name="plain", extent=2, sources="[point]"))
    (place / "s.yaml").write_text(SCENE.replace("asset: wax.h5", "recipe: plain.yaml"))
    report, found = rendered(call, place, "a", f"materials[0].method={method}", "stop={noise: 1%}")
    assert report["method"] == ("paths" if method == "auto" else method) and report["noise"] == 0 and report["mean"] == [0, 0, 0]
    assert report["reasons"] == ["nothing in the scene shines: its picture is black"] and not picture(found).any()


@pytest.mark.slow
@pytest.mark.parametrize("method", ["paths", "vrl", "vrl+tables"])
def test_going_on_is_as_not_having_stopped(call, place, method):
    method = f"materials[0].method={method}"
    more = "stop={samples: 64, noise: 0.01%}" if "=paths" in method else "stop={samples: 4, noise: 0.01%}"
    straight = picture(rendered(call, place, "a", method, more)[1])
    begun = rendered(call, place, "b", method)[0]
    report, resumed = rendered(call, place, "b", method, more, options=("--resume",))
    assert report["samples"] == 2 * begun["samples"]
    assert np.allclose(picture(resumed), straight, rtol=1e-5, atol=1e-6)
    other = picture(rendered(call, place, "c", method, options=("--seed", "1"))[1])
    assert not np.array_equal(other, picture(rendered(call, place, "d", method)[1]))


@pytest.mark.slow
def test_chains_report_and_go_on(call, place, monkeypatch):
    from renderers.transport import metropolis

    monkeypatch.setattr(metropolis, "_FEWEST", 1 << 14)
    settings = "materials[0].method=metropolis", "stop={samples: 200, noise: 0.01%}"
    straight, found = rendered(call, place, "a", *settings)
    begun = rendered(call, place, "b", settings[0], "stop={samples: 100, noise: 0.01%}")[0]
    report, resumed = rendered(call, place, "b", *settings, options=("--resume",))
    assert begun["passes"] == {"metropolis": 2} and report["passes"] == straight["passes"] == {"metropolis": 4}
    assert np.allclose(picture(resumed), picture(found), rtol=1e-5, atol=1e-6)
    chains = straight["chains"]
    assert 0 < chains["large_steps"] < chains["small_steps"] < 1 and 0 < chains["error"] < chains["normalisation"]
    assert any("chains are normalised by the mean luminance" in sentence for sentence in straight["reasons"])


@pytest.mark.slow
def test_states_with_tables_report_and_go_on(call, place, monkeypatch):
    from renderers.materials.bodies import mutations

    monkeypatch.setattr(mutations, "_PATHS", 1 << 12)
    settings = "materials[0].method=metropolis+tables", "stop={samples: 4, noise: 0.01%}"
    straight, found = rendered(call, place, "a", *settings)
    begun = rendered(call, place, "b", settings[0], "stop={samples: 2, noise: 0.01%}")[0]
    report, resumed = rendered(call, place, "b", *settings, options=("--resume",))
    assert set(begun["passes"]) == {"few", "mutations"} and report["passes"] == straight["passes"]
    assert np.allclose(picture(resumed), picture(found), rtol=1e-5, atol=1e-6)
    assert straight["noise"] > 0 and straight["bias"] >= 0


def test_chains_refuse_points_through_glass(call, place):
    in_light_of(place, POINT, GLASS)
    status, _, err = call("render", place / "s.yaml", "-o", place / "x.png", "--set", "materials[0].method=metropolis")
    assert status == 2 and "materials[0].method: method metropolis finds no light of lamps without extent" in err, err
    assert "paths or vrl+tables would do" in err and not (place / "x.png").exists()


def test_a_light_that_is_no_number_is_refused(call, place):
    """In a scene, and in the Mitsuba file by itself."""
    (place / "lit.xml").write_text(XML.replace("4 4 4", "4 nan 4").replace("<sensor", '<integrator type="path"/><sensor'))
    for source in ("s.yaml", "lit.xml"):
        status, _, err = call("render", place / source, "-o", place / "out.png")
        assert status == 2 and "lit.xml: light panel: radiance is 4 nan 4; expected finite numbers" in err
    assert not (place / "out.png").exists()


@pytest.mark.parametrize("setting, said", [
    ("materials[0].where.shape=wax", "expected the id of a shape of the Mitsuba scene: ball, far, matt, open, panel, round"),
    ("materials[0].where.shape=round", "round is no mesh; a closed mesh would do"),
    ("materials[0].where.shape=open", "open is no closed mesh: not closed: face 76 alone has the edge of the vertices"),
    ("materials[0].where.shape=matt", "the BSDF of matt lets no light in; dielectric, roughdielectric or null would do"),
    ("materials[0].boundary={index: 1.4}", "boundary.index: found 1.4, and the BSDF of ball has 1"),
    ("materials=[{where: {shape: ball}, asset: wax.h5, method: paths, boundary: {tables: none}}]",
     "found boundary.tables, which method paths does not use"),
    ("materials[0].method=magic", "expected auto, paths"),
    ("materials=[{where: {shape: ball}, asset: bare.h5, method: vrl+tables}]", "no stage 'multiple'"),
    ("materials=[{where: {shape: ball}, asset: points.h5, method: vrl+tables}]", "no tables of segments"),
    ("materials=[{where: {shape: ball}, recipe: gone.yaml}]", 'recipe: found "gone.yaml"'),
    ("materials=[]", "at least 1"),
    ("film.wavelengths=rgb", "found a key that translucent does not use"),
])
def test_what_is_refused(call, place, setting, said):
    refused(call, place, said, setting)


@pytest.mark.parametrize("method", ["vrl+tables", "beams"])
def test_bodies_too_wide_for_beams(call, place, method):
    """10,000 mean free paths and more: few beams of a pass are near any line of sight, and whether noise is right is chance."""
    status, out, err = call("render", place / "s.yaml", "-o", place / "x.png", "--set", "scene.unit=2 m", "--set",
                            f"materials[0].method={method}")
    assert status and not out and "ball is 2e+04 transport mean free paths wide" in err, err
    assert f"method {method} needs" in err and "auto, paths, shells or metropolis would do" in err


POINT = '<emitter type="point"><point name="position" value="0, 0, 20"/><rgb name="intensity" value="90, 90, 90"/></emitter>'
GLASS = '<bsdf type="dielectric"><float name="int_ior" value="1.4"/><float name="ext_ior" value="1"/></bsdf>'
FLOOR = """<shape type="rectangle" id="floor"><transform name="to_world"><scale value="20"/><translate z="-6"/></transform>
<bsdf type="diffuse"/></shape>"""


def in_light_of(place, around, ball='<bsdf type="null"/>'):
    """The scene with other things around the ball than the panel."""
    begin = XML.index('<shape type="rectangle" id="panel">')
    text = XML[:begin].replace('<bsdf type="null"/>', ball, 1) + around + "</scene>"
    (place / "lit.xml").write_text(text)


@pytest.mark.slow
def test_methods_that_leave_light_out_are_no_reference(call, place):
    """Glass throws light of a point on the floor, which no method brings: it is bias, and nothing counts as exact."""
    in_light_of(place, POINT + FLOOR, GLASS)
    status, out, err = call("compare", place / "s.yaml", "--methods", "paths,vrl+tables", "-o", place / "c.html", "--json")
    assert status == 0, err
    found = json.loads(out)
    for one in found["methods"]:
        assert not one["exact"] and not one["kept"] and "caustics" in one["left_out"][0]
        assert one["stated_bias"] > 0.003 and one["left_out"][0] in one["reasons"]
    assert any("paths lacks some light" in remark for remark in found["remarks"])


@pytest.mark.slow
def test_trade_has_no_reference_that_leaves_light_out(call, place):
    in_light_of(place, POINT + FLOOR, GLASS)
    status, out, err = call("trade", place / "s.yaml", "--methods", "paths,dipole", "--budget", "0.1", "-o", place / "t.html")
    assert status and not out and "none is a reference for errors" in err and "caustics" in err
    assert not (place / "t.html").exists()


def test_a_picture_without_light_knows_no_noise(call, place):
    """A point in a bulb of glass, which no way leaves that a method looks for."""
    in_light_of(place, POINT + f"""<shape type="sphere" id="bulb"><point name="center" x="0" y="0" z="20"/>
<float name="radius" value="2"/>{GLASS}</shape>""")
    report, found = rendered(call, place, "a", "materials[0].method=paths")
    assert not picture(found).any() and report["noise"] is None and report["bias"] is None
    assert any("no pass found any" in said for said in report["reasons"]) and "bulb" in report["left_out"][0]
    status, _, err = call("render", place / "s.yaml", "-o", place / "asked.png", "--set", "materials[0].method=paths",
                          "--set", "stop.noise=5%")
    assert status == 3 and "no pass found any" in err  # what was asked for is not known to be there


INTEGRATOR = """<integrator type="bakery_translucent"><string name="body.ball" value="wax.h5"/>
<float name="unit" value="0.001"/></integrator>"""


@pytest.mark.slow
@pytest.mark.parametrize("method", ["paths", "vrl+tables"])
def test_the_integrator_makes_the_same_picture(method, call, place):
    """With the scene in YAML and its seed: what `mi.render` gives, and what the film holds."""
    import renderers.materials.bodies.plugin  # noqa: F401
    import mitsuba as mi  # isort: skip

    integrator = INTEGRATOR.replace("</integrator>", f'<string name="method" value="{method}"/></integrator>')
    (place / "plugin.xml").write_text(XML.replace("</scene>", f"{integrator}</scene>"))
    report, found = rendered(call, place, "a", f"materials[0].method={method}", options=("--seed", "3"))
    expected = picture(found)
    mi.set_variant("llvm_ad_rgb")
    loaded = mi.load_file(str(place / "plugin.xml"), optimize=False)
    found = np.array(mi.render(loaded, spp=report["samples"], seed=3))
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
    refused(call, place, said, source="plugin.xml")


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
