"""Lines through a periodic tile of spheres, whose images lie in a grid of cells (`cells`)."""

import math
from typing import NamedTuple

import numpy as np

from bakery.system.compiled import njit

MOMENTS = 4


@njit(cache=True, nogil=True, error_model="numpy")
def first_hit(o, d, cell, m, start, image, limit):
    """Distance along unit d (3,) from o (3,), outside of all spheres, to the first sphere; `limit` where none comes before it.

    A sphere whose centre lies behind is passed over, so a ray may start on a surface that it leaves.  o is changed.
    """
    h = cell / m
    index, step, wall, every = np.zeros(3, np.int64), np.zeros(3, np.int64), np.zeros(3), np.zeros(3)
    for k in range(3):
        o[k] -= math.floor(o[k] / cell[k]) * cell[k]
        index[k] = min(int(o[k] / h[k]), m[k] - 1)
        step[k] = 1 if d[k] > 0 else -1
        if d[k] == 0:
            wall[k] = every[k] = np.inf
        else:
            wall[k] = ((index[k] + (d[k] > 0)) * h[k] - o[k]) / d[k]
            every[k] = h[k] / abs(d[k])
    best = limit
    while True:
        cell_index = (index[0] * m[1] + index[1]) * m[2] + index[2]
        for s in range(start[cell_index], start[cell_index + 1]):
            x, y, z = image[s, 0] - o[0], image[s, 1] - o[1], image[s, 2] - o[2]
            along = x * d[0] + y * d[1] + z * d[2]
            if along > 0:
                # from the distance of the line to the centre: far away, |oc|^2 - along^2 would lose its digits
                u, v, w = x - along * d[0], y - along * d[1], z - along * d[2]
                inside = image[s, 3] - (u * u + v * v + w * w)
                if inside > 0:
                    best = min(best, max(along - math.sqrt(inside), 0.0))
        k = 0
        if wall[1] < wall[k]:
            k = 1
        if wall[2] < wall[k]:
            k = 2
        if best <= wall[k]:
            return best
        index[k] += step[k]
        wall[k] += every[k]
        if index[k] == m[k] or index[k] < 0:
            index[k] -= step[k] * m[k]
            # the tile repeats: the ray goes on in the first tile, seen from an origin one tile further back
            o[k] -= step[k] * cell[k]


class Tile(NamedTuple):
    """N spheres of a tile that repeats.

    centers, radii : (N, 3), (N,);  share : (N,) cumulated shares of the surface
    cell : (3,) edges of the tile;  m : (3,) cells of its grid;  start, image : of `cells.tile_grid`
    """

    centers: np.ndarray
    radii: np.ndarray
    share: np.ndarray
    cell: np.ndarray
    m: np.ndarray
    start: np.ndarray
    image: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy")
def chords(uniform, tile, edges, limit):
    """Chords of isotropic uniform lines between spheres, added up.

    Lines cross surfaces uniformly in area and with the cosine of the angle to the normal: each chord starts at such a crossing.

    Parameters
    ----------
    uniform : (n, 5) 1, in [0, 1)
    tile : `Tile`
    edges : (B + 1,) of bins; the last one counts all longer chords too
    limit : where a chord is cut off

    Returns
    -------
    counts : (B,)
    sums : (4,) of chord^1 .. chord^4
    longest : of the chords
    cut : number of chords cut off at `limit`
    """
    counts, sums, longest, cut = np.zeros(edges.size - 1, np.int64), np.zeros(MOMENTS), 0.0, 0
    centers, radii, share, cell, m, start, image = tile
    o, d, n = np.zeros(3), np.zeros(3), np.zeros(3)
    for line in range(len(uniform)):
        i = min(np.searchsorted(share, uniform[line, 0], side="right"), len(radii) - 1)
        for v, first in ((n, 1), (d, 3)):
            v[2] = 2 * uniform[line, first] - 1
            across, phi = math.sqrt(max(1 - v[2] * v[2], 0.0)), 2 * math.pi * uniform[line, first + 1]
            v[0], v[1] = across * math.cos(phi), across * math.sin(phi)
        # the normal plus a point of the unit sphere has the cosine distribution about the normal
        length = 0.0
        for k in range(3):
            o[k] = centers[i, k] + radii[i] * n[k]
            d[k] += n[k]
            length += d[k] * d[k]
        length = math.sqrt(length)
        if length < 1e-12:
            continue
        for k in range(3):
            d[k] /= length
        z = first_hit(o, d, cell, m, start, image, limit)
        cut += z >= limit
        longest = max(longest, z)
        counts[min(np.searchsorted(edges, z, side="right"), edges.size - 1) - 1] += 1
        power = z
        for k in range(MOMENTS):
            sums[k] += power
            power *= z
    return counts, sums, longest, cut
