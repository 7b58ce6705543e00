"""Legendre moments of a phase function, and expansion coefficients of a scattering matrix in generalised spherical functions.

A table is linear in cos theta between its angles (`medium.phase`), and the moments are those of that interpolant.  Twice
integrated by parts, each is a sum over the angles: the jump of the slope there times the second integral of the Legendre
polynomial, which has a closed form without cancellation.  Matrix elements go with Wigner's functions d^l_mn, integrated over
each cell by Gauss's rule at nodes close enough for the highest order.

Shapes: theta (A,) rad, ascending from 0 to pi; elements (..., A) 1/sr; orders l = 0 .. N on the last axis.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bakery.physics.medium import phase as tables

MOST = 4096  # orders that are tried where a tolerance asks for as many as it takes
_NODES = 7  # of Gauss's rule on a piece on which l theta grows by at most 2: exact to 1e-14
_NODES_OF_ERROR = 3  # the same where an error is measured, to some percent
_TOGETHER = 16  # phase functions whose series are summed at once: memory


@dataclass(frozen=True)
class Series:
    """The first moments of phase functions, and what is cut with the others.

    Attributes
    ----------
    moments : (..., N + 1) 1, from order 0, which is 1
    cut : (...) 1, integral over the sphere of |phase function - its series|: a share of the scattered light
    """

    moments: np.ndarray
    cut: np.ndarray


@dataclass(frozen=True)
class Expansion:
    """Coefficients of a scattering matrix in generalised spherical functions, in the notation of Hovenier & van der Mee.

    Attributes
    ----------
    alpha1, alpha2, alpha3, alpha4, beta1, beta2 : (..., N + 1) 1, from order 0; alpha1 is (2 l + 1) times the Legendre moment
    """

    alpha1: np.ndarray
    alpha2: np.ndarray
    alpha3: np.ndarray
    alpha4: np.ndarray
    beta1: np.ndarray
    beta2: np.ndarray


def legendre_moments(theta, phase, orders: int) -> np.ndarray:
    """Moments chi_l = 2 pi * integral of phase * P_l(cos theta) over cos theta, (..., orders + 1), l = 0 .. orders.

    Parameters
    ----------
    theta : (A,) rad, ascending from 0 (forward) to pi
    phase : (..., A) 1/sr, linear in cos theta between the angles; where it integrates to 1, chi_0 = 1 and chi_1 = g
    orders : the highest l, at least 0

    Notes
    -----
    The phase function is the sum of (2 l + 1) / (4 pi) chi_l P_l(cos theta): chi_l is what DISORT calls PMOM, g^l for Henyey
    and Greenstein.  Exact for the interpolant up to rounding, about l^2 * 1e-16 of the largest; a table that meets a tolerance
    of its phase function has moments within the integral of that error over the sphere.

    With the second integral I_l of P_l, 0 at both ends, chi_l = 2 pi * sum over the inner angles of (jump of the slope) * I_l,
    and I_l = sin^2(theta) d^l_20(theta) / sqrt((l-1) l (l+1) (l+2)) by Rodrigues' formula.

    Examples
    --------
    >>> theta = np.linspace(0, np.pi, 19)
    >>> bool(abs(legendre_moments(theta, (1 + np.cos(theta)) / (4 * np.pi), 3) - [1, 1 / 3, 0, 0]).max() < 1e-14)
    True
    """
    theta, phase = _checked(theta, phase, orders)
    moments = np.empty((*phase.shape[:-1], orders + 1))
    moments[..., 0] = tables.phase_integral(theta, phase)
    if orders > 0:
        # of a table that is normalised, the mean cosine; else its share of the integral: 1 - g keeps its digits in both
        moments[..., 1] = moments[..., 0] - (1 - tables.mean_cosine(theta, phase))
    for l, row in _higher(theta, phase, orders):
        moments[..., l] = row
    return moments


def legendre_series(theta, phase, tolerance: float, most: int = MOST) -> Series:
    """As many moments as a tolerance needs, to some 3 %, the same number for all phase functions.

    Parameters
    ----------
    theta, phase : as for `legendre_moments`
    tolerance : 1, largest integral over the sphere of |phase function - its series|, as a share of the scattered light
    most : highest order that is tried; where it does not do, `cut` says what is missing

    Notes
    -----
    The integral itself is formed, by Gauss's rule.  Parseval's sum of what is left would bound it without a series, some ten
    times too high for fog: what is cut lies in the peak, on a small part of the sphere.
    """
    if not tolerance > 0:
        raise ValueError("a series needs a tolerance above 0")
    theta, phase = _checked(theta, phase, most)
    rows = phase.reshape(-1, theta.size)
    orders = 0
    for first in range(0, len(rows), _TOGETHER):
        orders = max(orders, _enough(theta, rows[first:first + _TOGETHER], tolerance, most, orders))
    cut = np.concatenate([series_error(theta, rows[first:first + _TOGETHER], orders) for first in range(0, len(rows), _TOGETHER)])
    return Series(legendre_moments(theta, phase, orders), cut.reshape(phase.shape[:-1]))


def series_error(theta, phase, orders: int) -> np.ndarray:
    """Integral over the sphere of |phase function - its series up to `orders`|, (...), to some percent of it."""
    theta, phase = _checked(theta, phase, orders)
    *_, (_, errors) = _errors(theta, phase, orders)
    return errors


def _enough(theta, phase, tolerance, most, least) -> int:
    """The first order tried, from `least`, up to which series of phase functions (L, A) are good enough; `most` where none is."""
    top = min(max(16, 2 * least), most)
    while True:
        for l, errors in _errors(theta, phase, top):
            if l >= least and (errors <= tolerance).all():
                return l
        if top == most:
            return most
        top = min(2 * top, most)


def _errors(theta, phase, orders) -> Iterator[tuple[int, np.ndarray]]:
    """`series_error` up to growing orders, the last of them `orders`."""
    moments = legendre_moments(theta, phase, orders)
    at, weight, cell, share = _quadrature(theta, orders, _NODES_OF_ERROR)
    residual = phase[..., cell] * (1 - share) + phase[..., cell + 1] * share
    due = 0
    for l, polynomial in wigner(at, 0, 0, orders):
        residual = residual - (2 * l + 1) / (4 * math.pi) * moments[..., l, None] * polynomial
        if l in (due, orders):
            yield l, 2 * math.pi * np.sum(weight * np.abs(residual), axis=-1)
            due = l + max(1, l // 32)


def phase_of(moments, theta) -> np.ndarray:
    """The sum of (2 l + 1) / (4 pi) chi_l P_l(cos theta), (..., *theta.shape) 1/sr: what a series stands for."""
    moments, theta = np.asarray(moments, float), np.asarray(theta, float)
    total = np.zeros((*moments.shape[:-1], *theta.shape))
    for l, polynomial in wigner(theta, 0, 0, moments.shape[-1] - 1):
        total += (2 * l + 1) / (4 * math.pi) * np.multiply.outer(moments[..., l], polynomial)
    return total


def expansion_coefficients(theta, s11, s12, s33, s34, orders: int, s22=None, s44=None) -> Expansion:
    """Expansion coefficients of a scattering matrix of randomly oriented particles.

    Parameters
    ----------
    theta : (A,) rad, ascending from 0 to pi
    s11, s12, s33, s34 : (..., A) 1/sr, in the convention of docs/conventions.md, s11 the phase function
    orders : highest l
    s22, s44 : (..., A) 1/sr; spheres have s22 = s11 and s44 = s33, which is taken where they are not given

    Notes
    -----
    With a = 4 pi s: a1 = sum of alpha1 P00, a2 + a3 = sum of (alpha2 + alpha3) P22, a2 - a3 = sum of (alpha2 - alpha3) P2-2,
    a4 = sum of alpha4 P00, b1 = sum of beta1 P02, b2 = sum of beta2 P02, where P_mn = i^(m-n) d_mn, so that P02 = -d02.
    Source: Hovenier & van der Mee 1983, Astron. Astrophys. 128, 1; de Rooij & van der Stap 1984, Astron. Astrophys. 131, 237,
    eqs. 13-18; checked against the output that comes with Mishchenko's spher.f.
    """
    theta, s11 = _checked(theta, s11, orders)
    s12, s33, s34 = (np.asarray(element, float) for element in (s12, s33, s34))
    s22 = s11 if s22 is None else np.asarray(s22, float)
    s44 = s33 if s44 is None else np.asarray(s44, float)
    scale = 2 * np.arange(orders + 1) + 1
    at, weight, cell, share = _quadrature(theta, orders)

    def projected(m, n, element):
        values = 2 * math.pi * weight * (element[..., cell] * (1 - share) + element[..., cell + 1] * share)
        coefficient = np.zeros((*element.shape[:-1], orders + 1))
        for l, function in wigner(at, m, n, orders):
            coefficient[..., l] = np.sum(values * function, axis=-1)
        return scale * coefficient

    total, difference = projected(2, 2, s22 + s33), projected(2, -2, s22 - s33)
    return Expansion(scale * legendre_moments(theta, s11, orders), (total + difference) / 2, (total - difference) / 2,
                     scale * legendre_moments(theta, s44, orders), 0 - projected(0, 2, s12), 0 - projected(0, 2, s34))


def wigner(theta, m: int, n: int, orders: int) -> Iterator[tuple[int, np.ndarray]]:
    """Wigner's d^l_mn(theta) for l from the larger of |m| and |n| to `orders`, each of theta's shape.

    m, n : (0, 0), (2, 0), (0, 2), (2, 2) or (2, -2)

    d^l_00 are Legendre polynomials.  The recurrence over l is stable upwards; its rounding grows as l^2 * 1e-16 near theta = 0.
    Source: Mishchenko, Travis & Lacis 2002, appendix B, eqs. B.22-B.25.
    """
    theta = np.asarray(theta, float)
    mu = np.cos(theta)
    seeds = {(0, 0): lambda: np.ones_like(theta), (2, 2): lambda: np.cos(theta / 2) ** 4, (2, -2): lambda: np.sin(theta / 2) ** 4,
             (0, 2): lambda: math.sqrt(6) / 4 * np.sin(theta) ** 2, (2, 0): lambda: math.sqrt(6) / 4 * np.sin(theta) ** 2}
    l = max(abs(m), abs(n))
    before, now = np.zeros_like(theta), seeds[m, n]()
    while l <= orders:
        yield l, now
        if l == 0:
            before, now = now, mu * now
        else:
            lower = (l + 1) * math.sqrt((l**2 - m**2) * (l**2 - n**2))
            upper = l * math.sqrt(((l + 1) ** 2 - m**2) * ((l + 1) ** 2 - n**2))
            before, now = now, ((2 * l + 1) * (l * (l + 1) * mu - m * n) * now - lower * before) / upper
        l += 1


def _checked(theta, phase, orders):
    theta, phase = np.asarray(theta, float), np.asarray(phase, float)
    if orders < 0:
        raise ValueError(f"{orders} orders; they are counted from 0: 0 or more would do")
    if theta.ndim != 1 or theta.size < 2 or phase.shape[-1:] != theta.shape or not (np.diff(theta) > 0).all():
        raise ValueError(f"angles of shape {theta.shape} for a phase function of shape {phase.shape}; two or more that ascend, "
                         "and as many along the last axis of the phase function, would do")
    return theta, phase


def _higher(theta, phase, orders) -> Iterator[tuple[int, np.ndarray]]:
    """Moments from order 2 on."""
    slope = (phase[..., :-1] - phase[..., 1:]) / tables.steps(theta)  # by cos theta, which descends
    inner = theta[1:-1]
    # the slope's jump at an angle, from the side of larger cosines; the ends of the second integral are 0
    jump = 2 * math.pi * (slope[..., :-1] - slope[..., 1:]) * np.sin(inner) ** 2
    for l, function in wigner(inner, 2, 0, orders):
        yield l, np.sum(jump * function, axis=-1) / math.sqrt((l - 1) * l * (l + 1) * (l + 2))


def _quadrature(theta, orders, nodes=_NODES):
    """Gauss's nodes (Q,) rad on pieces of all cells, their weights in cos theta, the cell of each and how far along it is."""
    pieces = np.maximum(np.ceil(np.diff(theta) * orders / 2).astype(int), 1)
    cell = np.repeat(np.arange(theta.size - 1), pieces)
    first = np.repeat(np.cumsum(pieces) - pieces, pieces)
    part = (np.arange(cell.size) - first) / pieces[cell]
    start = theta[cell] + (theta[cell + 1] - theta[cell]) * part
    width = (theta[cell + 1] - theta[cell]) / pieces[cell]
    node, weight = np.polynomial.legendre.leggauss(nodes)
    at = (start[:, None] + width[:, None] * (node + 1) / 2).reshape(-1)
    cell = np.repeat(cell, nodes)
    # d(cos theta) = sin(theta) d(theta); cells of small angles keep their digits
    weight = (width[:, None] / 2 * weight).reshape(-1) * np.sin(at)
    a, b = theta[cell], theta[cell + 1]
    share = np.sin((at + a) / 2) * np.sin((at - a) / 2) / (np.sin((a + b) / 2) * np.sin((b - a) / 2))
    return at, weight, cell, share
