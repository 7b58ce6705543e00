"""Frames of a sequence: numbers as they are asked for, values between others, faults with their lines, the scene of a frame."""

import numpy as np
import pytest

from bakery.errors import RecipeError, UsageError
from renderers import colour, scene
from renderers.pictures import progressive
from renderers.scene import assets, frames, requirements
from renderers.sequence import prepared, sheet

SCENE = """\
bakery_scene: 2
name: drift
scene: {mitsuba: street.xml, parameters: {lamp: 3}}
camera: {origin: [0, -12, 1.7] m, target: [0, 0, 2] m, fov: 40 deg}
materials:
  - {where: {box: {lo: [0, 0, 0] m, hi: [1, 1, 1] m}}, as: particles, asset: snow.h5, velocity: [1, 0, 0] m/s}
"""
FRAMES = """\
frames:
  count: 5
  materials[0].time: {from: 0 s, to: 2 s}
  camera.origin: {from: [0, -12, 1.7] m, through: [[0, -12, 3.7] m], to: [4, -12, 3.7] m}
  display.exposure: [1, 2, 3, 4, 5]
"""


@pytest.fixture
def load(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "snow.h5").write_bytes(b"x")
    (tmp_path / "street.xml").write_text('<scene version="3.0.0"><default name="lamp" value="2"/>'
                                         '<emitter type="constant"><rgb name="radiance" value="$lamp"/></emitter></scene>')

    def loaded(text=SCENE + FRAMES, frame=None, **settings):
        (tmp_path / "s.yaml").write_text(text)
        return scene.load("s.yaml", {key.replace("__", "."): value for key, value in settings.items()}, frame=frame)

    return loaded


def faults(load, text, frame=1, **settings):
    with pytest.raises(RecipeError) as error:
        load(text, frame, **settings)
    return str(error.value)


@pytest.mark.parametrize(("text", "found"), [
    ("7", (7,)), ("1-4", (1, 2, 3, 4)), ("9, 1,5", (1, 5, 9)), ("1-9:4", (1, 5, 9)), ("2-3,3-4", (2, 3, 4)),
    ("001-002", (1, 2)),
])
def test_numbers(text, found):
    assert frames.numbers(text) == found


@pytest.mark.parametrize("text", ["", "0", "3-1", "1-", "-3", "a", "1-5:0", "1,,2", "1.5", "1-9999999", "200000", "１"])
def test_what_are_no_numbers(text):
    with pytest.raises(UsageError, match="expected 1-48, 1,5,9 or 1-48:2"):
        frames.numbers(text)


def test_a_frame_is_the_scene_with_its_values(load):
    """As `--set` would give it: the same values, and the same picture by its fingerprint."""
    third = load(frame=3)
    assert third.values.materials[0].time == 1.0 and third.values.display.exposure == 3.0
    assert list(third.values.camera.origin) == [0, -12, 3.7] and list(third.values.camera.target) == [0, 0, 2]
    assert third.overrides["materials[0].time"] == "1 s" and third.frame == 3
    by_hand = load(SCENE, **{"materials[0]__time": "1 s", "camera__origin": "[0, -12, 3.7] m", "display__exposure": "3"})
    assert progressive.fingerprint(*progressive.made_of(third)) == progressive.fingerprint(*progressive.made_of(by_hand))


def test_ends_are_as_they_are_written(load):
    """First and last are the numbers of the scene, and what is between lies on lines through the places between."""
    origins = np.array([load(frame=number).values.camera.origin for number in range(1, 6)])
    assert np.array_equal(origins[[0, 2, 4]], [[0, -12, 1.7], [0, -12, 3.7], [4, -12, 3.7]])
    assert np.allclose(origins[[1, 3]], [[0, -12, 2.7], [2, -12, 3.7]], rtol=0, atol=1e-15)
    assert [load(frame=number).values.materials[0].time for number in (1, 2, 5)] == [0.0, 0.5, 2.0]


def test_without_a_number_it_is_the_scene_as_it_stands(load):
    plain, bare = load(), load(SCENE)
    assert plain.values.materials[0].time == 0.0 and plain.values.display.exposure == 1.0 and plain.overrides == {}
    assert progressive.fingerprint(*progressive.made_of(plain)) == progressive.fingerprint(*progressive.made_of(bare))


def test_lists_with_one_unit_and_of_any_values(load):
    text = SCENE + "frames:\n  materials[0].time: [0, 40, 80] ms\n  materials[0].peak: [keep, auto, 1 deg]\n"
    found = [load(text, number).values.materials[0] for number in (1, 2, 3)]
    assert [one.time for one in found] == pytest.approx([0, 0.04, 0.08]) and [one.peak for one in found[:2]] == ["keep", "auto"]
    with pytest.raises(UsageError, match=r"s.yaml: found no frame 4; it has frames 1 to 3"):
        load(text, 4)


def test_whole_numbers_stay_whole(load):
    text = SCENE + "frames:\n  count: 3\n  stop.samples: {from: 16, to: 64}\n"
    assert load(text, 2).values.stop.samples == 40
    assert "stop.samples: found \"20.5\"" in faults(load, text.replace("64", "25"), 2)


def test_values_of_the_mitsuba_scene(load):
    text = SCENE + "frames:\n  scene.parameters.lamp: [1, [3, 2, 1], 0.5]\n"
    assert [load(text, number).values.scene.parameters["lamp"] for number in (1, 2, 3)] == ["1", "3, 2, 1", "0.5"]
    told = faults(load, text.replace("parameters: {lamp: 3}", "parameters: {lmap: 3}"))
    assert 's.yaml:3: scene.parameters.lmap: found "lmap", but street.xml has no $lmap; expected a parameter of it; ' \
        "it has $lamp (lamp?)" in told


@pytest.mark.parametrize(("line", "told"), [
    ("  materials[0].time: {from: 0 s, to: 2 m}", 's.yaml:8: frames.materials[0].time: found "2 m" after "0 s"; expected'),
    ("  materials[0].time: {from: 0 s, to: 2000 ms}", "expected as many numbers, in the same unit"),
    ("  materials[0].time: {from: 0 s}", "s.yaml:8: frames.materials[0].time: found no to; expected {from: 0 s, to: 2 s}"),
    ("  materials[0].time: {from: 0 s, too: 2 s}", 'found the unknown key "too"; expected from, through or to (to?)'),
    ("  materials[0].time: 2 s", 'found "2 s"; expected a list of one value a frame, or {from: …, to: …}'),
    ("  materials[0].time: [0, x, 1] s", 's.yaml:8: materials[0].time: found "x s"'),
    ("  materials[0].tme: [0, 1, 2]", 's.yaml:8: materials[0].tme: found the unknown key "tme"'),
    ("  materials[2].time: [0, 1, 2] s", "s.yaml:8: frames.materials[2].time: found materials[2]; expected an index below 1"),
    ("  materials[0].method: {from: auto, to: query}", "cannot change gradually"),
    ("  camera.origin: {from: [0, 0, 1] m, to: [0, 1] m}", "expected as many numbers"),
    ("  camera.origin: {from: [0 m, 0 m, 1 m], to: [0, 1, 2] m}", "expected values of the same form"),
    ("  display.exposure: [1, 2]", "frames.display.exposure: found 2 values; expected 3, as count says, one a frame"),
    ("  film.width: [1, 2, 3]", "found a key that frames cannot change; expected another one: a film has frames of one size"),
    ("  cont: 4", 'frames.cont: found "cont", which is neither an option nor a dotted key; expected count, rate, noise'),
    ("  rate: 0", "s.yaml:8: frames.rate: found \"0\"; expected a number above 0"),
    ("  noise: new", 'frames.noise: found "new"; expected same or fresh'),
])
def test_faults_have_their_lines(load, line, told):
    assert told in faults(load, f"{SCENE}frames: \n{line}\n  count: 3\n  materials[0].footprint: [1, 1, 1]\n", 2)


def test_a_section_without_values(load):
    assert "s.yaml:7: frames: found no key that changes" in faults(load, SCENE + "frames: {count: 3}\n")
    assert "s.yaml:7: frames.count: missing" in faults(load, SCENE + "frames: {materials[0].time: {from: 0 s, to: 1 s}}\n"
                                                       .replace("materials[0].time", '"materials[0].time"'))
    assert 's.yaml:7: frames: found "3"; expected keys with values' in faults(load, SCENE + "frames: 3\n")
    assert "s.yaml: frames: missing; expected frames: {count: 48" in faults(load, SCENE)


def test_what_is_set_by_hand(load):
    changed = load(frame=5, **{"frames__count": "5", "frames__materials[0]__time": "{from: 1 s, to: 3 s}"})
    assert changed.values.materials[0].time == 3.0
    told = faults(load, SCENE + FRAMES, **{"materials[0]__time": "1 s"})
    assert "frames.materials[0].time: found a key that --set materials[0].time gives as well" in told


def test_faults_of_all_frames_at_once(load, tmp_path):
    """What is wrong in some frames says in which; what is wrong in all at one place is said once."""
    load()
    text = SCENE + FRAMES.replace("4, 5]", "-4, x]").replace("materials[0].time: {from: 0 s", "camera.fov: {from: 40")
    (tmp_path / "s.yaml").write_text(text.replace("to: 2 s}", "to: -40}") + "  camera.target: [[0, 0, 2] m, [0, 0, 2] m, "
                                     "[0, -12, 3.7] m, [0, 0, 2] m, [0, 0, 2] m]\n")
    with pytest.raises(RecipeError) as error:
        prepared._loaded("s.yaml", {}, (1,))
    told = str(error.value)
    assert 's.yaml:11: display.exposure: found "-4", in frame 4; expected a number above 0' in told
    assert 's.yaml:11: display.exposure: found "x", in frame 5' in told
    assert "s.yaml:12: camera.target: found the camera's own place, in frame 3" in told
    assert told.count("camera.fov: found") == 1 and 'found "40", which has no unit, in frame 1 and 4 others; angles' in told
    with pytest.raises(UsageError, match="--frames: found frame 6; s.yaml has frames 1 to 5"):
        prepared._loaded("s.yaml", {}, (1, 6))


def test_thumbnails_keep_the_light():
    """Means of linear light, whatever the sizes; larger ones repeat pixels."""
    picture = np.random.default_rng(3).uniform(0.2, 0.9, (40, 63, 3))
    small = colour.decode(sheet._resized(picture, (10, 7)))
    assert small.shape == (10, 7, 3) and np.allclose(small.mean(axis=(0, 1)), colour.decode(picture).mean(axis=(0, 1)), rtol=1e-6)
    assert sheet._resized(picture, (11, 8)).shape == (11, 8, 3)
    assert np.allclose(sheet._resized(picture[:3], (9, 63)), np.repeat(picture[:3], 3, axis=0), rtol=1e-6)
    assert sheet._grid(48, (300, 400)) == (8, (220, 293)) and sheet._grid(2, (16, 16)) == (2, (48, 48))


def test_of_long_sequences_only_what_is_asked_for_is_checked(load, tmp_path, monkeypatch):
    load()
    (tmp_path / "s.yaml").write_text(SCENE + FRAMES.replace("4, 5]", "-4, 5]"))
    monkeypatch.setattr(prepared, "CHECKED", 4)
    section, loaded = prepared._loaded("s.yaml", {}, (2,))
    assert section.count == 5 and sorted(loaded) == [1, 2, 3, 5]  # and those that say what assets have to hold
    with pytest.raises(RecipeError, match=r'display.exposure: found "-4", in frame 4'):
        prepared._loaded("s.yaml", {}, (4,))


def test_an_asset_is_baked_once_for_all_frames(load, tmp_path, monkeypatch):
    """Of each recipe that frames name, by the needs of all of them that were measured."""
    for name in ("snow", "rain"):
        (tmp_path / f"{name}.yaml").write_text(f"bakery: 1\nname: {name}\ndiscrete: {{}}\n")
    baked, needs = [], []

    def ensured(recipe, *, require, **_):
        baked.append(recipe.name)
        require("recipe", "medium", "seconds")
        return tmp_path / f"{recipe.stem}.baked.h5"

    def of_scenes(scenes, *about):
        needs.append([one.frame for one in scenes])
        return requirements.Required((), share=0.25)

    monkeypatch.setattr(assets, "ensured", ensured)
    monkeypatch.setattr(requirements, "of_scenes", of_scenes)
    text = SCENE.replace("asset: snow.h5", "recipe: snow.yaml")
    scenes = [load(text + FRAMES, number) for number in range(1, 6)]
    together = assets.together(scenes, measured=[scenes[0], scenes[2], scenes[4]])
    assert baked == ["snow.yaml"] and needs == [[1, 3, 5]]
    assert {one.asset for one in together} == {tmp_path / "snow.baked.h5"} and {one.share for one in together} == {0.25}
    listed = "frames:\n  materials[0].recipe: [snow.yaml, rain.yaml, snow.yaml]\n"
    together = assets.together([load(text + listed, number) for number in (1, 2, 3)])
    assert baked[1:] == ["snow.yaml", "rain.yaml"] and needs[1:] == [[1, 3], [2]]
    assert [one.asset.name for one in together] == ["snow.baked.h5", "rain.baked.h5", "snow.baked.h5"]
