"""`bake trade SCENE` as a user calls it: points of a toy whose passes take a second each, on a clock of their own."""

import json
import signal

import numpy as np
import pytest

from bakery.errors import UsageError
from bakery.scenes import is_scene
from renderers.choice import Choice
from renderers.colour import LUMINANCE
from renderers.pictures import comparison
from renderers.pictures.progressive import Estimate, Part, Stop, fingerprint
from renderers.pictures.running import Render
from tests import toy_renderer
from tests.cli.test_compare import Parts
from tests.renders import hazy, refused_unrendered

SHAPE = (24, 32, 3)
LEVELS, NOISE = {"single": 1.0, "isotropic": 1.01}, {"single": 0.25, "isotropic": 0.025}  # of a pass, a channel
SETUP = 2.0  # s, before the first pass


@pytest.fixture
def place(call, milk, monkeypatch):
    """A folder with a scene by two methods: one exact, the other 1 % off with a tenth of the noise; `asked`: renders so far."""
    monkeypatch.setattr(comparison, "_clocks", lambda compiled: (render.now, render.now, 0.0))
    return hazy(call, milk, monkeypatch, render, broken="", now=0.0, took={})


def render(scene, output, *, quality=None, variant=None, seed=None, overwrite=False, resume=False, progress=None):
    """By passes, without a kernel."""
    job = Render(scene, output, overwrite=overwrite, progress=progress)
    assert scene.whole
    values, name = job.scene.values, job.scene.values.toy.method
    if name == render.broken:
        raise UsageError(f"{name} cannot do this")
    render.now += SETUP

    def passed(index):
        render.now += 1.0
        if render.interrupt == (name, index):
            signal.raise_signal(signal.SIGINT)
        return {"": LEVELS[name] + NOISE[name] * np.random.default_rng([seed, index]).standard_normal(SHAPE)}

    estimate = Estimate([Part("haze", passed)], {"scene": fingerprint(name, values.toy.sun)})
    if resume:
        estimate.resume(job.pair[1])
    begun = estimate.samples
    estimate.run(Stop(noise=values.stop.noise), job.progress(0.0, 1.0))
    render.asked.append((name, begun, estimate.samples))
    return estimate.finish(job, method=render.took.get(name, name))


def traded(call, place, *words):
    status, out, err = call("trade", place / "haze.yaml", "--json", *words)
    assert status == 0, err
    return json.loads(out)


def test_the_quickest_to_the_tolerance_is_named(call, place):
    """By a clock that passes alone move: times to the tolerance are those of the noise put in, within ten standard errors."""
    status, out, err = call("trade", place / "haze.yaml")
    assert status == 0, err
    found = traded(call, place)
    trade, single = found["trade"], found["methods"][0]
    assert found["reference"] == single["name"] == "single" and found["as_it_stands"] == "single" and trade["tolerance"] == 0.05
    passes = 0.25**2 * float(np.sum(LUMINANCE**2)) / 0.05**2
    assert trade["until"]["single"] == pytest.approx(SETUP + passes, rel=0.1)
    assert trade["until"]["isotropic"] == pytest.approx(SETUP + 2.0)  # two passes are more than enough
    assert single["pace"]["setup"] == SETUP and single["noise"] <= 0.025  # half of the tolerance
    isotropic = found["methods"][1]["difference"]
    assert isotropic["bias"] == pytest.approx(0.01, abs=4.5 * isotropic["bias_error"]) and 0 < isotropic["bias_error"] < 0.001
    advised = trade["advised"]
    assert (advised["name"], advised["alike"], advised["next"]["name"]) == ("isotropic", [], "single")
    assert {one["name"] for one in trade["ranges"]} == {"single", "isotropic"}
    for said in (trade["advice"][-1], "front", "as it stands", "--set toy.method=isotropic --set 'stop={noise: "):
        assert said in out, out
    assert trade["advice"][-1].startswith("For 5 %: isotropic, after 4 s; ")
    parts = Parts(place / "haze_trade.html")
    assert out.splitlines()[-1] == found["page"] == str(place / "haze_trade.html")
    assert {"p0", "p1", "d1"} <= set(parts.ids) and all(one.startswith("data:") for one in parts.addresses)
    assert "error against time" in parts.text and trade["advice"][-1] in parts.text


def test_figures_of_the_picture_are_no_stop_of_pixels(call, place):
    """Where the tolerance is one of pixels, that is said, and the command stops as the scene does."""
    found = traded(call, place, "--set", "measure=pixels")
    status, out, err = call("trade", place / "haze.yaml", "--set", "measure=pixels")
    assert status == 0 and found["measure"] == "pixels" and "of the picture as a whole" in found["remarks"][-1]
    assert found["remarks"][-1] in out and found["remarks"][-1] in Parts(place / "haze_trade.html").text
    assert "--set measure=pixels --set toy.method=isotropic" in out and "stop" not in out


@pytest.mark.slow
def test_finished_points_are_kept(call, place):
    """An interruption loses none, the same call again renders nothing; another scene or seed is rendered anew."""
    render.interrupt = ("isotropic", 2)
    status, out, err = call("trade", place / "haze.yaml")
    assert (status, out) == (130, "") and "the same call goes on with it" in err and not (place / "haze_trade.html").exists()
    render.interrupt, before = None, list(render.asked)
    found = traded(call, place)
    assert before[0][:2] == ("single", 0) and before[1][:2] == ("isotropic", 0)
    after = render.asked[len(before):]
    assert all(begun > 0 for _, begun, _ in after) and after[0][:2] == ("isotropic", before[1][2])
    count = len(render.asked)
    again = traded(call, place)
    assert len(render.asked) == count and all(one["taken"] for one in again["methods"])
    assert again["trade"] == found["trade"]
    for words in (("--set", "toy.sun=[1, 2, -2]"), ("--seed", "7")):
        count = len(render.asked)
        traded(call, place, *words)
        assert [begun for _, begun, _ in render.asked[count:]][:2] == [0, 0]


def test_a_budget_that_is_spent_begins_no_other_point(call, place):
    """The reference is rendered in any case; a later call goes on with the others."""
    found = traded(call, place, "--budget", "1e-9")
    assert [one["name"] for one in found["methods"]] == ["single"] and found["trade"] is None
    assert "Not rendered: isotropic: the budget was spent before; the same call goes on with it" in found["remarks"]
    assert [one["name"] for one in traded(call, place)["methods"]] == ["single", "isotropic"]


def test_what_cannot_be_rendered_is_said(call, place, monkeypatch):
    """And the others go on; without a reference it is an error."""
    monkeypatch.setattr("tests.toy_renderer.scene.POINTS", ("single", "isotropic", "single:son=1"))
    render.broken = "isotropic"
    found = traded(call, place)
    assert found["refused"]["isotropic"] == "isotropic cannot do this" and set(found["refused"]) == {"isotropic", "single:son=1"}
    assert found["trade"] is None and [one["name"] for one in found["methods"]] == ["single"]
    render.broken = "single"
    status, out, err = call("trade", place / "haze.yaml", "-o", place / "b.html")
    assert status == 2 and not out and "single cannot do this" in err and len(err.splitlines()) == 1
    assert call("trade", place / "haze.yaml", "-o", place / "c.html", "--methods", "single")[0] == 2
    assert any((place / "b").iterdir()) and not (place / "c").exists()  # only the other method's pictures stay


@pytest.mark.parametrize("begin, scene", [
    ("\ufeffbakery_scene: 2", True), ('"bakery_scene": 1', True), ("'bakery_scene' : 1\nname: [", True),
    ("bakery: 1\ndescription: \"\n\nbakery_scene: 2\"", False), ("bakery: 1\nnote: {bakery_scene: 2}", False)])
def test_what_is_a_scene(tmp_path, begin, scene):
    (tmp_path / "a.yaml").write_text(f"{begin}\n", encoding="utf-8")
    assert is_scene(tmp_path / "a.yaml") == scene and not is_scene(tmp_path) and not is_scene(tmp_path / "gone.yaml")


def test_scenes_and_recipes_are_not_mixed_up(call, place, monkeypatch):
    """One line that says what would do, none about keys."""
    monkeypatch.chdir(place)
    for words in ("haze.yaml", "haze.yaml --sweep tolerance=1%,2%"):
        assert call(*words.split()) == (2, "", "haze.yaml: is a scene; `bake render haze.yaml` renders it\n")
    for words in ("render milk.yaml", "compare milk.yaml --methods a,b", "plan milk.yaml --scene milk.yaml"):
        status, out, err = call(*words.split())
        assert (status, out) == (2, "")
        assert err.startswith("milk.yaml: is a recipe; `bake milk.yaml` bakes it, `bake render` takes its asset, and a scene ")


WRONG = (
    ("haze.yaml --methods single,isotropc", "expected single or isotropic (isotropic?)"),
    ("haze.yaml --methods single,single", "found single twice"),
    ("haze.yaml --budget 0", "--budget: found 0; expected a number of minutes above 0"),
    ("haze.yaml --seed x", '--seed: found "x"; expected a whole number'),
    ("haze.yaml --seed 9007199254740993", "expected a whole number from 0 to 2^53"),
    ("haze.yaml --stage optics", "--stage: haze.yaml is a scene, which has none"),
    ("haze.yaml --measure phase", "--measure: haze.yaml is a scene"),
    ("haze.yaml --set toy.method=single", "the methods are those of --methods"),
    ("haze.yaml --set toy.methd=single", "toy.methd"),
    ("haze.yaml -o haze.trade", "ends in .html"),
    ("haze.yaml -o notes.html", "not an HTML page"),
    ("milk.yaml --methods single", "--methods: milk.yaml is a recipe"),
    ("haze.xml", "found \"haze.xml\", which is no scene (.yaml)"),
)


def test_what_is_wrong_is_said_before_anything_is_rendered(call, place, monkeypatch):
    monkeypatch.chdir(place)
    refused_unrendered(call, place, "trade", WRONG)
    assert not render.asked


def test_the_time_of_pilots_counts(call, place, monkeypatch):
    """Of a method that chooses, for a render as the scene asks for it: 30 s of pilots, more than the other one needs."""
    stops = []

    def of_scene(scene, **_):
        stops.append((scene.values.stop.noise, scene.values.stop.time))
        chooses = scene.values.toy.method == "isotropic"
        return Choice("isotropic", ["isotropic"], [], None, "by pilots", spent=30.0) if chooses else None

    monkeypatch.setattr(comparison.choice, "of_scene", of_scene)
    monkeypatch.setattr(toy_renderer.scene, "KEPT", ("isotropic",))
    found = traded(call, place)
    assert not found["methods"][1]["exact"]  # it has an error of its own within the tolerance
    assert found["trade"]["until"]["isotropic"] == pytest.approx(30.0 + SETUP + 2.0)
    assert found["trade"]["advised"]["name"] == "single" and set(stops) == {(None, None)}


def test_what_chose_a_method_without_an_error_has_none(call, place, monkeypatch):
    """Noise hid up to half of the tolerance, and `auto` that is `paths` took 1.3 times as long as `paths` by that."""
    render.took = {"isotropic": "single"}
    monkeypatch.setattr(toy_renderer.scene, "KEPT", ("isotropic",))
    assert traded(call, place)["methods"][1]["exact"]
