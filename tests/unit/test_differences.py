"""Differences of pictures: the error beneath the noise, the bias of the mean, what is not known."""

import numpy as np
import pytest

from bakery.errors import UsageError
from renderers import colour
from renderers.mitsuba import bitmaps
from renderers.pictures import differences
from renderers.pictures.differences import Picture, between
from renderers.pictures.running import rgb_layers

SHAPE = (48, 64)


def picture(name, level, scatter=0.0, known=True, word=0):
    """Grey pictures with normal noise of a known variance."""
    grey = level + scatter * np.random.default_rng([3, word]).standard_normal(SHAPE)
    error = scatter / np.sqrt(grey.size)
    return Picture(name, np.repeat(grey[..., None], 3, axis=-1), np.full(SHAPE, scatter**2) if known else None,
                   error if known else None)


def steps(size):
    """A mean of 2 with squares of 8 pixels that are off by +- size."""
    y, x = np.indices(SHAPE) // 8
    return 2 + size * (1.0 - 2.0 * ((x + y) % 2))


def test_noise_is_taken_off():
    """Two pictures with noise of 40 % that differ by 10 %: their difference has 57 %.  Its square is off by its standard error,
    0.0082, times 4.5 at most in 1 of 150,000 runs; errors that are 0 do not stand out, but in 1 of 40."""
    exact, noisy = picture("exact", 2.0, 0.8, word=1), picture("noisy", steps(0.2), 0.8, word=2)
    found = between(noisy, exact)
    assert found.noise == pytest.approx(np.sqrt(0.32), rel=0.05) and found.rms == pytest.approx(np.sqrt(0.33), rel=0.1)
    assert found.error**2 == pytest.approx(0.01, abs=4.5 * 0.0082) and found.most >= found.error
    assert found.bias == pytest.approx(0, abs=4.5 * found.bias_error)
    assert found.bias_error == pytest.approx(np.hypot(0.4, 0.4) / np.sqrt(48 * 64), rel=0.05) and not found.left_in
    same = between(picture("same", 2.0, 0.8, word=5), exact)
    assert not same.resolved and same.error < same.most < 0.25


def test_an_error_stands_out_of_little_noise():
    found = between(picture("off", steps(0.2) * 1.05, 0.01, word=1), picture("exact", 2.0, 0.01, word=2))
    assert found.resolved and found.error == pytest.approx(np.hypot(0.105, 0.05), rel=0.01)
    assert found.bias == pytest.approx(0.05, abs=4.5 * found.bias_error) and found.bias_error < 2e-4
    assert found.map.shape == SHAPE and found.map[0, 0] > 0 > found.map[0, 8]


def test_noise_that_is_not_known_is_named_and_left_in():
    found = between(picture("file", 2.0, 0.4, known=False), picture("exact", 2.0))
    assert found.left_in == ("file",) and found.error == found.rms == pytest.approx(0.2, rel=0.1) and found.bias_error == 0
    both = between(picture("file", 2.0, 0.4, known=False), picture("other", 2.0, known=False))
    assert both.noise is None and both.bias_error is None and both.left_in == ("file", "other")
    assert between(picture("lit", 1.0), picture("black", 0.0)) is None


def test_the_standard_error_counts_neighbours_together():
    """What is the same over 16 x 16 pixels is one number, not 256.  The square over 200 pictures of 16 blocks has a standard
    deviation of 2.6 %, its root over one picture without blocks 18 %: 4.5 of them, 1 in 150,000 runs."""
    rng = np.random.default_rng(4)
    fields = np.kron(rng.standard_normal((200, 4, 4)), np.ones((16, 16)))
    stated = np.mean([differences._standard_error(field) ** 2 for field in fields])
    assert stated == pytest.approx(1 / 16, rel=4.5 * 0.026)
    assert differences._standard_error(rng.standard_normal((64, 64))) == pytest.approx(1 / 64, rel=4.5 * 0.18)


def test_files(tmp_path):
    """Colours alone are a picture whose noise is not known; no colours are none."""
    rgb = np.random.default_rng(0).random((4, 6, 3))
    for name, layers in (("plain", {}), ("noisy", {"noise.Y": np.full((4, 6), 0.5)})):
        bitmaps.write((tmp_path / f"{name}.png", tmp_path / f"{name}.exr"), rgb, rgb_layers("", rgb) | layers)
    plain, noisy = (differences.read(tmp_path / f"{name}.exr", name) for name in ("plain", "noisy"))
    assert plain.variance is None and plain.mean_error is None and np.all(noisy.variance == 0.25)
    assert plain.luminance == pytest.approx(rgb @ colour.LUMINANCE, rel=1e-6)
    bitmaps.write((tmp_path / "grey.png", tmp_path / "grey.exr"), rgb, {"Y": rgb[..., 0], "Z": rgb[..., 1]})
    (tmp_path / "words.exr").write_text("no picture")
    for name, said in (("grey", "holds no channels R, G and B, only Y, Z"), ("words", "cannot be read as a picture")):
        with pytest.raises(UsageError, match=said):
            differences.read(tmp_path / f"{name}.exr", name)


def test_flip_sees_what_differs():
    pytest.importorskip("flip_evaluator", reason="flip-evaluator is not installed: FLIP is not tested")
    grey = np.full((32, 32, 3), 0.5)
    other = grey.copy()
    other[8:24, 8:24, 0] += 0.3
    assert differences.flip(grey, grey)[0] == 0
    mean, shown = differences.flip(other, grey)
    assert 0 < mean < 1 and shown.shape == (32, 32) and shown[16, 16] > 5 * shown[1, 1]
    assert mean == pytest.approx(shown.mean(), rel=1e-3)
