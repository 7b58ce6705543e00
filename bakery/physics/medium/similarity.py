"""Coefficients of media that stand for a given one: isotropic and diffusing alike, or without a forward peak."""

import numpy as np

from bakery.physics.medium import phase as tables


def reduced(sigma_s, sigma_a, g):
    """Reduced coefficients.

    Parameters
    ----------
    sigma_s, sigma_a : (L,) 1/m
    g : (L,) 1, mean cosine

    Returns
    -------
    sigma_t_reduced : (L,) 1/m, (1 - g) sigma_s + sigma_a
    albedo_reduced : (L,) 1, (1 - g) sigma_s / sigma_t_reduced; 1 exactly where nothing is absorbed, 0 where the medium is empty
    sigma_tr : (L,) 1/m, sqrt(3 sigma_a sigma_t_reduced), the decay of diffuse light; 0 where nothing is absorbed

    Notes
    -----
    Formed from sigma_a itself, never from 1 - albedo: at albedo 1 - 1e-15 that difference has no digits left.
    Source: Wyman, Patterson & Wilson 1989, J. Comput. Phys. 81, 137.
    """
    sigma_s, sigma_a, g = (np.asarray(value, float) for value in (sigma_s, sigma_a, g))
    scattered = (1 - g) * sigma_s
    sigma_t = scattered + sigma_a
    albedo = np.divide(scattered, sigma_t, out=np.zeros_like(sigma_t), where=sigma_t > 0)
    return sigma_t, albedo, np.sqrt(3 * sigma_a) * np.sqrt(sigma_t)


def without_peak(albedo, share):
    """The medium in which a share of the scattered light counts as not scattered.

    Parameters
    ----------
    albedo, share : 1; one medium

    Returns
    -------
    albedo : of that medium, 0 where it is empty
    extinction : its sigma_t over that of the medium with the peak

    Source: Joseph, Wiscombe & Weinman 1976, J. Atmos. Sci. 33, 2452 (their f and omega).
    """
    extinction = 1 - albedo * share
    return albedo * (1 - share) / extinction if extinction > 0 else 0.0, extinction


def without_delta(sigma_t, sigma_s, theta, phase, share):
    """The medium in which unscattered (delta) transmission is no event: a collision that keeps direction and weight is none.

    Parameters
    ----------
    sigma_t, sigma_s : (L,) 1/m
    theta, phase : (A,) rad, (L, A) 1/sr, with the peak below theta[1] as `phase.with_delta` puts it
    share : (L,) of the scattered light that keeps its direction, 0 to 1

    Returns
    -------
    sigma_t, sigma_s : (L,) 1/m; the absorption is that of the medium given
    phase : (L, A) 1/sr, of the light that is deflected
    """
    return sigma_t - share * sigma_s, (1 - share) * sigma_s, tables.without_delta(theta, phase, share)
