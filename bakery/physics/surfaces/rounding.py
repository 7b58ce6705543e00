"""Fourier orders rounded to what a tolerance tells: high ones become 0 away from grazing angles, and pack well.

A step is a power of two, the same for all orders of a pair of directions: a share of the least light of the pair over azimuth.
Order 0 stays: it is energy.
"""

from dataclasses import replace

import numpy as np

from bakery.physics.surfaces.nodes import sines

_AZIMUTHS = np.linspace(0, np.pi, 17)
_FLOOR = 1e-3  # of the median: light below that counts as that
_FINEST = 2.0**-20  # single precision has little more


def rounded(solution, step: float):
    """A solution (`Solution`, `Covered` or `Stacked`) whose orders above 0 are rounded.

    step : relative to the light of a pair of directions; below a millionth nothing is rounded
    """
    if step < _FINEST:
        return solution
    changes = {name: _rounded(solution, name, side, step) for name, side in (("reflected", -1), ("transmitted", 1))
               if getattr(solution, name, np.zeros(1)).any()}
    return replace(solution, **changes)


def _rounded(solution, name: str, side: int, step: float):
    """One of its arrays (M, N, N)."""
    orders, air = getattr(solution, name), solution.nodes.air
    # of layers on each other the way back is that of the stack upside down
    symmetric = side < 0 or solution.slab.under is None
    row, column = np.triu_indices(len(air)) if symmetric else np.indices((len(air), len(air))).reshape(2, -1)
    at = air[row][:, None], air[column][:, None], _AZIMUTHS
    exact = replace(solution, **{name: orders[:0]})
    factor = solution.factor(*at[:2], side)[:, 0]
    waves = np.where(np.arange(len(orders)) == 0, 1.0, 2.0)[:, None] * np.cos(np.arange(len(orders))[:, None] * _AZIMUTHS)
    values, odd = orders[:, row, column], sines(air[row], air[column], solution.nodes.index)
    smooth = values[::2].T @ waves[::2] + odd[:, None] * (values[1::2].T @ waves[1::2])
    light = np.abs(smooth + (exact.transmission if side > 0 else exact.reflection)(*at) / factor[:, None]).min(axis=1)
    light = np.maximum(light, _FLOOR * np.median(light))
    even, odd = (2.0 ** np.floor(np.log2(step * np.where(part > 0, part, 1.0))) for part in (light, light / odd))
    result = values.copy()
    result[2::2], result[1::2] = even * np.round(values[2::2] / even), odd * np.round(values[1::2] / odd)
    last = int(np.flatnonzero(result.any(axis=1)).max(initial=0)) + 1
    filled = np.empty((last, *orders.shape[1:]))
    filled[:, row, column] = result[:last]
    if symmetric:
        filled[:, column, row] = result[:last]
    return filled
