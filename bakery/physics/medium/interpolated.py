"""A medium between the wavelengths, and the values of another axis, at which it is tabulated.

Extinction, scattering and scattered light are linear between the tabulated places, so that the mixture of two media is a medium:
the albedo goes weighted by extinction, the phase function by scattering, as libRadtran and Eradiate have it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from bakery.physics.medium.phase import normalised, phase_at


@dataclass(frozen=True)
class Tabulated:
    """Media at W wavelengths by P places of another axis."""

    wavelength: np.ndarray  # (W,) um, ascending
    values: np.ndarray  # (P,) ascending
    # extinction, albedo: (W, P)
    extinction: np.ndarray
    albedo: np.ndarray
    # theta, phase: W tuples of P arrays: angles (A,) rad from 0 to pi, phase functions in any scale, linear in cos theta
    theta: Sequence[Sequence[np.ndarray]]
    phase: Sequence[Sequence[np.ndarray]]


@dataclass(frozen=True)
class Between:
    """A medium at L wavelengths."""

    # sigma_s, sigma_a: (L,) unit of the extinction
    sigma_s: np.ndarray
    sigma_a: np.ndarray
    # theta, phase, bias: (A,) rad, (L, A) 1/sr with the integral 1, (L, A) 1/sr estimated error of phase
    theta: np.ndarray
    phase: np.ndarray
    bias: np.ndarray
    error: float  # 1, largest estimated relative error of extinction, albedo and phase function


def between(table: Tabulated, wavelength, value: float) -> Between:
    """The medium at wavelengths (L,) um and a value of the other axis, all within the table.

    The error is what a bracket one place wider on either side changes, times the share that the error of a linear interpolation
    in the narrower bracket has of the change: exact for a parabola.  Where there are no wider places a quarter of the difference
    of the two ends counts.  A tabulated place has none.
    """
    wavelength = np.asarray(wavelength, float)
    across = _bracket(table.values, value)
    along = [_bracket(table.wavelength, um) for um in wavelength]
    used = {(i, j) for row in along for i in _places(table.wavelength, row) for j in _places(table.values, across)}
    theta = reduce(np.union1d, (table.theta[i][j] for i, j in sorted(used)))
    phases = {(i, j): normalised(theta, phase_at(table.theta[i][j], table.phase[i][j], theta))[0] for i, j in used}
    rows = [_mixed(table, phases, row, across) for row in along]
    bias, error = np.zeros((len(wavelength), theta.size)), 0.0
    for l, (row, medium) in enumerate(zip(along, rows, strict=True)):
        for widened, factor in ((_wider(table.wavelength, row), 0), (_wider(table.values, across), 1)):
            if widened is None:
                continue
            bracket, share = widened
            coarse = _mixed(table, phases, *((bracket, across) if factor == 0 else (row, bracket)))
            gaps = [abs(a - b) * share for a, b in zip(medium, coarse, strict=True)]
            bias[l] += gaps[2]
            scale = np.maximum(medium[2], np.finfo(float).tiny)
            error = max(error, gaps[0] / medium[0] if medium[0] else 0.0, gaps[1], float(np.max(gaps[2] / scale)))
    sigma_t, albedo = (np.array([row[i] for row in rows]) for i in (0, 1))
    return Between(albedo * sigma_t, (1 - albedo) * sigma_t, theta, np.array([row[2] for row in rows]), bias, error)


def _bracket(grid, at: float) -> tuple[int, int, float]:
    """The two places around a value, and how far it lies between them; the same place twice where it is tabulated."""
    nearest = int(np.argmin(np.abs(grid - at)))
    if abs(grid[nearest] - at) <= 1e-6 * abs(at):  # files hold them in single precision
        return nearest, nearest, 0.0
    upper = int(np.clip(np.searchsorted(grid, at), 1, len(grid) - 1))
    return upper - 1, upper, float((at - grid[upper - 1]) / (grid[upper] - grid[upper - 1]))


def _wider(grid, bracket) -> tuple[tuple[int, int, float], float] | None:
    """A bracket one place wider on each side, and the error of the narrower one over what it changes; None at a place."""
    lower, upper, t = bracket
    if lower == upper:
        return None
    at = grid[lower] + t * (grid[upper] - grid[lower])
    low, high = max(lower - 1, 0), min(upper + 1, len(grid) - 1)
    if (low, high) == (lower, upper):
        return (lower, lower, 0.0), 0.25 / t
    widened, narrow = (at - grid[low]) * (grid[high] - at), (at - grid[lower]) * (grid[upper] - at)
    return (low, high, float((at - grid[low]) / (grid[high] - grid[low]))), float(narrow / (widened - narrow))


def _places(grid, bracket) -> set[int]:
    """All that a bracket and its wider one need."""
    widened = _wider(grid, bracket)
    return {bracket[0], bracket[1]} | (set() if widened is None else {widened[0][0], widened[0][1]})


def _mixed(table: Tabulated, phases, along, across) -> tuple[float, float, np.ndarray]:
    """Extinction, albedo and phase function (A,) in a bracket of wavelengths and one of the other axis."""
    (lower, upper, t), (low, high, s) = along, across
    corners = {}
    for corner, weight in (((lower, low), (1 - t) * (1 - s)), ((upper, low), t * (1 - s)), ((lower, high), (1 - t) * s),
                          ((upper, high), t * s)):
        corners[corner] = corners.get(corner, 0.0) + weight
    extinction = sum(weight * table.extinction[corner] for corner, weight in corners.items())
    scattering = {corner: weight * table.extinction[corner] * table.albedo[corner] for corner, weight in corners.items()}
    total = sum(scattering.values())
    if not total > 0:  # nothing scatters there: any phase function would do
        scattering, total = corners, sum(corners.values())
        return float(extinction), 0.0, sum(weight / total * phases[corner] for corner, weight in scattering.items())
    phase = sum(weight / total * phases[corner] for corner, weight in scattering.items())
    return float(extinction), float(total / extinction), phase
