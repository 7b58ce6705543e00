"""Lorenz-Mie as a textbook writes it: scalar loops of one sphere, after Bohren & Huffman 1983, appendix A.

Compiled, otherwise as it comes: complex arithmetic, x + 4.3 x^(1/3) + 1 terms as in the paper, nothing shared between spheres,
one angle at a time.  It is the opponent of the paper's time ratio, not a reference: see `bakery.mie` for exact values.
"""

import numpy as np
from numba import njit

STRICT = dict(cache=True, nogil=True, error_model="numpy")


@njit(**STRICT)
def _coefficients(m, x):
    count = int(np.ceil(x + 4.3 * x ** (1.0 / 3.0) + 1.0))
    y = m * x
    start = int(max(count, abs(y) + 7.5 * abs(y) ** (1.0 / 3.0))) + 16  # the textbook's + 15 is 4 % off at x = 1e4
    d = np.zeros(start + 1, dtype=np.complex128)
    for n in range(start, 0, -1):
        d[n - 1] = n / y - 1.0 / (d[n] + n / y)
    a, b = np.empty(count + 1, dtype=np.complex128), np.empty(count + 1, dtype=np.complex128)
    psi0, psi1, chi0, chi1 = np.cos(x), np.sin(x), -np.sin(x), np.cos(x)
    for n in range(1, count + 1):
        psi, chi = (2 * n - 1) * psi1 / x - psi0, (2 * n - 1) * chi1 / x - chi0
        xi, xi1 = complex(psi, -chi), complex(psi1, -chi1)
        t, u = d[n] / m + n / x, m * d[n] + n / x
        a[n] = (t * psi - psi1) / (t * xi - xi1)
        b[n] = (u * psi - psi1) / (u * xi - xi1)
        psi0, psi1, chi0, chi1 = psi1, psi, chi1, chi
    return a, b


@njit(**STRICT)
def _series(a, b, theta):
    mu = np.cos(theta)
    low, pi = 0.0, 1.0
    s1, s2 = 0j, 0j
    for n in range(1, a.shape[0]):
        tau = n * mu * pi - (n + 1) * low
        share = (2 * n + 1) / (n * (n + 1))
        s1 += share * (a[n] * pi + b[n] * tau)
        s2 += share * (a[n] * tau + b[n] * pi)
        low, pi = pi, ((2 * n + 1) * mu * pi - (n + 1) * low) / n
    return s1, s2


@njit(**STRICT)
def by_sphere(m, x, theta, s1, s2):
    """S1, S2 (A,): coefficients once, then every angle."""
    a, b = _coefficients(m, x)
    for j in range(theta.shape[0]):
        s1[j], s2[j] = _series(a, b, theta[j])


@njit(**STRICT)
def by_angle(m, x, theta, s1, s2):
    """S1, S2 (A,): coefficients again for each angle, as a renderer would that asks for S(theta)."""
    for j in range(theta.shape[0]):
        a, b = _coefficients(m, x)
        s1[j], s2[j] = _series(a, b, theta[j])
