"""Figures of a medium or a population that other fields ask for, from coefficients, phase functions and radii."""

import math

import numpy as np

CONTRAST, CONTRAST_WMO = 0.02, 0.05  # of a black object against the sky, below which it is not seen: Koschmieder, the WMO's range


def ratio(numerator, denominator) -> np.ndarray:
    """A quotient; not a number where the denominator is 0."""
    numerator, denominator = np.broadcast_arrays(np.asarray(numerator, float), np.asarray(denominator, float))
    return np.divide(numerator, denominator, out=np.full(numerator.shape, np.nan), where=denominator != 0)


def albedo_error(albedo, sigma_t, scattering, absorbed) -> np.ndarray:
    """Error of sigma_s / sigma_t from a relative error of sigma_s and an absolute one of sigma_a, 1/m: at 1 from that alone."""
    share = np.where(np.asarray(sigma_t) > 0, ratio(absorbed, sigma_t), 0.0)
    return np.asarray(albedo) * ((1 - np.asarray(albedo)) * scattering + share)


def angstrom_exponent(wavelength, values, error):
    """-d ln(values) / d ln(wavelength) between neighbouring wavelengths.

    wavelength : (L,) um, ascending
    values, error : (L,), absolute

    Returns exponent, error : (L - 1,) 1; not a number where a value is 0, for then there is no power law
    """
    values, relative = np.asarray(values, float), ratio(error, values)
    logarithm = np.log(np.where(values > 0, values, np.nan))
    step = np.diff(np.log(wavelength))
    return 0 - np.diff(logarithm) / step, (relative[1:] + relative[:-1]) / np.abs(step)


def visual_range(sigma_t, contrast: float) -> np.ndarray:
    """How far black objects are seen, m: Koschmieder 1924; not a number where nothing is extinguished."""
    return ratio(-math.log(contrast), sigma_t)


def linear_depolarisation(s11, s22) -> np.ndarray:
    """Of linearly polarised light straight back, as lidars measure it: (s11 - s22) / (s11 + s22)."""
    return ratio(np.asarray(s11) - s22, np.asarray(s11) + s22)


def natural_depolarisation(s11, s12) -> np.ndarray:
    """Of unpolarised light: intensity in the scattering plane over that across it, (s11 + s12) / (s11 - s12)."""
    return ratio(np.asarray(s11) + s12, np.asarray(s11) - s12)


def mass_efficiency(extinction, mass) -> np.ndarray:
    """Extinction per mass, m^2/g, of mean cross sections (L,) um^2 and a mean mass 1e-18 kg."""
    return 1e3 * np.asarray(extinction, float) / mass


def effective_sizes(radius, weight, mean_volume=None):
    """Effective radius and variance of nodes of a size distribution.

    Parameters
    ----------
    radius, weight : (R,) um, share of the number
    mean_volume : um^3, exact, where it is known: what the nodes miss of it counts as an error

    Returns
    -------
    radius, variance : um, 1
    errors : the same of each: with every other node, and of the volume

    Source: Hansen & Travis 1974, Space Sci. Rev. 16, 527, eqs. 2.53-2.54.
    """
    radius, weight = np.asarray(radius, float), np.asarray(weight, float)

    def sizes(r, w):
        second, third, fourth = (np.sum(w * r**power) for power in (2, 3, 4))
        return np.array([third / second, max(fourth * second / third**2 - 1, 0.0)])

    values = sizes(radius, weight)
    if radius.size == 1:
        return values, np.zeros(2)
    volume = 4 / 3 * math.pi * np.sum(weight * radius**3)
    missed = 0.0 if mean_volume is None else abs(volume / mean_volume - 1)
    halved = sizes(radius[::2], weight[::2]) if radius.size > 4 else np.zeros(2)
    return values, np.abs(values - halved) + missed * np.array([values[0], 1 + values[1]])
