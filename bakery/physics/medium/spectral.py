"""Quantities between the wavelengths at which they were computed, and what that is off by.

Between two neighbours a quantity goes as a power of the wavelength (linear in its logarithm over that of the wavelength, as
Angstrom's law has it) where it is positive at both, else linearly.  How far that misses is measured by leaving out: each inner
wavelength is interpolated from its two neighbours and compared with what is stored there.

Shapes: L stored wavelengths in any order, W wanted ones, values (L, ...).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from bakery.physics.medium.phase import normalised

SAME = 1e-9  # relative distance below which two wavelengths are one
_ANGLES = 9  # over which the largest relative error counts at each: between crests and troughs a difference passes through 0


class Places(NamedTuple):
    """Where wanted wavelengths lie among stored ones, each (W,)."""

    # lower, upper: indices of the stored neighbours, one index twice at a stored wavelength
    lower: np.ndarray
    upper: np.ndarray
    # power, linear: 1, how far towards the upper one in the logarithm of the wavelength, and in the wavelength itself
    power: np.ndarray
    linear: np.ndarray


def places(stored, wanted) -> Places:
    """The neighbours of wavelengths (W,); ValueError outside of the stored ones (L,)."""
    stored, wanted = np.asarray(stored, float), np.asarray(wanted, float)
    order = np.argsort(stored)
    ascending = stored[order]
    outside = wanted[~((wanted >= ascending[0] * (1 - SAME)) & (wanted <= ascending[-1] * (1 + SAME)))]
    if outside.size:
        raise ValueError(f"wavelength {outside.flat[0]:g} um is not stored; {ascending[0]:g} to {ascending[-1]:g} um would do")
    nearest = order[np.argmin(np.abs(ascending - wanted[..., None]), axis=-1)]
    same = np.abs(stored[nearest] - wanted) <= SAME * stored[nearest]
    upper = np.clip(np.searchsorted(ascending, wanted), min(1, stored.size - 1), stored.size - 1)
    low, high = (np.where(same, nearest, order[i]) for i in (np.maximum(upper - 1, 0), upper))
    return _placed(stored, low, high, wanted, same)


def _placed(stored, low, high, wanted, same) -> Places:
    a, b = stored[low], np.where(same, 2 * stored[low], stored[high])
    return Places(low, high, np.where(same, 0.0, np.log(wanted / a) / np.log(b / a)), np.where(same, 0.0, (wanted - a) / (b - a)))


def interpolated(at: Places, values) -> np.ndarray:
    """Values (L, ...) at places, (W, ...); at a stored wavelength exactly what is stored."""
    values = np.asarray(values, float)
    first, last = values[at.lower], values[at.upper]
    power, linear = (share.reshape(share.shape + (1,) * (values.ndim - 1)) for share in (at.power, at.linear))
    positive = (first > 0) & (last > 0) & (power > 0)
    logarithm = np.log(np.where(positive, first, 1.0)) * (1 - power) + np.log(np.where(positive, last, 1.0)) * power
    return np.where(positive, np.exp(logarithm), first * (1 - linear) + last * linear)


def phase_functions(at: Places, theta, table) -> np.ndarray:
    """Phase functions (L, A) at places, (W, A), each of integral 1."""
    rows = interpolated(at, table)
    return np.where((at.power > 0)[:, None], normalised(theta, rows)[0], rows)


def missed(stored, wanted, compute: Callable[[Places], np.ndarray], values, over_angles: bool = False) -> np.ndarray:
    """What interpolation is off by at wanted wavelengths, (W, ...) absolute; 0 at stored ones, not a number where not known.

    stored, wanted : (L,), (W,) um
    compute : places -> values there
    values : (L, ...) as stored
    over_angles : whether the last axis goes over angles, of which the largest relative error within a few counts

    The larger of what leaving out either neighbour shows, in the middle of two wavelengths, and less towards them, as t (1 - t).
    An error that goes as the square of the spacing is a quarter of that where wavelengths are equidistant; what is claimed is the
    whole, as ripples and bows follow no such law.  A gap wider than those that were left out counts by its square.  The ends have
    one neighbour only; two wavelengths have none, and the error is not known.
    """
    stored, values = np.asarray(stored, float), np.asarray(values, float)
    at = places(stored, wanted)
    result = compute(at)
    shape = at.power.shape + (1,) * (values.ndim - 1)
    between = at.power > 0
    if not between.any():
        return np.zeros_like(result)
    rank = np.argsort(np.argsort(stored))
    worst = np.full(result.shape, np.nan)
    for node in (at.lower, at.upper):
        inner = np.flatnonzero(between & (rank[node] > 0) & (rank[node] < stored.size - 1))
        if inner.size:
            gap = _left_out(stored, node[inner], compute, values, over_angles)
            magnitude = np.abs(values[node[inner]])
            gap = gap * np.maximum(np.divide(np.abs(result[inner]), magnitude, out=np.ones_like(gap), where=magnitude > 0), 1.0)
            gap *= _wider(stored, rank, at, node, inner).reshape((-1,) + (1,) * (values.ndim - 1))
            worst[inner] = np.fmax(worst[inner], gap)
    t = at.power.reshape(shape)
    return np.where(between.reshape(shape), 4 * t * (1 - t) * worst, 0.0)


def _left_out(stored, node, compute, values, over_angles) -> np.ndarray:
    """|interpolated from the neighbours - stored| at inner wavelengths."""
    from scipy.ndimage import maximum_filter1d

    order = np.argsort(stored)
    rank = np.argsort(order)[node]
    around = _placed(stored, order[rank - 1], order[rank + 1], stored[node], np.zeros(len(node), bool))
    gap = np.abs(compute(around) - values[node])
    if over_angles:
        magnitude = np.abs(values[node])
        share = np.divide(gap, magnitude, out=np.zeros_like(gap), where=magnitude > 0)
        gap = np.maximum(gap, maximum_filter1d(share, _ANGLES, axis=-1, mode="nearest") * magnitude)
    return gap


def _wider(stored, rank, at: Places, node, inner) -> np.ndarray:
    """By what the error of a gap exceeds that of an inner wavelength left out, at least 1: their widths in the logarithm."""
    logarithm = np.log(np.sort(stored))
    width = np.log(stored[at.upper[inner]] / stored[at.lower[inner]])
    left_out = rank[node[inner]]
    before, after = logarithm[left_out] - logarithm[left_out - 1], logarithm[left_out + 1] - logarithm[left_out]
    return np.maximum(width**2 / (4 * before * after), 1.0)
