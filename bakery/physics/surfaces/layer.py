"""Reflection and transmission of a homogeneous layer, and of layers on each other, of one Fourier order.

Operators act on radiance times the square root of the flux that a direction stands for: they are symmetric, and energy is the
length of a vector.  With u and v the sum and the difference of downward and upward radiance, du/dt = -Y v and dv/dt = -X u (t
optical depth; X and Y are symmetric, Y positive definite, X too unless nothing is absorbed).  Of light that enters both faces
alike, v = E u at the upper face; of light that enters them with opposite signs, v = O u.  In g = (Y^(1/2) X Y^(1/2))^(1/2) and
half the thickness h,

    E = Y^(-1/2) g tanh(g h) Y^(-1/2)        O = Y^(-1/2) g coth(g h) Y^(-1/2)

and as coth 2x is the arithmetic mean of tanh x and coth x, and tanh 2x their harmonic mean, a layer twice as thick has the mean
of E and O for its O, and their harmonic mean for its E.  Doubling is nothing but sums and parallel sums of positive matrices: no
digits cancel, from layers of any thinness to thick ones.  Rounding of X absorbs some 1e-16 of the light of a lossless medium:
thicker than 2e8, layers are taken as infinite, and infinite lossless ones as that thick, which costs 1e-8 of the light.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

_THIN = 1e-3  # g h of the start: tanh x = x / (1 + x^2/3) is then exact to rounding
_THICK = 1e8  # half of an optical depth: what passes a lossless layer and what rounding absorbs in it are both some 1e-8
_CONVERGED = 1e-15


@dataclass(frozen=True)
class Layer:
    """What a layer does to light, in symmetric operators (N, N).

    Attributes
    ----------
    above, below : reflection of light from above and from below
    through : transmission downward, unscattered light left out; upward it is the transpose
    direct : (N,) share of light that passes unscattered
    """

    above: np.ndarray
    below: np.ndarray
    through: np.ndarray
    direct: np.ndarray

    @property
    def passed(self) -> np.ndarray:
        """All light downward."""
        return self.through + np.diag(self.direct)


def homogeneous(even, odd, mu, flux, albedo: float, depth: float) -> Layer:
    """A homogeneous layer.

    Parameters
    ----------
    even, odd : (N, N) parts of the phase function, `orders.phase_matrices`
    mu, flux : (N,) of `nodes.Nodes`
    albedo : single-scattering albedo, 0 to 1
    depth : optical depth, 0 to infinity
    """
    if depth > 2 * _THICK:
        depth = math.inf
    zero, identity = np.zeros((len(mu), len(mu))), np.eye(len(mu))
    if depth == 0:
        return Layer(zero, zero, zero, np.ones(len(mu)))
    scale = np.sqrt(0.5 * flux) / mu
    scale = albedo * scale[:, None] * scale
    X, Y = np.diag(1 / mu) - scale * even, np.diag(1 / mu) - scale * odd
    alike, opposite = _half_space(X, Y, mu.min()) if math.isinf(depth) else _finite(X, Y, depth / 2, mu.min())
    in_alike = cho_solve(cho_factor(identity + alike), alike)
    in_opposite = cho_solve(cho_factor(identity + opposite), identity)
    reflection = _symmetric(in_opposite - in_alike)
    if math.isinf(depth):
        return Layer(reflection, reflection, zero, np.zeros(len(mu)))
    through = _symmetric(np.diag(-np.expm1(-depth / mu)) - in_alike - in_opposite)
    return Layer(reflection, reflection, through, np.exp(-depth / mu))


def _finite(X, Y, half: float, smallest: float):
    """E and O of a layer of half the thickness `half`."""
    doublings = max(0, math.ceil(math.log2(half / (_THIN * smallest))))
    h = half * 2.0**-doublings
    identity = np.eye(len(X))
    alike = _symmetric(h * X @ np.linalg.inv(identity + h * h / 3 * Y @ X))
    opposite = cho_solve(cho_factor(Y), identity) / h + h / 3 * X
    for _ in range(doublings):
        alike, opposite = _doubled(alike, opposite)
    return alike, opposite


def _half_space(X, Y, smallest: float):
    """Their common limit: the geometric mean of X and the inverse of Y, between whose two sides the means close in."""
    start = math.sqrt(smallest)  # any number will do: this one is as far from the fastest decay as from one of 1
    alike, opposite = start * X, cho_solve(cho_factor(Y), np.eye(len(X))) / start
    for _ in range(math.ceil(math.log2(_THICK / start))):
        alike, opposite = _doubled(alike, opposite)
        if np.abs(opposite - alike).max() < _CONVERGED * np.abs(opposite).max():
            break
    return alike, opposite


def _doubled(alike, opposite):
    """Harmonic and arithmetic mean of two symmetric matrices."""
    total = alike + opposite
    root = np.linalg.cholesky(total)
    sum_part, difference_part = (solve_triangular(root, part, lower=True) for part in (alike, opposite))
    return _symmetric(2 * sum_part.T @ difference_part), 0.5 * total


def _symmetric(matrix):
    return 0.5 * (matrix + matrix.T)


def stacked(upper: Layer, lower: Layer) -> Layer:
    """One layer on another (adding)."""
    identity = np.eye(len(upper.direct))
    back = np.linalg.solve(identity - upper.below @ lower.above, upper.passed)
    forth = np.linalg.solve(identity - lower.above @ upper.below, lower.passed.T)
    direct = upper.direct * lower.direct
    return Layer(_symmetric(upper.above + upper.passed.T @ lower.above @ back),
                 _symmetric(lower.below + lower.passed @ upper.below @ forth), lower.passed @ back - np.diag(direct), direct)


def between(layer: Layer, below, top):
    """What comes back to the top, and what arrives at the bottom, of light that enters a layer between a boundary and a base.

    Parameters
    ----------
    below : (N, N) reflection of what lies under the layer; None for nothing
    top : (N,) share that the boundary above sends back in

    Returns
    -------
    upward, downward : (N, N) at the top and at the bottom
    """
    identity = np.eye(len(top))
    arriving, returned = layer.passed, layer.above
    if below is not None and arriving.any():
        arriving = np.linalg.solve(identity - layer.below @ below, arriving)
        returned = returned + layer.passed.T @ below @ arriving
    if not top.any():
        return returned, arriving
    entered = np.linalg.inv(identity - top[:, None] * returned)
    return returned @ entered, arriving @ entered
