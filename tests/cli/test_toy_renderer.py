"""A renderer is its folder and one line: a toy is registered and found by every command that takes scenes."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import bakery
from renderers import scene
from renderers.camera import Camera
from renderers.pictures.progressive import Estimate, Part, Stop
from renderers.pictures.running import Render
from renderers.scene import budget
from tests.exr import layers
from tests.renders import HAZE as SCENE


@pytest.fixture
def place(milk, monkeypatch):
    """A folder with a scene of the toy, and the recipe of its asset."""
    monkeypatch.setitem(scene.RENDERERS, "toy", "tests.toy_renderer")  # the one line
    (milk.parent / "haze.yaml").write_text(SCENE)
    return milk.parent


def test_it_renders(call, place, milk):
    """By a compiled loop that looks the phase function up; the same as by `bakery.open`, and the same bytes again."""
    assert call(milk, "-o", place / "milk.h5")[0] == 0
    status, out, err = call("render", place / "haze.yaml", "--json")
    assert status == 0, err
    report, found = json.loads(out), layers(place / "haze.exr")
    assert {"renderer", "method", "files", "size", "samples", "noise", "bias", "seconds", "mean", "reasons"} <= set(report)
    assert (report["renderer"], report["method"], report["size"]) == ("toy", "single", [8, 6])
    assert report["files"] == [str(place / "haze.png"), str(place / "haze.exr")]
    assert set(report["seconds"]) == {"haze", "write", "total"}
    medium = bakery.open(place / "milk.h5").medium
    rays = Camera.looking((0, -2, 1), (0, 0, 1), (0, 0, 1), np.radians(40), 6, 8).rays(6, 8)
    theta = np.arccos(-rays @ np.array([1, 2, -1]) / np.sqrt(6))
    exact = medium.albedo[:, None] * medium.phase(theta.ravel())
    assert np.allclose([found[c].ravel() for c in "RGB"], exact, rtol=1e-6)
    assert np.allclose(report["mean"], exact.mean(axis=1), rtol=1e-12)
    status, out, err = call("render", place / "haze.yaml", "-o", place / "again.png")
    assert status == 0 and out == f"{place / 'again.png'}\n{place / 'again.exr'}\n"
    assert "method: single" in err and "more than once" in err
    for kind in ("png", "exr"):
        assert (place / f"again.{kind}").read_bytes() == (place / f"haze.{kind}").read_bytes()


def test_a_picture_that_misses_its_noise_is_status_3(call, place, milk, monkeypatch):
    """By one rule: written, told also with --quiet, `missed` in the report; a draft, and a scene that asks for no noise, tell."""

    def render(scene, output, quality=None, resume=False, progress=None, **_):
        job = Render(scene, output, quality=quality, progress=progress)
        values = job.scene.values
        estimate = Estimate([Part("haze", lambda index: {"": np.full((6, 8, 3), 1.0 + index % 2)})], {"scene": "haze"})
        if resume:
            estimate.resume(job.pair[1])
        estimate.run(Stop.of(budget.of(job.scene), samples=values.stop.samples, quality=quality), job.progress(0.0, 1.0))
        return estimate.finish(job, method="passes")

    monkeypatch.setattr("tests.toy_renderer.render", render)
    monkeypatch.setattr("tests.toy_renderer.scene.RESUMES", True)
    monkeypatch.setattr("tests.toy_renderer.scene.UNUSED", {})
    assert call(milk, "-o", place / "milk.h5")[0] == 0

    def rendered(stop, *words):
        status, out, err = call("render", place / "haze.yaml", "--set", f"stop={stop}", "--json", "--quiet", *words)
        return status, json.loads(out), err

    # passes of 1 and 2 in turns, alike in all pixels: after N of them the noise is 1/3/sqrt(N - 1), of regions times Student's t
    status, report, err = rendered("{samples: 8, noise: 12%}")
    sentence = "samples ended the passes: a noise of 12 % was wanted, it is 13 %, 14 % of the means of regions"
    assert (status, report["missed"], report["reasons"], err) == (3, [sentence], [], f"{place / 'haze.png'}: {sentence}\n")
    assert (place / "haze.png").is_file() and (place / "haze.exr").is_file()
    status, report, err = rendered("{samples: 8}", "--set", "tolerance=10%", "--resume")
    assert status == 3 and "a noise of 7.1 % was wanted, it is 13 %" in report["missed"][0]
    status, report, err = rendered("{samples: 64, noise: 12%}", "--resume")
    assert (status, report["missed"], err) == (0, [], "") and report["stopped_by"] == "noise" and report["samples"] == 10
    status, report, err = rendered("{samples: 8}")
    assert (status, report["missed"], err) == (0, [], "") and "was wanted, it is 13 %" in report["reasons"][0]
    status, report, err = rendered("{samples: 32, noise: 1%}", "--quality", "draft")
    assert (status, report["missed"], err) == (0, [], "") and "a noise of 4 % was wanted" in report["reasons"][0]
    status, report, err = rendered("{samples: 32, noise: 1%}", "--quality", "preview")
    assert status == 3 and "a noise of 2 % was wanted" in report["missed"][0]


def test_a_plan_of_a_scene_by_a_pilot(call, place, milk, monkeypatch):
    """The bake that is due, and the noise of the picture by that of smaller ones; nothing is written but into the cache.

    Passes of independent normal noise, 0.5 of the level: after 64 of them 6.25 %.  The pilots' 192 pixels and two passes or more
    know that to 7 %, one standard error: four for a false alarm of 6e-5, with a fixed seed.
    """

    def render(scene, output, quality=None, seed=None, progress=None, **_):
        job = Render(scene, output, quality=quality, progress=progress)
        film, stop = job.scene.values.film, job.scene.values.stop

        def passed(index):
            noise = np.random.default_rng([7, film.width, index]).standard_normal((film.height, film.width, 1))
            return {"": 1.0 + 0.5 * np.repeat(noise, 3, axis=2)}

        job.part_over("preparation")
        estimate = Estimate([Part("haze", passed)], {"scene": "haze"})
        # no clock: pilots that would end by their time end after four passes
        estimate.run(Stop.of(budget.of(job.scene), samples=4 if stop.time else stop.samples, quality=quality))
        job.part_over("passes")
        return estimate.finish(job, method="passes")

    monkeypatch.setattr("tests.toy_renderer.render", render)
    monkeypatch.setattr("tests.toy_renderer.scene.RESUMES", True)
    monkeypatch.setattr("tests.toy_renderer.scene.UNUSED", {})
    (place / "haze.yaml").write_text(SCENE.replace("asset: milk.h5", "recipe: milk.yaml")
                                     + "film: {width: 160, height: 120}\nstop: {samples: 64, noise: 2%}\n")
    before = sorted(path.name for path in place.iterdir())
    status, out, err = call("plan", place / "haze.yaml", "--json")
    assert status == 0, err
    [plan] = json.loads(out)
    [bake] = plan["bakes"]
    assert bake["due"] and Path(bake["asset"]).parent.name == "scenes"
    assert plan["bakes"][0]["plan"]["steps"][0]["stage"] == "medium"
    found = plan["render"]
    assert found["size"] == [160, 120] and found["stopped_by"] == "samples" and found["pilot"]["size"] == [111, 83]
    assert found["noise"] == pytest.approx(0.0625, rel=4 * 0.07) and "a noise of 2 % was wanted" in found["missed"][0]
    assert plan["memory"] >= found["memory"] > 0 and plan["seconds"] > 0
    assert plan["files"] == [str(place / "haze.png"), str(place / "haze.exr")]
    assert sorted(path.name for path in place.iterdir()) == before
    status, out, err = call("plan", place / "haze.yaml", "--set", "stop={samples: 64}", "--quality", "preview")
    assert status == 0 and "expected: samples ended the passes: a noise of 7.1 % was wanted" in out
    assert re.search(r"reuse  .*/scenes/milk-[0-9a-f]{64}.h5", out) and "render toy by passes, 160 x 120: " in out
    for words in (("--stage", "medium"), ("--sweep", "a.b=[1, 2]"), ("--seed", "x"), ("--force",)):
        status, _, err = call("plan", place / "haze.yaml", *words)
        assert status == 2 and words[0] in err


def test_its_needs_are_baked(call, place, milk, monkeypatch):
    monkeypatch.setattr("tests.toy_renderer.scene.NEEDS", ("medium", "beam"))
    status, out, err = call("plan", milk, "--scene", place / "haze.yaml", "--json")
    assert status == 0 and "beam, because" in err
    assert [step["stage"] for step in json.loads(out)[0]["steps"]] == ["medium", "beam"]


def test_messages_list_every_renderer(call, place, milk):
    said = "found nothing to render; expected materials, fog or toy"
    (place / "haze.yaml").write_text(SCENE[:SCENE.index("toy:")])
    assert said in call("render", place / "haze.yaml")[2] and said in call("plan", milk, "--scene", place / "haze.yaml")[2]
    (place / "haze.yaml").write_text(SCENE + "fog: {}\n")
    for words in (("render", place / "haze.yaml"), ("plan", milk, "--scene", place / "haze.yaml")):
        status, _, err = call(*words)
        found = "haze.yaml:6: fog: found fog beside toy; expected materials, fog or toy, one of them"
        assert status == 2 and found in err


def test_problems_of_its_scene(call, place):
    """Its own, those of every scene, and of a section that is misspelt: by its schema."""
    (place / "milk.h5").touch()
    bad = SCENE.replace("[1, 2, -1]", "[0, 0, 0]}\nfilm: {hight: 3").replace("target: [0, 0, 1]", "target: [0, -2, 1]")
    (place / "haze.yaml").write_text(bad)
    err = call("render", place / "haze.yaml")[2]
    assert "toy.sun: found a direction of length 0" in err and "(height?)" in err and "the camera's own place" in err
    (place / "haze.yaml").write_text(SCENE.replace("toy:", "toys:"))
    assert "(toy?)" in call("render", place / "haze.yaml")[2]


@pytest.mark.slow
def test_its_recipe_is_baked_where_that_is_due(call, place, milk, monkeypatch):
    """Missing, then out of date, then without a stage that is needed; said on standard error.  None is baked twice."""
    (place / "haze.yaml").write_text(SCENE.replace("asset: milk.h5", f"recipe: {milk.name}"))

    def rendered():
        status, out, err = call("render", place / "haze.yaml", "--json", "--overwrite")
        assert status == 0 and not (place / "milk.h5").exists(), err
        return json.loads(out)["mean"], bakery.open(json.loads(out)["asset"]), err

    mean, first, err = rendered()
    assert "medium: " in err and set(first.stages) == {"medium"}
    again, same, err = rendered()
    assert again == mean and same.content_hash == first.content_hash and "medium: " not in err
    milk.write_text(milk.read_text().replace("g: 0.7", "g: 0.2"))
    changed, _, _ = rendered()
    assert changed != mean
    monkeypatch.setattr("tests.toy_renderer.scene.NEEDS", ("medium", "multiple"))
    _, whole, err = rendered()
    assert set(whole.stages) == {"medium", "multiple"} and "multiple, because the scene needs it" in err


def test_problems_of_its_recipe(call, place, milk):
    """Its own file and line; nothing is baked where the pictures cannot be written."""
    text = SCENE.replace("asset: milk.h5", f"recipe: {milk.name}")
    (place / "haze.yaml").write_text(text)
    (place / "notes.png").write_text("what I saw")
    assert "not a PNG picture" in call("render", place / "haze.yaml", "-o", place / "notes.png")[2]
    milk.write_text(milk.read_text().replace("albedo", "albdo"))
    status, out, err = call("render", place / "haze.yaml")
    assert status == 2 and not out and f"{milk.name}:" in err and "(albedo?)" in err and not (place / "milk.h5").exists()
    for words, said in (("asset: milk.h5\n" + f"recipe: {milk.name}", "recipe: found a recipe beside an asset"),
                        ("", "asset: missing; expected asset: a baked asset, or recipe:"),
                        ("recipe: gone.yaml", "haze.yaml:3: recipe: found \"gone.yaml\", and there is no such file")):
        (place / "milk.h5").touch()
        (place / "haze.yaml").write_text(SCENE.replace("asset: milk.h5", words))
        status, _, err = call("render", place / "haze.yaml")
        assert status == 2 and said in err, err


def test_common_keys(place, monkeypatch):
    """Those that a renderer reads come in base units, with their defaults; each that it does without is refused."""
    (place / "milk.h5").touch()
    (place / "lamp.xml").touch()
    more = ("tolerance: 2%\nscene: {mitsuba: lamp.xml, unit: 1 cm}\nfilm: {width: 640, height: 480, wavelengths: rgb}\n"
            "stop: {noise: 1%, time: 500 ms, samples: 1024}\n")
    (place / "haze.yaml").write_text(SCENE + more)
    with pytest.raises(bakery.RecipeError) as error:
        scene.load(place / "haze.yaml")
    said = str(error.value)
    for line, key in ((6, "tolerance"), (7, "scene"), (8, "film.wavelengths"), (9, "stop")):
        assert f"haze.yaml:{line}: {key}: found a key that toy does not use; expected none: " in said
    monkeypatch.setattr("tests.toy_renderer.scene.UNUSED", {})
    values = scene.load(place / "haze.yaml").values
    assert (values.tolerance, values.scene.unit, values.film.wavelengths) == (0.02, 0.01, "rgb")
    assert (values.film.width, values.film.height) == (640, 480)
    assert (values.stop.noise, values.stop.time, values.stop.samples) == (0.01, 0.5, 1024)
    assert place / "lamp.xml" in scene.load(place / "haze.yaml").inputs
    (place / "haze.yaml").write_text(SCENE)
    values = scene.load(place / "haze.yaml").values
    assert values.tolerance is values.scene is values.film.width is values.stop.time is None
    for key, value, said in (("film", "{width: 64}", "film.height: missing"), ("stop.time", "3 min", "times take ms, s"),
                             ("stop.noise", "2", "(2 %?)"), ("tolerance", "0", "at least 1e-06"),
                                 ("scene", "{unit: 1 m}", "mitsuba")):
        with pytest.raises(bakery.RecipeError, match=re.escape(said)):
            scene.load(place / "haze.yaml", {key: value})


def test_samples_that_go_on(call, place, milk, monkeypatch):
    """`--resume` reaches a renderer that declares it; the others refuse it."""
    (place / "milk.h5").touch()
    status, _, err = call("render", place / "haze.yaml", "--resume")
    assert status == 2 and "--resume: the renderer toy cannot go on from an EXR" in err
    assert "is no scene" in call("render", place / "milk.h5", "--resume")[2]
    told = {}

    def render(scene, output, **options):
        told.update(options)
        return {"files": []}

    monkeypatch.setattr("tests.toy_renderer.scene.RESUMES", True)
    monkeypatch.setattr("tests.toy_renderer.render", render)
    assert call("render", place / "haze.yaml", "--resume", "--json")[0] == 0 and told["resume"] is True
    assert call("render", place / "haze.yaml", "--json")[0] == 0
