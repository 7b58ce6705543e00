"""Pixels that share what they gather: which of them gather, and what the others get."""

from types import SimpleNamespace

import numpy as np
import pytest

from renderers.materials.bodies import methods, smooth
from tests.odds import sigmas

SPACING = 1e-3  # m


def plane(reach, height=21, width=20):
    """Seen head-on; its right quarter is another body."""
    y, x = np.mgrid[:height, :width].astype(float)
    point = np.stack([SPACING * x, SPACING * y, 0 * x], axis=2)
    return smooth.Seen((x >= 3 * width // 4).astype(np.int64), point, np.zeros_like(point) + [0.0, 0.0, 1.0],
                       np.full((height, width), reach))


def test_pixels_take_turns():
    """One of each block in each pass, unless it lies across two bodies, at the picture's edge, or wider than light is alike."""
    counts = sum(smooth.chosen(plane(12 * SPACING), number).astype(int) for number in range(4, 8))
    assert (counts[-1] == 4).all() and (counts[:-1, 14:16] == 4).all()  # the last row is left over
    assert (counts[:-1, :14] == 1).all() and (counts[:-1, 16:] == 1).all()
    assert smooth.chosen(plane(2 * SPACING), 1).all()


def test_what_others_get():
    """The value at their place of what is a polynomial of degree two around them."""
    what = plane(12 * SPACING)
    x, y, _ = np.moveaxis(what.point, 2, 0)
    image = 1 + what.point @ np.array([[20.0, 0, 1], [3, -10, 0], [0, 0, 0]]) + 5.0 * what.body[..., None]
    image += np.stack([x * x, x * y, x * x - y * y], axis=2) * 500
    for number in range(4):
        known = smooth.chosen(what, number)
        for share in (1.0, 0.5):
            got = smooth.smoothed(np.where(known[..., None], image, 1e300), known, what, share)
            inner = got[6:-6, 6:9] - image[6:-6, 6:9]
            assert abs(inner).max() < 1e-11 and abs(got - image).max() < 0.1  # beyond them at the edges, of 1.4
            assert not known.all()


def test_outlines_keep_what_they_cover():
    """What is smooth is the light over the cover, so pixels that see a body in part are neither too bright nor blurred."""
    what, cover = plane(8 * SPACING), np.random.default_rng(2).random((21, 20))
    light = 1 + what.point @ np.array([[20.0, 0, 1], [3, -10, 0], [0, 0, 0]])
    cover[3, 3] = 0.0
    got = smooth.smoothed(cover[..., None] * light, np.ones(cover.shape, bool), what, cover=cover)
    assert np.allclose(got, cover[..., None] * light, atol=1e-11)


@pytest.mark.parametrize("share, block", [(1.0, (1, 1)), (1 / 2, (1, 2)), (1 / 8, (2, 4)), (1 / 16, (4, 4))])
def test_pixels_that_gather_for_their_neighbours(share, block):
    """One of each block, and each as often as others; blocks may be cut by the edges of the picture."""
    passes = SimpleNamespace(_size=(13, 10), _seed=0)
    chosen = np.array([methods._Passes._gathering_pixels(passes, number, share) for number in range(4000)])
    tall, wide = block
    whole = chosen[:, :13 // tall * tall, :10 // wide * wide].reshape(4000, 13 // tall, tall, 10 // wide, wide)
    assert np.all(whole.sum(axis=(2, 4)) == 1)
    error = np.sqrt(share * (1 - share) / 4000)
    assert np.all(abs(chosen.mean(axis=0) - share) <= sigmas(comparisons=4 * 130) * error)
