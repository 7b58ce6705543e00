"""The triangles of a mesh in a grid of cubic cells, over whose empty parts rays leap: `laid`.

Each cell knows, for each of the eight octants of directions, how many cells a ray of that octant may leap over because the cube
of cells ahead is empty (Es & Isler's anisotropic chessboard distance, 2007).  A cell that triangles reach into lists them in
blocks of eight, their corners rounded to int8: good enough to sort out those that a ray misses by far, in an eighth of the
memory.  What remains is tested exactly.
"""

import math
from typing import NamedTuple

import numpy as np

from bakery.physics.grains._rays import BLOCK, FULL, MORE, NAMES, SLACK, TRIANGLES, UNITS
from bakery.system.compiled import njit

# Side of a cell over that of a square as large as the mean triangle.  Small cells hold few triangles, but those of a fine mesh
# fill more memory than is near: with 200,000 triangles waiting for it costs more than tests (measured best: 1.5 with 20,000, 4).
SIDE, SIDE_MAX, MANY = 1.5, 4.0, 20_000
CELLS_MAX, ALONG_MAX = 1 << 22, 1000  # in all, along an axis: float32 knows a place in the grid to 1e-4 cells
MARGIN = 1e-3  # cells; triangles count as reaching so far beyond themselves
_FARTHEST = FULL - 2
# Edge functions: rounding moves a corner by half a unit along each axis and the float32 arithmetic by less than 0.15, the shear
# makes that 1.15 along two axes; an edge is at most sqrt(3) times as long after the shear.
_SLACK = 1.15 * math.sqrt(2) * math.sqrt(3)


class Grid(NamedTuple):
    """What walks take."""

    low: np.ndarray  # (3,) R, corner of the grid
    scale: float  # cells per R
    count: np.ndarray  # (3,) cells along the axes
    leaps: np.ndarray  # (8 cells,) uint8, x fastest, cells to leap over, + FULL where the cell has triangles
    first: np.ndarray  # (cells,) int32, number of the first block of a cell, 0 where it has none
    blocks: np.ndarray  # (BLOCK B,) int8, see `_rays`
    corners: np.ndarray  # (9 T,) R, [triangle][corner][axis]
    longest: int  # largest number of blocks of a cell

    @property
    def nbytes(self) -> int:
        return sum(array.nbytes for array in (self.leaps, self.first, self.blocks, self.corners))


def laid(vertices, faces) -> Grid:
    """Grid of the triangles faces (T, 3) of vertices (V, 3)."""
    corners = np.ascontiguousarray(vertices[faces])
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    area = 0.5 * np.sum(np.linalg.norm(np.cross(b - a, c - a), axis=1))
    low, size = vertices.min(0), np.ptp(vertices, axis=0)
    share = min(SIDE * max(1.0, len(faces) / MANY) ** 0.42, SIDE_MAX)
    side = max(share * math.sqrt(area / len(faces)), size.max() / ALONG_MAX)
    while True:
        count = np.ceil(size / side + 4 * MARGIN).astype(np.int64)
        if np.prod(count) <= CELLS_MAX:
            break
        side *= 1.03
    low, scale, cells = low - 2 * MARGIN * side, 1 / side, int(np.prod(count))
    number = np.zeros(cells, np.int32)
    placed = (corners - low) * scale
    _list(placed, count, number, np.zeros(0, np.int64), np.zeros(0, np.int32))
    start = np.zeros(cells + 1, np.int64)
    np.cumsum(number, out=start[1:])
    names = np.empty(start[-1], np.int32)
    _list(placed, count, np.zeros(cells, np.int32), start, names)
    several = -(-number // TRIANGLES)
    blocks, first = np.zeros(BLOCK * int(several.sum()), np.int8), np.zeros(cells, np.int32)
    _pack(placed, count, start, names, first, blocks, blocks.view(np.int32), blocks.view(np.float32))
    leaps = np.empty(8 * cells, np.uint8)
    _measure(number, count, leaps)
    return Grid(low, scale, count, leaps, first, blocks, corners.reshape(-1), int(several.max()))


@njit(cache=True, nogil=True, error_model="numpy")
def _reaches(corners, x, y, z, half):
    """Whether a triangle (3, 3) reaches into the cube of half side `half` around (x, y, z): no axis separates them."""
    v = np.empty((3, 3))
    for c in range(3):
        v[c, 0], v[c, 1], v[c, 2] = corners[c, 0] - x, corners[c, 1] - y, corners[c, 2] - z
    for k in range(3):
        if min(v[0, k], v[1, k], v[2, k]) > half or max(v[0, k], v[1, k], v[2, k]) < -half:
            return False
    ux, uy, uz = v[1, 0] - v[0, 0], v[1, 1] - v[0, 1], v[1, 2] - v[0, 2]
    wx, wy, wz = v[2, 0] - v[0, 0], v[2, 1] - v[0, 1], v[2, 2] - v[0, 2]
    nx, ny, nz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    if abs(nx * v[0, 0] + ny * v[0, 1] + nz * v[0, 2]) > half * (abs(nx) + abs(ny) + abs(nz)):
        return False
    for c in range(3):
        d = (c + 1) % 3
        for k in range(3):
            p, q = (k + 1) % 3, (k + 2) % 3
            ep, eq = v[d, p] - v[c, p], v[d, q] - v[c, q]
            # the edge's own two corners give one value
            first, second = v[c, q] * ep - v[c, p] * eq, v[(c + 2) % 3, q] * ep - v[(c + 2) % 3, p] * eq
            reach = half * (abs(ep) + abs(eq))
            if min(first, second) > reach or max(first, second) < -reach:
                return False
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _list(corners, count, number, start, names):
    """Count the triangles of each cell into `number`; with `names`, write them there, a cell's from its `start` on."""
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for t in range(len(corners)):
        for k in range(3):
            least = min(corners[t, 0, k], corners[t, 1, k], corners[t, 2, k])
            most = max(corners[t, 0, k], corners[t, 1, k], corners[t, 2, k])
            low[k], high[k] = max(0, int(least - MARGIN)), min(count[k] - 1, int(most + MARGIN))
        alone = low[0] == high[0] and low[1] == high[1] and low[2] == high[2]
        for z in range(low[2], high[2] + 1):
            for y in range(low[1], high[1] + 1):
                for x in range(low[0], high[0] + 1):
                    if alone or _reaches(corners[t], x + 0.5, y + 0.5, z + 0.5, 0.5 + MARGIN):
                        at = (z * count[1] + y) * count[0] + x
                        if len(names):
                            names[start[at] + number[at]] = t
                        number[at] += 1


@njit(cache=True, nogil=True, error_model="numpy")
def _pack(corners, count, start, names, first, blocks, ints, floats):
    """Write the blocks of all cells, and where each cell's begin; ints, floats : the same memory as blocks."""
    middle, block = np.empty(3), 0
    for at in range(len(first)):
        several = (start[at + 1] - start[at] + TRIANGLES - 1) // TRIANGLES
        if several == 0:
            continue
        first[at] = block
        middle[0], middle[1] = at % count[0] + 0.5, at // count[0] % count[1] + 0.5
        middle[2] = at // (count[0] * count[1]) + 0.5
        for part in range(several):
            begin = start[at] + part * TRIANGLES
            end = min(begin + TRIANGLES, start[at + 1])
            reach, edge = 0.5, 0.0
            for i in range(begin, end):
                t = names[i]
                for c in range(3):
                    square = 0.0
                    for k in range(3):
                        reach = max(reach, abs(corners[t, c, k] - middle[k]))
                        square += (corners[t, c, k] - corners[t, (c + 1) % 3, k]) ** 2
                    edge = max(edge, math.sqrt(square))
            units = 127 / reach
            for lane in range(TRIANGLES):
                if begin + lane >= end:
                    ints[block * BLOCK // 4 + NAMES // 4 + lane] = -1
                    continue
                t = names[begin + lane]
                ints[block * BLOCK // 4 + NAMES // 4 + lane] = t
                for c in range(3):
                    for k in range(3):
                        blocks[block * BLOCK + (3 * k + c) * TRIANGLES + lane] = round((corners[t, c, k] - middle[k]) * units)
            floats[(block * BLOCK + UNITS) // 4] = units
            floats[(block * BLOCK + SLACK) // 4] = _SLACK * (edge * units + 2.0)  # the rounded edge: up to sqrt(3) longer
            ints[(block * BLOCK + MORE) // 4] = several - 1 - part
            block += 1


@njit(cache=True, nogil=True, error_model="numpy")
def _measure(number, count, leaps):
    """Cells that may be leapt over from each, its own included, in the octants of directions (bits: x, y, z > 0)."""
    nx, ny, nz = count[0], count[1], count[2]
    for octant in range(8):
        sx, sy, sz = 2 * (octant & 1) - 1, (octant & 2) - 1, (octant & 4) // 2 - 1
        base = octant * len(number)
        for c in range(nz):
            z = nz - 1 - c if sz > 0 else c
            for b in range(ny):
                y = ny - 1 - b if sy > 0 else b
                for a in range(nx):
                    x = nx - 1 - a if sx > 0 else a
                    least = _FARTHEST
                    for corner in range(1, 8):
                        i, j, k = x + sx * (corner & 1), y + sy * (corner >> 1 & 1), z + sz * (corner >> 2)
                        if 0 <= i < nx and 0 <= j < ny and 0 <= k < nz:  # beyond the grid all is empty
                            free = leaps[base + (k * ny + j) * nx + i]
                            least = min(least, 0 if free >= FULL else np.int64(free))
                    at = (z * ny + y) * nx + x
                    leaps[base + at] = least + 1 + (FULL if number[at] else 0)
