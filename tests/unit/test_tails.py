"""What pilots say of noise that few passes show too little of: made-up passes whose variance among more is known."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from renderers.camera import Camera
from renderers.choice import tails, trial
from renderers.pictures.engine import Part
from renderers.transport import metropolis

SIDE = 64
PICTURE = 1024  # its side: 256 times the pixels of a pilot's


def normal(random, shape):
    return random.normal(size=shape)


def bright(random, shape):
    """Rare light of a Pareto law, whose variance just is infinite."""
    return random.random(shape) ** (-1 / 2.0) - 2.0


def variance(draw, random, count):
    """Of so many numbers, as they show it."""
    return float(np.mean(draw(random, count) ** 2))


@pytest.mark.parametrize("draw, within", [(normal, 1.1), (bright, 2.0)])
def test_variance_of_a_picture_is_foretold_by_a_pilot_of_two_passes(draw, within):
    """The median of 25 pilots is that of pictures: its logarithm is known to 0.1, as that of each is to 0.4.  Of bright paths it
    is at most two standard errors above that of most pilots."""
    random = np.random.default_rng(0)
    pilots = [tails.of_passes(1 + draw(random, (2, SIDE, SIDE)), PICTURE**2) for _ in range(25)]
    foretold = [tail.variance(PICTURE**2) for tail, _ in pilots]
    shown = np.median([variance(draw, random, PICTURE**2) for _ in range(9)])
    assert shown / within < np.median(foretold) < within * shown
    assert np.mean([figure * math.exp(2 * spread) > 0.9 * shown for figure, (_, spread) in zip(foretold, pilots)]) > 0.6


def test_no_single_path_decides_how_heavy_a_tail_is():
    """One that is ten thousand times brighter than the rest has all of the squares: it counts as it is, not as a law's first, and
    is known to a factor of e."""
    passes = np.random.default_rng(1).normal(size=(4, SIDE, SIDE))
    (before, sure), brighter = tails.of_passes(passes, PICTURE**2), passes.copy()
    brighter[2, 30, 30] += 1e4
    after, known = tails.of_passes(brighter, PICTURE**2)
    assert before.variance(PICTURE**2) == pytest.approx(1, rel=0.1) and sure < 0.1
    # squares from the median of few passes are a little too large where one of them is bright
    assert after.variance(PICTURE**2) == pytest.approx(brighter.var(axis=0, ddof=1).mean(), rel=0.3)
    assert after._replace(shown=0.0).variance(PICTURE**2) == pytest.approx(1, rel=0.1)
    assert known == pytest.approx(1, abs=0.1)


@pytest.mark.parametrize("each", [1, 3])
def test_few_bright_paths_are_not_left_out(each):
    """So many in a pilot of two passes, on average, of a thousand times the mean: the rim of a lamp, or its light through glass.
    Of pilots with two or three of them the law alone told a thousandth and less of their noise."""

    def rare(random, shape):
        return 0.1 * random.normal(size=shape) + 1e3 * (random.random(shape) < each / (2 * SIDE**2))

    random = np.random.default_rng(5)
    truth, pilots = 1e6 * each / (2 * SIDE**2), [tails.of_passes(rare(random, (2, SIDE, SIDE)), PICTURE**2) for _ in range(60)]
    foretold, spread = np.array([(tail.variance(PICTURE**2), spread) for tail, spread in pilots]).T
    seen = foretold > 1
    assert np.mean(seen) == pytest.approx(1 - math.exp(-each), abs=0.2)  # of none nothing is known: 4 standard errors
    assert truth / 3 < np.median(foretold[seen]) < 3 * truth
    assert np.mean((foretold * np.exp(2 * spread))[seen] > truth) > 0.95


def test_chains_that_stay_are_known_less_well():
    """Of squares that are alike over 8 x 8 pixels there are 64 times fewer."""
    random = np.random.default_rng(2)
    alone = random.exponential(size=(3, SIDE, SIDE))
    together = np.kron(random.exponential(size=(3, SIDE // 8, SIDE // 8)), np.ones((8, 8)))
    spreads = [tails.of_passes(passes)[1] for passes in (alone, together)]
    assert spreads[1] > 3 * spreads[0] > 0


def test_dots_of_one_brightness_are_no_tail():
    """Twenty of them, far above all else, are foretold within a factor of 1.7 where they are the picture's."""
    random, passes = np.random.default_rng(3), 1e-3 * np.random.default_rng(4).normal(size=(8, SIDE, SIDE))
    passes.reshape(-1)[random.choice(passes.size, 20, replace=False)] += 10.0
    tail, _ = tails.of_passes(passes, PICTURE**2)
    assert tail.variance(PICTURE**2) == pytest.approx(20 * 10.0**2 / passes.size, rel=0.7)


def test_extremes():
    """No noise, one tile, one pixel that is not dark, and pictures that are no larger than the pilot."""
    tail, spread = tails.of_passes(np.ones((2, SIDE, SIDE)), 1e6)
    assert tail.variance(1e6) == 0 and spread == 0
    tail, spread = tails.of_passes(np.array([[[1.0, 2.0], [3.0, 4.0]], [[2.0, 2.0], [3.0, 4.0]]]), 16.0)
    assert tail.variance(16.0) == pytest.approx(0.5 / 4) and spread == 0
    single = np.zeros((2, SIDE, SIDE))
    single[0, 3, 3] = 1.0
    tail, spread = tails.of_passes(single)
    assert tail.variance() == pytest.approx(0.5 / SIDE**2) and spread >= 1
    steep = tails.Tail(0.0, 1.0, 1.0, 16, 1000)
    assert steep.variance(1e-9) == 0 and steep.variance(1e4) == pytest.approx(math.log(160))


def test_rare_bright_paths_are_no_noise_that_grows_with_pixels():
    """Eight in the larger picture of a pilot, and one in the smaller or none.  Of forty pilots half were carried on as if the
    noise of a picture of 1024 x 1024 were up to 256 times that."""

    def rare(random, shape):
        return 0.1 * random.normal(size=shape) + 300 * random.random(shape) * (random.random(shape) < 1e-3)

    pilots = [trial.of(lambda small, seed, number=number: prepared(rare)(small, seed + number), world(PICTURE), None, 2)
              for number in range(40)]
    assert np.mean([tried.costs[0].grows > 0.05 for tried in pilots]) <= 0.1


def prepared(draw, samples=1, steps=1):
    def prepare(small, seed):
        def render(number):
            random = np.random.default_rng((seed, number))
            image = 1 + draw(random, (samples, *small.size)).mean(axis=0)
            return {"": np.repeat(image[..., None], 3, axis=2)}

        return SimpleNamespace(parts=(Part("walk", render, samples, steps=steps),))

    return prepare


def world(side):
    camera = Camera.looking((0, 0, 0), (1, 0, 0), (0, 0, 1), 1.0, side, side)
    return SimpleNamespace(size=(side, side), camera=camera, dark=False, variant="llvm_ad_rgb")


def test_a_bright_path_of_a_pilot_is_no_noise_that_grows():
    """One sample of half a million, which has 99.9 % of the squares that the pilot shows: they count as many times as shown."""

    def spoilt(random, shape):
        image = normal(random, shape)
        image[0, 9, 9] += 1e4 * (shape[1:] == (SIDE, SIDE) and not spoilt.seen)
        spoilt.seen |= shape[1:] == (SIDE, SIDE)
        return image

    spoilt.seen = False
    plain, bright = (trial.of(prepared(draw, 16), world(PICTURE), None, 128).costs[0] for draw in (normal, spoilt))
    assert spoilt.seen and bright.grows == plain.grows == 0 and bright.spread == pytest.approx(1, abs=0.1) and plain.spread < 0.1
    assert plain.of_pixel(PICTURE**2, SIDE**2, 8) == pytest.approx(1 / 16, rel=0.2)
    shown = (1e4 / 16) ** 2 / 8 / SIDE**2  # one pass of eight
    assert bright.of_pixel(PICTURE**2, SIDE**2, 8) == pytest.approx(shown, rel=0.3)


def shared(noise):
    def draw(random, shape):
        return 0.1 * random.normal(size=shape) + noise * random.normal()

    return draw


def test_what_pixels_share_of_chains_goes_down_with_their_number():
    """Of beams, of which there are as many however many pixels gather from them, it does not."""
    pilots = [trial.of(prepared(shared(0.5), steps=steps), world(PICTURE), None, 64) for steps in (1, 12)]
    beams, chains = (tried.costs[0].of_region(PICTURE**2, tried.pixels) for tried in pilots)
    assert beams == pytest.approx(0.25, rel=5 * math.sqrt(2 / 64)) and chains == pytest.approx(beams / 256)


def test_pilots_of_chains_have_as_many_paths_a_pixel_as_others_have():
    """However few a pass of a large picture has: of 1 a pixel, 256 chains told nothing of what a path takes."""
    size = SimpleNamespace(size=(PICTURE, PICTURE), whole=None)
    picture = metropolis.part("metropolis", size, [], None, 0, np.ones(3))
    pilot = metropolis.part("metropolis", SimpleNamespace(size=(SIDE, SIDE), whole=size), [], None, 0, np.ones(3))
    assert (picture.samples, pilot.samples, pilot.fewer(4).samples) == (1, 16, 4) and picture.fewer is None
    assert pilot.render.group.chains == SIDE**2 and picture.steps == pilot.steps == pilot.fewer(4).steps > 1
