"""A periodic tile of spheres in a grid of cells: what rays through it look among."""

import math

import numpy as np

from bakery.system.compiled import njit

_EDGE = 0.7  # of a cell, in the edge of a cube with one sphere in it: the quickest flights


def counts(cell, spheres):
    """Cells (3,) along the edges of a tile (3,) of so many spheres, about a third of a sphere each."""
    return np.maximum(np.floor(cell / (_EDGE * (np.prod(cell) / spheres) ** (1 / 3))), 1).astype(np.int64)


@njit(cache=True, nogil=True, error_model="numpy")
def tile_grid(centers, radii, cell, m):
    """For each of m (3,) cells of the tile, the images of spheres that reach into it.

    Returns
    -------
    start : (cells + 1,) where the images of each begin
    image : (K, 4) centre as seen from the tile, square of the radius
    owner : (K, 4) number of the sphere, and of the copy of the tile that its centre lies in
    """
    h = cell / m
    start = np.zeros(m[0] * m[1] * m[2] + 1, np.int64)
    image, owner = np.zeros((0, 4)), np.zeros((0, 4), np.int64)
    low, high, shift, origin = np.zeros(3, np.int64), np.zeros(3, np.int64), np.zeros(3, np.int64), np.zeros(3, np.int64)
    for filling in range(2):
        if filling:
            for k in range(start.size - 1, 0, -1):
                start[k] = start[k - 1]
            start[0] = 0
            for k in range(1, start.size):
                start[k] += start[k - 1]
            image, owner = np.zeros((start[-1], 4)), np.zeros((start[-1], 4), np.int64)
            at = start[:-1].copy()
        for i in range(len(radii)):
            for axis in range(3):
                low[axis] = math.floor((centers[i, axis] - radii[i]) / h[axis])
                high[axis] = math.floor((centers[i, axis] + radii[i]) / h[axis])
            for a in range(low[0], high[0] + 1):
                for b in range(low[1], high[1] + 1):
                    for c in range(low[2], high[2] + 1):
                        origin[0], origin[1], origin[2] = a, b, c
                        apart = 0.0
                        for axis in range(3):
                            x = centers[i, axis]
                            gap = max(max(origin[axis] * h[axis] - x, x - (origin[axis] + 1) * h[axis]), 0.0)
                            apart += gap * gap
                            shift[axis] = math.floor(origin[axis] / m[axis])
                        if apart > radii[i] * radii[i]:
                            continue
                        k = ((a - shift[0] * m[0]) * m[1] + b - shift[1] * m[1]) * m[2] + c - shift[2] * m[2]
                        if filling:
                            for axis in range(3):
                                image[at[k], axis] = centers[i, axis] - shift[axis] * cell[axis]
                                owner[at[k], 1 + axis] = -shift[axis]
                            image[at[k], 3], owner[at[k], 0] = radii[i] * radii[i], i
                            at[k] += 1
                        else:
                            start[k] += 1
    return start, image, owner
