"""Scenes made to do harm: each is refused with one sentence before Mitsuba opens anything, and before anything is computed."""

import os

import pytest

from bakery.errors import RecipeError, UsageError
from renderers import scene
from renderers.mitsuba.scene import load
from renderers.pictures import images
from renderers.scene import inputs

SCENE = """\
bakery_scene: 2
name: lit
scene: {mitsuba: lit.xml, unit: 1 mm}
film: {width: WIDTH, height: 16}
materials: [{where: {shape: ball}, recipe: wax.yaml}]
"""
MESH = '<shape type="ply"><string name="filename" value="{}"/></shape>'


@pytest.fixture
def place(tmp_path):
    (tmp_path / "in").mkdir()
    os.mkfifo(tmp_path / "pipe.ply")
    os.mkfifo(tmp_path / "in" / "deep.ply")
    (tmp_path / "zero.png").symlink_to("/dev/zero")
    (tmp_path / "more.xml").write_text("<scene>" + MESH.format("pipe.ply") + "</scene>")
    for name in ("vast.ply", "vast.xml"):
        (tmp_path / name).touch()
        os.truncate(tmp_path / name, 4 << 40)
    (tmp_path / "fine.ply").touch()
    (tmp_path / "wax.yaml").touch()
    return tmp_path


@pytest.mark.parametrize(("content", "found"), [
    (MESH.format("pipe.ply"), "pipe.ply, a pipe"),
    (MESH.format("zero.png"), "zero.png, a device"),
    (MESH.format("/dev/zero"), "/dev/zero, a device"),
    ('<default name="what" value="pipe"/>' + MESH.format("$what.ply"), "pipe.ply, a pipe"),
    ('<path value="in"/>' + MESH.format("deep.ply"), "deep.ply, a pipe"),
    ('<include filename="more.xml"/>', "pipe.ply, a pipe"),
    ('<include filename="vast.xml"/>', "vast.xml, a scene of 4.4e+06 MB"),
    (MESH.format("vast.ply"), "files of 4.4e+03 GB in all"),
])
def test_files_without_end_in_mitsuba_scenes(place, content, found):
    """In a scene's YAML with its line, of a Mitsuba scene by itself, and with what else would do."""
    (place / "lit.xml").write_text(f"<scene version='3.0.0'>{content}</scene>")
    (place / "s.yaml").write_text(SCENE.replace("WIDTH", "20"))
    with pytest.raises(RecipeError) as fault:
        scene.load(place / "s.yaml")
    assert str(fault.value).startswith(str(place / "s.yaml:3: scene.mitsuba: ")) and found in str(fault.value)
    with pytest.raises(UsageError) as fault:
        load(place / "lit.xml")
    assert found in str(fault.value)
    assert not {"pipe.ply", "deep.ply", "zero.png"} & {file.name for file in inputs.files_of(place / "lit.xml")}


def test_sound_files_are_no_fault(place):
    (place / "lit.xml").write_text("<scene>" + MESH.format("fine.ply") + '<path value="in"/></scene>')
    assert inputs.unbounded(place / "lit.xml") is None
    assert inputs.files_of(place / "lit.xml") == [place / "lit.xml", place / "fine.ply"]


def test_a_film_that_memory_does_not_hold(place, call, monkeypatch):
    """16,000 x 16,000 pixels want 256 GB; the recipe, which would have to be baked first, is not even looked at."""
    (place / "lit.xml").write_text("<scene/>")
    (place / "s.yaml").write_text(SCENE.replace("WIDTH", "16000").replace("16}", "16000}"))
    monkeypatch.setattr(images, "free_memory", lambda: 24e9)
    status, out, err = call("render", place / "s.yaml")
    assert (status, out) == (2, "")
    assert "s.yaml:4: film: found 16000 x 16000 pixels, which need some 256 GB of memory; 24 GB are free" in err
