"""Moments of the small-angle beam against depth, homogeneous or layered, and what absorption on longer paths takes.

M_n is the integral of r^n Psi over the plane, scattered light only.  B is a quarter of the mean square scattering angle.  With
S_n = integral of sigma_s (z - z')^n dz' from 0 to z, all three are closed and exact for a Gaussian phase function:

    M0 = e^-tau_a (1 - e^-S_0),   M2 = 4 B e^-tau_a S_2,   M4 = 32 B^2 e^-tau_a (S_2^2 + S_4).

The formula for M2 of Shinya et al. 2016 (eqs. 26 and 29) is 1.3 to 2.9 times too large.
"""

import math

import numpy as np

_FEW = 40.0  # events; below, the average over their number is summed, above it is their mean's


def levers(depth, sigma_s):
    """S_0, S_2, S_4 of a homogeneous medium: sigma_s z, sigma_s z^3/3, sigma_s z^5/5."""
    depth, sigma_s = np.asarray(depth, float), np.asarray(sigma_s, float)
    return sigma_s * depth, sigma_s * depth**3 / 3, sigma_s * depth**5 / 5


def layered_levers(edges, sigma_s):
    """S_0, S_2, S_4 at every edge of layers of constant density, in one pass.

    edges : (N + 1,) ascending, the first where the light enters
    sigma_s : (..., N) in each layer

    Returns S_0, S_2, S_4 : (..., N + 1); exact, sums of positive terms only
    """
    edges, sigma_s = np.asarray(edges, float), np.asarray(sigma_s, float)
    S = np.zeros((5, *sigma_s.shape[:-1], len(edges)))
    for i, dz in enumerate(np.diff(edges)):
        for n in range(5):
            # (z + dz - z')^n by the binomial theorem, and the new layer
            S[n, ..., i + 1] = sigma_s[..., i] * dz ** (n + 1) / (n + 1) + sum(
                math.comb(n, m) * dz ** (n - m) * S[m, ..., i] for m in range(n + 1))
    return S[0], S[2], S[4]


def moments(S_0, S_2, S_4, tau_a, B):
    """M0, M2, M4.

    S_0, S_2, S_4 : of `levers` or `layered_levers`
    tau_a : absorption optical depth
    B : rad^2, a quarter of the mean square scattering angle; broadcasts

    Returns M0, M2, M4 : 1, mfp^2, mfp^4; full relative precision down to optical depths of 1e-300
    """
    transmitted = np.exp(-np.asarray(tau_a, float))
    return -transmitted * np.expm1(-S_0), 4 * B * transmitted * S_2, 32 * np.square(B) * transmitted * (np.square(S_2) + S_4)


def mean_square(S_0, S_2, B):
    """M2/M0 without the 0/0 of shallow depths, mfp^2: 4 B S_2/(1 - e^-S_0)."""
    S_0 = np.asarray(S_0, float)
    shape = np.divide(S_0, -np.expm1(-S_0), out=np.ones_like(S_0), where=S_0 > 0)
    return 4 * B * np.divide(S_2, S_0, out=np.zeros(np.broadcast(S_2, S_0).shape), where=S_0 > 0) * shape


def absorbed(depth, sigma_s, sigma_a, B):
    """What longer paths lose in a homogeneous medium: factors on M0 and on the mean square radius of the small-angle beam.

    A path whose direction is theta off the axis is longer by theta^2/2.  After n events at random depths 1/cosh x of the light is
    left, x^2 = 2 B n sigma_a z, and the mean square radius shrinks by 3 (x - tanh x)/x^3 (Gaussian closure of Fokker-Planck with
    loss; exact to first order in x^2 for every n); both are averaged over the number of events, at least one.

    depth, sigma_s, sigma_a, B : broadcast

    Returns weight, shrink : 1, in (0, 1]
    """
    depth, sigma_s, sigma_a, B = np.broadcast_arrays(*(np.asarray(x, float) for x in (depth, sigma_s, sigma_a, B)))
    S, y = sigma_s * depth, 2 * B * sigma_a * depth
    # few events: the Poisson sum; many: quadrature points of the normal distribution that it becomes
    n = np.arange(1, int(_FEW + 12 * math.sqrt(_FEW)))
    log_factorial = np.cumsum(np.log(n))
    node, share = np.polynomial.hermite_e.hermegauss(9)
    small = (S < _FEW)[..., None]
    with np.errstate(divide="ignore"):
        poisson = np.exp(n * np.log(np.maximum(S, 1e-300))[..., None] - S[..., None] - log_factorial)
    poisson[..., 0] = np.where(S < 1e-8, 1.0, poisson[..., 0])  # relative to one event, where more never happen
    events = np.where(small, n, 1.0)
    many = np.maximum(S[..., None] + np.sqrt(S)[..., None] * node, 1.0)
    events = np.concatenate([events, np.where(small, 1.0, many)], axis=-1)
    weight = np.concatenate([np.where(small, poisson, 0.0), np.where(small, 0.0, share)], axis=-1)
    x = np.sqrt(events * y[..., None])
    transmitted = weight / np.cosh(np.minimum(x, 300.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        g = np.where(x < 0.03, 1 - 0.4 * x * x, 3 * (x - np.tanh(x)) / x**3)
    total = transmitted.sum(-1)
    square = np.sum(transmitted * events * g, -1) / total
    return total / weight.sum(-1), square / (np.sum(weight * events, -1) / weight.sum(-1))
