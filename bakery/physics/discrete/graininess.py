"""How grainy a discrete medium looks: mean and variance of single scattering in a pixel, in closed form.

A pixel of solid angle W that looks through independent particles receives from one at distance s the radiance
w = C f E T / (W s^2): C its scattering cross section, f its phase function towards the pixel, E the irradiance that reaches it, T
the transmittance back.  Campbell's theorem gives mean and variance over realisations: n times the integrals of <w> and <w^2> over
the pixel's frustum, whose element of volume is W s^2 ds.

T is 0 or 1 for a pencil between discs, so its mean is exp(-sigma_t s) and so is the mean of its square.  Light from afar is taken
to arrive as it is: what weakens it weakens mean and deviation alike, but shadows of single particles add to the variance.
Source: N. Campbell, Proc. Camb. Phil. Soc. 15, 117 (1909).
"""

import math

import numpy as np

_EULER = 0.5772156649015329
_TERMS = 60  # of the continued fraction: 12 digits from 1 on


def mixture_moments(share, scattering, spread, phase):
    """Mean and mean square of C f over the particles, (L, ...) um^2/sr and um^4/sr^2.

    share : (K,) of the number, adds up to 1
    scattering, spread : (L, K) um^2, 1; mean and relative variance of the cross section within the class
    phase : (L, K, ...) 1/sr
    """
    share, scattering, spread = (np.asarray(value, float) for value in (share, scattering, spread))
    term = np.asarray(phase, float) * scattering.reshape(scattering.shape + (1,) * (np.ndim(phase) - 2))
    within = (1 + spread).reshape(spread.shape + (1,) * (np.ndim(phase) - 2))
    return np.einsum("k,lk...->l...", share, term), np.einsum("k,lk...->l...", share, term**2 * within)


def relative_variance(mean, square, number_density, sigma_t, near, far, solid_angle):
    """Variance of a pixel's radiance over its squared mean, from particles between two distances; broadcasts.

    mean, square : of C f, um^2/sr and um^4/sr^2, from `mixture_moments`
    number_density : 1/m^3;  sigma_t : 1/m
    near, far : m, 0 < near < far; far may be inf where sigma_t > 0
    solid_angle : sr, of the pixel, small

    Returns the reciprocal of a number: so many equal particles would be as grainy.

    Particles stand for points: where a disc covers more than a pixel, neighbouring pixels share it and each deviates less.
    """
    mean, square, near, far = (np.asarray(value, float) for value in (mean, square, near, far))
    ratio = square / mean**2
    return ratio * inverse_square_path(sigma_t, near, far) / (number_density * solid_angle * path(sigma_t, near, far) ** 2)


def path(sigma_t, near, far):
    """Integral of exp(-sigma_t (s - near)) ds from near to far, m."""
    depth = sigma_t * (np.asarray(far, float) - near)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(depth > 1e-8, -np.expm1(-depth) / sigma_t, np.asarray(far, float) - near)


def inverse_square_path(sigma_t, near, far):
    """Integral of exp(-sigma_t (s - near)) / s^2 ds from near to far, 1/m."""
    near, far = np.asarray(near, float), np.asarray(far, float)
    with np.errstate(invalid="ignore", over="ignore"):
        beyond = np.where(np.isinf(far), 0.0, np.exp(-sigma_t * (far - near)) * _second(sigma_t * far) / far)
    return _second(sigma_t * near) / near - beyond


def _second(x):
    """exp(x) E_2(x) to 12 digits: 1 at 0, 1/x far out.  Not SciPy's: loading it takes longer than a picture.

    Source: Abramowitz & Stegun, eqs. 5.1.11, 5.1.14 and, from 1 on, 5.1.22 in its contracted form.
    """
    x = np.asarray(x, float)
    far, large = np.zeros_like(x), np.maximum(x, 1.0)
    for k in range(_TERMS, 0, -1):
        far = k * (k + 1) / (large + 2 * k + 2 - far)
    small = np.clip(x, 1e-300, 1.0)
    term, tail = -small, -small
    for k in range(2, 20):
        term = -term * small / k
        tail = tail + term / k
    first = -_EULER - np.log(small) - tail  # E_1
    return np.where(x < 1, 1 - small * first * np.exp(small), 1 / (large + 2 - far))


def pixel_solid_angle(field, pixels):
    """Solid angle (sr) of a pixel in the middle of a picture `field` (rad) and `pixels` wide."""
    return (2 * math.tan(field / 2) / pixels) ** 2
