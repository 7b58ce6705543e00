"""Loops of the filter: pixels and blocks in, sums of light and of shares out, LANES channels at a time.

Sums of a pixel p: `NEAR` light of nearer pixels by their own kernels, `FAR` light of the others by the kernel of p; `SHARE` the
nearer ones' shares, `REST` weights of these, `MET` weights of the others by the kernel of p.
"""

import math
from typing import NamedTuple

import numpy as np

from bakery.system.compiled import njit
from renderers.fog import _blocks
from renderers.fog._blocks import number_of
from renderers.fog._lanes import LANES, add_light, add_share

NEAR, SHARE, FAR, MET, REST = range(5)  # in this order: two at a time are added to
SUMS = 5
NODES = 18  # of a radial profile of a block


class Kernels(NamedTuple):
    """Tables of a medium.

    shape : (LANES, T, X + NODES + 1), ends with zeros;  means : (LANES, T, X, O), `kernels.over_pixels`
    depth_of : (LANES,) index of log sigma_t
    step, first : of log u
    """

    shape: np.ndarray
    means: np.ndarray
    depth_of: np.ndarray
    step: float
    first: float


class Nearest(NamedTuple):
    """Level 0.

    taps : (N, 3) dy, dx and offset o of pixels around one
    weight : (O,) of the band
    """

    taps: np.ndarray
    weight: np.ndarray


class Level(NamedTuple):
    """Blocks of `side` pixels.

    shift : from u to a profile's first node, in steps of the table
    profiles : (E, NODES, LANES), see `profiles`
    """

    side: float
    shift: float
    blocks: _blocks.Blocks
    profiles: np.ndarray


class Band(NamedTuple):
    """The distances, in blocks, that a level has its part in: `inner` to `outer`.

    table : (N, 4) float32, on equal steps of the squared distance from 0 to outer^2: weight of the band over the distance, its
        difference to the next, index on a profile's nodes, its difference
    """

    inner: float
    outer: float
    table: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _place(value, last):
    return min(max(value, 0.0), last)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _four(t, v, factor):
    """Nodes before a place (t, v) and the weights of the four around it, times a factor."""
    i, j = int(t), int(v)
    f, g = t - i, v - j
    return (i, j, np.float32((1 - f) * (1 - g) * factor), np.float32((1 - f) * g * factor), np.float32(f * (1 - g) * factor),
            np.float32(f * g * factor))


@njit(cache=True, nogil=True, error_model="numpy")
def _profile(shape, depth_of, column, lever, factor, e, out):
    """Profile out[e], (NODES, LANES), at an index of the column, from an index of log u on, times a factor."""
    # whole arrays and numbers of rows, here and below: numba counts each slice that is taken, which takes most of the time
    last_t, last_u = shape.shape[1] - 1.001, shape.shape[2] - NODES - 1.001
    for k in range(LANES):
        i, j, a, b, c, d = _four(_place(column + depth_of[k], last_t), _place(lever, last_u), factor)
        for n in range(NODES):
            out[e, n, k] = (a * shape[k, i, j + n] + b * shape[k, i, j + n + 1] + c * shape[k, i + 1, j + n]
                            + d * shape[k, i + 1, j + n + 1])


@njit(cache=True, nogil=True, error_model="numpy")
def profiles(low, high, kernels, entries, shift, side, out):
    """Radial profiles (E, NODES, LANES) of entries: what a pixel receives, times its distance in blocks."""
    for e in range(low, high):
        factor = math.exp(kernels.first + kernels.step * entries[e, _blocks.LEVER]) / side
        _profile(kernels.shape, kernels.depth_of, entries[e, _blocks.COLUMN], entries[e, _blocks.LEVER] + shift, factor, e, out)


@njit(cache=True, nogil=True, error_model="numpy")
def _means(means, depth_of, column, lever, u, weight, e, out):
    """Shares out[e], (O, LANES), of a pixel's light in those at offsets, times the weights of these."""
    last_t, last_u = means.shape[1] - 1.001, means.shape[2] - 1.001
    for k in range(LANES):
        i, j, a, b, c, d = _four(_place(column + depth_of[k], last_t), _place(lever, last_u), u)
        for o in range(len(weight)):
            out[e, o, k] = weight[o] * (a * means[k, i, j, o] + b * means[k, i, j + 1, o] + c * means[k, i + 1, j, o]
                                        + d * means[k, i + 1, j + 1, o])


@njit(cache=True, nogil=True, error_model="numpy")
def nearest_rows(low, high, pixels, kernels, nearest, out):
    """Level 0: all pairs of pixels at the offsets `nearest.taps`, for rows low to high; out (H W, SUMS, LANES)."""
    taps, weight = nearest
    z, light = pixels.distance, pixels.light
    means, depth_of = kernels.means, kernels.depth_of
    height, width = z.shape
    none, all_of = np.float32(0), np.float32(1)
    reach = 0
    for n in range(len(taps)):
        reach = max(reach, taps[n, 0])
    top, bottom = max(low - reach, 0), min(high + reach, height)
    # one more, as two neighbours are read of a profile
    profile = np.zeros(((bottom - top) * width + 1, len(weight), LANES), np.float32)
    for y in range(top, bottom):
        for x in range(width):
            _means(means, depth_of, pixels.column[y, x], pixels.lever[y, x], pixels.u[y, x], weight, (y - top) * width + x,
                   profile)
    for y in range(low, high):
        for x in range(width):
            at, beam, distance = (y * width + x) * SUMS * LANES, ((y - top) * width + x) * len(weight), z[y, x]
            for n in range(len(taps)):
                yy, xx, o = y + taps[n, 0], x + taps[n, 1], taps[n, 2]
                if yy < 0 or yy >= height or xx < 0 or xx >= width:
                    continue
                source = (yy * width + xx) * _blocks.LIGHT
                if z[yy, xx] < distance:
                    neighbour = ((yy - top) * width + xx) * len(weight) + o
                    add_light(out, at + NEAR * LANES, profile, neighbour, none, all_of, light, source + 2 * LANES)
                    add_share(out, at + REST * LANES, profile, beam + o, none, all_of)
                else:
                    add_light(out, at + FAR * LANES, profile, beam + o, none, all_of, light, source)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _looked(s, table):
    """Weight of the band, node and fraction of a profile."""
    s = np.float32(s)
    i = np.uint32(s)
    s -= np.float32(i)
    g = table[i, 2] + s * table[i, 3]
    n = np.uint32(g)
    return table[i, 0] + s * table[i, 1], n, g - np.float32(n)


@njit(cache=True, nogil=True, error_model="numpy")
def _between(entries, e, distance):
    """Share of an entry's pixels that are nearer than a distance between its ends."""
    first, last = entries[e, _blocks.NEAREST], entries[e, _blocks.FARTHEST]
    between = entries[e, _blocks.COUNT] - entries[e, _blocks.AT_NEAREST] - entries[e, _blocks.AT_FARTHEST]
    if between < 0.5:
        return entries[e, _blocks.AT_NEAREST] / entries[e, _blocks.COUNT]
    inside = between * ((distance - first) / (last - first)) ** entries[e, _blocks.BETWEEN]
    return (entries[e, _blocks.AT_NEAREST] + inside) / entries[e, _blocks.COUNT]


@njit(cache=True, nogil=True, error_model="numpy")
def level_targets(low, high, targets, kernels, level, band, out):
    """Levels above 0: what all blocks of `level` at the distances of `band` send to targets low to high; out (N, SUMS, LANES)."""
    mask, start, entries = level.blocks
    spread, table = level.profiles, band.table
    rows, columns = mask.shape
    beam = np.zeros((1, NODES + 1, LANES), np.float32)
    shape, depth_of = kernels.shape, kernels.depth_of
    around, size = band.outer + 0.71, 1 / level.side
    nearest, farthest = (band.inner * level.side) ** 2, (band.outer * level.side) ** 2
    step = len(table) * (1 - 1e-6) / farthest  # single precision reaches no further than the last
    for p in range(low, high):
        y, x, distance, at = targets.y[p], targets.x[p], targets.distance[p], p * SUMS * LANES
        _profile(shape, depth_of, targets.column[p], targets.lever[p] + level.shift,
                 math.exp(kernels.first + kernels.step * targets.lever[p]) * size, 0, beam)
        v, h = y * size, x * size
        for by in range(max(math.floor(v - around), 0), min(math.floor(v + around) + 1, rows)):
            across = around * around - (by + 0.5 - v) ** 2
            if across <= 0:
                continue
            across = math.sqrt(across)
            first, last = max(math.ceil(h - across - 0.5), 0), min(math.floor(h + across - 0.5) + 1, columns)
            if first >= last:
                continue
            for e in range(np.uint64(start[by * columns + first]), np.uint64(start[by * columns + last])):
                square = (entries[e, _blocks.Y] - y) ** 2 + (entries[e, _blocks.X] - x) ** 2
                if nearest < square < farthest:
                    if distance <= entries[e, _blocks.NEAREST]:
                        nearer = 0.0
                    elif distance > entries[e, _blocks.FARTHEST]:
                        nearer = 1.0
                    else:
                        nearer = _between(entries, e, distance)
                    w, n, g = _looked(square * step, table)
                    if nearer > 0:
                        share = np.float32(w * nearer)
                        add_light(out, at + NEAR * LANES, spread, e * NODES + n, g, share, entries,
                                  e * _blocks.ENTRY + _blocks.SENT)
                        add_share(out, at + REST * LANES, beam, n, g, share * np.float32(entries[e, _blocks.COUNT]))
                    if nearer < 1:
                        add_light(out, at + FAR * LANES, beam, n, g, np.float32(w * (1 - nearer)), entries,
                                  e * _blocks.ENTRY + _blocks.FIRST)


@njit(cache=True, nogil=True, error_model="numpy")
def between_points(low, high, offset, fine, coarse, sums, out):
    """Adds to targets the sums (n, SUMS, LANES) of points twice as far apart, linear between those of the same class.

    low, high : rows of `fine`
    offset : of a target from the lattice's corner, in its steps: 0 for points, 0.5 for pixels
    """
    width, across = fine.mask.shape[1], coarse.mask.shape[1]
    for y in range(low, high):
        i = int(0.5 * (y + offset))
        f = 0.5 * (y + offset) - i
        for x in range(width):
            j = int(0.5 * (x + offset))
            g = 0.5 * (x + offset) - j
            n, bits = fine.start[y * width + x], fine.mask[y, x]
            while bits:
                below = (bits & -bits) - 1
                bits &= bits - 1
                for k in range(4):
                    weight = (f if k & 2 else 1 - f) * (g if k & 1 else 1 - g)
                    if weight > 0:
                        yy, xx = i + (k >> 1), j + (k & 1)
                        m = coarse.start[yy * across + xx] + number_of(coarse.mask[yy, xx] & below)
                        for s in range(SUMS):
                            for c in range(LANES):
                                out[n, s, c] += weight * sums[m, s, c]
                n += 1
