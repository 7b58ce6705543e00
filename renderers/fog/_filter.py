"""Loops of the filter: rows of pixels in, sums of light and of shares out.

A kernel's kinds are the medium's channels: 1 for all channels of the picture, or one each, so kind k is that of the channels k,
k + kinds, ...

Sums of a pixel p: `NEAR` light of nearer pixels by their own kernels, `FAR` light of the others by the kernel of p, for each
channel; `SHARE` the nearer ones' shares, `REST` weights of these, `MET` weights of the others by the kernel of p, for each kind.

An entry is what one block of 2^l x 2^l pixels holds of one class of distances: sums over its pixels, then means.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bakery.system.compiled import njit

NEAR, SHARE, FAR, MET, REST = range(5)
# columns of an entry: pixels and their centre, light and its centre, distances (smallest, largest, pixels at those two, mean),
# indices on log column and on log of pixel over lever with the weight of those two; from FIRST on (C,) col, (C,) light sent, (K,)
# its share
COUNT, Y, X, GLOW, GLOW_Y, GLOW_X, NEAREST, FARTHEST, AT_NEAREST, AT_FARTHEST, DISTANCE, COLUMN, LEVER, WEIGHT, FIRST = range(15)
NODES = 18  # of a radial profile of a block


class Pixels(NamedTuple):
    """Of a picture.

    distance : (H, W) m
    column, lever : (H, W) 1, indices on log tau of sigma_t = 1 and on log u;  u : (H, W) 1
    light : (H, W, 2 C + K), as the tail of an entry
    depth_of : K numbers, index of log sigma_t
    """

    distance: np.ndarray
    column: np.ndarray
    lever: np.ndarray
    u: np.ndarray
    light: np.ndarray
    depth_of: tuple


class Nearest(NamedTuple):
    """Level 0.

    means : (K, T, X, O), `kernels.over_pixels`
    taps : (N, 3) dy, dx and offset o of pixels around one
    weight : (O,) of the band
    """

    means: np.ndarray
    taps: np.ndarray
    weight: np.ndarray


class Level(NamedTuple):
    """Blocks of `side` pixels.

    shape : (K, T, X + NODES + 1), ends with zeros
    shift : from u to a profile's first node, in steps of the table
    start : (h w + 1,), where the entries of blocks start, of which there are `blocks`, (h, w)
    entries : (E, F)
    profiles : (E, NODES, K), see `profiles`
    """

    shape: np.ndarray
    shift: float
    side: float
    start: np.ndarray
    blocks: tuple
    entries: np.ndarray
    profiles: np.ndarray


class Band(NamedTuple):
    """The distances, in blocks, that a level has its part in: `inner` to `outer`.

    node, weight : index on a profile's nodes, and weight of the band over the distance, on equal steps of the squared distance
        from 0 to outer^2
    """

    inner: float
    outer: float
    node: np.ndarray
    weight: np.ndarray


class Table(NamedTuple):
    """Kernels of pairs of pixels.

    shape : (K, T, X);  means : (K, T, X, O)
    offset : (R, R) number of the mean over pixels at |dy|, |dx|, or -1: the kernel at the pixel's centre
    step : of log u
    """

    shape: np.ndarray
    means: np.ndarray
    offset: np.ndarray
    step: float


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _place(value, last):
    return min(max(value, 0.0), last)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _four(t, v, factor):
    """Nodes before a place (t, v) and the weights of the four around it, times a factor."""
    i, j = int(t), int(v)
    f, g = t - i, v - j
    return i, j, (1 - f) * (1 - g) * factor, (1 - f) * g * factor, f * (1 - g) * factor, f * g * factor


@njit(cache=True, nogil=True, error_model="numpy")
def _profile(table, t, v, factor, out):
    """table[t, v + n] for n = 0, 1, ..., linear in both, times a factor."""
    i, j, a, b, c, d = _four(t, v, factor)
    for n in range(len(out)):
        out[n] = a * table[i, j + n] + b * table[i, j + n + 1] + c * table[i + 1, j + n] + d * table[i + 1, j + n + 1]


@njit(cache=True, nogil=True, error_model="numpy")
def _means(table, t, v, factor, out):
    """The same for means over pixels: table[t, v, o]."""
    i, j, a, b, c, d = _four(t, v, factor)
    for n in range(len(out)):
        out[n] = a * table[i, j, n] + b * table[i, j + 1, n] + c * table[i + 1, j, n] + d * table[i + 1, j + 1, n]


@njit(cache=True, nogil=True, error_model="numpy")
def nearest_rows(low, high, pixels, nearest, out):
    """Level 0: all pairs of pixels at the offsets `nearest.taps`, for rows low to high; out (H, W, 5, C)."""
    z, column, lever, u, light, depth_of = pixels
    means, taps, weight = nearest
    height, width = z.shape
    channels, kinds, last_t, last_u = out.shape[3], len(depth_of), means.shape[1] - 1.001, means.shape[2] - 1.001
    reach = 0
    for n in range(len(taps)):
        reach = max(reach, taps[n, 0])
    top, bottom = max(low - reach, 0), min(high + reach, height)
    profile = np.empty((bottom - top, width, kinds, len(weight)), np.float32)
    for y in range(top, bottom):
        for x in range(width):
            for k in range(kinds):
                row = profile[y - top, x, k]
                _means(means[k], _place(column[y, x] + depth_of[k], last_t), _place(lever[y, x], last_u), u[y, x], row)
                for o in range(len(weight)):
                    row[o] *= weight[o]
    for y in range(low, high):
        for x in range(width):
            sums, beam, distance = out[y, x], profile[y - top, x], z[y, x]
            for n in range(len(taps)):
                yy, xx, o = y + taps[n, 0], x + taps[n, 1], taps[n, 2]
                if yy < 0 or yy >= height or xx < 0 or xx >= width:
                    continue
                if z[yy, xx] < distance:
                    for k in range(kinds):
                        share = profile[yy - top, xx, k, o]
                        for c in range(k, channels, kinds):
                            sums[NEAR, c] += share * light[yy, xx, channels + c]
                        sums[SHARE, k] += share * light[yy, xx, 2 * channels + k]
                        sums[REST, k] += beam[k, o]
                else:
                    for k in range(kinds):
                        for c in range(k, channels, kinds):
                            sums[FAR, c] += beam[k, o] * light[yy, xx, c]
                        sums[MET, k] += beam[k, o]


@njit(cache=True, nogil=True, error_model="numpy")
def count(mask, below_height, below_width):
    """Classes in blocks of two by two (h, w) as bits, and where their entries start (h w + 1,)."""
    height, width = (below_height + 1) // 2, (below_width + 1) // 2
    classes = np.zeros((height, width), np.int64)
    for y in range(below_height):
        for x in range(below_width):
            classes[y // 2, x // 2] |= mask[y, x]
    start = np.zeros(height * width + 1, np.int64)
    for y in range(height):
        for x in range(width):
            bits, number = classes[y, x], 0
            while bits:
                bits &= bits - 1
                number += 1
            start[y * width + x + 1] = start[y * width + x] + number
    return classes, start


@njit(cache=True, nogil=True, error_model="numpy")
def merge(below, below_mask, below_start, mask, start, classes, entries):
    """Entries of blocks from those of the four blocks of half their size."""
    below_height, below_width = below_mask.shape
    height, width = mask.shape
    columns = below.shape[1]
    sums = np.empty((classes, columns))
    for y in range(height):
        for x in range(width):
            sums[:] = 0
            sums[:, NEAREST] = math.inf
            for yy in range(2 * y, min(2 * y + 2, below_height)):
                for xx in range(2 * x, min(2 * x + 2, below_width)):
                    n, bits = below_start[yy * below_width + xx], below_mask[yy, xx]
                    for k in range(classes):
                        if not (bits >> k) & 1:
                            continue
                        entry, total = below[n], sums[k]
                        n += 1
                        if entry[NEAREST] < total[NEAREST]:
                            total[NEAREST], total[AT_NEAREST] = entry[NEAREST], 0
                        if entry[FARTHEST] > total[FARTHEST]:
                            total[FARTHEST], total[AT_FARTHEST] = entry[FARTHEST], 0
                        total[AT_NEAREST] += entry[AT_NEAREST] if entry[NEAREST] == total[NEAREST] else 0
                        total[AT_FARTHEST] += entry[AT_FARTHEST] if entry[FARTHEST] == total[FARTHEST] else 0
                        total[DISTANCE] += entry[COUNT] * entry[DISTANCE]
                        total[COUNT] += entry[COUNT]
                        total[WEIGHT] += entry[WEIGHT]
                        total[Y] += entry[COUNT] * entry[Y]
                        total[X] += entry[COUNT] * entry[X]
                        total[GLOW] += entry[GLOW]
                        total[GLOW_Y] += entry[GLOW] * entry[GLOW_Y]
                        total[GLOW_X] += entry[GLOW] * entry[GLOW_X]
                        total[COLUMN] += entry[WEIGHT] * entry[COLUMN]
                        total[LEVER] += entry[WEIGHT] * entry[LEVER]
                        for c in range(FIRST, columns):
                            total[c] += entry[c]
            n = start[y * width + x]
            for k in range(classes):
                if (mask[y, x] >> k) & 1:
                    for c in range(columns):  # not a row at once: what numba checks then takes half of the time to compile this
                        entries[n, c] = sums[k, c]
                    entries[n, DISTANCE] /= sums[k, COUNT]
                    entries[n, Y] /= sums[k, COUNT]
                    entries[n, X] /= sums[k, COUNT]
                    entries[n, GLOW_Y] = sums[k, GLOW_Y] / sums[k, GLOW] if sums[k, GLOW] > 0 else entries[n, Y]
                    entries[n, GLOW_X] = sums[k, GLOW_X] / sums[k, GLOW] if sums[k, GLOW] > 0 else entries[n, X]
                    if sums[k, WEIGHT] > 0:
                        entries[n, COLUMN] /= sums[k, WEIGHT]
                        entries[n, LEVER] /= sums[k, WEIGHT]
                    n += 1


@njit(cache=True, nogil=True, error_model="numpy")
def profiles(entries, depth_of, shape, lever_step, lever_first, shift, side, out):
    """Radial profiles (E, NODES, K) of entries: what a pixel receives, times its distance in blocks.

    shape (K, T, X + NODES + 1) ends with zeros; shift is from u to the first node, in steps of the table.
    """
    last_t, last_u = shape.shape[1] - 1.001, shape.shape[2] - NODES - 1.001
    for e in range(len(entries)):
        factor = math.exp(lever_first + lever_step * entries[e, LEVER]) / side
        for k in range(len(depth_of)):
            _profile(shape[k], _place(entries[e, COLUMN] + depth_of[k], last_t), _place(entries[e, LEVER] + shift, last_u),
                     factor, out[e, :, k])


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _looked(s, node, weight):
    """Weight of the band, node and fraction of a profile."""
    i = int(s)
    s -= i
    g = node[i] + s * (node[i + 1] - node[i])
    n = int(g)
    return weight[i] + s * (weight[i + 1] - weight[i]), n, g - n


@njit(cache=True, nogil=True, error_model="numpy")
def _nearer(entry, distance):
    """Share of an entry's pixels that are nearer than a distance between its ends.

    Those at the ends are counted (a wall that faces the camera is one distance); the others have a density t^(k - 1) with their
    mean.
    """
    span = entry[FARTHEST] - entry[NEAREST]
    between = entry[COUNT] - entry[AT_NEAREST] - entry[AT_FARTHEST]
    if between < 0.5:
        return entry[AT_NEAREST] / entry[COUNT]
    mean = ((entry[DISTANCE] - entry[NEAREST]) * entry[COUNT] - entry[AT_FARTHEST] * span) / (between * span)
    mean = min(max(mean, 1e-3), 1 - 1e-3)
    return (entry[AT_NEAREST] + between * ((distance - entry[NEAREST]) / span) ** (mean / (1 - mean))) / entry[COUNT]


@njit(cache=True, nogil=True, error_model="numpy")
def level_rows(low, high, pixels, level, band, out):
    """Levels above 0: what all blocks of `level` at the distances of `band` send to rows low to high."""
    z, column, lever, u, _, depth_of = pixels
    shape, shift, side, start, blocks, entries, spread = level
    inner, outer, node, weight = band
    width, channels, kinds = z.shape[1], out.shape[3], len(depth_of)
    last_t, last_u = shape.shape[1] - 1.001, shape.shape[2] - NODES - 1.001
    beam = np.empty((NODES, kinds), np.float32)
    rows, columns = blocks
    nearest, farthest = inner * inner, outer * outer
    step = (len(node) - 1) / farthest
    around, size = outer + 0.71, 1 / side
    for y in range(low, high):
        for x in range(width):
            sums, distance = out[y, x], z[y, x]
            for k in range(kinds):
                _profile(shape[k], _place(column[y, x] + depth_of[k], last_t), _place(lever[y, x] + shift, last_u),
                         u[y, x] * size, beam[:, k])
            v, h = (y + 0.5) * size, (x + 0.5) * size
            for by in range(max(math.floor(v - around), 0), min(math.floor(v + around) + 1, rows)):
                across = around * around - (by + 0.5 - v) ** 2
                if across <= 0:
                    continue
                across = math.sqrt(across)
                for bx in range(max(math.ceil(h - across - 0.5), 0), min(math.floor(h + across - 0.5) + 1, columns)):
                    for e in range(start[by * columns + bx], start[by * columns + bx + 1]):
                        entry = entries[e]
                        if distance <= entry[NEAREST]:
                            nearer = 0.0
                        elif distance > entry[FARTHEST]:
                            nearer = 1.0
                        else:
                            nearer = _nearer(entry, distance)
                        # light lies where it is bright, weights where the pixels are: without that a lamp's halo is not round
                        square = ((entry[GLOW_Y] - y - 0.5) ** 2 + (entry[GLOW_X] - x - 0.5) ** 2) * (size * size)
                        if nearest < square < farthest:
                            w, n, g = _looked(square * step, node, weight)
                            if nearer > 0:
                                for k in range(kinds):
                                    share = w * nearer * (spread[e, n, k] + g * (spread[e, n + 1, k] - spread[e, n, k]))
                                    for c in range(k, channels, kinds):
                                        sums[NEAR, c] += share * entry[FIRST + channels + c]
                            if nearer < 1:
                                for k in range(kinds):
                                    share = w * (1 - nearer) * (beam[n, k] + g * (beam[n + 1, k] - beam[n, k]))
                                    for c in range(k, channels, kinds):
                                        sums[FAR, c] += share * entry[FIRST + c]
                        square = ((entry[Y] - y - 0.5) ** 2 + (entry[X] - x - 0.5) ** 2) * (size * size)
                        if nearest < square < farthest:
                            w, n, g = _looked(square * step, node, weight)
                            for k in range(kinds):
                                share = w * entry[COUNT] * (beam[n, k] + g * (beam[n + 1, k] - beam[n, k]))
                                sums[MET, k] += (1 - nearer) * share
                                sums[REST, k] += nearer * share
                            if nearer > 0:
                                for k in range(kinds):
                                    share = w * nearer * (spread[e, n, k] + g * (spread[e, n + 1, k] - spread[e, n, k]))
                                    sums[SHARE, k] += share * entry[FIRST + 2 * channels + k]


@njit(cache=True, nogil=True, error_model="numpy")
def _shares(pixels, y, x, distance, along, o, table, out):
    """Shares (K,) of a pixel's light in another one: at offset number o by the mean over the pixel, or else at its centre."""
    shape, means = table.shape, table.means
    column, lever, u, depth_of = pixels.column[y, x], pixels.lever[y, x], pixels.u[y, x], pixels.depth_of
    last_t, last_u = shape.shape[1] - 1.001, shape.shape[2] - 1.001
    v = lever if o >= 0 else lever + along
    if o < 0 and v > last_u:
        out[:] = 0
        return
    v = _place(v, last_u)
    j = int(v)
    g = v - j
    factor = u if o >= 0 else u / distance
    for c in range(len(out)):
        t = _place(column + depth_of[c], last_t)
        i = int(t)
        f = t - i
        if o >= 0:
            out[c] = factor * ((1 - f) * ((1 - g) * means[c, i, j, o] + g * means[c, i, j + 1, o])
                               + f * ((1 - g) * means[c, i + 1, j, o] + g * means[c, i + 1, j + 1, o]))
        else:
            out[c] = factor * ((1 - f) * ((1 - g) * shape[c, i, j] + g * shape[c, i, j + 1])
                               + f * ((1 - g) * shape[c, i + 1, j] + g * shape[c, i + 1, j + 1]))


@njit(cache=True, nogil=True, error_model="numpy")
def every_pair(chosen, reach, pixels, table, remainder, out):
    """The sums of chosen pixels (flat indices) over every pixel at most `reach` away along either axis; out (N, 5, C).

    remainder : whether `REST` is wanted
    """
    z, light, offset = pixels.distance, pixels.light, table.offset
    height, width = z.shape
    channels, kinds, near = out.shape[2], len(pixels.depth_of), len(offset)
    share = np.empty(kinds)
    for n in range(len(chosen)):
        y, x = chosen[n] // width, chosen[n] % width
        this, sums = z[y, x], out[n]
        for yy in range(max(y - reach, 0), min(y + reach + 1, height)):
            for xx in range(max(x - reach, 0), min(x + reach + 1, width)):
                dy, dx = abs(yy - y), abs(xx - x)
                o = offset[dy, dx] if dy < near and dx < near else -1
                distance = math.sqrt(float(dy * dy + dx * dx))
                along = math.log(distance) / table.step if o < 0 else 0.0
                if z[yy, xx] < this:
                    _shares(pixels, yy, xx, distance, along, o, table, share)
                    for k in range(kinds):
                        for c in range(k, channels, kinds):
                            sums[NEAR, c] += share[k] * light[yy, xx, channels + c]
                        sums[SHARE, k] += share[k] * light[yy, xx, 2 * channels + k]
                    if remainder:
                        _shares(pixels, y, x, distance, along, o, table, share)
                        for k in range(kinds):
                            sums[REST, k] += share[k]
                else:
                    _shares(pixels, y, x, distance, along, o, table, share)
                    for k in range(kinds):
                        for c in range(k, channels, kinds):
                            sums[FAR, c] += share[k] * light[yy, xx, c]
                        sums[MET, k] += share[k]
