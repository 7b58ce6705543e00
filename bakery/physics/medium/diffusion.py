"""Diffusion: parameters of the improved approximation.

Any unit of length; coefficients are 1 over it.  Arrays broadcast.
"""

import numpy as np

from bakery.physics.medium.similarity import reduced


def improved(sigma_s, sigma_a, g):
    """D = (2 sigma_a + sigma_s')/(3 sigma_t'^2), infinite in an empty medium, and sigma_tr, by which diffuse light decays.

    With the light that has not been scattered, the integrals of the fluence and of r^2 times it, 1/sigma_a and
    2/(sigma_a^2 sigma_t'), are those of exact transport with isotropic scattering.
    Source: Grosjean 1956; d'Eon & Irving 2011, ACM Trans. Graph. 30, 56.
    """
    sigma_t, albedo, sigma_tr = reduced(sigma_s, sigma_a, g)
    excess = 2 - albedo  # (2 sigma_a + sigma_s')/sigma_t'
    with np.errstate(divide="ignore"):
        return excess / (3 * sigma_t), sigma_tr / np.sqrt(excess)
