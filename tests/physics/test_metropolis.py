"""Chains of paths: against targets in closed form, against `paths`, and in a white world.

Comparisons with chance go wrong once in 1e7 seeds; seeds are fixed.
"""

import numpy as np
import pytest
from scipy import stats

from renderers import threads
from renderers.colour import LUMINANCE
from renderers.materials.bodies import methods
from renderers.mitsuba import variants
from renderers.transport import metropolis, primary
from renderers.transport.scene import Scene
from renderers.transport.wavefront import ORDERS
from tests.odds import ODDS, sigmas
from tests.physics.test_transport import BALL, FLOOR, PANEL, POINT, SKY, asset, transport

import drjit as dr  # isort: skip  behind renderers.mitsuba, which finds LLVM
import mitsuba as mi  # isort: skip

SIZE = 6, 8  # of pictures in closed form


def closed(value):
    """Light of a path that takes two numbers, as a function (pixel, x, y) of them; x alone makes it red, too."""
    variants.activate("rgb")

    def light(source):
        pixel, _, numbers = source.begin(dr.arange(mi.UInt32, source.count))
        x, y = numbers.next_float32(), numbers.next_float32()
        brought = value(pixel, x, y)
        width = dr.width(pixel)
        sums = np.zeros((width, 3 * ORDERS), np.float32)
        sums[:, 3:6] = np.asarray(brought + dr.zeros(mi.Float, width))[:, None]
        sums[:, 9] = np.asarray(x + dr.zeros(mi.Float, width)) * sums[:, 3]
        return sums, np.asarray(pixel + dr.zeros(mi.UInt32, width))

    return light


def chains(value, count=24, size=SIZE, candidates=4096):
    """Passes (count, H, W, 3), and what makes them."""
    made = metropolis.Metropolis(closed(value), size, 0, LUMINANCE)
    made.group = metropolis.Group(candidates, 256, 12)
    return np.array([made(number)[""] for number in range(count)]), made


def within(found, wanted):
    """Whether means of passes are what they have to be, each pixel of them."""
    error = found.std(axis=0, ddof=1) / len(found) ** 0.5
    return np.all(abs(found.mean(axis=0) - wanted) <= sigmas(len(found), comparisons=np.size(wanted)) * error + 1e-6)


def spots(pixel, x, y):
    """A spot of a hundredth of each pixel's numbers, brighter from pixel to pixel, on little light: the mean is in `of_spots`."""
    return dr.select((x < 0.1) & (y > 0.9), 100 * mi.Float(pixel + 1), 0.5)


def of_spots(size=SIZE):
    number = np.arange(size[0] * size[1]).reshape(size)
    grey, red = 1.0 * (number + 1) + 0.495, 1.0 * (number + 1) * 0.05 + 0.5 * (0.5 - 0.1 * 0.1 * 0.05)
    return np.stack([grey + red, grey, grey], axis=-1)


def test_the_mean_of_each_pixel_is_right():
    found, made = chains(spots)
    assert within(found, of_spots())
    mean = found.mean(axis=(1, 2))
    assert within(mean, of_spots().mean(axis=(0, 1))) and not within(2 * mean, of_spots().mean(axis=(0, 1)))
    figures = made.figures()
    luminance = of_spots() @ LUMINANCE
    assert abs(figures.normalisation - luminance.mean()) < 6 * figures.error + 1e-3 * luminance.mean()
    assert 0.1 < figures.small_steps < 1 and 0 < figures.large_steps < figures.small_steps


def test_the_first_steps_are_as_right_as_the_last(monkeypatch):
    """Chains of one step: nothing is thrown away at the start, and nothing is off."""
    made = metropolis.Metropolis(closed(spots), SIZE, 3, LUMINANCE)
    made.group = metropolis.Group(256, 256, 1)
    assert within(np.array([made(number)[""] for number in range(60)]), of_spots())


def test_light_below_zero_and_without_luminance_counts():
    def signed(pixel, x, y):
        return dr.select(x < 0.5, -2.0, 1.0)

    grey, red = -0.5, -2 * 0.125 + 1 * 0.375
    wanted = np.broadcast_to([grey + red, grey, grey], (*SIZE, 3))
    assert within(chains(signed)[0], wanted)

    made = metropolis.Metropolis(lambda source: _green_against_red(closed(lambda pixel, x, y: x)(source)), SIZE, 0, LUMINANCE)
    made.group = metropolis.Group(1024, 256, 12)
    found = np.array([made(number)[""] for number in range(8)])
    assert within(found[..., 0], np.full(SIZE, 0.5)) and found[..., 1].mean() < 0


def _green_against_red(path):
    """Light of the same size whose luminance is 0, but for the rounding."""
    light, pixel = path
    light[:, 5], light[:, 9] = 0, 0
    light[:, 4] = -light[:, 3] * np.float32(0.2126 / 0.7152)
    return light, pixel


def test_no_light_is_no_light():
    found, made = chains(lambda pixel, x, y: 0 * x, count=2)
    assert not found.any() and made.figures().normalisation == 0 and made.figures().small_steps is None


@pytest.mark.slow
def test_light_that_pilots_do_not_find_is_right_when_a_pass_does():
    """One in 1500 candidates finds it: most passes are black, and none waits for it."""
    found, made = chains(lambda pixel, x, y: dr.select((pixel == 5) & (x < 0.032), 1e5, 0.0), 80, candidates=1024)
    made._typical = 0.0
    again = np.array([made(number)[""] for number in range(80)])
    for passes in (found, again):
        assert 0.3 < np.any(passes > 0, axis=(1, 2, 3)).mean() < 0.9
        mean, error = passes[:, 0, 5, 1].mean(), passes[:, 0, 5, 1].std(ddof=1) / 80**0.5
        assert abs(mean - 3200) < 6 * error and error < 0.3 * 3200 and not passes.reshape(80, -1, 3)[:, 6:].any()


def test_a_chain_that_takes_no_step(monkeypatch):
    """Light on less of the numbers than any step hits: chains stay where they began, and what they bring is right."""
    def needle(pixel, x, y):
        return dr.select(64 * y - dr.floor(64 * y) < 1 / 64, 64.0, 0.0)

    def moved(table, size, words):
        kept = dr.arange(mi.UInt32, table.count * table.width) < 3 * table.width
        return primary.Table(dr.select(kept, table.values, 0.3), table.count, table.width)

    monkeypatch.setattr(primary, "moved", moved)
    monkeypatch.setattr(metropolis, "_LARGE", 100)
    found, made = chains(needle)
    assert made.figures().small_steps == 0
    assert within(found[..., 1], np.full(SIZE, 1.0))


def test_one_pixel():
    found, _ = chains(lambda pixel, x, y: 3 * x * x, size=(1, 1))
    assert within(found[..., 1], np.ones((1, 1)))


@pytest.mark.slow
def test_paths_that_are_followed_again_go_the_same_way(tmp_path):
    how = transport(tmp_path, {"ball": (BALL, asset(0.9, 0.3))}, PANEL + FLOOR, [1.4], size=16)
    scene, n = Scene(how.world, how.bodies, how.colours), 5000
    pixel = (np.arange(n) % 256).astype(np.uint32)
    words = np.stack([np.arange(n), np.full(n, 7)]).astype(np.uint32)
    source = primary.Source((16, 16), pixel, words)
    light, there = primary.light(scene, source)
    table = source.drawn(30)
    again, back = primary.light(scene, primary.Source((16, 16), pixel, words, table))
    assert light.any() and np.array_equal(light, again) and np.array_equal(there, back)
    moved = primary.moved(table, (16, 16), (1, 2))
    steps = np.asarray(moved.values - table.values).reshape(30, n)
    steps -= np.round(steps)
    assert abs(steps[2:]).min() > 0 and abs(steps[2:]).max() < 1 / 60 and abs(steps[2:].mean()) < 1e-3
    beside, _ = primary.light(scene, primary.Source((16, 16), pixel, words, moved))
    bright = light.sum(axis=1) > 0
    assert (beside[bright].sum(axis=1) > 0).mean() > 2 * bright.mean(), "near light there is light"


def layers_of(how, name, count, seed=0):
    """Layers (count, H, W, 3) of passes."""
    (part,) = methods.parts(how, name, "negative", seed)
    rendered = [part.render(number) for number in range(count)]
    return {layer: np.array([each[layer] for each in rendered]) for layer in rendered[0]}


def passes(how, name, count, seed=0):
    return layers_of(how, name, count, seed)[""]


@pytest.mark.slow
def test_passes_depend_on_their_number_and_the_seed_alone(tmp_path, monkeypatch):
    how = transport(tmp_path, {"ball": (BALL, asset(0.9, 0.0))}, PANEL + FLOOR, [1.4], size=8)
    monkeypatch.setattr(metropolis, "_FEWEST", 1 << 14)
    monkeypatch.setattr(metropolis, "_SAMPLES", 1)
    first = passes(how, "metropolis", 2)
    (part,) = methods.parts(how, "metropolis", "negative", 0)
    assert np.array_equal(part.render(1)[""], first[1]) and not np.array_equal(first[0], first[1])
    assert not np.array_equal(passes(how, "metropolis", 1, seed=1)[0], first[0])
    count = dr.thread_count()
    try:
        dr.set_thread_count(1)
        monkeypatch.setattr(threads, "_pool", lambda: threads.ThreadPoolExecutor(1))
        assert np.array_equal(passes(how, "metropolis", 1)[0], first[0])
    finally:
        dr.set_thread_count(count)


def test_orders_add_up(tmp_path, monkeypatch):
    monkeypatch.setattr(metropolis, "_FEWEST", 1 << 14)
    how = transport(tmp_path, {"ball": (BALL, asset(0.9, 0.0))}, PANEL + FLOOR, [1.0], size=8)
    (part,) = methods.parts(how, "metropolis", "negative", 0)
    layers = part.render(0)
    assert set(layers) == {"", "order0", "order1", "order2", "orders"}
    assert np.allclose(sum(layers[name] for name in layers if name), layers[""]) and layers["orders"].any()


@pytest.fixture
def few(monkeypatch):
    """Passes of few paths."""
    monkeypatch.setattr(metropolis, "_FEWEST", 1 << 16)


@pytest.mark.slow
@pytest.mark.parametrize("index", [1.0, 1.4])
def test_a_white_world(tmp_path, index, few):
    """Albedo 1 in light from everywhere is 1."""
    white = asset(1.0, 0.5, (0.9, 0.7, 1.1, 2.0, 0.8), (0.45, 0.5, 0.55, 0.6, 0.65))
    how = transport(tmp_path, {"ball": (BALL, white)}, SKY, [index], size=8)
    found = passes(how, "metropolis", 12).mean(axis=(1, 2, 3))
    error = found.std(ddof=1) / 12**0.5
    assert error < 0.003 and abs(found.mean() - 1) < sigmas(12) * error


@pytest.mark.slow
@pytest.mark.parametrize("index, g, around", [(1.0, 0.7, SKY + PANEL), (1.4, 0.3, FLOOR + PANEL), (1.5, 0.0, FLOOR + PANEL),
                                              (1.0, 0.0, FLOOR + POINT)],
                         ids=["matched", "glass", "rough", "point"])
def test_chains_and_paths_agree(tmp_path, index, g, around, few):
    """In each layer, of a ball of 5 mean free paths and more; light of one event that rough glass lets out is known to 6 %."""
    how = transport(tmp_path, {"ball": (BALL, asset([0.95, 0.9, 0.5], g, (1.0, 0.8, 0.6)))}, around, [index], size=16)
    of_paths, of_chains = layers_of(how, "paths", 40), layers_of(how, "metropolis", 16, 1)
    for layer in ("", "order1", "orders"):
        drawn, moved = (layers[layer].mean(axis=(1, 2, 3)) for layers in (of_paths, of_chains))
        error = np.hypot(drawn.std(ddof=1) / 40**0.5, moved.std(ddof=1) / 16**0.5)
        assert error < 0.1 * drawn.mean() and stats.ttest_ind(drawn, moved, equal_var=False).pvalue > ODDS


@pytest.mark.slow
def test_what_chains_do_not_find_is_refused(tmp_path):
    """A point through smooth glass, which paths of the loop do not reach."""
    how = transport(tmp_path, {"ball": (BALL, asset(0.9, 0.0))}, POINT, [1.4], size=8)
    with pytest.raises(ValueError, match="no paths but those of the loop"):
        methods.parts(how, "metropolis", "negative", 0)
