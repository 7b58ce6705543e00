"""Reflection and transmission of a homogeneous layer, and of what lies on and under it, of one Fourier order.

Operators act on radiance times the square root of the flux that a direction stands for: they are symmetric, and energy is the
length of a vector.  With u and v the sum and the difference of downward and upward radiance, du/dt = -Y v and dv/dt = -X u (t
optical depth; X and Y are symmetric, Y positive definite, X too unless nothing is absorbed).  Of light that enters both faces
alike, v = E u at the upper face; of light that enters them with opposite signs, v = O u.  In g = (Y^(1/2) X Y^(1/2))^(1/2) and
half the thickness h,

    E = Y^(-1/2) g tanh(g h) Y^(-1/2)        O = Y^(-1/2) g coth(g h) Y^(-1/2)

Thick layers take g from singular values.  X = 1/M - ... and Y = 1/M - ... (M the cosines) hold 1/mu up to a million and more,
M^(1/2) X M^(1/2) and M^(1/2) Y M^(1/2) do not: with these as B B' and C C, C M^-1 B = V g W', and g V is exact to rounding times
the largest 1/mu.  A lossless layer has one g that is 0; B then lacks a column, and that g is 0 exactly: tanh and coth have their
limits, infinite layers are the limit h = infinity, and nothing is inverted that could be singular.

Thin and faint layers are doubled from very thin ones: coth 2x is the arithmetic mean of tanh x and coth x, and tanh 2x their
harmonic mean, so that a layer twice as thick has the mean of E and O for its O, and their harmonic mean for its E.  Doubled is
what scattering adds to the E and O of a layer that only absorbs: all digits of that stay, however thin or faint the layer is.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.linalg.lapack import dgejsv

_START = 1e-3  # g h of a very thin layer: tanh x = x / (1 + x^2/3) is then exact to rounding
_THIN = 0.05  # half of an optical depth: below, layers are doubled
_FAINT, _BLACK = 1e-3, 40.0  # albedos below which all layers are doubled; half an optical depth that is then infinite
_LEAST = 1e-14  # eigenvalue of Y, where rounding leaves less


@dataclass(frozen=True)
class Layer:
    """What a layer does to light."""

    # alike, opposite: (N, N) E and O less their values where nothing scatters
    alike: np.ndarray
    opposite: np.ndarray
    # alike0, opposite0: (N,) these values
    alike0: np.ndarray
    opposite0: np.ndarray
    direct: np.ndarray  # (N,) share of light that passes unscattered

    def scattered(self, mirror) -> tuple[np.ndarray, np.ndarray]:
        """Light (N, N) scattered upward at the top and downward at the bottom, of light that enters at the top.

        mirror : (N,) share that the boundaries above and below, which are the same, send back in

        For light that enters both faces alike, (1 - r) u + (1 + r) v is twice what enters.  Where r = 1, that is E u: light
        that is caught between the faces of a thin layer loses no digits.
        """
        if not self.alike.any() and not self.opposite.any():
            return self.alike, self.opposite
        leak = (1 - mirror) / (1 + mirror)
        alike, opposite = (_symmetric(_inverse_times(_plus(part, bare + leak), part) / (bare + leak))
                           for part, bare in ((self.alike, self.alike0), (self.opposite, self.opposite0)))
        weight = np.outer(1 / (1 + mirror), 1 / (1 + mirror))
        return -weight * (alike + opposite), weight * (opposite - alike)

    def unscattered(self, mirror) -> tuple[np.ndarray, np.ndarray]:
        """The same (N,) of light that is only mirrored."""
        downward = np.divide(self.direct, 1 - (mirror * self.direct) ** 2, out=np.zeros_like(self.direct),
                             where=mirror * self.direct < 1)
        return downward * mirror * self.direct, downward


def homogeneous(even, odd, mu, flux, albedo: float, depth: float) -> Layer:
    """A homogeneous layer.

    even, odd : (N, N) parts of the phase function, `orders.phase_matrices`
    mu, flux : (N,) of `nodes.Nodes`
    albedo : single-scattering albedo, 0 to 1
    depth : optical depth, 0 to infinity
    """
    half, nothing = depth / 2, np.zeros((len(mu), len(mu)))
    if depth == 0:
        return Layer(nothing, nothing, np.zeros(len(mu)), np.full(len(mu), math.inf), np.ones(len(mu)))
    alike0, opposite0, direct = np.tanh(half / mu), 1 / np.tanh(half / mu), np.exp(-depth / mu)
    if albedo == 0 or not (even.any() or odd.any()):
        return Layer(nothing, nothing, alike0, opposite0, direct)
    share = np.sqrt(0.5 * flux / mu)
    share = albedo * np.outer(share, share)
    if half < _THIN or albedo < _FAINT:
        alike, opposite = _doubled(share * even, share * odd, mu, min(half, _BLACK))
    else:
        alike, opposite = _by_modes(share * even, share * odd, mu, flux, albedo, half)
    return Layer(alike, opposite, alike0, opposite0, direct)


def _by_modes(even, odd, mu, flux, albedo: float, half: float):
    """What scattering adds to E and O, from singular values."""
    order = np.argsort(mu)
    across = np.ix_(order, order)
    k, modes = _modes(even[across], odd[across], mu[order], flux[order], albedo)
    modes = modes[np.argsort(order)]
    tanh = np.tanh(np.multiply(k, half, where=k > 0, out=np.ones_like(k)))
    absorbing = np.tanh(half / mu)
    alike = (modes * (k * tanh)) @ modes.T
    opposite = (modes * np.where(k > 0, k / tanh, 1 / half)) @ modes.T
    return _plus(_symmetric(alike), -absorbing), _plus(_symmetric(opposite), -1 / absorbing)


def _modes(even, odd, mu, flux, albedo: float):
    """Rates k (N,), and modes (N, N) in columns, such that E = modes k tanh(k h) modes', for ascending mu.

    C is upper triangular, so that M C M^-1 is no larger than C, and C M^-1 B a diagonal matrix times a well-conditioned one: of
    such, Jacobi rotations (Drmac and Veselic 2008) find even the smallest singular values to rounding; other ways to rounding of
    the largest, which lost all digits at an albedo of 1e-4 under 72 nodes.
    """
    identity, isotropic = np.eye(len(mu)), np.sqrt(flux / mu)
    values, vectors = np.linalg.eigh(identity - even)
    lossless = albedo == 1 and abs(vectors[:, 0] @ isotropic) > (1 - 1e-6) * np.linalg.norm(isotropic)
    B = (vectors * np.sqrt(np.maximum(values, 0.0)))[:, 1 if lossless else 0:]
    values, vectors = np.linalg.eigh(identity - odd)
    C = np.linalg.qr((vectors * np.sqrt(np.maximum(values, _LEAST))).T, mode="r")
    product = ((mu[:, None] * C / mu) @ B) / mu[:, None]
    scaled, V, _, work, _, info = dgejsv(product)
    if info:
        raise ArithmeticError("modes of a layer do not converge")
    k = scaled * (work[0] / work[1])
    if lossless:
        k, still = np.append(k, 0.0), solve_triangular(C, np.sqrt(mu * flux), trans=1)
        V = np.column_stack([V, still / np.linalg.norm(still)])
    return k, np.sqrt(mu)[:, None] * solve_triangular(C, V)


def _doubled(even, odd, mu, half: float):
    """What scattering adds to E and O, by doubling."""
    doublings = max(0, math.ceil(math.log2(half / (_START * mu.min()))))
    h = half * 2.0**-doublings
    root = np.outer(1 / np.sqrt(mu), 1 / np.sqrt(mu))
    X, Y = -root * even, -root * odd  # what scattering adds to 1/mu
    k = 1 / (1 + (h / mu) ** 2 / 3)
    K = np.linalg.inv(np.eye(len(mu)) + h * h / 3 * _plus(Y, 1 / mu) @ _plus(X, 1 / mu))
    alike = _symmetric(h * (K.T @ X * k - h * h / 3 * (_plus(X, 1 / mu) @ K) @ Y * (k / mu)))
    opposite = _symmetric(h / 3 * X - _inverse_times(_plus(Y, 1 / mu), Y * mu) / h)
    for _ in range(doublings):
        alike0, opposite0 = np.tanh(h / mu), 1 / np.tanh(h / mu)
        E, O, total = _plus(alike, alike0), _plus(opposite, opposite0), alike0 + opposite0
        changes = np.concatenate([alike * (opposite0 / total), opposite * (alike0 / total)], axis=1)
        first, second = np.split(_inverse_times(E + O, changes), 2, axis=1)
        alike, opposite, h = _symmetric(2 * (O @ first + E @ second)), 0.5 * (alike + opposite), 2 * h
    return alike, opposite


def between(layer: Layer, below, top):
    """Light (N, N) that comes back to the top of a layer between a boundary and a base, of light that enters at the top.

    What the base sends back of light that is scattered nowhere else, and not mirrored either, is left out.

    below : (N, N) reflection of what lies under the layer
    top : (N,) share that the boundary above sends back in
    """
    identity, direct = np.eye(len(top)), layer.direct
    reflection, down = layer.scattered(np.zeros(len(top)))
    base = below @ np.linalg.inv(identity - reflection @ below)
    again = below @ reflection @ base
    returned = reflection + down.T @ base @ _plus(down, direct) + direct[:, None] * (base @ down + again * direct)
    if not top.any():
        return returned
    whole = returned + below * np.outer(direct, direct)
    return returned + whole * top @ whole @ np.linalg.inv(identity - top[:, None] * whole)


def _inverse_times(matrix, right):
    """Of a positive definite matrix."""
    return cho_solve(cho_factor(matrix), right)


def _plus(matrix, diagonal):
    return matrix + np.diag(diagonal)


def _symmetric(matrix):
    return 0.5 * (matrix + matrix.T)
