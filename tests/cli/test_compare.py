"""`bake compare` as a user calls it: what is rendered and what is taken, numbers, the page, and every way to be wrong."""

import importlib.util
import json
import re
import signal
from html.parser import HTMLParser
from itertools import chain, repeat
from pathlib import Path

import numpy as np
import pytest

from bakery.errors import UsageError
from bakery.scenes.methods import drawing
from bakery.trade.methods import Curve
from renderers.colour import LUMINANCE
from renderers.pictures import comparison, differences
from renderers.pictures.comparison import jobs
from renderers.pictures.progressive import Estimate, Part, Stop, fingerprint
from renderers.pictures.running import Render
from tests.browser import CHROMIUM, Page
from tests.renders import hazy, refused_unrendered

SHAPE = (24, 32, 3)
LEVELS = {"single": 1.0, "isotropic": 1.1}


@pytest.fixture
def place(call, milk, monkeypatch):
    """A folder with a scene whose two methods differ by 10 % and have noise of 2 % after 16 passes; `asked`: renders so far."""
    return hazy(call, milk, monkeypatch, render)


def render(scene, output, *, quality=None, variant=None, seed=None, overwrite=False, resume=False, progress=None):
    """By passes, without a kernel."""
    job = Render(scene, output, overwrite=overwrite, progress=progress)
    name = job.scene.values.toy.method

    def passed(index):
        if render.interrupt == (name, index):
            signal.raise_signal(signal.SIGINT)
        return {"": LEVELS[name] + 0.08 * np.random.default_rng([seed, index]).standard_normal(SHAPE)}

    estimate = Estimate([Part("haze", passed)], {"scene": fingerprint(name), "asset": job.asset.content_hash})
    if resume:
        estimate.resume(job.pair[1])
    begun = estimate.samples
    estimate.run(Stop(noise=job.scene.values.stop.noise, samples=16), job.progress(0.0, 1.0))
    render.asked.append((name, seed, begun, estimate.samples))
    return estimate.finish(job, method=name, reasons=[f"why {name} & <how>"])


def test_the_drawing_shows_what_was_measured():
    """Curves begin with the first picture, and go through what was rendered."""
    curves = [Curve("a", 8.0, 1.0, 0.05, 0.0, 0.0), Curve("b", 2.0, 0.5, 0.02, 0.03, 0.04)]
    columns = dict(drawing(curves, None).columns)
    assert columns["a: time [s]"][0] == pytest.approx(1.0, rel=0.15) and columns["b: time [s]"][0] == pytest.approx(0.5)
    assert np.interp(8.0, columns["a: time [s]"], columns["a: error"]) == pytest.approx(0.05, rel=0.01)
    assert np.all(columns["b: at most"] > columns["b: error"])


def compared(call, place, *words, methods="single,isotropic"):
    status, out, err = call("compare", place / "haze.yaml", "--methods", methods, "--json", *words)
    assert status == 0, err
    return json.loads(out)


class Parts(HTMLParser):
    """Tags, ids and texts of a page; every address in it."""

    def __init__(self, path):
        super().__init__()
        self.ids, self.addresses, self.text, self.tags = [], [], "", []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.ids += [value for name, value in attributes if name == "id"]
        self.addresses += [value for name, value in attributes if name in ("src", "href")]

    def handle_data(self, data):
        self.text += data


def test_a_method_that_misses_its_noise_is_status_3(call, place):
    """The page is there, and says it; what is taken from an earlier call misses as before."""
    for taken in (False, True):
        status, out, err = call("compare", place / "haze.yaml", "--methods", "single,isotropic", "--noise", "0.1%", "--json")
        found = json.loads(out)
        assert status == 3 and [one["taken"] for one in found["methods"]] == [taken] * 2
        for one in found["methods"]:
            assert f"{one['files'][0]}: {one['missed'][0]}\n" in err and "a noise of 0.1 % was wanted" in one["missed"][0]
        assert "Missed: samples ended the passes" in Parts(Path(found["page"])).text


def test_numbers_and_page(call, place):
    """Against levels that are known: each figure within 4.5 of its own standard errors; the noise of one is not the other's."""
    found = compared(call, place)
    single, isotropic = found["methods"]
    assert [one["name"] for one in found["methods"]] == ["single", "isotropic"] and found["reference"] == "single"
    assert single["difference"] is None and single["seed"] != isotropic["seed"]
    difference = isotropic["difference"]
    assert difference["resolved"] and difference["error"] == pytest.approx(0.1, abs=0.005)
    assert difference["bias"] == pytest.approx(0.1, abs=4.5 * difference["bias_error"]) and difference["bias_error"] < 0.002
    assert difference["noise"] == pytest.approx(0.02 * np.sqrt(2 * np.sum(LUMINANCE**2)), rel=0.1) and not difference["left_in"]
    assert set(isotropic["seconds"]) == {"write", "total"} and isotropic["compiling"] == 0 and not isotropic["taken"]
    page = place / "haze_compare.html"
    assert found["page"] == str(page) and found["bytes"] == page.stat().st_size
    parts = Parts(page)
    assert {"p0", "p1", "d1", "slider"} <= set(parts.ids) and "d0" not in parts.ids
    assert parts.addresses and all(address.startswith("data:image/png;base64,") for address in parts.addresses)
    for said in ("A haze & a <sun>", "why isotropic & <how>", "10 %", "haze: 2 methods", "drawn", *found["trade"]["advice"]):
        assert said in parts.text, said
    assert re.search("script-src 'sha256-[A-Za-z0-9+/=]+'\"", page.read_text())


@pytest.mark.slow
def test_what_is_there_is_taken(call, place, monkeypatch):
    """Until something that it depends on changes; samples go on with --resume, all begin anew with --force."""
    compared(call, place)
    status, out, err = call("compare", place / "haze.yaml", "--methods", "isotropic,single")
    pictures = [f"{place}/haze_compare/{name}.{kind}" for name in ("isotropic", "single") for kind in ("png", "exr")]
    assert status == 0 and out.split() == [str(place / "haze_compare.html"), *pictures], err
    with monkeypatch.context() as elsewhere:  # paths are as this call sees them
        elsewhere.chdir(place.parent)
        status, near, _ = call("compare", f"{place.name}/haze.yaml", "--methods", "isotropic,single")
    assert status == 0 and near.split() == [str(path).removeprefix(f"{place.parent}/") for path in out.split()]
    assert len(render.asked) == 2 and "single: error 9.2 %, bias −9.1" in err and err.count("(rendered before)") == 2
    found = compared(call, place, "--noise", "4%")  # reached after 4 passes
    assert [samples for *_, samples in render.asked[2:]] == [4, 4] and found["overrides"] == {"stop.noise": "4%"}
    compared(call, place, "--resume")
    assert render.asked[4:] == [("single", 0, 4, 16), ("isotropic", 1, 4, 16)]
    compared(call, place, "--seed", "7")
    compared(call, place, "--seed", "7", "--force")
    assert render.asked[6:] == 2 * [("single", 7, 0, 16), ("isotropic", 8, 0, 16)]
    (place / "haze_compare" / "single.json").write_text("{}")
    compared(call, place, "--seed", "7")
    assert render.asked[10:] == [("single", 7, 0, 16)]


@pytest.mark.slow
def test_resume_goes_on_with_the_same_alone(call, place):
    """Anything else is rendered anew, and that is said, here where the asset is another; not where quality is."""
    words = [place / "haze.yaml", "--methods", "single,isotropic", "--quiet"]
    assert call("compare", *words, "--noise", "4%")[0] == 0
    assert [one["anew"] for one in compared(call, place, "--resume", "--quality", "preview")["methods"]] == [False, False]
    assert [begun for *_, begun, _ in render.asked] == [0, 0, 4, 4]
    assert call(place / "milk.yaml", "-o", place / "milk.h5", "--set", "medium.phase.g=0.1", "--quiet")[0] == 0
    status, _, err = call("compare", *words[:3], "--resume")
    assert status == 0 and err.count("(rendered again: the earlier picture had other inputs)") == 2
    assert [begun for *_, begun, _ in render.asked[4:]] == [0, 0]


def test_what_shows_a_picture_is_no_part_of_it(call, place):
    """Another exposure writes the PNGs, from the passes that are there; another name or description writes nothing."""
    compared(call, place)
    shown = (place / "haze_compare" / "single.png").read_bytes()
    found = compared(call, place, "--set", "display.exposure=0.5")
    assert [(begun, samples) for *_, begun, samples in render.asked[2:]] == [(16, 16), (16, 16)]
    assert (place / "haze_compare" / "single.png").read_bytes() != shown and not any(one["anew"] for one in found["methods"])
    page = ("-o", place / "haze_compare.html", "--set", "display.exposure=0.5")
    found = compared(call, place, *page, "--set", "name=fog", "--set", "description=fog")
    assert found["description"] == "fog" and all(one["taken"] for one in found["methods"]) and len(render.asked) == 4


def test_an_interruption_is_gone_on_with(call, place):
    """What is finished is taken, what is not goes on, and ends as if there had been no break; no page before that."""
    compared(call, place, "-o", place / "whole.html")
    render.interrupt = ("isotropic", 2)
    status, out, err = call("compare", place / "haze.yaml", "--methods", "single,isotropic")
    assert (status, out) == (130, "") and "interrupted while rendering isotropic" in err and "same call goes on" in err
    assert not (place / "haze_compare.html").exists()
    render.interrupt = None
    found = compared(call, place)
    assert render.asked[2:] == [("single", 0, 0, 16), ("isotropic", 1, 0, 3), ("isotropic", 1, 3, 16)]
    assert [one["taken"] for one in found["methods"]] == [True, False]
    assert found["methods"][1]["seconds"]["earlier"] > 0
    whole, again = (differences.read(place / folder / "isotropic.exr", "") for folder in ("whole", "haze_compare"))
    assert np.allclose(whole.rgb, again.rgb, rtol=1e-6)


def test_what_is_refused_leaves_no_folder(call, place, monkeypatch):
    """Where the first method fails, nothing is to be gone on with."""
    def refuses(scene, output, **options):
        raise UsageError("no picture today")

    monkeypatch.setattr("tests.toy_renderer.render", refuses)
    status, _, err = call("compare", place / "haze.yaml", "--methods", "single,isotropic")
    assert status == 2 and "no picture today" in err and not (place / "haze_compare").exists()


def test_time_that_went_into_compiling_is_given_back(place, monkeypatch):
    """Once, as time for passes, no more than was asked for; the report has the time of both."""
    asked = []

    def timed(scene, output, **options):
        report = render(scene, output, **options)
        asked.append((scene.values.stop.time, options.get("resume", False)))
        return report | {"stopped_by": "time", "seconds": {"passes": 30.0, "total": 31.0}}

    monkeypatch.setattr("tests.toy_renderer.render", timed)
    for seconds, quality, again in ((120, "final", 20), (120, "preview", 80), (5, "final", 5)):  # preview takes a quarter
        clock = chain([(0.0, 0.0)], repeat((20.0, 5.0)))  # seconds that went into compiling, of the clock, of processors
        job, = jobs(place / "haze.yaml", ["single"], place, {"stop.time": f"{seconds} s"})
        made = comparison.render(comparison.baked(job), quality=quality, compiled=lambda: next(clock))
        assert asked[-2:] == [(seconds, False), (again, True)]
    assert made.report["seconds"] == {"passes": 60.0, "total": 62.0} and made.compiling == 20.0


@pytest.mark.slow
def test_settings_of_one_method(call, place):
    """Beside the method as it is, with noise and files of their own; a bare key is of the method's section."""
    found = compared(call, place, "--set", "tolerance=3%", methods="single,single:stop.noise=4%,isotropic:stop.samples=9")
    assert [one["overrides"] for one in found["methods"]] == [
        {"toy.method": "single"}, {"toy.method": "single", "stop.noise": "4%"}, {"toy.method": "isotropic", "stop.samples": "9"}]
    assert found["overrides"] == {"tolerance": "3%"} and found["trade"]["tolerance"] == 0.03
    assert [(name, samples) for name, _, _, samples in render.asked] == [("single", 16), ("single", 4), ("isotropic", 16)]
    assert len({one["seed"] for one in found["methods"]}) == 3 and found["methods"][1]["difference"]["error"] < 0.02
    assert (place / "haze_compare" / "single_stop.noise=4_.png").is_file()
    own = jobs(place / "haze.yaml", ["single:method=isotropic"], place, {})
    assert own[0].scene.values.toy.method == "isotropic"


@pytest.mark.slow
def test_references(call, place):
    """A method that is not in the list is rendered too; a file is held against all, whatever it says of its noise."""
    found = compared(call, place, "--reference", "isotropic", methods="single")
    assert [one["name"] for one in found["methods"]] == ["isotropic", "single"]
    assert found["methods"][1]["difference"]["bias"] == pytest.approx(-1 / 11, abs=0.01)
    own = compared(call, place, "--reference", place / "haze_compare" / "isotropic.exr", "-o", place / "b.html", methods="single")
    assert own["methods"][0]["difference"] == found["methods"][1]["difference"] and len(own["methods"]) == 1
    assert own["reference"] == "isotropic.exr" and own["reference_file"] == str(place / "haze_compare" / "isotropic.exr")
    from renderers.mitsuba import bitmaps

    for name, level, shape in (("plain", 1.0, SHAPE), ("black", 0.0, SHAPE), ("small", 1.0, (12, 16, 3))):
        rgb = np.full(shape, level)
        bitmaps.write((place / f"{name}.png", place / f"{name}.exr"), rgb, rgb)
    plain = compared(call, place, "--reference", place / "plain.exr", "-o", place / "b.html", methods="single")
    assert "not subtracted: that of plain.exr." in plain["remarks"][-1] and plain["methods"][0]["difference"]["left_in"]
    black = compared(call, place, "--reference", place / "black.exr", "-o", place / "b.html", methods="single")
    assert "is black" in black["remarks"][-1] and black["methods"][0]["difference"] is None
    status, _, err = call("compare", place / "haze.yaml", "--methods", "single", "--reference", place / "small.exr")
    assert status == 2 and "has 16 x 12 pixels, and single 32 x 24" in err


@pytest.mark.slow
def test_without_flip(call, place, monkeypatch):
    """It is said on the page and on standard error, and the rest goes on; with it there are maps."""
    if importlib.util.find_spec("flip_evaluator"):
        assert compared(call, place)["methods"][1]["flip"] > 0 and "f1" in Parts(place / "haze_compare.html").ids
    monkeypatch.setattr(differences, "find_spec", lambda name: None)
    status, _, err = call("compare", place / "haze.yaml", "--methods", "single,isotropic")
    parts = Parts(place / "haze_compare.html")
    assert status == 0 and all("flip-evaluator is not installed" in text for text in (err, parts.text))
    assert "f1" not in parts.ids and "d1" in parts.ids


WRONG = (
    ("haze.yaml --methods single,isotropc", "expected single or isotropic (isotropic?)"),
    ("haze.yaml --methods single,single", "found single twice"),
    ("haze.yaml --methods single", "two or more, or a --reference"),
    ("haze.yaml --methods single,", "found \"single,\", with a name missing"),
    ("haze.yaml --methods single,single:sun", "expected METHOD:KEY=VALUE"),
    ("haze.yaml --methods single,single:son=[1,1,1]", "toy.son"),
    ("haze.yaml --methods single --reference gone.exr", "there is no such file"),
    ("haze.yaml --methods single --reference other", 'found "other"'),
    ("haze.yaml --methods single,isotropic --set toy.method=single", "those of --methods"),
    ("haze.yaml --methods single,isotropic --time 5", "has no unit"),
    ("haze.yaml --methods single,isotropic --quality good", "expected draft, preview, final"),
    ("haze.yaml --methods single,isotropic --resume --force", "use one of them"),
    ("haze.yaml --methods single,isotropic -o page.htm", "ends in .html"),
    ("haze.yaml --methods single,isotropic -o notes.html", "not an HTML page"),
    ("milk.h5 --methods single,isotropic", "only scenes have methods"),
    ("gone.yaml --methods single,isotropic", "no such scene"),
)


def test_what_is_wrong_is_said_before_anything_is_rendered(call, place, monkeypatch):
    monkeypatch.chdir(place)
    refused_unrendered(call, place, "compare", WRONG)
    assert not render.asked


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: the slider of the page is not tried")
def test_the_slider_in_a_browser(call, place):
    """Keys, mouse and address move it, nothing is complained about, and on a phone nothing is wider than the screen."""
    page = compared(call, place)["page"]
    at = "document.querySelector('.move').value"
    names = "[...document.querySelectorAll('.name')].map(one => one.textContent).join()"
    place_of_view = "(({x, y, width}) => [x, y, width])(document.querySelector('.view').getBoundingClientRect())"
    with Page(page, address="#left=isotropic&right=single&at=30") as shown:
        assert shown.value(names) == "isotropic,single" and float(shown.value(at)) == 30
        assert shown.value("getComputedStyle(document.querySelector('.over')).clipPath") == "inset(0px 70% 0px 0px)"
        assert shown.value("document.querySelector('.over').src == document.getElementById('p1').src")
        shown.value("document.querySelector('.move').focus()")
        shown.key("ArrowRight", 39)
        assert float(shown.value(at)) == 30.5
        x, y, width = shown.value(place_of_view)
        shown.drag((x + 0.3 * width, y + 20), (x + 0.75 * width, y + 20))
        assert float(shown.value(at)) == pytest.approx(75, abs=0.5)
        shown.value("document.querySelector('select').focus()")
        shown.key("ArrowDown", 40)
        assert shown.value(names) == "isotropic: difference,single"
        assert shown.said == []
    with Page(page, width=390, height=844, dark=True) as shown:
        assert shown.value("document.documentElement.scrollWidth") == 390 and shown.said == []
        assert shown.value("getComputedStyle(document.body).backgroundColor") == "rgb(20, 24, 29)"
