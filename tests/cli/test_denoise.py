"""`bake render --denoise` as a user calls it: what the PNG, the EXR and the report say, and what is said where it cannot be."""

import json
import sys

import numpy as np
import pytest

from bakery.cli import status_of
from bakery.physics.shapes.radial import icosphere
from bakery.store import ply
from renderers.pictures import denoise
from tests.exr import layers

RECIPE = """\
bakery: 1
name: wax
wavelengths: [0.55]
tolerance: 10%
medium: {albedo: 0.9, mean_free_path: 1 mm, phase: {type: hg, g: 0}}
"""
SCENE = """\
bakery_scene: 2
name: lit
scene: {mitsuba: lit.xml, unit: 1 mm}
film: {width: 24, height: 20}
stop: {samples: 64}
materials:
  - {where: {shape: ball}, asset: wax.h5, method: paths}
"""
XML = """<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="40"/><transform name="to_world">
<lookat origin="0, -19, 5" target="0, 0, 0" up="0, 0, 1"/></transform></sensor>
<shape type="ply" id="ball"><string name="filename" value="ball.ply"/><bsdf type="dielectric"/></shape>
<emitter type="constant"><rgb name="radiance" value="1 1 1"/></emitter></scene>"""


@pytest.fixture
def place(tmp_path):
    (tmp_path / "wax.yaml").write_text(RECIPE)
    assert status_of([str(tmp_path / "wax.yaml"), "-o", str(tmp_path / "wax.h5"), "--stage", "medium", "--quiet"]) == 0
    vertices, faces = icosphere(320)
    (tmp_path / "ball.ply").write_bytes(ply.mesh(5 * vertices, faces, single=True))
    (tmp_path / "s.yaml").write_text(SCENE)
    (tmp_path / "lit.xml").write_text(XML)
    return tmp_path


def rendered(call, place, *options):
    """Report, layers and bytes of the PNG."""
    status, out, err = call("render", place / "s.yaml", "-o", place / "a.png", "--json", *options)
    assert status in (0, 3), err
    return json.loads(out), layers(place / "a.exr"), (place / "a.png").read_bytes()


def test_a_draft_keeps_its_picture_beside_the_one_without_noise(call, place):
    """The EXR has both, and the passes of either can be gone on with."""
    if denoise.fault():
        pytest.skip("mitsuba-oidn is not installed")
    report, found, shown = rendered(call, place, "--quality", "draft")
    assert report["denoised"] is True and report["denoising"]["features"] == ["albedo", "normal"]
    assert report["denoising"]["apart"] == [] and abs(report["denoising"]["mean_change"]) < 0.1
    assert "denoising" in report["seconds"] and any("not the error of what is shown" in line for line in report["reasons"])
    assert b"bakery_denoised" in shown and b"Open Image Denoise" in shown
    middle = found["distance.Z"][10, 12]
    # half of the light has scattered after ln 2 mean free paths; facets lie up to 0.1 mm inside of the ball
    assert middle == pytest.approx(np.hypot(19, 5) * 1e-3 - 5e-3 + np.log(2) * 1e-3, rel=0.01)
    assert found["normal.Y"][10, 12] < -0.9 and found["albedo.G"][10, 12] == pytest.approx(0.9, abs=1e-3)
    rough, smooth = (np.abs(np.diff(found[name][7:13, 9:15])).mean() for name in ("G", "denoised.G"))
    assert smooth < 0.6 * rough
    kept, without, plain = rendered(call, place, "--quality", "draft", "--resume", "--no-denoise")
    assert kept["denoised"] is False and kept["denoising"] is None and plain != shown and b"bakery_denoised" not in plain
    assert all(np.array_equal(without[name], found[name]) for name in ("R", "G", "B", "noise.Y"))
    assert not any(name.startswith(("denoised.", "albedo.", "normal.")) for name in without)
    again, *_ = rendered(call, place, "--resume", "--denoise")
    assert again["denoised"] is True and again["samples"] == 64 and report["samples"] < 64


def test_without_the_package(call, place, monkeypatch):
    """A draft is what it was, with a line; asked for, a refusal that names the extra, before any work."""
    monkeypatch.setitem(sys.modules, "mitsuba_oidn", None)
    report, found, _ = rendered(call, place, "--quality", "draft")
    assert report["denoised"] is False and any(".[denoise]" in line for line in report["reasons"])
    (place / "a.png").unlink(), (place / "a.exr").unlink(), (place / "wax.h5").unlink()
    for option in (("--denoise",), ("--set", "denoise=yes")):
        status, _, err = call("render", place / "s.yaml", "-o", place / "a.png", *option)
        assert status == 2 and "denoise: found yes, which takes the package mitsuba-oidn (" in err and ".[denoise]" in err
    assert not (place / "wax.h5").exists() and not (place / "a.png").exists()


def test_where_there_is_nothing_to_take_out(call, place):
    status, _, err = call("render", place / "lit.xml", "--denoise")
    assert status == 2 and "--denoise" in err and "is no scene (.yaml)" in err
    (place / "lit.xml").write_text(XML.replace('"1 1 1"', '"0 0 0"'))
    report, found, _ = rendered(call, place, "--quality", "draft")
    assert report["denoised"] is False and not found["R"].any()
