"""Wavelengths to colour, and pictures to files."""

import numpy as np
import pytest

from bakery.errors import UsageError
from renderers import colour
from renderers.pictures import images

VISIBLE8 = np.arange(0.405, 0.76, 0.05)


def test_observer_against_the_tables():
    """Mitsuba's copy of the CIE 1931 tables, every 5 nm; the fit's stated error is 0.024."""
    pytest.importorskip("renderers.mitsuba", exc_type=ImportError)
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    nm = np.arange(360, 831, 5)
    table = np.array([np.array(mi.cie1931_xyz(float(w))).ravel() for w in nm]).T
    difference = np.abs(colour.observer(nm / 1e3) - table).max()
    assert 0.015 < difference < 0.024


@pytest.mark.parametrize("wavelength", [[0.55], [0.61, 0.55, 0.465], [0.465, 0.55, 0.61], VISIBLE8, VISIBLE8[::-1], [0.4, 0.7],
                                        [0.5, 0.52, 0.54]])
def test_equal_radiance_is_white(wavelength):
    np.testing.assert_allclose(colour.srgb_matrix(wavelength).sum(axis=1), 1, atol=2e-4)
    band = colour.band_matrix(wavelength)
    np.testing.assert_allclose(band.sum(axis=1), 1)
    assert np.all(band >= 0)


def test_three_display_wavelengths_are_the_channels():
    np.testing.assert_array_equal(colour.srgb_matrix([0.61, 0.55, 0.465]), np.eye(3))
    np.testing.assert_array_equal(colour.srgb_matrix([0.465, 0.61, 0.55]) @ [1, 2, 3], [2, 3, 1])
    assert colour.rgb_order([0.5, 0.52, 0.54]) is None


def test_hues():
    """Light at 450, 550 and 650 nm alone is blue, green, red."""
    fine = np.arange(0.4, 0.71, 0.01)
    matrix = colour.srgb_matrix(fine)
    for at, channel in ((0.45, 2), (0.55, 1), (0.65, 0)):
        assert np.argmax(matrix @ np.exp(-(((fine - at) / 0.01) ** 2))) == channel


def test_order_of_wavelengths_does_not_matter():
    values = np.random.default_rng(0).random(8)
    np.testing.assert_allclose(colour.srgb_matrix(VISIBLE8) @ values, colour.srgb_matrix(VISIBLE8[::-1]) @ values[::-1])


# sRGB values of the 24 patches of a ColorChecker, 8 bits, as its maker gives them
CHECKER = """115 82 68  194 150 130  98 122 157  87 108 67  133 128 177  103 189 170  214 126 44  80 91 166  193 90 99  94 60 108
157 188 64  224 163 46  56 61 150  70 148 73  175 54 60  231 199 31  187 86 149  8 133 161  243 243 242  200 200 200  160 160 160
122 122 121  85 85 85  52 52 52"""


@pytest.mark.parametrize("wavelength, error", [
    ([0.61, 0.55, 0.465], 0), ([0.465, 0.61, 0.55], 0), (np.linspace(0.4, 0.7, 16), 0.003), (np.linspace(0.7, 0.4, 8), 0.012),
    (VISIBLE8, 0.027), (np.linspace(0.4, 0.7, 4), 0.17), ([0.45, 0.65], 0.23)])
def test_colours_there_and_back(wavelength, error):
    """The errors that `spread_matrix` states, met to a third; white stays white, and nothing becomes negative or brighter."""
    patches = colour.decode(np.array(CHECKER.split(), float).reshape(24, 3) / 255)
    spread = colour.spread_matrix(wavelength)
    assert np.all(spread >= 0) and np.allclose(spread.sum(axis=1), 1, atol=1e-15)
    off = np.abs(patches @ (colour.srgb_matrix(wavelength) @ spread).T - patches).max()
    assert 2 / 3 * error <= off <= error


def test_spreading_one_wavelength_or_turned_round():
    np.testing.assert_array_equal(colour.spread_matrix([0.9]), [colour.LUMINANCE])
    np.testing.assert_allclose(colour.spread_matrix(VISIBLE8[::-1]), colour.spread_matrix(VISIBLE8)[::-1], atol=1e-9)
    red, blue = colour.spread_matrix(np.linspace(0.4, 0.7, 16))[:, [0, 2]].T
    assert red[-1] > 0.9 and red[7] < 0.1 and blue[0] > 0.9 and np.abs(np.diff(red)).max() < 0.6


def test_interpolation_is_linear_and_clamped():
    np.testing.assert_allclose(colour.interpolate([0.6, 0.5], [0.4, 0.55, 0.7]) @ [1, 3], [3, 2, 1])


def test_display_curve_round_trip():
    display = np.linspace(0, 1, 101)
    np.testing.assert_allclose(colour.encode(colour.decode(display)), display, atol=1e-6)
    grey = images.tone_map(np.linspace(0, 4, 50)[:, None, None] * np.ones(3))
    assert np.all(np.diff(grey[:, 0, 0]) > 0) and grey[-1, 0, 0] == pytest.approx(1)


def test_a_white_of_next_to_nothing_makes_all_light_white():
    """Also where its square is less than a double holds, and without a warning."""
    picture = np.array([[[0.0, 0.0, 0.0], [1e-6, 1e-6, 1e-6], [1e12, 1e12, 1e12]]])
    for white in (1e-300, 1e-160, 1e-90):
        assert np.allclose(images.tone_map(picture, 1e12, white), [[[0.0] * 3, [1.0] * 3, [1.0] * 3]])


def test_hue_of_lines():
    """Violet, blue, green, yellow, red, and red to the end, where next to nothing is seen."""
    lines = colour.hue(np.array([0.405, 0.465, 0.53, 0.58, 0.64, 0.755]))
    assert lines.shape == (6, 3) and (lines >= 0).all()
    assert lines.argmax(axis=1).tolist() == [2, 2, 1, 0, 0, 0]
    assert lines[5, 0] > 20 * lines[5, 1]


def test_filter_lowers_noise_and_keeps_edges():
    random = np.random.default_rng(0)
    truth = np.ones((60, 80, 3)) * 0.2
    truth[:, 40:] = 1.0
    halves = [truth + 0.2 * random.standard_normal(truth.shape) for _ in range(2)]
    first, second = images.filtered(halves, np.full(truth.shape, 0.04))
    left = (first + second) / 2 - truth
    assert left.std() < 0.2 * np.std((halves[0] + halves[1]) / 2 - truth)
    assert np.abs(left[:, 38:42].mean(axis=0)).max() < 0.06


def test_filter_keeps_what_features_show():
    """An edge far below the noise, which only the features know: kept; without them it is lost."""
    random = np.random.default_rng(1)
    truth = np.full((60, 80, 3), 0.5)
    truth[:, 40:] = 0.7
    halves = [truth + 0.4 * random.standard_normal(truth.shape) for _ in range(2)]
    features = (truth[..., :1] > 0.6).astype(float)

    def step(features):
        mean = sum(images.filtered(halves, np.full(truth.shape, 0.16), features)) / 2
        return mean[:, 42:46].mean() - mean[:, 34:38].mean()

    assert step(features) == pytest.approx(0.2, abs=0.04)
    assert step(None) < 0.14


@pytest.mark.parametrize("name", ["x.jpg", "x", "nowhere/x.png"])
def test_impossible_outputs_are_refused_first(tmp_path, name):
    with pytest.raises(UsageError):
        images.output_pair(tmp_path / name)
    (tmp_path / "y.exr").mkdir()
    with pytest.raises(UsageError, match="folder"):
        images.output_pair(tmp_path / "y.png")
    assert images.output_pair(tmp_path / "z.exr") == (tmp_path / "z.png", tmp_path / "z.exr")
