"""Kernels in closed form: the error-function kernel of narrow-beam theory, and those that it is compared with.

All take what `moments` gives and a distance r > 0 from the axis (mfp), broadcast, and return mfp^-2.
"""

import math

import numpy as np
from scipy import special


def G(x):
    """Upper tail of the normal distribution, erfc(x/sqrt 2)/2."""
    return special.erfc(np.asarray(x, float) / math.sqrt(2)) / 2


def erf_parameters(M0, mean_square):
    """alpha (mfp^-1) and beta (mfp) of the error-function kernel: beta^2 = (3/2) M2/M0, alpha = M0/(sqrt(2 pi) beta).

    Shinya et al. 2016, eqs. 35 and 36, give other constants, with which neither moment comes out; single scattering, M2/M0 =
    4 B z^2/3, must have beta = z sqrt(2 B).
    """
    beta = np.sqrt(1.5 * np.asarray(mean_square, float))
    alpha = np.divide(M0, math.sqrt(2 * math.pi) * beta, out=np.zeros(np.broadcast(M0, beta).shape), where=beta > 0)
    return alpha, beta


def erf_kernel(alpha, beta, r):
    """alpha/r G(r/beta): the shape of single scattering with the moments of all orders.  Source: Shinya et al. 2016, eq. 34."""
    return alpha / r * G(np.divide(r, beta))


def gaussian_kernel(M0, mean_square, r):
    """M0/(pi q) e^(-r^2/q), q the mean square radius."""
    return M0 / (math.pi * mean_square) * np.exp(-np.square(r) / mean_square)


def path_integral(depth, sigma_s, sigma_a, B, M0, r):
    """Path-integral kernel: paths that end where they began to point, so its width is half of that of all light.

    A Gaussian of weight M0 with the variance (z - (2/lambda) tanh(lambda z/2))/sigma_a along each axis, lambda^2 = 2 B sigma_s
    sigma_a; without absorption B sigma_s z^3/6.  After Premoze et al. 2003 and Ashikhmin et al. 2004; the width is derived here
    from the same path integral.
    """
    depth = np.asarray(depth, float)
    x = np.sqrt(2 * np.asarray(B) * sigma_s * sigma_a) * depth / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        shrink = np.where(x < 0.03, 1 - 0.4 * x * x, 3 * (x - np.tanh(x)) / x**3)
    return gaussian_kernel(M0, 2 * B * sigma_s * depth**3 / 6 * shrink, r)


def elek(depth, sigma_s, B, M0, r):
    """Stands for the kernel of Elek et al. 2013, approximately (its constants are unknown to us): no absorption in the width."""
    return path_integral(depth, sigma_s, 0.0, B, M0, r)
