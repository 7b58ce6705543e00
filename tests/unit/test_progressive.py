"""Pictures from passes: noise, what stops them, interruptions, and going on from a file."""

import signal
import subprocess
import sys

import numpy as np
import pytest

from bakery.errors import Interrupted, UsageError
from renderers import colour
from renderers.mitsuba import bitmaps
from renderers.pictures import differences, engine, images, means, progressive
from renderers.pictures.progressive import Estimate, Part, Stop, fingerprint
from renderers.pictures.running import describe, rgb_layers
from renderers.scene import budget
from tests import exr
from tests.conftest import slow

SHAPE = (6, 8, 3)


class Job:
    """What `renderers.pictures.running.Render` does at the end, without a scene."""

    def __init__(self, folder):
        self.pair = folder / "x.png", folder / "x.exr"

    def finish(self, rgb, *, layers, text, **more):
        bitmaps.write(self.pair, images.shown(rgb)[0], rgb_layers("", rgb) | layers, text)
        return {"files": [str(path) for path in self.pair]} | more


def noisy(word, scatter=1.0, level=1.0):
    """A part's passes: level, and normal noise by pass."""

    def render(index):
        direct = level + scatter * np.random.default_rng([word, index]).standard_normal(SHAPE)
        return {"": direct + 0.25, "order1": direct, "order2": np.full(SHAPE, 0.25)}

    return render


def pair(identity="scene"):
    return Estimate([Part("splat", noisy(1), samples=2), Part("walk", noisy(2, 0.5, level=3.0), samples=2)], {"scene": identity})


def ended(job, estimate, samples):
    estimate.run(Stop(samples=samples))
    return estimate.finish(job, method="test")


def test_noise_is_what_the_mean_is_off():
    """Standard error against the true one, 864 degrees of freedom a part: within 4.5 deviations, 1 in 70,000 runs."""
    estimate = pair()
    estimate.run(Stop(samples=14))
    assert estimate.stopped_by == "samples" and [mean.count for mean in estimate.means.values()] == [7, 7]
    assert estimate.variance[..., :3].mean() == pytest.approx(1.25 / 7, rel=4.5 * np.sqrt(2 / 864 * (1 + 0.25**2)) / 1.25)
    assert np.sqrt(np.mean((estimate.rgb - 4.5) ** 2)) == pytest.approx(np.sqrt(1.25 / 7), rel=4.5 / np.sqrt(2 * 144))
    assert estimate.noise == pytest.approx(
        np.sqrt(np.mean(estimate.variance[..., :3] @ colour.LUMINANCE**2)) / np.mean(estimate.rgb @ colour.LUMINANCE), rel=0.1)


def test_noise_that_pixels_share_is_in_the_error_of_the_mean(tmp_path):
    """By the scatter of the passes' means, parts added up; the same from the file, and after going on from it."""
    levels = np.random.default_rng(8).standard_normal((2, 6, 3))

    def parts():
        return [Part(name, lambda index, part=part: {"": np.broadcast_to(5 + levels[part, index], SHAPE)})
                for part, name in enumerate(("splat", "walk"))]

    def error(passes):
        both = np.concatenate([levels, levels @ colour.LUMINANCE[:, None]], axis=-1)[:, :passes]
        return np.sqrt(np.sum(both.var(axis=1, ddof=1) / passes, axis=0))

    job, estimate = Job(tmp_path), Estimate(parts(), {})
    report = ended(job, estimate, 4)
    assert report["mean_error"] == pytest.approx(error(4)[:3], rel=1e-9)
    assert progressive.error_of_mean(bitmaps.read(job.pair[1])[1]) == pytest.approx(error(4), rel=1e-9)
    on = Estimate(parts(), {})
    on.resume(job.pair[1])
    assert ended(job, on, 6)["mean_error"] == pytest.approx(error(6)[:3], rel=1e-5)  # means were rounded to 32 bits
    assert progressive.error_of_mean({}) is None


def loop(samples):
    """A part of passes of a size that may be chosen."""
    return Part("paths", noisy(3, 1 / np.sqrt(samples)), samples, loop)


@pytest.mark.parametrize("seconds, samples", [(None, 16), (60.0, 16), (16.0, 16), (4.0, 4), (3.75, 2), (0.9, 1), (0.0, 1)])
def test_passes_of_a_short_render_are_smaller(seconds, samples):
    """By what is asked for and no clock; two have to end, and parts whose passes have one size keep it."""
    fixed = Part("splat", noisy(1), 2)
    parts = engine.in_time([loop(16), fixed], seconds)
    assert [part.samples for part in parts] == [samples, 2] and parts[1] is fixed


@pytest.mark.parametrize("seconds, share", [(None, 1), (16.0, 1), (9.0, 0.5), (4.0, 0.25), (0.9, 0.25), (0.0, 0.25)])
def test_longest_paths_by_chance(seconds, share):
    """A part whose passes can do with a share of their longest paths has no less than that."""
    def of(samples):
        return Part("medium", noisy(1), samples, of, fewest=0.25)

    assert engine.in_time([of(1)], seconds)[0].samples == share
    assert engine.shares([of(1), loop(16)], seconds) == {"medium": share, "paths": 1}


def test_going_on_from_passes_of_another_size(tmp_path):
    """Samples are counted as they were, and the noise is that of all of them; of a file that does not say, passes were alike."""
    job, short = Job(tmp_path), Estimate([loop(1)], {})
    ended(job, short, 3)
    long = Estimate([loop(16)], {})
    long.resume(job.pair[1])
    assert long.samples == 3
    report = ended(job, long, 40)
    assert report["samples"] == 51 and report["passes"] == {"paths": 6}
    # each pass counts as one; two degrees of freedom at least in each of 144 values: 4.5 deviations, 1 in 150,000
    assert long.variance[..., :3].mean() == pytest.approx((3 + 3 / 16) / 36, rel=4.5 * np.sqrt(2 / 144 / 2))
    picture, text = bitmaps.read(job.pair[1])
    text[progressive._STATE] = text[progressive._STATE].replace('"samples": 51, ', "")
    bitmaps.write(job.pair, np.zeros(SHAPE, np.uint8), picture, text)
    again = Estimate([loop(16)], {})
    again.resume(job.pair[1])
    assert again.samples == 6 * 16


def swaying(word, sway=1.0, scatter=0.0, level=5.0):
    """Passes whose pixels share noise, and have noise of their own besides."""

    def render(index):
        random = np.random.default_rng([word, index])
        grey = level + sway * random.standard_normal() + scatter * random.standard_normal((*SHAPE[:2], 1))
        return {"": np.broadcast_to(grey, SHAPE)}

    return render


@pytest.mark.parametrize("passes", [2, slow(4)])
def test_noise_of_the_mean_holds_after_few_passes(passes):
    """Noise that all pixels share: two passes in 68 of 100 pictures are within what they state (of 600, 4.5 deviations: 1 in
    150,000 runs); a standard error without Student's factor would hold in 50 of them, and in 61 after four."""
    within = []
    for word in range(600):
        estimate = Estimate([Part("walk", swaying([7, word]))], {})
        estimate.run(Stop(samples=passes))
        stated = estimate.noise_mean * np.mean(estimate.rgb @ colour.LUMINANCE)
        assert estimate.noise_region == pytest.approx(estimate.noise_mean, rel=1e-9) and estimate.noise < estimate.noise_mean
        within.append(abs(np.mean(estimate.rgb) - 5) <= stated)
    assert abs(np.mean(within) - 0.683) < 4.5 * np.sqrt(0.683 * 0.317 / 600)


def test_few_passes_do_not_claim_a_mean_without_noise():
    """Two passes whose means are the same by chance, of pixels that are not: noise as if pixels were independent."""
    scatter = np.random.default_rng(3).standard_normal((*SHAPE[:2], 1))
    scatter -= scatter.mean()
    estimate = Estimate([Part("walk", lambda index: {"": np.broadcast_to(5 + scatter * (-1) ** index, SHAPE)})], {})
    estimate.run(Stop(samples=2))
    assert estimate.noise_mean == pytest.approx(estimate.noise / np.sqrt(scatter.size), rel=1e-9) and estimate.noise > 0.05


@pytest.mark.slow
def test_noise_of_regions_is_what_their_means_are_off():
    """Half of the picture sways in common, the rest pixel by pixel: against the true error of the tiles' means over 200 pictures
    of 16 passes, which is known to 5 %, and to 5.5 times that here; independent pixels would have a quarter of it."""
    share = np.where(np.arange(24) < 12, 1.0, 0.0)[None, :, None]
    stated, errors, pixels = [], [], []
    for word in range(200):
        def render(index, word=word):
            random = np.random.default_rng([9, word, index])
            return {"": np.repeat(5 + share * random.standard_normal() + 0.5 * random.standard_normal((16, 24, 1)), 3, axis=2)}

        estimate = Estimate([Part("walk", render)], {})
        estimate.run(Stop(samples=16))
        tiles = means.tiled(estimate.rgb @ colour.LUMINANCE)
        assert tiles.shape == (4, 6)
        stated.append(estimate.noise_region)
        errors.append(np.sqrt(np.mean((tiles - 5) ** 2)) / 5)
        pixels.append(np.sqrt(np.mean(estimate.variance[..., 3]) / 16) / 5)
    truth = np.sqrt(np.mean(np.square(errors)))
    assert np.sqrt(np.mean(np.square(stated))) == pytest.approx(truth, rel=5.5 * 0.05)
    assert 3 * np.mean(pixels) < truth


def test_noise_that_pixels_share_stops_later():
    """After four passes where pixels are independent, after eight where they share noise; and not before regions keep it too."""
    for part, passes in ((noisy(1), 4), (swaying(1), 8), (swaying(1, sway=0.1, scatter=1.0), 4)):
        estimate = Estimate([Part("walk", part)], {})
        estimate.run(Stop(noise=1e9))
        assert (estimate.stopped_by, estimate.samples) == ("noise", passes)
    estimate = Estimate([Part("walk", swaying(1))], {})
    estimate.run(Stop(noise=0.05))
    assert estimate.noise < 0.98 * estimate.noise_region and estimate.noise_region <= 0.05 and 8 < estimate.samples < 40


def test_what_is_below_0_is_kept_beside_the_picture(tmp_path):
    """Clipped where people look, whole in its layer; the figures, the noise beside it, and a picture that is gone on with."""
    for parts in (1, 2):
        folder = tmp_path / str(parts)
        folder.mkdir()
        job = Job(folder)

        def some(parts=parts):
            return Estimate([Part(name, noisy(word, scatter=4.0, level=0.5)) for word, name in enumerate("ab")][:parts], {})

        whole = some()
        whole.run(Stop(samples=8))
        report = ended(job, some(), 4)
        written = exr.layers(job.pair[1])
        kept, clipped = (np.stack([written[prefix + c] for c in "RGB"], axis=-1) for prefix in ("signed.", ""))
        assert (kept < 0).mean() == pytest.approx(report["below_zero"]["share"]) and 0.1 < (kept < 0).mean() < 0.5
        assert np.array_equal(clipped, np.maximum(kept, 0)) and np.allclose(report["mean"], kept.mean(axis=(0, 1)), rtol=1e-5)
        raised = ((clipped - kept) @ colour.LUMINANCE).mean() / (kept @ colour.LUMINANCE).mean()
        assert report["below_zero"]["raised"] == pytest.approx(raised, rel=1e-4) and raised > 0.1
        assert "% of the values are below 0, down to -" in report["reasons"][0]
        for i, c in enumerate("RGB"):
            assert (written[f"noise.{c}"] >= clipped[..., i] - kept[..., i]).all()
            assert (written[f"noise.{c}"] >= written[f"signed.noise.{c}"]).all()
        assert np.array_equal(differences.read(job.pair[1], "a").rgb, kept.astype(float))
        on = some()
        on.resume(job.pair[1])
        ended(job, on, 8)
        assert np.allclose(on.rgb, whole.rgb, rtol=1e-5, atol=1e-6) and np.allclose(on.variance, whole.variance, rtol=1e-5)
        assert on.noise_region == pytest.approx(whole.noise_region, rel=1e-5)


def test_what_rounding_leaves_below_0_is_not_told(tmp_path):
    image = np.full(SHAPE, 1.0)
    image[0, 0] = -1e-9
    report = ended(Job(tmp_path), Estimate([Part("walk", lambda index: {"": image})], {}), 4)
    assert report["below_zero"] is None and report["reasons"] == []
    written = exr.layers(tmp_path / "x.exr")
    assert written["R"].min() == 0 and "signed.R" not in written


def test_noise_of_all_channels_together_counts_in_full():
    """Passes of 1, 2, 3 in every channel: sqrt(1 / 3) of 2, though independent channels would have three quarters of that."""
    mean = means.Mean()
    for level in (1.0, 2.0, 3.0):
        mean.add({"": np.full(SHAPE, level)})
    assert np.allclose(mean.variance, 1 / 3, rtol=1e-12)


def test_scatter_that_cancels_is_none():
    """Rounding alone made it less than none, of which a root was taken."""
    for seed in range(20):
        mean, random = means.Mean(), np.random.default_rng(seed)
        for _ in range(5):
            half = random.standard_normal((4, 4, 3))
            mean.add({"": np.concatenate([half, -half[::-1]])})
        assert mean.spread.min() >= 0 and np.min(mean.regions) >= 0 and 0 <= mean.spread.max() < 1e-25


def test_passes_in_single_precision_add_up_in_double():
    """A million and a little noise: in single precision the scatter of the mean would drown in rounding, 0.06."""
    mean, passes = means.Mean(), [1e6 + noisy(1, 0.25)(index)[""] for index in range(64)]
    for image in passes:
        mean.add({"": image.astype(np.float32)})
    assert np.allclose(mean.layers[""], np.mean(np.float32(passes), axis=0, dtype=float), rtol=1e-14)
    assert np.allclose(mean.variance[..., :3], np.var(np.float32(passes), axis=0, ddof=1, dtype=float) / 64, rtol=1e-6)


def test_values_that_are_no_numbers_are_dark_and_said(tmp_path):
    image = np.ones(SHAPE)
    image[0, 0] = [np.nan, np.inf, 1.0]
    for _ in range(2):
        estimate = Estimate([Part("walk", lambda index: {"": image})], {})
        if (tmp_path / "x.exr").exists():
            estimate.resume(tmp_path / "x.exr")
        report = ended(Job(tmp_path), estimate, 4)
        assert estimate.noise == 0 and np.array_equal(estimate.rgb[0, 0], [0, 0, 1])
        assert report["reasons"] == ["8 values of pixels were no numbers and count as dark"]


def test_a_noise_that_is_not_reached_is_said(tmp_path):
    for noise, pixels, said in ((1e9, False, []), (None, False, []), (0.001, False, ["a noise of 0.1 % was wanted"]),
                                (0.001, True, ["a noise of 99 of 100 pixels of 0.1 % was wanted"])):
        estimate = pair()
        estimate.run(Stop(noise=noise, samples=8, pixels=pixels))
        sentences = estimate.finish(Job(tmp_path))["unreached"]
        assert len(sentences) == len(said) and all(f"samples ended the passes: {words}, it is " in sentence
                                                 for words, sentence in zip(said, sentences, strict=True))


def test_layers_of_the_file(tmp_path):
    report = ended(Job(tmp_path), pair(), 8)
    layers = exr.layers(tmp_path / "x.exr")
    assert {"R", "noise.G", "noise.Y", "order1.B", "order2.R", "splat.R", "splat.noise.R", "walk.order1.G"} <= set(layers)
    for name in "RGB":
        assert np.allclose(layers[name], layers[f"order1.{name}"] + layers[f"order2.{name}"], rtol=1e-6)
        assert np.allclose(layers[name], layers[f"splat.{name}"] + layers[f"walk.{name}"], rtol=1e-6)
        noise = np.hypot(layers[f"splat.noise.{name}"], layers[f"walk.noise.{name}"])
        assert np.allclose(layers[f"noise.{name}"], noise, rtol=1e-5)
    assert report["passes"] == {"splat": 4, "walk": 4} and report["samples"] == 8 and report["stopped_by"] == "samples"


@pytest.mark.parametrize("parts", [1, 2])
@pytest.mark.parametrize("first", [2, 8])
def test_going_on_is_as_good_as_not_stopping(tmp_path, parts, first):
    """Half of the passes, and the rest from the file: the same picture and noise but for rounding to 32 bits."""

    def some():
        estimate = pair()
        return Estimate(estimate.parts[:parts], estimate.identity)

    whole, job = some(), Job(tmp_path)
    whole.run(Stop(samples=32))
    ended(job, some(), 2 * first)
    on = some()
    on.resume(job.pair[1])
    assert on.samples == 2 * first
    ended(job, on, 32)
    assert on.samples == 32
    assert np.allclose(on.rgb, whole.rgb, rtol=3e-7) and np.allclose(on.variance, whole.variance, rtol=1e-6)
    assert all(np.allclose(image, on.layers()[name], rtol=1e-6, atol=1e-6) for name, image in whole.layers().items())
    again = some()
    again.resume(job.pair[1])
    again.run(Stop(samples=32))
    assert again.samples == 32  # nothing is left to do


class Clock:
    """Time that passes in parts only."""

    def __init__(self, monkeypatch):
        self.now = 0.0
        monkeypatch.setattr(engine.time, "monotonic", lambda: self.now)

    def spending(self, seconds, render):
        def slow(index):
            self.now += seconds
            return render(index)

        return slow


def test_time_goes_where_the_variance_is(monkeypatch):
    """Sixteen times the variance at a quarter of the cost: 8 times the passes, as n is proportional to sqrt(variance / cost)."""
    clock = Clock(monkeypatch)
    estimate = Estimate([Part("loud", clock.spending(1.0, noisy(1, 4.0))), Part("quiet", clock.spending(4.0, noisy(2, 1.0)))], {})
    estimate.run(Stop(time=1200.0))
    loud, quiet = (mean.count for mean in estimate.means.values())
    assert estimate.stopped_by == "time" and loud + 4 * quiet in (1197, 1198, 1199, 1200)
    assert 7 < loud / quiet < 9


def test_a_part_without_noise_so_far_is_not_forgotten(monkeypatch):
    clock = Clock(monkeypatch)
    dark = clock.spending(1.0, lambda _: {"": np.zeros(SHAPE)})
    estimate = Estimate([Part("loud", clock.spending(1.0, noisy(1))), Part("dark", dark)], {})
    estimate.run(Stop(time=200.0))
    assert 9 <= estimate.means["dark"].count <= 12


def test_what_stops_first(monkeypatch):
    clock = Clock(monkeypatch)

    def run(**stop):
        estimate, told = Estimate([Part("walk", clock.spending(1.0, noisy(3)))], {}), []
        estimate.run(Stop(**stop), lambda fraction, noise: told.append((fraction, noise)))
        assert told[0] == (0.0, None) and told[-1] == (1.0, estimate.noise)
        assert all(0 <= fraction < 1 for fraction, _ in told[:-1])
        return estimate.stopped_by, estimate.samples, estimate.noise

    assert run(samples=5, time=100.0, noise=0.01)[:2] == ("samples", 5)
    assert run(samples=50, time=10.0, noise=0.01)[:2] == ("time", 10)
    stopped_by, samples, noise = run(samples=500, time=1000.0, noise=0.1)
    assert stopped_by == "noise" and 0.09 < noise <= 0.1
    assert run(noise=1e9)[:2] == ("noise", 4) and run(time=0.1)[:2] == ("time", 2) and run(samples=1)[:2] == ("samples", 2)


def test_pixels_each_keep_their_noise():
    """One pixel in 8 is four times as noisy as the others: passes go on until it is good too, 10 times as many; of its 48 true
    errors, normal ones of the standard error asked for, none is beyond 5.2 of it (by chance once in 100,000)."""
    scatter = np.where(np.arange(48).reshape(6, 8, 1) % 8 == 0, 4.0, 1.0)

    def render(index):
        return {"": np.broadcast_to(5 + scatter * np.random.default_rng([3, index]).standard_normal((6, 8, 1)), SHAPE)}

    estimates = [Estimate([Part("walk", render)], {}) for _ in range(2)]
    for estimate, pixels in zip(estimates, (False, True)):
        estimate.run(Stop(noise=0.1, pixels=pixels))
    whole, each = estimates
    assert whole.noise <= 0.1 < whole.pixel_noise and each.pixel_noise <= 0.1
    assert 4 * whole.samples < each.samples < 16 * whole.samples
    assert np.abs(each.rgb / 5 - 1).max() < 0.52


def test_the_noise_that_stopped_the_passes_is_told():
    report = {"files": ["x.png"], "seconds": {"total": 1.0}, "method": "paths", "samples": 9, "noise": 0.061, "bias": None,
              "pixel_noise": 0.094, "reasons": []}
    assert describe(report | {"measure": "picture"})[1] == "method: paths; 9 samples a pixel; noise 6.1 %"
    assert describe(report | {"measure": "pixels"})[1].endswith("; noise 6.1 %, of 99 of 100 pixels 9.4 % at most")
    means_ = {"measure": "picture", "noise_mean": 0.012, "noise_region": 0.02}
    assert describe(report | means_)[1].endswith("; noise 6.1 %, of the picture's mean 1.2 %")
    assert describe(report | means_ | {"noise_region": 0.05})[1].endswith(
        "; noise 6.1 %, of the means of regions 5 % as pixels share it, of the picture's mean 1.2 %")


def test_stops_by_quality():
    split = budget.Split(0.02, 0.0, 0.01, 0.01)
    assert Stop.of(split) == Stop(0.01, None, None) and Stop.of(split, "pixels").pixels
    assert Stop.of(split, time=60.0, samples=1024, quality="preview") == Stop(0.02, 15.0, 256)
    assert Stop.of(split, samples=4, quality="draft").samples == 1
    with pytest.raises(UsageError, match='found "best"; expected draft, preview, final'):
        Stop.of(split, quality="best")


@pytest.mark.parametrize("number, status", [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interruption_leaves_the_picture_so_far(tmp_path, number, status):
    """The pass in hand is finished; afterwards signals do what they did before."""
    passes = noisy(1)

    def render(index):
        if index == 4:
            signal.raise_signal(number)
        return passes(index)

    usual = signal.signal(number, handler := lambda *_: pytest.fail("handled elsewhere"))
    try:
        job, estimate = Job(tmp_path), Estimate([Part("walk", render)], {})
        estimate.run(Stop(samples=100))
        assert signal.getsignal(number) is handler
    finally:
        signal.signal(number, usual)
    with pytest.raises(Interrupted, match=r"after 5 samples a pixel, noise .* %; .*x\.exr, and --resume") as caught:
        estimate.finish(job, method="test")
    assert caught.value.exit_status == status and estimate.stopped_by == "interruption"
    on = Estimate([Part("walk", passes)], {})
    on.resume(job.pair[1])
    assert on.samples == 5 and np.allclose(on.rgb, estimate.rgb, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("second, status, said", [("SIGTERM", 0, "interruption 1\n"), slow("SIGINT", -signal.SIGINT, "")])
def test_two_signals(second, status, said):
    """The other one at once is kept as well, and Python complains of neither; the same one again ends the process."""
    source = f"""if True:
        import os, signal
        import numpy as np
        from renderers.pictures.progressive import Estimate, Part, Stop

        def render(index):
            signal.pthread_sigmask(signal.SIG_BLOCK, both)
            os.kill(os.getpid(), signal.SIGINT)
            if signal.{second} == signal.SIGINT:
                signal.pthread_sigmask(signal.SIG_UNBLOCK, both)
            os.kill(os.getpid(), signal.{second})
            signal.pthread_sigmask(signal.SIG_UNBLOCK, both)
            return {{"": np.ones({SHAPE})}}

        both = {{signal.SIGINT, signal.SIGTERM}}
        signal.signal(signal.SIGTERM, lambda *_: print("handled elsewhere"))
        estimate = Estimate([Part("walk", render)], {{}})
        estimate.run(Stop(samples=100))
        print(estimate.stopped_by, estimate.samples)
    """
    done = subprocess.run([sys.executable, "-c", source], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (status, said, "")


def test_an_interruption_before_there_is_a_picture(tmp_path):
    def render(index):
        signal.raise_signal(signal.SIGINT)
        return noisy(1)(index)

    estimate = Estimate([Part("splat", render), Part("walk", noisy(2))], {})
    estimate.run(Stop(samples=10))
    with pytest.raises(Interrupted, match="nothing was written"):
        estimate.finish(Job(tmp_path), method="test")
    assert not list(tmp_path.iterdir())


def test_files_that_do_not_go_on(tmp_path):
    job = Job(tmp_path)
    with pytest.raises(UsageError, match="there is no picture to go on with"):
        pair().resume(job.pair[1])
    ended(job, pair(), 4)
    with pytest.raises(UsageError, match=r"something else \(other scene\)"):
        pair("other").resume(job.pair[1])
    with pytest.raises(UsageError, match=r"something else \(other method, parts\)"):
        Estimate(pair().parts[:1], {"scene": "scene", "method": "new"}).resume(job.pair[1])
    bitmaps.write(job.pair, np.zeros(SHAPE), np.zeros(SHAPE), {"bakery_passes": "{"})
    with pytest.raises(UsageError, match="holds no passes"):
        pair().resume(job.pair[1])
    job.pair[1].write_bytes(b"nothing")
    with pytest.raises(UsageError, match="cannot be read as a picture"):
        pair().resume(job.pair[1])


def test_fingerprints(tmp_path):
    file = tmp_path / "mesh.ply"
    file.write_bytes(b"1")
    first = fingerprint({"a": 1.5, "b": [2, 3]}, file)
    assert first == fingerprint({"b": (2, 3), "a": 1.5}, file) and len(first) == 16
    assert first != fingerprint({"a": 1.5, "b": [2, 4]}, file) != fingerprint(file, {"a": 1.5, "b": [2, 4]})
    file.write_bytes(b"2")
    assert first != fingerprint({"a": 1.5, "b": [2, 3]}, file)
