"""Realisations laid out for compiled loops: particles by size, each size in a lattice of cells of its own.

Particles of like discs share a level.  Its cells hold one or two particles, so that large particles, which are few and reach far,
do not make every pencil look through the cells of the small ones far from its way.
"""

import math
from typing import NamedTuple

import numpy as np

from bakery.physics.discrete import hashing
from bakery.physics.discrete.region import Region
from bakery.system.compiled import njit

PER_CELL = 1.5  # particles; 1 to 2 take the same time, as `make figures-discrete CLAIM=fig17` measures
_BITS = 2
BLOCK = 1 << _BITS  # cells along the edge of what lies together in memory: a pencil finds its next cells in the cache
_BEGIN = 20.0  # cells that take as long as beginning with a level
_MOST_CELLS = 1 << 40  # of a procedural level, so that indices stay exact


class Discs(NamedTuple):
    """Discs that stop pencils; G levels, K classes in ascending order of levels, N particles.

    region : where particles are
    stored : 1 where places are stored, 0 where they come from hashes
    key : (G,) uint64, of each procedural level
    step : (G, 3) m, edges of the cells;  cells : (G, 3) how many of them the region's box has
    reach : (G,) m, radius of the largest disc at any wavelength
    shift : (G, 3) m, by which the level has moved; what leaves a stored box on one side comes in on the other
    classes : (G + 1,) which classes are a level's
    offset : (sum of cells + G,) uint32, first particle of each cell (`cell_index`), level after level
    start : (G,) where a level begins in it
    place : (N, 3) float32 m, from region.lo;  kind : (N,) uint16, class
    counts : (G, MOST) cumulated probabilities of numbers in a cell;  cumulated : (K,) cumulated shares within the level
    square : (K, L) m^2, squared radii of the discs;  largest : (K,) of all wavelengths
    """

    region: Region
    stored: int
    key: np.ndarray
    step: np.ndarray
    cells: np.ndarray
    reach: np.ndarray
    shift: np.ndarray
    classes: np.ndarray
    offset: np.ndarray
    start: np.ndarray
    place: np.ndarray
    kind: np.ndarray
    counts: np.ndarray
    cumulated: np.ndarray
    square: np.ndarray
    largest: np.ndarray


def disc_order(extinction):
    """Classes from large discs to small ones, (K,): the order in which `stored` and `procedural` take them.

    extinction : (L, K) m^2
    """
    return np.argsort(-np.max(extinction, axis=0), kind="stable")


def stored_discs(region, extinction, position, kind, velocity=None, time=0.0, per_cell=PER_CELL) -> Discs:
    """Particles at given places.

    Parameters
    ----------
    region : `Region`; places outside of its box count as on its walls
    extinction : (L, K) m^2, cross sections of the classes' discs, in the order of `disc_order`
    position : (N, 3) m
    kind : (N,) class of each
    velocity : (K, 3) m/s, equal within a level's classes or None
    time : s
    per_cell : particles a cell aims at
    """
    largest = np.max(extinction, axis=0)
    numbers = np.bincount(kind, minlength=len(largest)).astype(float)
    extent = region.hi - region.lo
    classes = _levels(largest, numbers, extent, per_cell, velocity)
    levels = [_lattice(extent, numbers[a:b].sum(), math.sqrt(largest[a:b].max() / math.pi), per_cell)
              for a, b in _pairs(classes)]
    cells = np.array(levels, np.int64).reshape(-1, 3)
    start = np.concatenate([[0], np.cumsum((-(-cells // BLOCK) * BLOCK).prod(axis=1) + 1)])
    level = np.repeat(np.arange(len(cells)), np.diff(classes))
    offset = np.zeros(start[-1], np.uint32)
    sorted_place, sorted_kind = np.empty((len(kind), 3), np.float32), np.empty(len(kind), np.uint16)
    if len(kind):
        _sort(np.asarray(position), np.ascontiguousarray(kind, np.uint16), region.lo, extent, cells, level, start,
              (offset, sorted_place, sorted_kind))
    return _discs(region, np.zeros(len(cells), np.uint64), cells, extinction, classes, (velocity, time), stored=1, offset=offset,
                  start=start[:-1].astype(np.int64), place=sorted_place, kind=sorted_kind)


def procedural_discs(region, extinction, density, words, velocity=None, time=0.0, per_cell=PER_CELL) -> Discs:
    """A Poisson process from hashes.

    Parameters
    ----------
    region, extinction, velocity, time, per_cell : as in `stored`
    density : (K,) 1/m^3, of each class where the region is full
    words : (2,) of `bakery.rng.key`
    """
    density = np.asarray(density, float)
    extent = region.hi - region.lo
    largest = np.max(extinction, axis=0)
    classes = _levels(largest, density * extent.prod(), extent, per_cell, velocity)
    cells, counts, cumulated = [], [], np.ones(len(largest))
    for a, b in _pairs(classes):
        number = density[a:b].sum() * extent.prod()
        cells.append(_lattice(extent, number, math.sqrt(largest[a:b].max() / math.pi), per_cell))
        counts.append(hashing.counts(number / np.prod(np.array(cells[-1], float))))
        cumulated[a:b - 1] = np.cumsum(density[a:b - 1]) / max(density[a:b].sum(), 1e-300)
    key = np.uint64(words[0]) << np.uint64(32) | np.uint64(words[1])
    keys = np.array([(int(key) + 0x9E3779B97F4A7C15 * (level + 1)) % 2**64 for level in range(len(cells))], np.uint64)
    return _discs(region, keys, np.array(cells, np.int64).reshape(-1, 3), extinction, classes, (velocity, time), stored=0,
                  counts=np.array(counts).reshape(-1, hashing.MOST), cumulated=cumulated)


def _discs(region, key, cells, extinction, classes, motion, **particles) -> Discs:
    """Levels of so many cells; motion : velocity and time;  particles : fields of `Discs` that say where they are."""
    levels, square = len(cells), np.ascontiguousarray(np.transpose(extinction) / math.pi)
    largest = square.max(axis=1)
    reach = np.sqrt(np.maximum.reduceat(largest, classes[:-1])) if levels else np.zeros(0)
    velocity, time = motion
    shift = np.zeros((levels, 3)) if velocity is None else np.asarray(velocity, float)[classes[:-1]] * time
    nowhere = {"offset": np.zeros(0, np.uint32), "start": np.zeros(levels, np.int64), "place": np.zeros((0, 3), np.float32),
               "kind": np.zeros(0, np.uint16), "counts": np.ones((levels, hashing.MOST)), "cumulated": np.ones(len(largest))}
    return Discs(region=region, key=key, step=(region.hi - region.lo) / cells, cells=cells, reach=reach, shift=shift,
                 classes=classes, square=square, largest=largest, **(nowhere | particles))


def _pairs(classes):
    return zip(classes[:-1].tolist(), classes[1:].tolist())


def _levels(largest, numbers, extent, per_cell, velocity):
    """(G + 1,) classes at which levels begin: of equal velocities, and so that pencils meet the fewest cells and particles."""
    classes = len(largest)
    reach, total = np.sqrt(largest / math.pi), np.concatenate([[0.0], np.cumsum(numbers)])
    best, begin = np.full(classes + 1, np.inf), np.zeros(classes + 1, np.int64)
    best[0] = 0.0
    for k in range(1, classes + 1):
        first = k - 1
        while first > 0 and (velocity is None or np.array_equal(velocity[first - 1], velocity[k - 1])):
            first -= 1
        b = np.arange(first, k)
        effort = best[b] + _effort(total[k] - total[b], reach[b], extent, per_cell)
        begin[k], best[k] = b[np.argmin(effort)], effort.min()
    levels = [classes] if classes else [0]
    while levels[0] > 0:
        levels.insert(0, int(begin[levels[0]]))
    return np.array(levels, np.int64)


def _effort(number, reach, extent, per_cell):
    """Cells that a pencil through a box looks into, with their particles, where `number` of them reach as far as `reach`, m."""
    volume = extent.prod()
    edge = np.maximum((volume * per_cell / np.maximum(number, per_cell)) ** (1 / 3), reach / 2)
    # as many cells in a layer as a square of that width, at a slope, touches
    return _BEGIN + volume ** (1 / 3) / edge * (1.5 + 2 * reach / edge) ** 2 * (1 + number / volume * edge**3 / per_cell)


def _lattice(extent, number, reach, per_cell):
    """Cells (3,) along the box, with `per_cell` particles each, edges of at least half the largest disc's radius."""
    edge = max((extent.prod() * per_cell / max(number, per_cell)) ** (1 / 3), reach / 2, (extent.prod() / _MOST_CELLS) ** (1 / 3))
    # a flat box has one layer of cells, whose number is made up for in the other directions
    counts = np.maximum(1, np.round(extent / edge))
    while number / counts.prod() > min(4 * per_cell, hashing.LARGEST_MEAN) and (extent / counts).max() > reach:
        counts[np.argmax(extent / counts)] *= 2
    if number / counts.prod() > hashing.LARGEST_MEAN:
        counts = np.maximum(counts, np.ceil(counts * (number / counts.prod() / hashing.LARGEST_MEAN) ** (1 / 3)))
    return counts.astype(np.int64)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def cell_index(i, j, k, n1, n2):
    """Where cell (i, j, k) of a level with (., n1, n2) cells stands in memory: blocks of BLOCK^3 cells lie together."""
    s0, s1, s2 = block_steps(n1, n2)
    return along_axis(i, s0, 2 * _BITS) + along_axis(j, s1, _BITS) + along_axis(k, s2, 0)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def block_steps(n1, n2):
    """How far blocks that follow each other along each axis are apart in memory, in a level of (., n1, n2) cells."""
    b1, b2 = (n1 + BLOCK - 1) >> _BITS, (n2 + BLOCK - 1) >> _BITS
    return b1 * b2 * BLOCK**3, b2 * BLOCK**3, BLOCK**3


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def along_axis(i, step, bits):
    """What the number i >= 0 of a cell along an axis adds to `cell_index`; bits: 4, 2 and 0 for the three axes."""
    return (i >> _BITS) * step + ((i & (BLOCK - 1)) << bits)


@njit(cache=True, nogil=True, error_model="numpy")
def _sort(position, kind, lo, extent, cells, level, start, out):
    """Counting sort by level and cell.  out : offset, place and kind of `Discs`."""
    offset, sorted_place, sorted_kind = out
    n = len(kind)
    cell, at = np.empty(n, np.int64), np.empty(3, np.int64)
    for i in range(n):
        g = level[kind[i]]
        for axis in range(3):
            m = cells[g, axis]
            at[axis] = min(max(math.floor((position[i, axis] - lo[axis]) / extent[axis] * m), 0), m - 1)
        cell[i] = start[g] + cell_index(at[0], at[1], at[2], cells[g, 1], cells[g, 2])
        offset[cell[i]] += np.uint32(1)
    total = np.int64(0)
    for c in range(len(offset)):
        slot = np.int64(offset[c])
        offset[c] = np.uint32(total)
        total += slot
    # a level's last entry counts nothing: it ends where the next level's first begins
    for i in range(n):
        to = np.int64(offset[cell[i]])
        offset[cell[i]] += np.uint32(1)
        for axis in range(3):
            sorted_place[to, axis] = np.float32(position[i, axis] - lo[axis])
        sorted_kind[to] = kind[i]
    for c in range(len(offset) - 1, 0, -1):
        offset[c] = offset[c - 1]
    offset[0] = np.uint32(0)
