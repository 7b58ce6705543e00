"""Components with numbers per volume become a medium: coefficients in 1/m and one phase function.

Independent scattering: cross sections add, phase functions add in proportion to what they scatter.  That holds for volume
fractions below about 1 %; denser suspensions scatter less than the sum (not modelled).

A host that absorbs: the spheres are computed for its real index alone (the usual definitions of cross sections fail in an
absorbing host, and k of water or ice in the visible changes nothing visible over one particle), and its bulk absorption
4 pi k / wavelength, over the share of volume that it fills, is added to sigma_a.
"""

import math

import numpy as np

from bakery.physics.medium import phase

_UM2_PER_M3 = 1e-12  # cross section in um^2 times number in 1/m^3, to 1/m
_UM3 = 1e-18  # m^3


def number_density(fraction, mean_volume, volume_fraction):
    """Particles per volume (1/m^3) that fill a `volume_fraction`, from shares by number (K,) and mean volumes (K,) um^3."""
    return volume_fraction / (math.fsum(f * v for f, v in zip(fraction, mean_volume)) * _UM3)


def volume_fraction(fraction, mean_volume, number):
    """Share of volume of `number` particles per m^3."""
    return number * math.fsum(f * v for f, v in zip(fraction, mean_volume)) * _UM3


def bulk_absorption(k, wavelength):
    """Absorption coefficient (L,) 1/m of a material with index n + ik, at vacuum wavelengths (um)."""
    return 4 * math.pi * np.asarray(k, float) / (np.asarray(wavelength, float) * 1e-6)


def coefficient(fraction, number, cross_section):
    """Sum over components (L,) 1/m, from shares (K,), particles per m^3 and mean cross sections (K, L) um^2.

    Written out: the order is that of the recipe.
    """
    return number * _UM2_PER_M3 * sum(f * c for f, c in zip(fraction, cross_section))


def mixed(fraction, number, scattering, absorption, elements, error, theta):
    """The medium of several components.

    Parameters
    ----------
    fraction : (K,) shares by number, adding up to 1
    number : 1/m^3, particles of all kinds
    scattering, absorption : (K, L) um^2, means over each component's sizes
    elements : (K, L, E, A) 1/sr, phase function (and S12, S33, S34), each normalised as a table
    error : (K, L, A) 1/sr, absolute
    theta : (A,) rad

    Returns
    -------
    sigma_s, sigma_a : (L,) 1/m
    elements : (L, E, A) 1/sr, the first normalised exactly
    error : (L, A) 1/sr
    """
    sigma_s, sigma_a = coefficient(fraction, number, scattering), coefficient(fraction, number, absorption)
    share = np.asarray(fraction, float)[:, None] * np.asarray(scattering, float)
    share = share / sum(share)
    total = sum(w[:, None, None] * e for w, e in zip(share, elements))
    first, was = phase.normalised(theta, total[:, 0])
    total = total / was[:, None, None]
    total[:, 0] = first
    return sigma_s, sigma_a, total, sum(w[:, None] * e for w, e in zip(share, error))
