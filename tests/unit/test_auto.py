"""How `auto` is chosen: what pilots say of made-up passes, and what is taken by that.  No clock is asserted."""

import dataclasses
import json
import math
import shutil
import time
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from bakery.errors import UsageError
from bakery.stages.members import MissingStage
from renderers import choice
from renderers.camera import Camera
from renderers.choice import trial
from renderers.choice.trial import Cost, Light, Trial
from renderers.materials.bodies import smooth
from renderers.materials.grains import bundles
from renderers.pictures import engine
from renderers.pictures.engine import Part, Stop
from renderers.scene import load
from renderers.scene.candidates import Candidate

REGIONS, STOP = (8, 8), Stop(noise=0.01)
SCENES = Path(__file__).parents[2] / "assets" / "scenes"


def world(height=128, width=128):
    camera = Camera.looking((0, 0, 0), (1, 0, 0), (0, 0, 1), 1.0, height, width)
    return SimpleNamespace(size=(height, width), camera=camera, dark=False, variant="llvm_ad_rgb", as_it_is=nullcontext)


def passes(own=0.0, shared=0.0, tilt=0.0, order="order1"):
    """What prepares a part of mean 1 whose pixels have noise of their own, share some, and are off by `tilt` across."""

    def prepare(small, seed):
        height, width = small.size

        def render(number):
            random = np.random.default_rng((seed, number))
            image = 1 + own * random.normal(size=(height, width)) + shared * random.normal() \
                + tilt * np.linspace(-1, 1, width) * np.sqrt(3)
            image = np.repeat(image[..., None], 3, axis=2)
            return {"": image, order: image}

        return SimpleNamespace(parts=(Part("walk", render),))

    return prepare


def test_a_pilot_tells_noise_of_pixels_from_noise_that_they_share():
    """Within 5 standard errors of a variance from 64 passes."""
    tried = trial.of(passes(own=0.5, shared=0.2), world(), None, 64)
    (cost,) = tried.costs
    assert tried.pixels == trial.SMALL
    assert cost.pixel == pytest.approx(0.29, rel=5 * np.sqrt(2 / tried.passes))
    assert cost.region == pytest.approx(0.04, rel=5 * np.sqrt(2 / tried.passes))
    alone = trial.of(passes(own=0.5), world(), None, 64)
    assert alone.costs[0].pixel == pytest.approx(0.25, rel=0.05) and alone.costs[0].region < 0.25 / 200


def test_noise_that_grows_as_pixels_get_smaller_is_carried_on():
    """One place smaller than a pixel lights one pixel of each pass: its variance goes with the number of pixels."""

    def prepare(small, seed):
        def render(number):
            random, image = np.random.default_rng((seed, number)), np.ones((*small.size, 3))
            image[tuple(random.integers(small.size))] += 0.1 * small.size[0] * small.size[1] * random.integers(2)
            return {"": image}

        return SimpleNamespace(parts=(Part("splat", render),))

    dots, even = trial.of(prepare, world(), None, 256), trial.of(passes(own=0.5), world(), None, 64)
    assert dots.costs[0].grows > 0.2 and even.costs[0].grows < 0.1
    rates = [one._replace(costs=(one.costs[0]._replace(fixed=0.0),)) for one in (dots, even)]
    growth = [one.rate(2**20) / one.rate(2**16) for one in rates]
    assert growth[0] > 16 * 1.5 and growth[1] < 16 * 1.4


def test_pilots_of_short_renders_follow_a_share_of_the_paths():
    """As the picture does; a pass that follows a quarter has four times the variance."""

    def prepare(small, seed):
        def of(share):
            return passes(own=0.5 / share**0.5)(small, seed).parts[0]._replace(name="grains", fewer=of)

        return SimpleNamespace(parts=(of(1),))

    (whole,), (quarter,) = (trial.of(prepare, world(), None, 64, shares).costs for shares in ({}, {"grains": 0.25}))
    # of 64 passes of 4096 pixels the variance is told to 0.3 %
    assert quarter.pixel / whole.pixel == pytest.approx(4, rel=0.05)


def test_bias_is_told_by_regions_and_by_orders():
    exact = trial.of(passes(own=0.3), world(), None, 64)
    tilted = trial.of(passes(own=0.3, tilt=0.05, order="order2"), world(), None, 64)
    bias = trial.bias(tilted, exact)
    assert bias.resolved and bias.size == pytest.approx(0.05, rel=0.2) and bias.error < 0.01
    assert bias.by_order["order1"][0] == pytest.approx(-1, rel=0.05) and bias.by_order["order2"][0] == pytest.approx(1, rel=0.05)
    same = trial.bias(trial.of(passes(own=0.4), world(), None, 64), exact)
    assert not same.resolved and same.size + same.error < 0.02


def test_bundles_of_a_pilot_are_as_close_as_in_the_picture():
    """Squares of 4 x 4 pixels of the film, one after the other over all of it."""
    small = trial.smaller(world(300, 400), trial.SMALL)
    corners = bundles.as_close(small).corners.reshape(*small.size, 2)
    assert small.size == (55, 74) and corners.min() >= 0 and (corners.max(axis=(0, 1)) < (400, 300)).all()
    assert (corners[:4, :4] - corners[0, 0] == np.moveaxis(np.mgrid[:4, :4][::-1], 0, -1)).all()
    assert corners[..., 0].max() > 370 and corners[..., 1].max() > 270 and (np.diff(corners[0, ::4, 0]) >= 16).all()


def tried(seconds, noise=1.0, shift=0.0, error=1e-4, level=1.0):
    """A pilot whose passes of the larger picture take so many seconds, of a picture of that level and that much more."""
    cost = Cost(0.0, seconds / trial.SMALL, 1, noise**2, 0.0, 0.0)
    light = Light(np.full(REGIONS, level + shift), np.full(REGIONS, error**2))
    return Trial(0.0, (cost,), dict.fromkeys(trial.ORDERS, light), trial.SMALL, 4, 1.0)


def test_later_passes_that_share_over_less_are_foretold_noisier():
    cost = Cost(0.0, 1e-3, 1, 1.0, 0.0, 0.0, noisier=lambda passes: smooth.noisier(passes, 1, smooth.FULL_OF_FEW))
    few, many = (cost.of_pixel(trial.SMALL, trial.SMALL, passes) for passes in (smooth.FULL_OF_FEW, 256 * smooth.FULL_OF_FEW))
    assert few == 1 and many == pytest.approx(2**smooth._NOISIER)  # over half the distance


@pytest.mark.parametrize("launch, path, samples", [(0.03, 1e-5, 12), (0.03, 1e-3, 1), (0.03, 1e-7, 16)])
def test_two_passes_of_a_pilot_take_no_longer_than_it_may(monkeypatch, launch, path, samples):
    """Of one second, by a made-up clock: what a path takes is seen although passes of one sample hardly take longer for it."""
    clock, drawn = [0.0], []

    def part(small, each):
        def render(number):
            clock[0] += launch + path * each * small.size[0] * small.size[1]
            drawn.append((small.size, each))
            return {"": np.random.default_rng(number).normal(1, 0.1, (*small.size, 3))}

        return Part("walk", render, each, lambda fewer: part(small, fewer))

    monkeypatch.setattr(trial.variants, "clock", lambda _variant: lambda: clock[0])
    monkeypatch.setattr(engine.Passes, "_over", lambda self, *_: "time" if self.means["walk"].count == 2 else None)
    trial.of(lambda small, seed: SimpleNamespace(parts=(part(small, 16),)), world(), 1.0)
    assert [each for size, each in drawn if size == (64, 64)] == [samples] * 2
    assert samples == 1 or 2 * path * samples * trial.SMALL <= 1.0


def method(name, exact=False, stated=0.0, pilot=0.0, **more):
    return Candidate(name, (name,), exact, lambda tolerance: stated, pilot, **more)


def taken(monkeypatch, *pairs, stop=STOP, tolerance=0.1):
    """The choice among (method, its pilot, what it raises, or what makes its pilot of seconds)."""
    pilots = {one.name: result for one, result in pairs}

    def of(prepare, small, seconds, most=math.inf):
        result = pilots[prepare(small, 0)]
        result = result(seconds) if callable(result) else result
        if isinstance(result, Exception):
            raise result
        return result

    scene = SimpleNamespace(values=SimpleNamespace(materials=[], tolerance=tolerance))
    monkeypatch.setattr(choice.trial, "of", of)
    monkeypatch.setattr(choice.candidates, "by_methods", lambda scene, names: SimpleNamespace(prepare=lambda *_: names[0]))
    return choice._Pilots(choice.Opened(scene, [], None), world(), stop, [one for one, _ in pairs]).choice()


def test_the_cheapest_that_fits_is_taken(monkeypatch):
    slow, quick = method("paths", exact=True), method("tables", stated=0.01)
    best = taken(monkeypatch, (slow, tried(1.0)), (quick, tried(0.1)))
    assert best.method == "tables" and best.approximations < 1e-3 and best.row["seconds"] == pytest.approx(4e3, rel=0.01)
    assert any("tables: 4e+03 s" in line for line in best.reasons)
    best = taken(monkeypatch, (slow, tried(1.0)), (quick, tried(0.1, shift=0.2)))
    assert best.method == "paths" and best.approximations == 0.0 and best.table[1]["bias"] == pytest.approx(0.2, rel=1e-3)
    assert "off by more than the 5 %" in best.table[1]["why"]


def test_clocks_that_differ_little_leave_the_first(monkeypatch):
    first, second = method("paths", exact=True), method("shells", exact=True)
    assert taken(monkeypatch, (first, tried(1.0)), (second, tried(0.85))).method == "paths"
    assert taken(monkeypatch, (first, tried(1.0)), (second, tried(0.75))).method == "shells"


def test_what_is_hardly_known_is_not_preferred(monkeypatch):
    """A fifth of the seconds, known to a factor of e: so at most 1.5 times those of a rival that is known well."""
    known, doubtful = tried(1.0), tried(0.2)
    doubtful = doubtful._replace(costs=(doubtful.costs[0]._replace(spread=1.0),))
    paths, chains = method("paths", exact=True), method("metropolis", exact=True)
    best = taken(monkeypatch, (paths, known), (chains, doubtful))
    assert best.method == "paths" and best.table[1]["at_most"] == pytest.approx(math.e**2 * best.table[1]["seconds"])
    assert taken(monkeypatch, (chains, doubtful), (paths, known)).method == "paths"
    assert taken(monkeypatch, (paths, known), (chains, tried(0.2))).method == "metropolis"
    unknown = doubtful._replace(costs=(doubtful.costs[0]._replace(spread=5.0),))
    row = taken(monkeypatch, (paths, unknown), (chains, unknown)).table[0]
    assert row["at_most"] == pytest.approx(10 * row["seconds"])


def test_of_what_nothing_is_known_the_first_stays(monkeypatch):
    """Half of the seconds by a pilot that tells them to a factor of e^5, beside one that tells no more: a lamp in dust was taken
    particle by particle so, which is 1.7 times as dear.  A twentieth is enough."""
    first, second = method("particles+continuous", exact=True), method("particles", exact=True)
    of = [tried(seconds) for seconds in (1.0, 0.5, 0.05)]
    dear, half, little = (one._replace(costs=(one.costs[0]._replace(spread=5.0),)) for one in of)
    assert taken(monkeypatch, (first, dear), (second, half)).method == "particles+continuous"
    assert taken(monkeypatch, (first, dear), (second, little)).method == "particles"
    assert taken(monkeypatch, (first, dear), (second, of[1])).method == "particles"


def test_of_two_that_are_known_as_badly_the_later_one_is_not_taken_by_chance(monkeypatch):
    """Particles in dust, as pilots told of them: 9,240 s and at most 48,700, and 8,840 and 37,100; by many passes the second one
    is 2.9 times as dear.  One that is known twice as well is taken, as before."""
    def known(seconds, at_most):
        pilot = tried(seconds)
        return pilot._replace(costs=(pilot.costs[0]._replace(spread=np.log(at_most / seconds) / 2),))

    first, second = method("particles+continuous", exact=True), method("particles", exact=True)
    dust = first, known(0.924, 4.87)
    assert taken(monkeypatch, dust, (second, known(0.884, 3.71))).method == "particles+continuous"
    assert taken(monkeypatch, dust, (second, known(0.884, 1.5))).method == "particles"
    assert taken(monkeypatch, dust, (second, known(0.5, 2.3))).method == "particles"


def test_pilots_take_a_small_share_of_a_minute(monkeypatch):
    """At most 8 %, and each 0.8 % but for the two passes that it has to have."""
    asked = []

    def of(seconds):
        asked.append(seconds)
        return tried(1.0)._replace(seconds=seconds)

    names = ("paths", "tables", "shells", "vrl", "chains")
    taken(monkeypatch, *((method(name, exact=True, pilot=0.5), of) for name in names), stop=Stop(noise=0.01, time=60.0))
    assert len(asked) > 2 and max(asked) <= 0.008 * 60 and sum(asked) <= 0.08 * 60
    # two passes through grains take longer than they should: others are not tried, whatever they say that a pilot takes
    grains = (method("ept", exact=True), tried(1.0)._replace(seconds=5.0)), (method("ept+vpt", exact=True, pilot=1.0), tried(0.1))
    best = taken(monkeypatch, *grains, stop=Stop(noise=0.01, time=60.0))
    assert best.method == "ept" and "not tried: a pilot takes 5 s" in best.table[1]["why"]


def test_a_pilot_that_leaves_no_time_for_others_ends_with_its_smaller_picture(monkeypatch):
    sizes = []

    def prepare(small, seed):
        sizes.append(small.size)
        return passes(own=0.5)(small, seed)

    assert trial.of(prepare, world(), None, 4, most=0.0) is None and sizes == [(24, 24)]
    grains = (method("ept", exact=True), lambda seconds: None), (method("ept+vpt", exact=True), tried(0.1))
    best = taken(monkeypatch, *grains, stop=Stop(noise=0.01, time=60.0))
    assert best.method == "ept" and best.foretold is None and "pilots take too long for so short a render" in best.sentence
    assert [row["why"] for row in best.table] == ["taken without a pilot", "not tried: pilots take more than 4.8 s"]


@pytest.mark.parametrize("first", [tried(1.0)._replace(seconds=5.0), lambda seconds: None])
def test_one_that_ends_long_paths_is_tried_where_the_first_follows_them_for_too_long(monkeypatch, first):
    """Within deep snow: `ept` took all of the time of pilots, `ept+vpt+da` a fifth of that, and a tenth to the same noise."""
    brief = method("ept+vpt+da", stated=0.01, pilot=1.0, ends_early=True)
    grains, medium = method("ept", exact=True), (method("ept+vpt", stated=0.01, pilot=1.0), tried(0.01))
    best = taken(monkeypatch, (grains, first), (brief, tried(0.1)), medium, stop=Stop(noise=0.01, time=60.0))
    assert best.method == "ept+vpt+da" and all("not tried" in row["why"] for row in best.table if row["method"] == "ept+vpt")
    assert "taken without a pilot" not in [row["why"] for row in best.table]
    best = taken(monkeypatch, (grains, first), (brief, lambda seconds: None), stop=Stop(noise=0.01, time=60.0))
    assert best.method == "ept" and best.table[1]["why"] == "not tried: pilots take more than 4.8 s"


def test_what_few_passes_cannot_tell_goes_by_what_is_declared(monkeypatch):
    exact = method("paths", exact=True), tried(1.0, error=1.0)
    best = taken(monkeypatch, exact, (method("tables", stated=0.01), tried(0.1, error=1.0)))
    assert best.method == "tables" and best.approximations is None and "an error of 1 %" in best.row["why"]
    assert taken(monkeypatch, exact, (method("tables", stated=0.06), tried(0.1, error=1.0))).method == "paths"


def test_light_that_a_method_has_not_found_counts_as_noise(monkeypatch):
    """A lamp that paths come upon by chance: their few passes lack half of the light and look clean."""
    paths, tables = method("paths", exact=True), method("vrl", exact=True)
    best = taken(monkeypatch, (paths, tried(0.1, level=0.5)), (tables, tried(1.0)))
    assert best.method == "vrl" and best.table[0]["seconds"] > 100 * best.table[1]["seconds"]
    best = taken(monkeypatch, (paths, tried(0.1, level=0.0)), (tables, tried(1.0)))
    assert best.method == "vrl" and "found no light" in best.table[0]["why"]
    json.dumps(best._asdict(), allow_nan=False)


def test_what_is_not_possible_or_not_worth_it_is_said(monkeypatch):
    first = method("paths", exact=True), tried(1e-3)
    best = taken(monkeypatch, first, (method("tables"), UsageError("no tables")), stop=Stop(noise=0.01, time=60.0))
    assert best.method == "paths" and best.table[1]["why"] == "not possible: no tables"
    missing = MissingStage("/cache/0123.h5: holds no stage 'multiple'; bake it again: `bake RECIPE -o /cache/0123.h5`")
    missing.brief = "the asset holds no stage 'multiple'"
    best = taken(monkeypatch, first, (method("tables"), missing), stop=Stop(noise=0.01, time=60.0))
    assert best.table[1]["why"] == "not possible: the asset holds no stage 'multiple'"
    best = taken(monkeypatch, first, (method("tables", pilot=2.0), tried(1e-6)), stop=Stop(noise=0.1, time=60.0))
    assert best.method == "paths" and "not tried: a pilot takes 2 s, and the picture 0.4 s" in best.table[1]["why"]


def test_what_states_too_much_is_taken_only_where_pilots_tell_its_error(monkeypatch):
    """Longer ones, where what is left of their time is enough for that."""
    medium, limits = method("medium", stated=0.3), []

    def longer(rate):
        def of(seconds):
            limits.append(seconds)
            return tried(rate, noise=1.0, error=0.15 / math.sqrt(seconds))._replace(seconds=seconds)

        return of

    best = taken(monkeypatch, (method("paths", exact=True), longer(1.0)), (medium, longer(0.1)), stop=Stop(noise=0.01, time=1e4))
    assert best.method == "medium" and 0 < best.approximations < 0.05 and max(limits) > min(limits)
    best = taken(monkeypatch, (method("paths", exact=True), longer(1.0)), (medium, longer(0.1)), stop=Stop(noise=0.01, time=20.0))
    assert best.method == "paths" and "measuring its error takes" in best.table[1]["why"]


def test_what_a_method_declares_gives_way_to_what_this_scene_shows(monkeypatch):
    """It states 1 %, and is off by 7 % here, which first pilots do not tell: of regions whose noise is 4 %."""

    def longer(rate, shift):
        return lambda seconds: tried(rate, shift=shift, error=0.05 / math.sqrt(seconds))._replace(seconds=seconds)

    pairs = (method("paths", exact=True), longer(1.0, 0.0)), (method("tables", stated=0.01), longer(0.1, 0.07))
    row = (best := taken(monkeypatch, *pairs)).table[1]
    assert best.method == "paths" and "off by more than the 5 % allowed" in row["why"] and row["bias"] > 0.05


def test_of_what_is_asked_for_pilots_tell_the_error(monkeypatch):
    """By a candidate that may not be taken."""
    explicit = method("explicit", exact=True, eligible=False), tried(0.01)
    best = taken(monkeypatch, (method("medium", stated=0.3, media=(0,)), tried(1.0, shift=0.2)), explicit)
    assert best.method == "medium" and best.approximations == pytest.approx(0.2, rel=0.01)
    assert best.row["bias"] == pytest.approx(0.2, rel=1e-3) and "other methods are asked for" in best.table[1]["why"]


def surface(*numbers, stated=0.01):
    return method("surface", stated=stated, surfaces=numbers)


def test_a_surface_is_taken_where_both_what_is_expected_and_what_pilots_measure_fit(monkeypatch):
    """Its light counts as not scattered, which is no error of it."""
    exact = method("paths", exact=True), tried(1.0)
    unscattered = tried(0.1)
    dark = Light(np.zeros(REGIONS), np.zeros(REGIONS))
    unscattered = unscattered._replace(light=unscattered.light | dict.fromkeys(trial.ORDERS[2:], dark))
    best = taken(monkeypatch, exact, (surface(0), unscattered))
    assert best.method == "surface" and best.methods == ["surface"] and best.approximations == pytest.approx(0.01)
    assert "by how far light spreads 1 % is expected" in best.row["why"]
    assert taken(monkeypatch, exact, (surface(0, stated=0.06), unscattered)).method == "paths"
    off = taken(monkeypatch, exact, (surface(0), tried(0.1, shift=0.2)))
    assert off.method == "paths" and "off by more than the 5 %" in off.table[1]["why"]
    untold = taken(monkeypatch, (exact[0], tried(1.0, error=1.0)), (surface(0), tried(0.1, error=1.0)))
    assert untold.method == "surface" and untold.approximations is None and "does not tell more" in untold.row["why"]


def test_chains_are_taken_where_variance_times_time_is_less(monkeypatch):
    """Noise that regions share counts, too."""
    paths, chains, tables = (method("paths", exact=True), method("metropolis", exact=True),
                             method("metropolis+tables", stated=0.01))
    rows = [(1.0, 0.5, 1.0), (1.0, 2.0, 0.5), (1.0, 2.0, 1.5)]
    names = [taken(monkeypatch, *zip((paths, chains, tables), map(tried, row))).method for row in rows]
    assert names == ["metropolis", "metropolis+tables", "paths"]
    blotched = tried(0.1)
    blotched = blotched._replace(costs=(blotched.costs[0]._replace(region=20.0),))
    assert taken(monkeypatch, (paths, tried(1.0)), (chains, blotched)).method == "paths"


def test_what_is_found_to_be_quick_leaves_others_less_time(monkeypatch):
    """A tenth of ten thousand seconds is enough for the third; of four, as the second shows them, it is not."""
    others = method("paths", exact=True), tried(1.0)
    slow = method("shells", exact=True, pilot=4.0), tried(1.0)
    assert taken(monkeypatch, others, (surface(0), tried(1e-3)), slow).table[2]["why"].startswith("not tried: a pilot takes 4 s")
    assert taken(monkeypatch, others, (surface(0, stated=0.06), tried(1e-3)), slow).table[2]["seconds"] is not None


@pytest.mark.slow
def test_pilots_of_slow_paths_take_fewer_samples():
    """Two passes of 16 samples would take a hundred times as long as a pilot may."""
    samples = []

    def prepare(small, seed):
        def part(count):
            def render(number):
                if count == 1 and number < 1 << 30:
                    samples.append(small.size)
                spin(2e-7 * count * small.size[0] * small.size[1] * 1e3)
                return {"": np.ones((*small.size, 3)) + 0.1 * np.random.default_rng(number).normal(size=(*small.size, 1))}

            return Part("paths", render, count, part)

        return SimpleNamespace(parts=(part(16),))

    trial.of(prepare, world(), 0.1)
    assert len(samples) >= 4 and len(set(samples)) == 2


def spin(seconds):
    begin = time.process_time()
    while time.process_time() - begin < seconds:
        pass


def test_a_choice_holds_for_the_variant_that_it_was_measured_with(monkeypatch):
    """A graphics card takes other times than the processor."""
    keys = []
    monkeypatch.setattr(choice.remembered, "get", lambda kind, key: keys.append(key))
    monkeypatch.setattr(choice.surfaces, "beside", lambda opened, world, offered: (offered, {}))
    monkeypatch.setattr(choice.candidates, "of", lambda scene: (method("paths"),))
    monkeypatch.setattr(choice, "made_of", lambda scene: ("scene",))
    monkeypatch.setattr(choice, "stop_of", lambda scene, quality: Stop(noise=0.01))
    opened = SimpleNamespace(scene=SimpleNamespace(values=SimpleNamespace(tolerance=0.05)), assets=[])
    for variant in ("llvm_ad_rgb", "cuda_ad_rgb", "llvm_ad_rgb"):
        choice.chosen(opened, SimpleNamespace(size=(64, 64), dark=False, variant=variant))
    assert keys[0] == keys[2] != keys[1]


def test_a_choice_does_not_outlive_what_it_was_made_of(monkeypatch, tmp_path):
    """Scene, its files, assets, quality, film, tolerance, stop, and the code that renders."""
    keys = []
    monkeypatch.setattr(choice.remembered, "get", lambda kind, key: keys.append(key))
    monkeypatch.setattr(choice.surfaces, "beside", lambda opened, world, offered: (offered, {}))
    monkeypatch.setattr(choice.candidates, "of", lambda scene: (method("paths"),))
    for name in ("head.xml", "head.ply", "head.yaml"):
        shutil.copy(SCENES / name, tmp_path)
    (tmp_path / "head.yaml").write_text((SCENES / "head.yaml").read_text().replace("../..", str(SCENES.parents[1])))

    def key(asset="a", quality=None, size=(64, 64), **settings):
        opened = choice.Opened(load(tmp_path / "head.yaml", settings), [SimpleNamespace(content_hash=asset)], None)
        choice.chosen(opened, SimpleNamespace(size=size, dark=False, variant="llvm_ad_rgb"), quality)
        return keys[-1]

    first = key()
    changes = [{"asset": "b"}, {"quality": "draft"}, {"size": (64, 65)}, {"tolerance": "3%"}, {"stop": "{noise: 2%, time: 61 s}"},
               {"materials[0].boundary.index": "1.3"}, {"measure": "pixels"}]
    assert key() == key(display="{exposure: 2}") == first and len({first, *(key(**change) for change in changes)}) == 8
    with (tmp_path / "head.ply").open("ab") as mesh:
        mesh.write(b" ")
    of_mesh = key()
    (tmp_path / "head.xml").write_text((tmp_path / "head.xml").read_text() + " ")
    of_scene = key()
    monkeypatch.setattr(choice.remembered, "of_code", lambda: "changed")
    assert len({first, of_mesh, of_scene, key()}) == 4


def test_code_that_changes_has_another_hash(monkeypatch, tmp_path):
    """Whatever version it says it is."""
    (tmp_path / "bodies").mkdir()
    monkeypatch.setattr(choice.remembered, "_SOURCES", (tmp_path,))
    hashes = [choice.remembered.of_code.__wrapped__()]
    for text in ("a = 1", "a = 2"):
        (tmp_path / "bodies" / "loop.py").write_text(text)
        hashes.append(choice.remembered.of_code.__wrapped__())
    assert len(set(hashes)) == 3 and hashes[-1] == choice.remembered.of_code.__wrapped__()


def test_a_choice_is_kept_and_found(monkeypatch):
    best = taken(monkeypatch, (method("paths", exact=True), tried(1.0)), (method("tables", stated=0.01), tried(0.1)))
    key = choice.remembered.key_of("scene", dataclasses.astuple(Stop(noise=0.01)))
    assert choice.remembered.get("choice", key) is None
    choice.remembered.put("choice", key, best._asdict())
    paths, tables = method("paths"), method("tables")
    assert choice._choice_of(choice.remembered.get("choice", key), [paths, tables]) == best
    assert choice._choice_of(choice.remembered.get("choice", key), [paths]) is None
    assert choice._choice_of(choice.remembered.get("choice", key), [paths, tables._replace(eligible=False)]) is None
    assert choice._choice_of({"method": "paths"}, [paths]) is None
