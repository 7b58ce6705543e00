"""`bake render SCENE --frames` as a user calls it: the same bytes, what is there stays, interruptions, film and sheet."""

import json
import signal
from pathlib import Path

import numpy as np
import pytest

from bakery.cli import status_of
from renderers.pictures import engine
from renderers.sequence import film
from tests.cli.test_render_discrete import RECIPE, XML
from tests.exr import library

SCENE = """\
bakery_scene: 2
name: drift
scene: {mitsuba: lamp.xml, unit: 1 um, parameters: {panel: 3}}
camera: {origin: [40, -150, 40] um, target: [40, 40, 40] um, fov: 30 deg}
film: {width: 16, height: 15}
stop: {samples: 2}
materials:
  - {asset: drops.h5, method: particles, velocity: [1, 2, 0] um/s}
frames:
  rate: 12
  materials[0].time: {from: 0 s, to: 20 s}
  camera.origin: {from: [40, -150, 40] um, to: [20, -150, 40] um}
  scene.parameters.panel: [3, 4, 5]
"""


def bake(folder):
    """The asset of the scene's particles."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BAKERY_CACHE", str(folder / "cache"))
        (folder / "drops.yaml").write_text(RECIPE.replace("METHOD", "method: stored"))
        assert status_of([str(folder / "drops.yaml"), "-o", str(folder / "drops.h5"), "--quiet"]) == 0
    return folder / "drops.h5"


def lay_out(folder, asset):
    """The scene in a folder."""
    (folder / "drops.h5").symlink_to(asset)
    (folder / "s.yaml").write_text(SCENE)
    xml = XML.replace("3 3 3", "$panel").replace('0">', '0"><default name="panel" value="1"/>', 1)
    (folder / "lamp.xml").write_text(xml)
    (folder / "apart").mkdir()
    return folder


@pytest.fixture(scope="module")
def baked(tmp_path_factory):
    return bake(tmp_path_factory.mktemp("assets"))


@pytest.fixture
def place(baked, tmp_path, monkeypatch):
    monkeypatch.setattr(film, "program", lambda: None)
    return lay_out(tmp_path, baked)


def frames_of(call, place, numbers, *options, name="drift.png"):
    status, out, err = call("render", place / "s.yaml", "-o", place / name, "--frames", numbers, "--json", *options)
    assert status == 0, err
    return json.loads(out)


def content(place):
    return {path.name: path.read_bytes() for path in place.iterdir() if ".0" in path.name}


@pytest.mark.slow
def test_frames_are_whole_and_depend_on_nothing_else(call, place):
    """Each frame is the picture of a call of its own, byte for byte, with the pixels that `--set` gives."""
    report = frames_of(call, place, "1-3")
    assert [row["frame"] for row in report["frames"]] == [1, 2, 3] and report["rate"] == 12 and report["film"] is None
    assert all(row["status"] == "rendered" and row["samples"] == 2 and row["noise"] > 0 and row["missed"] == []
               for row in report["frames"])
    assert report["sheet"] == str(place / "drift.frames.png") and library().Bitmap(report["sheet"]).size().x == 168
    assert any("ffmpeg is not on the path" in remark for remark in report["remarks"])
    alone = frames_of(call, place, "2", name="apart/drift.png")
    assert alone["sheet"] is None and {path.name for path in (place / "apart").iterdir()} == {"drift.0002.png", "drift.0002.exr"}
    assert (place / "apart" / "drift.0002.exr").read_bytes() == (place / "drift.0002.exr").read_bytes()
    assert (place / "apart" / "drift.0002.png").read_bytes() == (place / "drift.0002.png").read_bytes()
    text = (place / "s.yaml").read_text()
    (place / "s.yaml").write_text(text[:text.index("frames:")])
    assert call("render", place / "s.yaml", "-o", place / "hand.png", "--set", "materials[0].time=10 s", "--set",
                "camera.origin=[30, -150, 40] um", "--set", "scene.parameters.panel=4")[0] == 0
    by_hand, second = (np.array(library().Bitmap(str(place / name))) for name in ("hand.exr", "drift.0002.exr"))
    assert np.array_equal(by_hand, second)


@pytest.mark.slow
def test_what_is_there_stays(call, place):
    """A frame that is whole and of the same scene, files, seed and quality is left; others are rendered, to the same bytes."""
    frames_of(call, place, "1-3")
    before = content(place)
    (place / "drift.0002.png").unlink()
    (place / "drift.0003.exr").write_bytes(before["drift.0003.exr"][:3000])
    statuses = [row["status"] for row in frames_of(call, place, "1-3")["frames"]]
    assert statuses == ["kept", "rendered", "rendered"] and content(place) == before
    for changed in (["--seed", "1"], ["--quality", "preview"], ["--set", "display.exposure=2"],
                    ["--set", "frames.scene.parameters.panel=[2, 4, 5]"]):
        assert frames_of(call, place, "1", *changed)["frames"][0]["status"] == "rendered", changed
    assert frames_of(call, place, "1-3:2")["frames"][0]["status"] == "rendered"
    text = (place / "lamp.xml").read_text()
    (place / "lamp.xml").write_text(text.replace("0.5 0.4 0.3", "0.5 0.4 0.2"))
    assert frames_of(call, place, "2")["frames"][0]["status"] == "rendered"


@pytest.mark.slow
def test_fresh_noise_is_that_of_other_seeds(call, place):
    same = frames_of(call, place, "2,3")
    fresh = frames_of(call, place, "2,3", "--set", "frames.noise=fresh", name="apart/drift.png")
    assert (same["noise"], fresh["noise"]) == ("same", "fresh")
    seeded = frames_of(call, place, "3", "--seed", "3", name="apart/seeded.png")
    assert seeded["frames"][0]["noise"] == fresh["frames"][1]["noise"] != same["frames"][1]["noise"]


@pytest.mark.slow
def test_an_interruption_keeps_what_is_finished(call, place, monkeypatch):
    """Status 130; the frame in which it came is written and can be gone on with; the same call renders the others."""
    frames_of(call, place, "1-3", "--set", "stop.samples=4")
    whole = content(place)
    for path in place.glob("drift.0*"):
        path.unlink()
    count, following = [], engine.Passes._next

    def interrupted(self, stop):
        count.append(self)
        if count.count(self) == 6 and len(set(map(id, count))) == 2:
            signal.raise_signal(signal.SIGINT)
        return following(self, stop)

    monkeypatch.setattr(engine.Passes, "_next", interrupted)
    status, out, err = call("render", place / "s.yaml", "-o", place / "drift.png", "--frames", "1-3", "--set", "stop.samples=4")
    assert (status, out) == (130, "") and "--resume goes on with it; 1 of 3 frames are finished, and the same call" in err
    assert content(place).keys() == {f"drift.000{number}.{kind}" for number in (1, 2) for kind in ("png", "exr")}
    monkeypatch.undo()
    monkeypatch.setattr(film, "program", lambda: None)
    statuses = [row["status"] for row in frames_of(call, place, "1-3", "--resume", "--set", "stop.samples=4")["frames"]]
    assert statuses == ["kept", "resumed", "rendered"]
    now = content(place)
    assert all(now[name] == whole[name] for name in whole if "0002" not in name)
    gone_on, unbroken = place / "drift.0002.exr", place / "unbroken.exr"
    unbroken.write_bytes(whole["drift.0002.exr"])
    assert np.allclose(*(np.array(library().Bitmap(str(path))) for path in (gone_on, unbroken)), rtol=1e-5, atol=1e-5)


def test_an_interruption_between_passes(call, place, monkeypatch):
    from renderers.mitsuba.world import World

    made = []

    def interrupted(scene, variant):
        made.append(scene)
        if len(made) == 2:
            raise KeyboardInterrupt
        return world(scene, variant)

    world = World.of
    monkeypatch.setattr(World, "of", interrupted)
    status, _, err = call("render", place / "s.yaml", "--frames", "1-3")
    assert status == 130 and "interrupted; 1 of 3 frames are finished, and the same call renders the others" in err
    assert content(place).keys() == {"drift.0001.png", "drift.0001.exr"}


@pytest.mark.slow
def test_a_missed_noise_is_told_in_the_end(call, place):
    """All frames are there, with status 3, also when they are only looked at."""
    for _ in range(2):
        status, out, err = call("render", place / "s.yaml", "-o", place / "a.png", "--frames", "1,2", "--set", "stop.noise=1%")
        assert status == 3 and "a.0002.exr" in out and "a.frames.png" in out
        assert all(f"a.000{number}.png: samples ended the passes: a noise of 1 % was wanted" in err for number in (1, 2))


@pytest.mark.parametrize(("options", "told"), [
    (("--frames", "4"), "--frames: found frame 4; "), (("--frames", "3-1"), "expected 1-48, 1,5,9 or 1-48:2"),
    (("--cluster", "tcp://host:1", "--live"), "leave the option or --cluster out"),
    (("--frames", "1", "--cluster", "host"), "Dask scheduler"), (("--cluster", "host"), "Dask scheduler"),
    (("--frames", "1", "--set", "frames.count=4"), "found 3 values; expected 4, as count says"),
    (("--frames", "2", "--set", "frames.display.exposure=[1, 1, 0]"), "display.exposure: found \"0\", in frame 3"),
    (("--frames", "1-2", "-o", "gone/a.png"), "there is no folder gone"),
])
def test_refusals_come_before_any_work(call, place, options, told):
    status, out, err = call("render", place / "s.yaml", *options)
    assert status == 2 and not out and told in err and not content(place)


def test_only_scenes_have_frames(call, place):
    assert "only scenes have frames" in call("render", place / "drops.h5", "--frames", "1")[2]
    text = (place / "s.yaml").read_text()
    (place / "s.yaml").write_text(text[:text.index("frames:")])
    status, _, err = call("render", place / "s.yaml", "--frames", "1")
    assert status == 2 and "s.yaml: frames: missing; expected frames: {count: 48" in err


def test_no_file_of_another_kind_is_replaced(call, place):
    (place / "drift.mp4").write_text("my notes")
    status, _, err = call("render", place / "s.yaml", "--frames", "1-2")
    assert status == 2 and "drift.mp4: an existing file is not a film (MP4)" in err and not content(place)


FFMPEG = """\
#!/bin/sh
for last; do :; done
printf '%s\\n' "$*" > {log}
printf '\\0\\0\\0\\040ftyp' > "$last"
cat >> "$last"
exit {status}
"""


@pytest.mark.parametrize("status", [0, 1])
def test_the_film(place, monkeypatch, status):
    """ffmpeg gets the pictures one behind the other, in order, at the rate of the scene; where it fails there is no film."""
    coder = place / "ffmpeg"
    coder.write_text(FFMPEG.format(log=place / "log", status=status))
    coder.chmod(0o755)
    monkeypatch.setattr(film, "program", lambda: str(coder))
    pictures = [place / f"{name}.png" for name in "ba"]
    for picture in pictures:
        picture.write_bytes(picture.name.encode())
    path, words = film.write(place / "film.mp4", pictures, 12.0)
    assert "-framerate 12 -i pipe:0" in (place / "log").read_text() and "yuv420p" in (place / "log").read_text()
    if status == 0:
        assert Path(path).read_bytes() == b"\0\0\0\x20ftypb.pnga.png" and words == []
    else:
        assert path is None and not (place / "film.mp4").exists() and "ffmpeg ended with status 1: no reason given" in words[0]
    assert not [one for one in place.iterdir() if one.name.startswith(".")]
