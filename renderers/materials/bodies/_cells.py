"""Grids of cells that know what may come near them: beams, or light that a triangle lets in."""

import math
from typing import NamedTuple

import numpy as np

from bakery.system.compiled import njit


class Cells(NamedTuple):
    """Items of each cell of a grid.

    low, edge, shape : (3,) m, m, (3,)
    begin : (cells + 1,) where the items of each begin in `names`
    """

    low: np.ndarray
    edge: float
    shape: np.ndarray
    begin: np.ndarray
    names: np.ndarray


class Steps(NamedTuple):
    """Where a line is among cells.

    at, step : (3,) the cell, and which way the line leaves it
    ahead, across : (3,) m, from its origin to the next plane between cells, and between two of them
    """

    at: np.ndarray
    step: np.ndarray
    ahead: np.ndarray
    across: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def steps_of_lines():
    """`Steps` of no line yet."""
    return Steps(np.empty(3, np.int64), np.empty(3, np.int64), np.empty(3), np.empty(3))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def start(cells, lines, i, steps):
    """Puts line i, of origins and directions (n, 3), into the cell of its origin, or into the nearest."""
    for k in range(3):
        position, d = (lines.origin[i, k] - cells.low[k]) / cells.edge, lines.direction[i, k]
        steps.at[k] = min(max(math.floor(position), 0), cells.shape[k] - 1)
        steps.step[k] = 1 if d > 0.0 else -1
        steps.across[k] = cells.edge / abs(d) if d != 0.0 else np.inf
        to_plane = (steps.at[k] + 1 - position) if d > 0.0 else (position - steps.at[k])
        steps.ahead[k] = to_plane * steps.across[k] if d != 0.0 else np.inf


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def cell_ahead(cells, steps):
    """The number of the cell, and the axis of the plane by which the line leaves it."""
    at, ahead = steps.at, steps.ahead
    axis = 0 if ahead[0] <= ahead[1] and ahead[0] <= ahead[2] else 1 if ahead[1] <= ahead[2] else 2
    return (at[0] * cells.shape[1] + at[1]) * cells.shape[2] + at[2], axis


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def onward(cells, steps, axis):
    """Takes the line to the next cell, by a plane; whether there is such a cell."""
    steps.at[axis] += steps.step[axis]
    steps.ahead[axis] += steps.across[axis]
    return 0 <= steps.at[axis] < cells.shape[axis]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def reach(cells, axis, low, high):
    """First and last cell along an axis between two coordinates (m), of those that there are."""
    last = min(math.floor((high - cells.low[axis]) / cells.edge), cells.shape[axis] - 1)
    return max(math.floor((low - cells.low[axis]) / cells.edge), 0), last


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def enter(cells, least, most, item, latest):
    """Counts an item in each cell from least to most (3,), in `begin`; or, where there are names, enters it there, beginning at
    `begin`, which is moved on.

    latest : (cells,) item that came last to each, which comes once
    """
    for x in range(least[0], most[0] + 1):
        for y in range(least[1], most[1] + 1):
            for z in range(least[2], most[2] + 1):
                cell = (x * cells.shape[1] + y) * cells.shape[2] + z
                if latest[cell] != item:
                    latest[cell] = item
                    if len(cells.names):
                        cells.names[cells.begin[cell]] = item
                    cells.begin[cell] += 1


def cells_of(low, high, edge, entered, *items) -> Cells:
    """Cells of an edge (m) in a box, filled by entered(*items, cells, latest), which calls `enter`."""
    shape = np.maximum(np.ceil((high - low) / edge), 1).astype(np.int64)
    count = int(np.prod(shape))
    empty = Cells(low, edge, shape, np.zeros(count + 1, np.int64), np.empty(0, np.int32))
    entered(*items, empty, np.full(count, -1, np.int32))
    begin = np.concatenate([[0], np.cumsum(empty.begin[:-1])])
    filled = empty._replace(begin=begin, names=np.empty(begin[-1], np.int32))
    entered(*items, filled._replace(begin=begin.copy()), np.full(count, -1, np.int32))
    return filled
