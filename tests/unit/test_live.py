"""Renders that are looked at: what an observer sees and stops, pictures one after another, frames for a page."""

import io
import os
import signal
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from bakery.errors import Interrupted
from renderers import colour
from renderers.mitsuba import bitmaps
from renderers.pictures import images, live, reached
from renderers.pictures.picture import Picture
from renderers.pictures.progressive import Estimate, Part, Stop
from renderers.pictures.running import rgb_layers

SHAPE = (6, 8, 3)
DISPLAY = {"curve": "reinhard", "exposure": 2.0, "white": 4.0}


class Job:
    """What `renderers.pictures.running.Render` does at the end, without a scene."""

    quality = None

    def __init__(self, folder):
        self.pair = folder / "x.png", folder / "x.exr"
        self.scene = SimpleNamespace(values=SimpleNamespace(display=DISPLAY, denoise="no"))

    def finish(self, rgb, *, layers, text, **more):
        bitmaps.write(self.pair, images.shown(rgb, **DISPLAY)[0], rgb_layers("", rgb) | layers, text)
        return {"files": [str(path) for path in self.pair], "missed": list(more.pop("unreached"))} | more


def noisy(word, level=1.0):
    """A part's passes: normal noise by pass, and a layer."""

    def render(index):
        once = level + 0.3 * np.random.default_rng([word, index]).standard_normal(SHAPE)
        return {"": once + 0.25, "order1": once, "first0": np.full(SHAPE, 0.25), "inner": once}

    return render


def pair():
    return Estimate([Part("splat", noisy(1), samples=2), Part("walk", noisy(2, level=3.0), samples=2)], {"size": list(SHAPE[:2])})


def written(folder, estimate):
    folder.mkdir()
    report = estimate.finish(Job(folder), method="test")
    return report, [(folder / name).read_bytes() for name in ("x.png", "x.exr")]


class Rendering:
    """A `renderers.pictures.passes.Rendering` without a scene."""

    def __init__(self, folder, samples=12):
        self.job, self.estimate, self.stop = Job(folder), pair(), Stop(noise=1e-9, samples=samples)
        self.method, self.reasons, self.denoised = SimpleNamespace(name="test"), ["as it is"], None
        self.variant = "scalar_rgb"

    def run(self, observer=None):
        self.estimate.run(self.stop, None, observer)

    def finish(self):
        return self.estimate.finish(self.job, method="test", reasons=self.reasons)


# ---- observers


def test_an_observer_changes_no_byte(tmp_path):
    """It is asked before each pass once every part has one, and at the end."""
    alone, watched, noises = pair(), pair(), []
    alone.run(Stop(samples=12))
    watched.run(Stop(samples=12), None, lambda noise: noises.append((noise, watched.so_far().rgb.sum())))
    assert written(tmp_path / "alone", alone)[1] == written(tmp_path / "watched", watched)[1]
    assert len(noises) == 2 * 6 - 2 + 1  # not before the first two passes
    assert noises[0][0] is None and noises[-1][0] == pytest.approx(max(watched.noise, watched.noise_region, watched.noise_mean))


def test_a_request_ends_the_passes_with_whole_files(tmp_path):
    """From the picture that it leaves the passes go on to what they would have been, in the same call of a program too."""
    whole, stopped, on = pair(), pair(), pair()
    whole.run(Stop(samples=12))
    stopped.run(Stop(noise=1e-9, samples=12), None, lambda noise: stopped.samples >= 6)
    assert (stopped.stopped_by, stopped.samples, stopped.signal) == ("request", 6, 0)
    report, _ = written(tmp_path / "stopped", stopped)
    assert report["stopped"] and "stopped on request, after 6 samples a pixel" in report["reasons"]
    assert report["missed"] == list(stopped.unreached) and stopped.unreached[0].startswith("a request ended the passes: a noise")
    on.resume(tmp_path / "stopped" / "x.exr")
    on.run(Stop(samples=12))
    stopped.run(Stop(samples=12))
    assert np.array_equal(stopped.rgb, whole.rgb) and np.allclose(on.rgb, whole.rgb, rtol=1e-6)


def test_a_request_waits_for_a_picture():
    estimate = pair()
    estimate.run(Stop(noise=0.01), None, lambda noise: True)
    assert [mean.count for mean in estimate.means.values()] == [1, 1] and estimate.stopped_by == "request"
    assert "after so few it is not known" in estimate.unreached[0]


def test_a_request_that_comes_when_all_is_reached_is_none():
    estimate = pair()
    estimate.run(Stop(samples=4), None, lambda noise: estimate.samples >= 4)
    assert estimate.stopped_by == "samples" and not reached.unreached("request", 0.1, 0.05)


def test_a_picture_stays_what_it_was():
    estimate, pictures = pair(), []
    estimate.run(Stop(samples=12), None, lambda noise: pictures.append(
        (estimate.so_far(), estimate.rgb.copy(), estimate.layer("order1").copy(), estimate.samples, estimate.noise)))
    for still, rgb, once, samples, noise in pictures:
        assert np.array_equal(still.rgb, rgb) and np.array_equal(still.layer("order1"), once)
        assert (still.samples, still.noise) == (samples, noise)
    with pytest.raises(ValueError, match="no further passes"):
        pictures[0][0].run(Stop(samples=20))


def test_seconds_left():
    """At the pace of the clock: passes of 1 and 3 s, of which two thirds were seen here, took twice as long as the quickest."""
    estimate = pair()
    estimate.run(Stop(samples=12))
    for mean, seconds in zip(estimate.means.values(), (1.0, 3.0)):
        mean.seconds, mean.resumed = seconds, 2
    estimate.spent = 2 * 4 * (1.0 + 3.0)
    assert estimate.seconds_left(Stop(samples=20), None) == pytest.approx(2 * 4 * (1.0 + 3.0))
    assert estimate.seconds_left(Stop(noise=0.01), 0.02) == pytest.approx(2 * 6 * 4.0 * 3)  # four times the passes in all
    assert estimate.seconds_left(Stop(noise=0.01, time=40.0), 0.02) == pytest.approx(8.0)
    assert estimate.seconds_left(Stop(noise=0.01), 0.005) == 0.0
    for mean, count in zip(estimate.means.values(), (4, 1)):
        mean.count, mean.resumed = count, 0
    estimate.spent = 2 * (4 * 1.0 + 1 * 3.0)
    assert estimate.seconds_left(Stop(time=1.0), 0.02) == pytest.approx(2 * 3.0)  # a second pass of each kind comes in any case
    assert estimate.seconds_left(Stop(), 0.02) is None and pair().seconds_left(Stop(samples=4), None) is None


# ---- pictures one after another


@pytest.fixture
def pictures(tmp_path, monkeypatch):
    monkeypatch.setattr(live, "_prepared", lambda path, output, **options: Rendering(tmp_path, **options))
    return lambda **options: live.Pictures("x.yaml", **options)


def test_pictures_one_after_another(pictures, tmp_path):
    shown = list(pictures(every=0))
    assert [picture.samples for picture in shown][:4] == [2, 2, 4, 4] and shown[-1].samples == 12
    assert all(picture.report is None for picture in shown[:-1]) and shown[-1].report["samples"] == 12
    channels, _ = bitmaps.read(tmp_path / "x.exr")
    assert np.allclose(shown[-1].rgb[..., 0], channels["R"], rtol=1e-6)
    assert np.allclose(shown[-1].error[..., 3], channels["noise.Y"], rtol=1e-6)
    assert np.array_equal(np.array(Image.open(io.BytesIO(shown[-1]._repr_png_()))), np.array(Image.open(tmp_path / "x.png")))
    assert repr(shown[-1]).startswith("<Picture 8 x 6, test, 12 samples a pixel, noise ") and "written" in repr(shown[-1])


def test_who_leaves_early_leaves_no_files(pictures, tmp_path):
    for _ in pictures(every=0):
        break
    assert list(tmp_path.iterdir()) == []


def test_who_stops_has_the_picture_written(pictures, tmp_path):
    running = pictures(every=0)
    for picture in running:
        if picture.samples >= 4:
            running.stop()
    assert running.report["stopped"] and picture.report is running.report and picture.samples == 4
    assert {path.name for path in tmp_path.iterdir()} == {"x.png", "x.exr"} and list(running) == []


def test_an_interruption_writes_the_picture(pictures, tmp_path):
    """As without an iterator: the files, and an error with the signal's status; nothing comes after it."""
    running = pictures(every=0)
    next(running)
    part = running._rendering.estimate.parts[0]
    render = part.render

    def interrupted(index):
        os.kill(os.getpid(), signal.SIGINT)
        return render(index)

    running._rendering.estimate.parts = (part._replace(render=interrupted), running._rendering.estimate.parts[1])
    with pytest.raises(Interrupted, match="--resume goes on with it") as fault:
        list(running)
    assert fault.value.exit_status == 130 and list(running) == [] and running.report is None
    assert {path.name for path in tmp_path.iterdir()} == {"x.png", "x.exr"}


def test_pictures_are_no_oftener_than_asked(pictures):
    """One without a wait in between: all passes together take less than an hour."""
    assert len(list(pictures(every=3600.0))) == 1


def test_a_notebook_shows_one_picture_that_gets_better(pictures, monkeypatch):
    shown = []
    handle = SimpleNamespace(update=lambda picture: shown.append(("update", picture.samples)))

    def display(picture, display_id):
        shown.append(("display", picture.samples))
        return handle

    monkeypatch.setitem(__import__("sys").modules, "IPython", SimpleNamespace())
    monkeypatch.setitem(__import__("sys").modules, "IPython.display", SimpleNamespace(display=display))
    pictures(every=0)._ipython_display_()
    assert [kind for kind, _ in shown] == ["display", *["update"] * (len(shown) - 1)] and shown[-1] == ("update", 12)


# ---- what a page is given


@pytest.fixture
def watched(tmp_path, monkeypatch):
    monkeypatch.setattr(live, "_OFTEN", 0.0)
    watch, rendering = live.Watch(), Rendering(tmp_path)
    watch.begin(rendering)
    return watch, rendering


def some_passes(watch, rendering, samples):
    rendering.estimate.run(Stop(samples=samples), None, watch.observe)


def test_frames_show_what_is_written(watched, tmp_path):
    watch, rendering = watched
    assert watch.frame("picture") is None and watch.state()["phase"] == "passes"
    some_passes(watch, rendering, 12)
    report = rendering.finish()
    watch.over(report)
    assert [layer["name"] for layer in watch.state()["layers"]] == ["picture", "noise", "order1", "first0"]  # none for programs
    frame = watch.frame("picture")
    assert np.array_equal(np.array(Image.open(io.BytesIO(frame.png))), np.array(Image.open(tmp_path / "x.png")))
    values, (channels, _) = np.frombuffer(frame.values, "<f4").reshape(6, 8, 6), bitmaps.read(tmp_path / "x.exr")
    assert np.allclose(values[..., 1], channels["G"], rtol=1e-6) and np.allclose(values[..., 4], channels["noise.G"], rtol=1e-6)
    noise, once = (watch.frame(name) for name in ("noise", "order1"))
    assert np.allclose(np.frombuffer(noise.values, "<f4").reshape(SHAPE), values[..., 3:]) and noise.white > 0
    assert np.allclose(np.frombuffer(once.values, "<f4").reshape(SHAPE)[..., 2], channels["order1.B"], rtol=1e-6)
    shares = np.array(Image.open(io.BytesIO(watch.frame("first0").png)))
    assert np.all(shares == round(255 * float(colour.encode(0.5))))  # as they are, without the tone curve
    state = watch.state()
    assert (state["phase"], state["samples"], state["report"]["files"]) == ("over", 12, report["files"])
    assert state["noise"] == pytest.approx(max(report[name] for name in ("noise", "noise_region", "noise_mean")))
    assert watch.frame("inner") is None and watch.frame("../x") is None


def test_frames_are_drawn_as_often_as_their_time_allows(watched, monkeypatch):
    """While passes go on none but the first where they may take no time; where they may, all that are asked for; and the last."""
    watch, rendering = watched
    watch._drawn = live.Allowance(0.0)
    some_passes(watch, rendering, 4)
    first = watch.frame("picture")
    some_passes(watch, rendering, 6)
    assert watch.frame("picture") is first and first.passes == 4
    watch._drawn = live.Allowance(1e9)
    later = watch.frame("picture")
    assert (later.number, later.passes) == (2, 6) and watch.frame("picture") is later
    watch._drawn = live.Allowance(0.0)
    some_passes(watch, rendering, 12)
    watch.over(rendering.finish())
    assert watch.frame("picture").passes == 12


def test_the_filter_runs_where_somebody_looks_and_as_seldom(tmp_path, monkeypatch):
    """Only while a page looks at its layer, within its time; where it can do nothing there is no layer; the last one is shown."""
    monkeypatch.setattr(live, "_OFTEN", 0.0)
    monkeypatch.setattr(live.denoise, "chosen", lambda values, quality, shared: (True, []))
    watch, rendering, runs = live.Watch(), Rendering(tmp_path), []

    def cleared(features=None):
        runs.append(rendering.estimate.samples)
        return SimpleNamespace(rgb=np.full(SHAPE, 0.25)) if len(runs) == 1 else None, []

    def names():
        return [layer["name"] for layer in watch.state()["layers"]]

    rendering.cleared = cleared
    watch.begin(rendering)
    watch._filtered = live.Allowance(1e9)
    some_passes(watch, rendering, 4)
    assert runs == [] and names()[:2] == ["picture", "denoised"] and watch.frame("denoised") is None
    some_passes(watch, rendering, 6)  # somebody asked
    assert runs[:1] == [4] and len(runs) == 2
    watch, rendering.estimate = live.Watch(), pair()
    runs.clear()
    watch.begin(rendering)
    watch._filtered = live.Allowance(0.0)
    watch.frame("denoised")
    some_passes(watch, rendering, 6)
    assert runs == []
    watch._filtered = live.Allowance(1e9)
    watch.observe(None)
    assert len(runs) == 1 and np.all(np.frombuffer(watch.frame("denoised").values, "<f4") == 0.25)
    watch.observe(None)
    assert len(runs) == 2 and "denoised" not in names() and watch.frame("denoised") is None
    report, rendering.denoised = rendering.finish(), SimpleNamespace(rgb=np.full(SHAPE, 0.5))
    watch.over(report)
    assert "denoised" in names() and np.all(np.frombuffer(watch.frame("denoised").values, "<f4") == 0.5)


def test_an_allowance_is_a_share_of_the_time():
    now = [10.0]
    allowance = live.Allowance(0.04, lambda: now[0])
    assert not allowance.allows(1e-9)
    now[0] = 15.0
    assert allowance.allows(0.19) and not allowance.allows(0.21)
    allowance.spent = 0.19
    assert not allowance.allows(0.02)


def test_news_come_when_there_are_some(watched):
    watch, rendering = watched
    version = watch.state()["version"]
    assert watch.state(version, 0.0)["version"] == version
    some_passes(watch, rendering, 4)
    state = watch.state(version, 60.0)  # at once
    assert state["version"] > version and state["samples"] == 4 and state["seconds_left"] is not None


def test_what_goes_wrong_is_on_the_page(monkeypatch):
    def fails(path, output, begins, **options):
        begins("choice")
        raise live.UsageError("x.yaml: found nothing")

    monkeypatch.setattr(live, "_prepared", fails)
    watch = live.Watch()
    with pytest.raises(live.UsageError):
        live.render("x.yaml", None, watch)
    state = watch.state()
    assert (state["phase"], state["part"], state["text"]) == ("failed", "choice", "x.yaml: found nothing") and watch.ended


def test_the_map_of_noise():
    """Brighter is noisier, the bright end is a round number, and a picture of one pass has a black one."""
    estimate = Estimate([Part("walk", lambda index: {"": np.ones(SHAPE) + index * (np.arange(8) >= 4)[None, :, None]})], {})
    estimate.run(Stop(), None, lambda noise: True)
    assert not Picture(estimate.so_far(), DISPLAY, "test").relative_error.any()
    estimate.run(Stop(samples=4))
    picture = Picture(estimate.so_far(), DISPLAY, "test")
    shown = picture.bytes_of("noise") @ colour.LUMINANCE
    assert shown[0, 0] < 5 and shown[0, 7] > 60
    assert picture.largest_error in (0.2, 0.5) and picture.relative_error.max() <= picture.largest_error


def test_png_of_any_packing():
    pixels = np.random.default_rng(3).integers(0, 256, (5, 7, 3), dtype=np.uint8)
    for level in (0, 1, 6):
        assert np.array_equal(np.array(Image.open(io.BytesIO(images.png(pixels, level)))), pixels)
