"""Grids of cells that know what may come near them: beams, or light that a triangle lets in."""

from __future__ import annotations

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
