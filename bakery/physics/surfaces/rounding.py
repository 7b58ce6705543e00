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


def rounded(solution, step: float, light: dict):
    """A solution (`Solution`, `Covered` or `Stacked`) whose orders above 0 are rounded.

    step : relative to the light of a pair of directions; below a millionth nothing is rounded
    light : its `least_light`
    """
    if step < _FINEST:
        return solution
    return replace(solution, **{name: _rounded(solution, name, step * least) for name, least in light.items()})


def least_light(solution) -> dict:
    """Of `reflected` and `transmitted`, where there is any, what steps are shares of: of pairs of nodes (K,)."""
    return {name: _least(solution, name, side) for name, side in (("reflected", -1), ("transmitted", 1))
            if getattr(solution, name, np.zeros(1)).any()}


def _pairs(solution, name: str):
    """Rows and columns (K,) of pairs of nodes, and whether each stands for both of its senses."""
    # of layers on each other the way back is that of the stack upside down
    symmetric, count = name == "reflected" or solution.slab.under is None, len(solution.nodes.air)
    return *(np.triu_indices(count) if symmetric else np.indices((count, count)).reshape(2, -1)), symmetric


def _least(solution, name: str, side: int):
    """(K,) the least light of pairs over azimuth."""
    orders, air = getattr(solution, name), solution.nodes.air
    row, column, _ = _pairs(solution, name)
    at = air[row][:, None], air[column][:, None], _AZIMUTHS
    exact = replace(solution, **{name: orders[:0]})
    factor = solution.factor(*at[:2], side)[:, 0]
    waves = np.where(np.arange(len(orders)) == 0, 1.0, 2.0)[:, None] * np.cos(np.arange(len(orders))[:, None] * _AZIMUTHS)
    values, odd = orders[:, row, column], sines(air[row], air[column], solution.nodes.index)
    smooth = values[::2].T @ waves[::2] + odd[:, None] * (values[1::2].T @ waves[1::2])
    light = np.abs(smooth + (exact.transmission if side > 0 else exact.reflection)(*at) / factor[:, None]).min(axis=1)
    light = np.maximum(light, _FLOOR * np.median(light))
    return np.where(light > 0, light, 1.0)


def _rounded(solution, name: str, light):
    """One of its arrays (M, N, N), in steps of powers of two up to (K,)."""
    orders, air = getattr(solution, name), solution.nodes.air
    row, column, symmetric = _pairs(solution, name)
    odd = light / sines(air[row], air[column], solution.nodes.index)
    even, odd = (2.0 ** np.floor(np.log2(part)) for part in (light, odd))
    result = orders[:, row, column]
    result[2::2], result[1::2] = even * np.round(result[2::2] / even), odd * np.round(result[1::2] / odd)
    last = int(np.flatnonzero(result.any(axis=1)).max(initial=0)) + 1
    filled = np.empty((last, *orders.shape[1:]))
    filled[:, row, column] = result[:last]
    if symmetric:
        filled[:, column, row] = result[:last]
    return filled
