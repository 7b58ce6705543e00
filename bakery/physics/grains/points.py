"""Low-discrepancy points in four dimensions: Sobol's sequence, scrambled at random and independently for each replicate.

Scrambling is linear (Matousek 1998) with a digital shift: each point is uniform, so means are unbiased, and the spread of the
means of independent replicates is their error.  Direction numbers: Joe & Kuo 2008.
"""

from functools import cache

import numpy as np

from bakery.system.compiled import njit

DIMENSIONS, BITS = 4, 32
_PRIMITIVE = ((0, 0, ()), (1, 0, (1,)), (2, 1, (1, 3)), (3, 1, (1, 3, 1)))  # degree, coefficients, first direction numbers
_PLACE = np.arange(BITS, dtype=np.uint64)[::-1]  # of digit 0, 1, ... in the word


def directions():
    """Direction numbers (4, 32) uint64, the first digit of a point in bit 31."""
    table = np.zeros((DIMENSIONS, BITS), np.uint64)
    for row, (degree, coefficients, first) in zip(table, _PRIMITIVE):
        v = [(first[k] if degree else 1) << (31 - k) for k in range(degree or BITS)]
        for k in range(len(v), BITS):
            new = v[k - degree] ^ (v[k - degree] >> degree)
            for j in range(1, degree):
                if coefficients >> (degree - 1 - j) & 1:
                    new ^= v[k - j]
            v.append(new)
        row[:] = v
    return table


@cache
def _digits():
    """Digits (4, 32, 32) of the direction numbers, 0.0 or 1.0: [d, k, bit] is digit k, the first of which is in bit 31."""
    return (directions()[:, None, :] >> _PLACE[:, None] & np.uint64(1)).astype(float)


def scrambled(rng):
    """Direction numbers (4, 32) and shifts (4,) of one replicate, from a numpy Generator."""
    shift = rng.integers(0, 1 << 32, DIMENSIONS, np.uint64)
    lower = np.tril([rng.integers(0, 2, (BITS, BITS)) for _ in range(DIMENSIONS)], -1) + np.eye(BITS)
    mixed = (lower @ _digits()).astype(np.uint64) & np.uint64(1)  # sums of at most 32 ones: exact
    return (mixed << _PLACE[:, None]).sum(1, dtype=np.uint64), shift


@njit(cache=True, nogil=True, error_model="numpy")
def points(table, shift, first, count):
    """Points first ... first + count - 1 of the sequence, (count, 4), strictly between 0 and 1."""
    out, word = np.empty((count, DIMENSIONS)), np.empty(DIMENSIONS, np.uint64)
    for i in range(count):
        index = np.uint64(first + i)
        gray, bit = index ^ (index >> np.uint64(1)), 0
        for d in range(DIMENSIONS):  # not at once: numba compiles two seconds of checks of shapes for that
            word[d] = shift[d]
        while gray:
            if gray & np.uint64(1):
                for d in range(DIMENSIONS):
                    word[d] ^= table[d, bit]
            gray >>= np.uint64(1)
            bit += 1
        for d in range(DIMENSIONS):
            out[i, d] = (word[d] + 0.5) * 2.0**-BITS
    return out
