"""Grains without their noise: how much is taken away, and what of the grains stays."""

import numpy as np
import pytest

from renderers import colour
from renderers.pictures import guided
from renderers.pictures.denoise import Features, denoised

WIDE, COUNT = 6, 12  # pixels of a grain, and grains along a side


def grains(word=0):
    """Brightness (H, W, 3) of square grains, each turned another way, and what is seen of them."""
    rng = np.random.default_rng(word)
    normal = rng.standard_normal((COUNT, COUNT, 3))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    level = 1 + 0.5 * rng.uniform(-1, 1, (COUNT, COUNT, 1)) * np.ones(3)
    level, normal = (np.repeat(np.repeat(of_grain, WIDE, axis=0), WIDE, axis=1) for of_grain in (level, normal))
    shape = level.shape[:2]
    return level, Features(np.ones(level.shape), normal, np.ones(shape), np.ones(shape), np.full(shape, 1e-3),
                           np.full(shape, float(WIDE)))


def passes(level, scatter, count, word=1):
    """Mean of noisy passes, and its variance and that of its luminance as they tell them."""
    seen = level * (1 + scatter * np.random.default_rng(word).standard_normal((count, *level.shape)))
    luminance = (seen @ colour.LUMINANCE)[..., None]
    return seen.mean(axis=0), np.concatenate([seen, luminance], axis=-1).var(axis=0, ddof=1) / count


def contrast_kept(picture, level):
    """Slope of the picture's contrast on that of the truth."""
    truth, found = level[..., 1] - level[..., 1].mean(), picture[..., 1] - picture[..., 1].mean()
    return np.sum(truth * found) / np.sum(truth**2)


@pytest.mark.parametrize("count", [2, 8])
def test_noise_goes_and_grains_stay(count):
    """Grains of 36 pixels under a noise of 150 % a pass: a third of the error at most, nine tenths of the contrast at least."""
    level, features = grains()
    picture, variance = passes(level, 1.5, count)
    smoothed = guided.smoothed(picture, variance, features)
    assert np.std(smoothed - level) < np.std(picture - level) / 3
    assert contrast_kept(smoothed, level) > 0.9
    assert smoothed.mean() == pytest.approx(picture.mean(), rel=0.01)


def test_what_the_surface_does_not_tell_stays_once_it_stands_out():
    """A pattern on grains that are turned alike: gone beneath the noise, there above it."""
    level, features = grains()
    features = features._replace(normal=np.broadcast_to([0.0, 0.0, 1.0], level.shape))
    few, many = (contrast_kept(guided.smoothed(*passes(level, scatter, 8), features), level) for scatter in (6.0, 0.06))
    assert few < 0.6 and many > 0.97


def test_a_picture_without_noise_is_left():
    level, features = grains()
    assert np.allclose(guided.smoothed(level, np.zeros(level.shape), features), level, rtol=1e-6)


def test_pixels_without_grains_are_left():
    """And are no part of the means beside them."""
    level, features = grains()
    picture, variance = passes(level, 1.0, 4)
    grain = np.where(np.arange(level.shape[1]) < 36, features.grain, 0.0)
    picture[:, 36:] = 1e6
    smoothed = guided.smoothed(picture, variance, features._replace(grain=grain))
    assert np.array_equal(smoothed[:, 36:], picture[:, 36:]) and smoothed[:, :36].max() < 100


def test_nothing_is_lost_where_grains_end():
    """Beyond them nothing is seen: its distance is infinite."""
    level, features = grains()
    features.distance[:4], features.grain[:4] = np.inf, 0.0
    assert np.isfinite(guided.smoothed(*passes(level, 1.0, 4), features)).all()


def test_the_part_that_shows_grains_is_filtered_by_itself():
    level, features = grains()
    picture, variance = passes(level, 1.0, 4)
    shown = denoised({"grains": (picture, variance)}, ["grains"], features)
    assert np.allclose(shown.rgb, np.maximum(guided.smoothed(picture, variance, features), 0), atol=1e-6)
    assert shown.figures["grains"] and not denoised({"grains": (picture, variance)}, ["grains"]).figures["grains"]


def test_means_reach_no_further_than_a_grain_is_wide():
    """A bright pixel beside others whose surfaces are alike."""
    level, features = grains()
    features = features._replace(normal=np.zeros(level.shape), width=np.full(level.shape[:2], 2.0))
    picture = np.zeros(level.shape)
    picture[30, 30] = 1.0
    rows, columns = np.nonzero(guided.smoothed(picture, None, features)[..., 1])
    assert (abs(rows - 30).max(), abs(columns - 30).max()) == (2, 2) and len(rows) == 21
