"""Products of matrices as loops of our own: BLAS may add in another order on another number of threads."""

from __future__ import annotations

import numpy as np

from bakery.system.compiled import njit


@njit(cache=True, nogil=True, error_model="numpy")
def add_four(factors, rows, first, step, count, out):
    """For i = 0 .. 3: out[i] += sum over n < count of factors[i, n] rows[first + step n], two at a time.

    Parameters
    ----------
    factors : (4, >= count)
    rows : (.., A), out : (4, A)

    Notes
    -----
    A sum for four rows loads every other row once: 16e9 products a second in double precision where one row makes 8e9.
    """
    # unsigned: an index that may count from the end keeps compilers from making vectors
    A = np.uintp(rows.shape[1])
    rows, out = rows.reshape(-1), out.reshape(-1)
    second, third, fourth = A, A + A, A + A + A
    whole = count - count % 2
    for n in range(0, whole, 2):
        a0, a1, a2, a3 = factors[0, n], factors[1, n], factors[2, n], factors[3, n]
        b0, b1, b2, b3 = factors[0, n + 1], factors[1, n + 1], factors[2, n + 1], factors[3, n + 1]
        at = np.uintp(first + step * n) * A
        after = at + np.uintp(step) * A
        for a in range(A):
            r, s = rows[at + a], rows[after + a]
            out[a] += a0 * r + b0 * s
            out[second + a] += a1 * r + b1 * s
            out[third + a] += a2 * r + b2 * s
            out[fourth + a] += a3 * r + b3 * s
    if count > whole:
        a0, a1, a2, a3 = factors[0, whole], factors[1, whole], factors[2, whole], factors[3, whole]
        at = np.uintp(first + step * whole) * A
        for a in range(A):
            r = rows[at + a]
            out[a] += a0 * r
            out[second + a] += a1 * r
            out[third + a] += a2 * r
            out[fourth + a] += a3 * r


@njit(cache=True, nogil=True, error_model="numpy")
def product(left, right):
    """left (N, K) times right (K, D); a row of it does not depend on the other rows."""
    N, K = left.shape
    D = right.shape[1]
    out, spare = np.zeros((N, D)), np.zeros((4, D))
    factors = np.zeros((4, K))
    for n in range(0, N, 4):
        rows = min(4, N - n)
        for i in range(rows):
            factors[i] = left[n + i]
        if rows == 4:
            add_four(factors, right, 0, 1, K, out[n:n + 4])
        else:
            add_four(factors, right, 0, 1, K, spare)
            out[n:] = spare[:rows]
    return out
