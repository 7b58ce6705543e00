"""Procedural realisations: how many particles a cell of a lattice has, and where they are, from a hash of its indices.

Nothing is stored, any thread gets the same answer, and a lattice has no end.  The count of a cell is Poisson, places are uniform
in it, so that the particles of any set of cells are a Poisson process.
"""

import math

import numpy as np

from bakery.physics.packing.instances import hashed
from bakery.system.compiled import njit

MOST = 64  # particles in one cell: beyond, the chance is below 1e-18 for means up to 16
LARGEST_MEAN = 16.0
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_X, _Y = np.uint64(0xD1B54A32D192ED03), np.uint64(0xAEF17502108EF2D9)
_SHORT, _MASK = np.uint64(21), np.uint64((1 << 21) - 1)
_UNIT21, _UNIT32 = 2.0**-21, 2.0**-32


def counts(mean):
    """Cumulated Poisson probabilities (MOST,) of 0, 1, 2, ... particles in a cell; the last is 1.

    mean : expected number in a cell, 0 to `LARGEST_MEAN`
    """
    if not 0 <= mean <= LARGEST_MEAN:
        raise ValueError(f"a mean of {mean:g} particles a cell; 0 to {LARGEST_MEAN:g} is possible")
    term, total = math.exp(-mean), []
    for n in range(MOST):
        total.append(term + (total[-1] if total else 0.0))
        term *= mean / (n + 1)
    return np.minimum(np.array([*total[:-1], 1.0]), 1.0)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def cell_hash(key, i, j, k):
    """Hash (uint64) of cell (i, j, k), int64 each, in the lattice of a key, uint64."""
    h = hashed(key + np.uint64(i) * _X + np.uint64(j) * _Y)
    return hashed((h ^ np.uint64(k)) + _GOLDEN)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def cell_count(h, cumulated):
    """Number of particles in the cell with hash h; `cumulated` from `counts`."""
    u = ((h >> np.uint64(11)) + 0.5) * 2.0**-53
    n = 0
    while u >= cumulated[n]:
        n += 1
    return n


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def cell_particle(h, n):
    """Particle n of the cell with hash h: place in the cell (0 to 1, three), and two more uniform numbers in (0, 1)."""
    a = hashed(h + np.uint64(2 * n + 1) * _GOLDEN)
    b = hashed(h + np.uint64(2 * n + 2) * _GOLDEN)
    x = ((a & _MASK) + 0.5) * _UNIT21
    y = (((a >> _SHORT) & _MASK) + 0.5) * _UNIT21
    z = (((a >> np.uint64(42)) & _MASK) + 0.5) * _UNIT21
    return x, y, z, ((b >> np.uint64(32)) + 0.5) * _UNIT32, ((b & np.uint64(0xFFFFFFFF)) + 0.5) * _UNIT32
