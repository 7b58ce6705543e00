"""The datasets of the group `medium`, and how they follow from coefficients and phase function."""

import math

import numpy as np

from bakery.stages.declaration import ANY, SIGNED, Output, datasets
from bakery.stages.optics.elements import ELEMENTS

OUTPUTS = (
    Output("sigma_t", "(L,)", "1/m", "extinction coefficient"),
    Output("sigma_s", "(L,)", "1/m", "scattering coefficient"),
    Output("sigma_a", "(L,)", "1/m", "absorption coefficient"),
    Output("sigma_a_bias", "(L,)", "1/m", "change of sigma_a when the nodes over sizes are halved", optional=True),
    Output("albedo", "(L,)", "1", "single-scattering albedo, sigma_s / sigma_t", within=(0, 1)),
    Output("g", "(L,)", "1", "mean cosine of the tabulated phase function", within=SIGNED),
    Output("sigma_t_reduced", "(L,)", "1/m", "(1 - g) sigma_s + sigma_a"),
    Output("albedo_reduced", "(L,)", "1", "(1 - g) sigma_s / sigma_t_reduced", within=(0, 1)),
    Output("sigma_tr", "(L,)", "1/m", "effective transport coefficient, sqrt(3 sigma_a sigma_t_reduced)"),
    Output("sigma_tr_bias", "(L,)", "1/m", "the part of sigma_a_bias in sigma_tr", optional=True),
    Output("theta", "(A,)", "rad", "angle between the directions of travel, from 0 (forward) to pi", within=(0, math.pi)),
    Output("phase", "(L, A)", "1/sr", "phase function, linear in cos theta between the angles, integral 1"),
    Output("phase_bias", "(L, A)", "1/sr", "estimated error of phase (and of s12, s33, s34)", optional=True),
    Output("cdf", "(L, A)", "1", "probability of a scattering angle below theta", within=(0, 1)),
    Output("s11", "(L, A)", "1/sr", "Mueller element s11, equal to phase", optional=True),
    Output("s12", "(L, A)", "1/sr", "Mueller element s12", optional=True, within=ANY),
    Output("s33", "(L, A)", "1/sr", "Mueller element s33", optional=True, within=ANY),
    Output("s34", "(L, A)", "1/sr", "Mueller element s34, for the time factor exp(-i w t)", optional=True, within=ANY),
)


def members_of(sigma_s, sigma_a, theta, elements, sigma_t=None, albedo=None) -> dict:
    """The group's datasets; elements (L, E, A)."""
    from bakery.physics.medium import phase, similarity

    f = elements[:, 0]
    g = phase.mean_cosine(theta, f)
    sigma_t = sigma_s + sigma_a if sigma_t is None else sigma_t
    if albedo is None:
        albedo = np.divide(sigma_s, sigma_t, out=np.zeros_like(sigma_t), where=sigma_t > 0)
    reduced = dict(zip(("sigma_t_reduced", "albedo_reduced", "sigma_tr"), similarity.reduced(sigma_s, sigma_a, g)))
    values = {"sigma_t": sigma_t, "sigma_s": sigma_s, "sigma_a": sigma_a, "albedo": albedo, "g": g, **reduced,
              "theta": theta, "phase": f, "cdf": phase.cumulative(theta, f)}
    if elements.shape[1] > 1:
        values |= dict(zip(("s11", *ELEMENTS), np.moveaxis(elements, 1, 0)))
    return datasets(OUTPUTS, values)
