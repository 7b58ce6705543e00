"""Places of particles put in the order of cells."""

import numpy as np

from bakery.system.compiled import njit


@njit(cache=True, nogil=True, error_model="numpy")
def sorted_by_cell(position, first, last, cells, edge, out):
    """Write places (n, 3) float32 m to `out`, cell by cell, row-major, those of a cell in the order in which they came.

    The cells are those from `first` to before `last` along x, of `cells` (3,) int64 in a box with edges `edge` (3,) m; what
    float32 rounds across a wall counts to the nearest of them.
    """
    ny, nz = cells[1], cells[2]
    offset = np.zeros((last - first) * ny * nz + 1, np.int64)
    at = np.empty(len(position), np.int64)
    sx, sy, sz = cells[0] / edge[0], cells[1] / edge[1], cells[2] / edge[2]
    for n in range(len(position)):
        i = min(max(int(position[n, 0] * sx), first), last - 1) - first
        j, k = min(int(position[n, 1] * sy), ny - 1), min(int(position[n, 2] * sz), nz - 1)
        at[n] = (i * ny + j) * nz + k
        offset[at[n] + 1] += 1
    for c in range(1, len(offset)):
        offset[c] += offset[c - 1]
    for n in range(len(position)):
        to = offset[at[n]]
        offset[at[n]] += 1
        out[to, 0], out[to, 1], out[to, 2] = position[n, 0], position[n, 1], position[n, 2]
