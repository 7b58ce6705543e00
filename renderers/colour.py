"""From radiance at a few wavelengths to linear sRGB.

A medium is baked at L wavelengths; a picture has three channels.  Three wavelengths that are one red, one green and one
blue are taken as the channels themselves, one wavelength is grey, and any other list is treated as a spectrum: linear
between the wavelengths, constant outside, weighted with the CIE 1931 2-degree observer, adapted so that equal radiance at
all wavelengths is white.
"""

import numpy as np

# um; where a display's primaries dominate.  The preset `rgb` of recipes (0.610, 0.550, 0.465) has one wavelength in each.
BANDS = ((0.58, 0.70), (0.50, 0.58), (0.40, 0.50))

# Lobes of the fit: height, peak (nm), width below and above the peak (nm).
_LOBES = (
    ((1.056, 599.8, 37.9, 31.0), (0.362, 442.0, 16.0, 26.7), (-0.065, 501.1, 20.4, 26.2)),
    ((0.821, 568.8, 46.9, 40.5), (0.286, 530.9, 16.3, 31.1)),
    ((1.217, 437.0, 11.8, 36.0), (0.681, 459.0, 26.0, 13.8)),
)
# IEC 61966-2-1, white point D65.
_SRGB_FROM_XYZ = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
# Of `spread_matrix`, relative to errors of the colour: steepness counts little, and sums of rows are kept to 1e-6.
_SMOOTH, _EXACT = 0.01, 1e3
# Luminance of linear sRGB, ITU-R BT.709.
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def observer(wavelength):
    """Colour-matching functions (3, N) of the CIE 1931 2-degree standard observer at wavelengths (N,) um, by an analytic fit; y
    peaks at 1.

    Largest distance from the 1931 tables 0.024 (in z, whose peak is 1.78), tested against Mitsuba's copy of the tables. Source:
    Wyman, Sloan and Shirley, J. Comput. Graph. Tech. 2(2), 2013, eq. 4 (multi-lobe fit).
    """
    nm = 1e3 * np.asarray(wavelength, dtype=float)
    xyz = np.zeros((3,) + nm.shape)
    for row, lobes in zip(xyz, _LOBES):
        for height, peak, below, above in lobes:
            row += height * np.exp(-0.5 * ((nm - peak) / np.where(nm < peak, below, above)) ** 2)
    return xyz


def rgb_order(wavelength):
    """Positions of the red, green and blue wavelength among three, or None where they are not one of each."""
    wavelength = np.asarray(wavelength, dtype=float)
    if wavelength.size != 3:
        return None
    rows = [np.flatnonzero((wavelength >= low) & (wavelength < high)) for low, high in BANDS]
    return tuple(int(index[0]) for index in rows) if all(index.size == 1 for index in rows) else None


def srgb_matrix(wavelength):
    """(3, L), what turns radiance at wavelengths (L,) um, in any order, into linear sRGB: `rgb = matrix @ radiance`.

    Rows add up to 1: equal radiance at all wavelengths is white.  Saturated spectra lie outside sRGB and give negative
    components; the caller clips them.  Chromatic adaptation by the Bradford transform (Lam 1985) from the fit's equal-energy
    white to D65.
    """
    wavelength = np.asarray(wavelength, dtype=float)
    if wavelength.size == 1:
        return np.ones((3, 1))
    order = rgb_order(wavelength)
    if order is not None:
        return np.eye(3)[list(order)]
    fine = np.linspace(0.36, 0.83, 471)
    xyz = observer(fine) @ _hats(fine, wavelength)
    white = xyz.sum(axis=1)
    xyz, white = xyz / white[1], white / white[1]
    d65 = np.linalg.solve(_SRGB_FROM_XYZ, np.ones(3))
    adapt = np.linalg.solve(_BRADFORD, np.diag(_BRADFORD @ d65 / (_BRADFORD @ white)) @ _BRADFORD)
    return _SRGB_FROM_XYZ @ adapt @ xyz


def hue(wavelength):
    """(N, 3) linear sRGB of lines in (N,) um, brought into the gamut; constant outside 0.42 to 0.68 um, as hue nearly is."""
    return np.maximum(_SRGB_FROM_XYZ @ observer(np.clip(wavelength, 0.42, 0.68)), 0.0).T


def band_matrix(wavelength):
    """(3, L), mean over the red, green and blue band of what is linear between L wavelengths, um; all entries >= 0, rows add up
    to 1.

    For quantities that must stay positive, such as phase functions.
    """
    order = rgb_order(wavelength)
    if order is not None:
        return np.eye(3)[list(order)]
    rows = [_hats(np.linspace(low, high, 101), wavelength).mean(axis=0) for low, high in BANDS]
    return np.array(rows)


def spread_matrix(wavelength):
    """(L, 3), what turns linear sRGB, of lights and surfaces, into radiance or reflectance at wavelengths (L,) um, in any order,
    all different: `radiance = matrix @ rgb`.

    Rows add up to 1 (white is equal at all wavelengths, and what is below 1 stays so), all entries are >= 0.  It is the least
    squares solution of `srgb_matrix(wavelength) @ matrix = 1` that is not steeper between wavelengths than it must be. One
    wavelength takes the luminance; a red, a green and a blue one are the channels themselves.  Largest error of a channel, there
    and back, over the 24 patches of a ColorChecker (channels up to 0.9): 0.17 at 4 wavelengths from 0.4 to 0.7 um, 0.012 at 8,
    0.003 at 16; 0.027 at the preset `visible8`.  Two wavelengths cannot hold three channels (0.23). Source: Mallett and Yuksel,
    EGSR 2019, whose primaries keep the same constraints.
    """
    wavelength = np.asarray(wavelength, dtype=float)
    if wavelength.size == 1:
        return LUMINANCE[None]
    matrix = srgb_matrix(wavelength)
    if rgb_order(wavelength) is not None:
        return matrix.T
    from scipy.optimize import nnls  # 0.1 s, which scenes of three wavelengths do not need

    ascending = np.argsort(wavelength)
    width = np.diff(wavelength[ascending])
    # its squares add up to the integral of the squared slope, the whole range being 1 long
    slope = np.diff(np.eye(wavelength.size)[ascending], axis=0) * np.sqrt(width.sum() / width)[:, None]
    rows, channels, sums = _SMOOTH * slope, np.eye(3), np.ones((1, 3))
    system = np.vstack([np.kron(matrix, channels), np.kron(rows, channels), _EXACT * np.kron(np.eye(wavelength.size), sums)])
    wanted = np.concatenate([channels.ravel(), np.zeros(3 * len(rows)), np.full(wavelength.size, _EXACT)])
    spread = nnls(system, wanted)[0].reshape(-1, 3)
    return spread / spread.sum(axis=1, keepdims=True)


def interpolate(wavelength, at):
    """Weights (N, L) that give, at each of N wavelengths `at`, a quantity linear between L `wavelength`, constant outside."""
    return _hats(np.atleast_1d(np.asarray(at, dtype=float)), wavelength)


def encode(linear):
    """Linear sRGB to display values, both 0 to 1 (IEC 61966-2-1); values outside are clipped."""
    linear = np.clip(linear, 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def decode(display):
    """Inverse of `encode`."""
    display = np.asarray(display, dtype=float)
    return np.where(display <= 0.04045, display / 12.92, ((display + 0.055) / 1.055) ** 2.4)


def _hats(fine, wavelength):
    wavelength = np.asarray(wavelength, dtype=float)
    ascending = np.argsort(wavelength)
    columns = [np.interp(fine, wavelength[ascending], row) for row in np.eye(wavelength.size)]
    hats = np.empty((fine.size, wavelength.size))
    hats[:, ascending] = np.stack(columns, axis=1)
    return hats
