"""Forecasts from pilots: what they make of the figures of two small pictures, in closed form."""

import math
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from bakery.errors import Interrupted
from renderers import choice, scene
from renderers.choice import pilot, trial
from renderers.choice.trial import Cost, Trial
from renderers.pictures.engine import Part, Stop
from tests.unit.test_auto import method, taken, tried, world


def part(seconds, noise, passes=4, samples=2):
    return {"samples": samples, "passes": passes, "seconds": seconds, "noise": noise, "concentration": 0.01}


def test_passes_of_splats_take_as_long_for_any_picture():
    """Seconds of two sizes that are alike but for what a clock tells do not go with the pixels; 3 us a pixel do."""
    small, large, picture = 24**2, 64**2, 400 * 300
    by_pixel = trial._by_pixel(1.46, 1.45, small, large)
    assert 1.45 < 1.45 + by_pixel * (picture - large) < 5 * 1.45
    assert trial._by_pixel(1e-3 + 3e-6 * small, 1e-3 + 3e-6 * large, small, large) == pytest.approx(3e-6)
    assert trial._by_pixel(0.5, 0.5, large, large) == 0.5 / large


def test_what_ends_the_passes():
    """Two kinds of passes with variances 1 and 4 a pass that take 1 and 4 s: best shared out they leave (1 + 4)^2 / T."""
    parts = {"a": part(1.0, math.sqrt(1 / 4)), "b": part(4.0, math.sqrt(4 / 4))}
    ends = pilot._ends(parts, Stop(noise=0.1, time=100.0, samples=20), {"noise": 1.0, "pixel_noise": 3.0})
    assert ends["noise"] == pytest.approx((2500.0, 0.1)) and ends["time"] == pytest.approx((100.0, 0.5))
    assert ends["samples"] == pytest.approx((50.0, math.sqrt(5 / 10)))  # ten passes of each
    pixels = pilot._ends(parts, Stop(noise=0.3, pixels=True), {"noise": 1.0, "pixel_noise": 3.0})
    assert pixels == {"noise": pytest.approx((2500.0, 0.1))}
    # four passes of each before a noise is relied upon, two before a time ends them
    early = pilot._ends(parts, Stop(noise=1e9, time=1e-3), {"noise": 1.0, "pixel_noise": 3.0})
    assert early["noise"][0] == pytest.approx(20.0) and early["time"] == pytest.approx((10.0, math.sqrt(25 / 10)))


def test_a_draft_has_two_passes_of_each_kind_however_dear():
    """Noise of cheap passes beside quiet ones that take nine times as long, as walks beside splats of drops: two of each leave
    1/2, and after 29 s there are eleven and two; seconds shared out as best they could be would say 1/20 of two of each."""
    parts = {"walk": part(1.0, math.sqrt(1 / 4)), "splat": part(9.0, 1e-9)}
    for seconds, passes in ((0.1, 2), (20.0, 2), (29.0, 11), (1018.0, 1000)):
        noise = pilot._ends(parts, Stop(noise=1e-6, time=seconds), {"noise": 1.0})["time"][1]
        assert noise == pytest.approx(1 / math.sqrt(passes), rel=1e-6)
    assert pilot._ends(parts, Stop(noise=0.01), {"noise": 1.0})["noise"] == pytest.approx((1e4, 0.01), rel=1e-6)
    unlit = parts | {"splat": part(9.0, 0.0)}
    assert pilot._ends(unlit, Stop(noise=0.0), {"noise": 1.0})["noise"] == (math.inf, 0.0)


def extrapolated(samples, **cost):
    """Part of a picture of 1024 x 1024, of a pilot of 64 x 64 whose passes of 16 samples take 1 ms a pixel."""
    known = Cost(0.5, 1e-3, 16, 1.0, 0.04, 0.2)._replace(**cost)
    tried = Trial(0.0, (known,), {}, 64**2, 2, 1.0, clock=0.5)
    foretold = tried.summary(1024**2, Stop(noise=0.1, time=60.0))
    (part,) = pilot._extrapolated(foretold, {"walk": samples}).values()
    return part


def test_passes_of_the_picture_have_its_samples():
    """A pass of one sample takes a sixteenth of the time and has sixteen times the variance; the clock goes half as fast as two
    processors."""
    many, single = extrapolated(16), extrapolated(1)
    assert many["passes"] * many["noise"] ** 2 == pytest.approx(1.0) and single["noise"] == pytest.approx(4 * many["noise"])
    assert many["seconds"] == pytest.approx(0.5 * (0.5 + 1024**2 * 1e-3))
    assert single["seconds"] == pytest.approx(0.25 + 1024**2 * 1e-3 / 32)
    assert pilot.shared_out({"walk": single}, single["seconds"])[2] == pytest.approx(0.2)


def test_regions_end_the_passes_where_they_have_more_noise():
    """Of beams; of chains there are 256 times as many in the picture."""
    parts = [{"walk": extrapolated(16, region=4.0, chains=chains)} for chains in (False, True)]
    beams, chains = (pilot._ends(part_of_kind, Stop(noise=0.1), {"noise": 1.0})["noise"][0] for part_of_kind in parts)
    assert beams == pytest.approx(4 * chains)


@pytest.mark.parametrize("size, pixels, smaller", [((640, 360), 2304, (64, 36)), ((8, 6), 2304, (8, 6)),
                                                   ((4000, 1), 256, (1012, 2))])
def test_a_pilot_has_the_shape_of_the_picture(size, pixels, smaller):
    assert trial.shrunk(*size, pixels) == smaller


@pytest.fixture
def planned(monkeypatch):
    """A function of the standard error of what a choice foretells, and of what makes another pilot: the scene, and that one."""
    monkeypatch.setattr(pilot, "in_time", lambda parts, _time: parts)
    world = SimpleNamespace(size=(1024, 1024), as_it_is=nullcontext, variant="llvm_ad_rgb")
    monkeypatch.setattr("renderers.mitsuba.world.World", SimpleNamespace(of=lambda *_: world))
    monkeypatch.setattr(pilot.choice.Opened, "of", lambda scene: None)

    def of(spread, another):
        cost = Cost(0.5, 1e-3, 16, 1.0, 0.04, spread)
        tried = Trial(0.0, (cost, cost._replace(pixel=0.3)), {}, 64**2, 2, 1.0, clock=0.5)
        kept = choice.Choice("paths", ["paths"], [], 0.0, "", tried.summary(1024**2, STOP, missing=0.2))
        parts = [SimpleNamespace(name=name, samples=4) for name in "ab"]
        monkeypatch.setattr(pilot.trial, "of", lambda _prepare, _world, seconds, shares: another(tried, seconds))
        return SimpleNamespace(choice=kept, prepare=lambda *_: SimpleNamespace(parts=parts)), tried

    return of


STOP = Stop(noise=0.1, time=60.0)


def seconds_to_noise(tried):
    """Of the clock, with what has not been found."""
    return tried.clock * tried.rate(1024**2, 0.2, STOP.noise, STOP.time) / STOP.noise**2


def test_the_plan_of_a_scene_says_what_its_choice_says(planned):
    """By the pilots of the choice, those with light that is not found: another pilot may come upon other bright paths, and the
    plan of a jelly said 3.7e5 s to a noise of 3.5 % beside 19 % after 62 s."""
    scene, tried = planned(0.2, lambda *_: pytest.fail("a second pilot"))
    reported = pilot._tried(scene, STOP, None)
    # passes of a quarter of the samples: four times as many, each with the fixed half second too, which is little
    assert pilot._ends(reported, STOP, {"noise": 1.0})["noise"][0] == pytest.approx(seconds_to_noise(tried), rel=2e-3)


def test_a_choice_that_was_kept_foretells_by_the_clock_of_today(planned):
    """It was made on a machine that had nothing else to do, or more processors: its passes took a tenth of the clock's time."""
    scene, tried = planned(0.2, lambda *_: pytest.fail("a second pilot"))
    then, now = (pilot._ends(pilot._tried(scene, STOP, None, clock), STOP, {"noise": 1.0})["noise"][0] for clock in (None, 5.0))
    assert now == pytest.approx(10 * then)


def test_where_the_pilot_of_a_choice_tells_little_a_longer_one_foretells(planned):
    """Of light that was not found as the choice knew it."""
    def another(tried, seconds):
        asked.append(seconds)
        costs = [cost._replace(pixel=1e4 * cost.pixel, spread=0.1) for cost in tried.costs]
        return tried._replace(costs=tuple(costs))

    asked: list[float] = []
    scene, tried = planned(1.5, another)
    reported = pilot._tried(scene, STOP, None)
    assert asked == [pilot.LONGER] and pilot._spread(reported) == pytest.approx(0.1, rel=0.3)
    expected = seconds_to_noise(another(tried, 0))
    assert expected > 2 * seconds_to_noise(tried)
    assert pilot._ends(reported, STOP, {"noise": 1.0})["noise"][0] == pytest.approx(expected, rel=2e-3)


def test_what_a_pilot_compiles_is_not_in_its_seconds(monkeypatch):
    """By a made-up clock: the first pass of each film takes 5 s, others 0.1 s; of 4 passes of each of the two films."""
    clock = [0.0]

    def prepare(small, _seed):
        passed = []

        def render(number):
            clock[0] += 0.1 if passed else 5.0
            passed.append(number)
            return {"": np.random.default_rng(number).normal(1, 0.1, (*small.size, 3))}

        return SimpleNamespace(parts=(Part("walk", render),))

    monkeypatch.setattr(trial.variants, "clock", lambda _variant: lambda: clock[0])
    assert trial.of(prepare, world(), None, 4).processor == pytest.approx(0.8)


def test_what_is_little_cheaper_has_to_be_so_twice(monkeypatch):
    """A busy machine: of two pilots of a candidate one takes longer by chance, or its larger picture less than it should."""
    def pilots(*seconds):
        times = list(seconds)
        return lambda _: tried(times.pop(0) if len(times) > 1 else times[0])

    first, second = method("ept", exact=True), method("ept+vpt", exact=True)
    for of_first, of_second, best in (((1.3, 1.0), (0.9,), "ept"), ((1.0,), (0.7, 0.9), "ept"), ((1.0,), (0.7,), "ept+vpt"),
                                      ((1.0, 0.2), (0.3, 9.0), "ept+vpt")):  # 3.3 times as cheap is enough
        assert taken(monkeypatch, (first, pilots(*of_first)), (second, pilots(*of_second))).method == best


def test_the_quickest_pass_tells_what_passes_take(monkeypatch):
    """By a made-up clock: of two passes the later one takes twice as long on a busy machine."""
    clock = [0.0]

    def prepare(small, _seed):
        pixels = small.size[0] * small.size[1]

        def render(number):
            clock[0] += (0.08 + 0.04 * pixels / trial.SMALL) * (2 if number == 1 else 1)
            return {"": np.random.default_rng(number).normal(1, 0.1, (*small.size, 3))}

        return SimpleNamespace(parts=(Part("walk", render),))

    monkeypatch.setattr(trial.variants, "clock", lambda _variant: lambda: clock[0])
    (cost,) = trial.of(prepare, world(), None, 2).costs
    assert cost.by_pixel == pytest.approx(0.04 / trial.SMALL) and cost.fixed == pytest.approx(0.08)


def test_an_interrupted_pilot_names_no_picture_that_is_gone(tmp_path, monkeypatch):
    """Nor `--resume`: its files lie in a folder that ends with it."""
    (tmp_path / "milk.h5").touch()
    (tmp_path / "s.yaml").write_text("bakery_scene: 2\nname: s\nmaterials:\n  - {where: everywhere, asset: milk.h5}\n")

    def interrupted(*about, **options):
        raise Interrupted("the picture so far is in pilot.png, and --resume goes on with it").ending(143)

    monkeypatch.setattr("renderers.pictures.passes.render", interrupted)
    with pytest.raises(Interrupted, match="^interrupted during a pilot; no picture was written$") as fault:
        pilot._drawn(scene.load(tmp_path / "s.yaml"), (16, 16), {"samples": 1}, {}, tmp_path / "pilot.png")
    assert fault.value.exit_status == 143
