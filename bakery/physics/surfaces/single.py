"""Light that is scattered once in a layer, exact at every angle.

All are factors of the phase function (integral 4 pi) times a quarter of the albedo: radiance sent out is R mu0 L0 / pi integrated
over incident directions.
"""

import numpy as np


def upward(mu, mu0, depth: float):
    """Sent back by a layer of an optical depth: (1 - exp(-depth (1/mu + 1/mu0))) / (mu + mu0)."""
    if depth == np.inf:
        return 1 / (mu + mu0)
    return -np.expm1(-depth * (1 / mu + 1 / mu0)) / (mu + mu0)


def downward(mu, mu0, depth: float):
    """Let through: (exp(-depth/mu) - exp(-depth/mu0)) / (mu - mu0), and its limit where both are the same."""
    if depth == np.inf:
        return np.zeros(np.broadcast(mu, mu0).shape)
    x, x0 = 1 / mu, 1 / mu0
    rate = depth * np.abs(x - x0)
    mean = np.divide(-np.expm1(-rate), rate, out=np.ones_like(rate), where=rate > 0)
    return x * x0 * depth * np.exp(-depth * np.minimum(x, x0)) * mean


def interacts(mu, depth: float):
    """Share of light that does not pass a layer unscattered; no smaller than 1e-150, so that products stay above 0."""
    return np.maximum(-np.expm1(-depth / mu), 1e-150)


def turned(mu, mu0, phi, side: int):
    """Scattering angle, rad, from light that goes down at mu0 to what leaves upward (side -1) or downward (+1) at mu and phi."""
    sines = np.sqrt(np.maximum((1 - mu * mu) * (1 - mu0 * mu0), 0.0))
    return np.arccos(np.clip(side * mu * mu0 + sines * np.cos(phi), -1, 1))
