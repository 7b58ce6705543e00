"""Hues of denoised pictures: spots of coloured noise go, what is no noise stays."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from renderers import colour
from renderers.pictures import chroma
from renderers.pictures.denoise import Features

SHAPE = 96, 128, 3
GREY = np.full(3, 0.5)


def seen_as(albedo):
    normal = np.zeros(SHAPE)
    normal[..., 2] = 1.0
    return Features(np.broadcast_to(albedo, SHAPE), normal, np.ones(SHAPE[:2]))


def with_luminance(variance):
    return np.dstack([variance, variance @ colour.LUMINANCE**2])


def hues(picture):
    return picture / (picture @ colour.LUMINANCE)[..., None]


def spotted(level, scatter, word=1):
    """A noisy picture, its variance, and what a network may make of it: its noise blurred to spots."""
    noise = scatter * np.random.default_rng(word).standard_normal(SHAPE)
    spots = gaussian_filter(noise, (4, 4, 0), mode="nearest")
    return np.maximum(level * (1 + noise), 0.0), with_luminance((scatter * level) ** 2 * np.ones(SHAPE)), level * (1 + spots)


def test_spots_of_coloured_noise_go():
    level = np.broadcast_to(np.linspace(0.5, 2, SHAPE[1])[None, :, None], SHAPE)
    seen, variance, filtered = spotted(level, 0.8)
    evened = chroma.evened(filtered, seen, variance, seen_as(GREY))
    assert np.allclose(evened @ colour.LUMINANCE, filtered @ colour.LUMINANCE)
    assert np.std(hues(evened)) < 0.5 * np.std(hues(filtered))


@pytest.mark.parametrize("scatter, least, most", [(0.02, 0.97, 1.01), (3.0, -0.1, 0.4)])
def test_hues_come_back_with_samples(scatter, least, most):
    """Light of two colours on one surface: all of the edge between them in a picture of little noise, little of it in much."""
    level = np.ones(SHAPE)
    level[:, 64:] = 1.6, 1.0, 0.4
    seen, variance, _ = spotted(level, scatter)
    evened = chroma.evened(level, seen, variance, seen_as(GREY))
    contrast = (hues(evened)[:, 66] - hues(evened)[:, 61]).mean(axis=0) / (hues(level)[0, 66] - hues(level)[0, 61])
    assert least < contrast[0] < most


def test_grey_noise_leaves_hues():
    """Colours that share their paths: noise of one luminance tells hues well, and what differs from the surroundings stays."""
    level = np.ones(SHAPE)
    level[:, 64:] = 1.6, 1.0, 0.4
    grey = np.maximum(1 + np.random.default_rng(3).standard_normal((*SHAPE[:2], 1)), 0.0)
    variance = np.dstack([level**2, (level @ colour.LUMINANCE) ** 2])
    evened = chroma.evened(level, level * grey, variance, seen_as(GREY))
    assert abs(hues(evened) - hues(level)).mean() < 0.1 * abs(hues(level)[:, 64:] - 1).mean()


def test_hues_of_other_surfaces_do_not_bleed():
    albedo = np.full(SHAPE, 0.5)
    albedo[:, 64:] = 0.9, 0.5, 0.1
    seen, variance, _ = spotted(albedo, 2.0)
    evened = chroma.evened(albedo, seen, variance, seen_as(albedo))
    assert abs(evened - albedo).max() < 0.02


def test_a_black_picture_and_nothing_behind():
    """No light, and pixels that see nothing: no division by zero."""
    features = seen_as(np.zeros(3))._replace(distance=np.full(SHAPE[:2], np.inf), normal=np.zeros(SHAPE))
    assert not chroma.evened(np.zeros(SHAPE), np.zeros(SHAPE), np.zeros((*SHAPE[:2], 4)), features).any()
