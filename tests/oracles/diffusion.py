"""Parts of diffusion that the bakery does without: the classical approximation, and light that has not been scattered."""

from __future__ import annotations

import math

import numpy as np

from bakery.physics.medium.diffusion import Diffusion, _parameters
from bakery.physics.medium.similarity import reduced


def classical(sigma_s, sigma_a, g) -> Diffusion:
    """D = 1/(3 sigma_t'), strength alpha'/D: light that has been scattered once is a source of diffuse light.

    Parameters
    ----------
    sigma_s, sigma_a, g : coefficients of the medium, as in `similarity.reduced`
    """
    sigma_t, albedo, sigma_tr = reduced(sigma_s, sigma_a, g)
    return _parameters(sigma_t, albedo, sigma_a, np.ones_like(sigma_t), sigma_tr)


def uncollided(medium: Diffusion, r):
    """Fluence that has not been scattered, e^(-sigma_t' r)/(4 pi r^2), of a point source of unit power at distances r."""
    with np.errstate(divide="ignore"):
        return np.exp(-medium.sigma_t * r) / (4 * math.pi * np.square(r))
