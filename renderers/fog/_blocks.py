"""A picture as blocks of 2, 4, 8 ... pixels, and points between blocks.

An entry is what one block holds of one class of distances: sums over its pixels, then means.  The points stand at the corners of
the blocks; each has one entry of every class that the four blocks around it hold.

`mask` (h, w) has a bit for each class of a block or point, `start` (h w + 1,) is where their entries begin, in the order of the
classes.
"""

import math
from typing import NamedTuple

import numpy as np

from bakery.system.compiled import njit
from renderers.fog._lanes import LANES

# columns of an entry: pixels, brightness and its centre, distances (smallest, largest, pixels at those two, mean, how the others
# lie between: see `_finish`), indices on log column and on log of pixel over lever with the weight of those two; from FIRST on
# col, pixels, light sent and its share, for LANES channels each
COUNT, GLOW, Y, X, NEAREST, FARTHEST, AT_NEAREST, AT_FARTHEST, DISTANCE, BETWEEN, COLUMN, LEVER, WEIGHT, FIRST = range(14)
LIGHT = 4 * LANES
SENT, ENTRY = FIRST + 2 * LANES, FIRST + LIGHT


class Pixels(NamedTuple):
    """Of a picture.

    distance : (H, W) m
    column, lever : (H, W) 1, indices on log tau of sigma_t = 1 and on log u;  u : (H, W) 1, pixel over lever
    glow : (H, W), brightness that a block is centred by, above 0: without that a lamp's halo is not round
    weight : (H, W), share that is scattered
    light : (H, W, LIGHT), as the tail of an entry
    """

    distance: np.ndarray
    column: np.ndarray
    lever: np.ndarray
    u: np.ndarray
    glow: np.ndarray
    weight: np.ndarray
    light: np.ndarray


class Blocks(NamedTuple):
    """mask : (h, w);  start : (h w + 1,);  entries : (E, ENTRY)"""

    mask: np.ndarray
    start: np.ndarray
    entries: np.ndarray


class Targets(NamedTuple):
    """Where sums are wanted: pixels, or points.

    mask, start : see above
    y, x : (N,) pixels from the picture's corner
    distance, column, lever : (N,) as of `Pixels`
    """

    mask: np.ndarray
    start: np.ndarray
    y: np.ndarray
    x: np.ndarray
    distance: np.ndarray
    column: np.ndarray
    lever: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def number_of(bits):
    """How many bits are 1."""
    bits = bits - ((bits >> 1) & 0x55555555)
    bits = (bits & 0x33333333) + ((bits >> 2) & 0x33333333)
    return (((bits + (bits >> 4)) & 0x0F0F0F0F) * 0x01010101 & 0xFFFFFFFF) >> 24


@njit(cache=True, nogil=True, error_model="numpy")
def starts(mask):
    """(h w + 1,) of a mask (h, w)."""
    bits = mask.reshape(-1)
    start = np.zeros(len(bits) + 1, np.int64)
    for n in range(len(bits)):
        start[n + 1] = start[n] + number_of(bits[n])
    return start


@njit(cache=True, nogil=True, error_model="numpy")
def merged_mask(mask):
    """Of blocks of two by two."""
    height, width = mask.shape
    classes = np.zeros(((height + 1) // 2, (width + 1) // 2), np.int64)
    for y in range(height):
        for x in range(width):
            classes[y // 2, x // 2] |= mask[y, x]
    return classes


@njit(cache=True, nogil=True, error_model="numpy")
def corner_mask(mask):
    """Of the points between blocks, (h + 1, w + 1)."""
    height, width = mask.shape
    classes = np.zeros((height + 1, width + 1), np.int64)
    for y in range(height):
        for x in range(width):
            for yy in range(y, y + 2):
                for xx in range(x, x + 2):
                    classes[yy, xx] |= mask[y, x]
    return classes


@njit(cache=True, nogil=True, error_model="numpy")
def _cleared(entry):
    for c in range(ENTRY):
        entry[c] = 0
    entry[NEAREST] = math.inf


@njit(cache=True, nogil=True, error_model="numpy")
def _add(entry, total):
    """Sums of a block from the means of a part of it."""
    if entry[NEAREST] < total[NEAREST]:
        total[NEAREST], total[AT_NEAREST] = entry[NEAREST], 0
    if entry[FARTHEST] > total[FARTHEST]:
        total[FARTHEST], total[AT_FARTHEST] = entry[FARTHEST], 0
    total[AT_NEAREST] += entry[AT_NEAREST] if entry[NEAREST] == total[NEAREST] else 0
    total[AT_FARTHEST] += entry[AT_FARTHEST] if entry[FARTHEST] == total[FARTHEST] else 0
    total[COUNT] += entry[COUNT]
    total[DISTANCE] += entry[COUNT] * entry[DISTANCE]
    total[GLOW] += entry[GLOW]
    total[Y] += entry[GLOW] * entry[Y]
    total[X] += entry[GLOW] * entry[X]
    total[WEIGHT] += entry[WEIGHT]
    total[COLUMN] += entry[WEIGHT] * entry[COLUMN]
    total[LEVER] += entry[WEIGHT] * entry[LEVER]
    for c in range(FIRST, ENTRY):
        total[c] += entry[c]


@njit(cache=True, nogil=True, error_model="numpy")
def _finish(total):
    """Means from sums.

    Of the pixels between the nearest and the farthest distance the share that is nearer than a fraction t of the way goes with
    t^BETWEEN, which has their mean.  Those at the two ends are counted apart: a wall that faces the camera is one distance.
    """
    number, span = total[COUNT], total[FARTHEST] - total[NEAREST]
    between = number - total[AT_NEAREST] - total[AT_FARTHEST]
    if between > 0.5:
        mean = (total[DISTANCE] - total[NEAREST] * number - total[AT_FARTHEST] * span) / (between * span)
        mean = min(max(mean, 1e-3), 1 - 1e-3)
        total[BETWEEN] = mean / (1 - mean)
    total[DISTANCE] /= number
    total[Y] /= total[GLOW]
    total[X] /= total[GLOW]
    if total[WEIGHT] > 0:
        total[COLUMN] /= total[WEIGHT]
        total[LEVER] /= total[WEIGHT]


@njit(cache=True, nogil=True, error_model="numpy")
def _pixel(pixels, y, x, entry):
    """A pixel as an entry."""
    entry[COUNT] = entry[AT_NEAREST] = entry[AT_FARTHEST] = 1
    entry[Y], entry[X] = y + 0.5, x + 0.5
    entry[GLOW], entry[WEIGHT] = pixels.glow[y, x], pixels.weight[y, x]
    entry[NEAREST] = entry[FARTHEST] = entry[DISTANCE] = pixels.distance[y, x]
    entry[COLUMN], entry[LEVER] = pixels.column[y, x], pixels.lever[y, x]
    for c in range(LIGHT):
        entry[FIRST + c] = pixels.light[y, x, c]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _clear_block(out, block):
    """Entries of a block of out (Blocks), emptied."""
    for n in range(out.start[block], out.start[block + 1]):
        _cleared(out.entries[n])


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _finish_block(out, block):
    """Entries of a block of out (Blocks), from sums to means."""
    for n in range(out.start[block], out.start[block + 1]):
        _finish(out.entries[n])


@njit(cache=True, nogil=True, error_model="numpy")
def first_rows(low, high, pixels, mask, out):
    """Entries of blocks of two by two pixels, rows low to high, into out (Blocks); mask is of the pixels."""
    height, width = mask.shape
    entry = np.zeros(ENTRY)
    for y in range(low, high):
        for x in range(out.mask.shape[1]):
            block, bits = y * out.mask.shape[1] + x, out.mask[y, x]
            at = out.start[block]
            _clear_block(out, block)
            for yy in range(2 * y, min(2 * y + 2, height)):
                for xx in range(2 * x, min(2 * x + 2, width)):
                    _pixel(pixels, yy, xx, entry)
                    _add(entry, out.entries[at + number_of(bits & (mask[yy, xx] - 1))])
            _finish_block(out, block)


@njit(cache=True, nogil=True, error_model="numpy")
def merge_rows(low, high, below, out):
    """Entries of blocks, rows low to high, into out (Blocks) from those of the four blocks of half their size."""
    height, width = below.mask.shape
    for y in range(low, high):
        for x in range(out.mask.shape[1]):
            block, bits = y * out.mask.shape[1] + x, out.mask[y, x]
            at = out.start[block]
            _clear_block(out, block)
            for yy in range(2 * y, min(2 * y + 2, height)):
                for xx in range(2 * x, min(2 * x + 2, width)):
                    n, part = below.start[yy * width + xx], below.mask[yy, xx]
                    while part:
                        _add(below.entries[n], out.entries[at + number_of(bits & ((part & -part) - 1))])
                        part &= part - 1
                        n += 1
            _finish_block(out, block)


@njit(cache=True, nogil=True, error_model="numpy")
def corner_rows(low, high, blocks, side, out):
    """Points at the corners of blocks of `side` pixels, rows low to high, into out (Targets)."""
    height, width = blocks.mask.shape
    for y in range(low, high):
        for x in range(width + 1):
            n, bits = out.start[y * (width + 1) + x], out.mask[y, x]
            while bits:
                bit = bits & -bits
                bits &= bits - 1
                number = weight = distance = column = lever = farthest = 0.0
                nearest = math.inf
                for yy in range(max(y - 1, 0), min(y + 1, height)):
                    for xx in range(max(x - 1, 0), min(x + 1, width)):
                        part = blocks.mask[yy, xx]
                        if part & bit:
                            entry = blocks.entries[blocks.start[yy * width + xx] + number_of(part & (bit - 1))]
                            number += entry[COUNT]
                            distance += entry[COUNT] * entry[DISTANCE]
                            nearest, farthest = min(nearest, entry[NEAREST]), max(farthest, entry[FARTHEST])
                            weight += entry[WEIGHT]
                            column += entry[WEIGHT] * entry[COLUMN]
                            lever += entry[WEIGHT] * entry[LEVER]
                out.y[n], out.x[n] = y * side, x * side
                out.distance[n] = min(max(distance / number, nearest), farthest)  # one distance stays just that
                out.column[n], out.lever[n] = (column / weight, lever / weight) if weight > 0 else (0.0, 0.0)
                n += 1
