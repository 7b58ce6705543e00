"""Half as many moments again until the answer no longer changes by more than what is asked for."""

from __future__ import annotations

import math

import numpy as np

from bakery.physics.multiple.legendre import moments
from bakery.physics.surfaces.slab import Slab
from bakery.physics.surfaces.solution import Covered, Solution, Stacked, solve
from bakery.physics.surfaces.stack import layers

FEWEST, MOST = 16, 640  # Legendre moments
_MOST_NODES = 256  # moments, where there are as many nodes
_UNSTEADY = 2.0  # errors over changes, where nodes are fewer than moments: both change from step to step
_FLOOR = 1e-3  # of the median: below, errors count as if relative to that (values at grazing angles are a thousand times larger)
_COSINES = np.array([math.cos(math.radians(89.9)), 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0])
_AZIMUTHS = np.linspace(0, math.pi, 5)


def refined(slab: Slab, tolerance: float, most: int = MOST) -> tuple[Solution | Covered | Stacked, float]:
    """The solution, and its relative change from two thirds of the moments: largest over angles from 0 to 89.9 degrees.

    The change is above the tolerance where `most` moments do not reach it.
    """
    if slab.roughness > 0 or slab.depth < math.inf and slab.base is None and slab.under is None:
        most = min(most, _MOST_NODES)
    wanted = moments_of(slab, most)
    count, before, error = FEWEST, None, math.inf
    while True:
        solution = solve(slab, wanted, count, tolerance)
        values = _values(solution)
        if before is not None:
            error = max(map(_change, values, before)) * (_UNSTEADY if solution.nodes.leaving < count else 1)
        if error <= tolerance or 3 * count // 2 > most:
            return solution, error
        before, count = values, 3 * count // 2


def moments_of(slab: Slab, most: int):
    """(most + 1,) Legendre moments of a slab's phase function; a list of them, one a layer, where others are under it."""
    if slab.under is None:
        return moments(slab.theta, slab.phase, most)
    return [moments(part.theta, part.phase, most) for part in layers(slab)[0]]


def _values(solution: Solution | Covered | Stacked) -> tuple[np.ndarray, ...]:
    """Reflection and transmission at the angles of the test."""
    at = np.meshgrid(_COSINES, _COSINES, _AZIMUTHS, indexing="ij")
    # where the peak is cut off, transmitted light is not told
    apart = np.abs(at[0] - at[1]) + at[2] > 0
    if solution.slab.under is not None:
        return (solution.reflection(*at),)
    return solution.reflection(*at), np.where(apart, solution.transmission(*at), 0.0)


def _change(values, before) -> float:
    scale = np.maximum(np.abs(values), _FLOOR * np.median(np.abs(values)))
    return float(np.max(np.divide(np.abs(values - before), scale, out=np.zeros_like(scale), where=scale > 0)))
