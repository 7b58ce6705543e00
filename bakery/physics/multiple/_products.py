"""Products of matrices as loops of our own: BLAS may add in another order on another number of threads."""

import numpy as np

from bakery.physics.multiple._tiles import (
    LANES,
    ROWS,
    TALL,
    VECTORS,
    flat_tile,
    least_tile,
    narrow_tile,
    tall_tile,
    whole_tile,
)
from bakery.system.compiled import njit

_WIDE = LANES * VECTORS


@njit(cache=True, nogil=True, error_model="numpy")
def multiply(factors, lines, out, rows, columns, count):
    """A product of matrices anywhere in arrays.

    For i < rows and a < columns: out[to + below i + a] = sum over n < count of
    factors[first + row i + step n] lines[at + line n + a].

    factors : array, first, row, step
    lines : array, at, line
    out : array, to, below; all three arrays contiguous, of one type, places counted in numbers

    Terms are added in the order of n, from 0 on.  Tiles at the edges overlap their neighbours: what is set twice is the same.
    """
    b, at, line = lines
    c, to, below = out
    column = 0
    while column + _WIDE <= columns:
        _wide(factors, (b, at + column, line), (c, to + column, below), rows, count)
        column += _WIDE
    while column < columns:
        column = min(column, columns - LANES)
        if column < 0:
            _plain(factors, lines, out, rows, columns, count)
            return
        _single(factors, (b, at + column, line), (c, to + column, below), rows, count)
        column += LANES


@njit(nogil=True, error_model="numpy", forceinline=True)
def _wide(factors, lines, out, rows, count):
    """`multiply` for the columns of two vectors."""
    (a, first, row, step), (c, to, below) = factors, out
    if rows < ROWS:
        for i in range(rows):
            flat_tile((a, first + row * i, row, step), lines, (c, to + below * i, below), count)
        return
    for i in range(0, rows, ROWS):
        i = min(i, rows - ROWS)
        whole_tile((a, first + row * i, row, step), lines, (c, to + below * i, below), count)


@njit(nogil=True, error_model="numpy", forceinline=True)
def _single(factors, lines, out, rows, count):
    """`multiply` for the columns of a vector."""
    (a, first, row, step), (c, to, below) = factors, out
    if rows < ROWS:
        for i in range(rows):
            least_tile((a, first + row * i, row, step), lines, (c, to + below * i, below), count)
        return
    if rows < TALL:
        for i in range(0, rows, ROWS):
            i = min(i, rows - ROWS)
            narrow_tile((a, first + row * i, row, step), lines, (c, to + below * i, below), count)
        return
    for i in range(0, rows, TALL):
        i = min(i, rows - TALL)
        tall_tile((a, first + row * i, row, step), lines, (c, to + below * i, below), count)


@njit(cache=True, nogil=True, error_model="numpy")
def _plain(factors, lines, out, rows, columns, count):
    """`multiply` for less than a vector of columns."""
    a, first, row, step = factors
    b, at, line = lines
    c, to, below = out
    a, b, c = a.reshape(-1), b.reshape(-1), c.reshape(-1)
    for i in range(rows):
        for n in range(columns):
            c[to + below * i + n] = 0
        for k in range(count):
            factor = a[first + row * i + step * k]
            for n in range(columns):
                c[to + below * i + n] += factor * b[at + line * k + n]


@njit(cache=True, nogil=True, error_model="numpy")
def product(factors, lines):
    """factors (N, K) times lines (K, D); a row of it does not depend on the other rows."""
    (N, K), D = factors.shape, lines.shape[1]
    out = np.empty((N, D))
    multiply((factors, 0, K, 1), (lines, 0, D), (out, 0, D), N, D, K)
    return out
