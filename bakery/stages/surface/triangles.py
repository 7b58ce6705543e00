"""Symmetric matrices as their upper triangles, and rounded ones as integers, which pack better."""

import numpy as np


def packed(orders, most: int) -> np.ndarray:
    """(most, P) upper triangles of symmetric matrices (M, N, N), in double precision; orders behind M are 0."""
    row, column = np.triu_indices(orders.shape[1])
    result = np.zeros((most, len(row)))
    result[:len(orders)] = orders[:, row, column]
    return result


def whole(orders, most: int) -> np.ndarray:
    """(most, N N) rows of matrices (M, N, N); orders behind M are 0."""
    result = np.zeros((most, orders.shape[1] * orders.shape[2]))
    result[:len(orders)] = orders.reshape(len(orders), -1)
    return result


def unpacked(triangles, count: int) -> np.ndarray:
    """(M, N, N) from upper triangles (M, P)."""
    row, column = np.triu_indices(count)
    result = np.empty((len(triangles), count, count))
    result[:, row, column] = result[:, column, row] = triangles
    return result


# ---- integers

KINDS = slice(0, 1), slice(1, None, 2), slice(2, None, 2)  # of orders: each has steps of its own, `surfaces.rounding`
_DIGITS = 24  # binary, of single precision
_MOST = 2**31


def integers(orders) -> tuple[np.ndarray, np.ndarray] | None:
    """Numbers of single precision as integers times powers of two, one power for each pair of directions and of `KINDS`.

    Parameters
    ----------
    orders : (..., M, P) Fourier orders

    Returns
    -------
    multiples : (..., M, P) int32
    exponents : (..., 3, P) int8; None where the numbers have no such common steps, as they are not rounded
    """
    multiples = np.empty(orders.shape, np.int32)
    exponents = np.zeros((*orders.shape[:-2], len(KINDS), orders.shape[-1]), np.int8)
    for kind, rows in enumerate(KINDS):
        values = np.asarray(orders[..., rows, :], np.float32).astype(float)
        mantissa, exponent = np.frexp(values)
        digits = np.round(np.ldexp(mantissa, _DIGITS)).astype(np.int64)
        last = exponent - _DIGITS
        if kind:  # order 0 is not rounded
            last += np.log2(np.maximum(digits & -digits, 1)).astype(int)
        least = np.where(digits == 0, 1000, last).min(axis=-2, initial=1000)
        least[least == 1000] = 0
        whole = np.ldexp(values, -least[..., None, :])
        if (np.abs(whole) >= _MOST).any() or (np.abs(least) > 127).any():
            return None
        multiples[..., rows, :], exponents[..., kind, :] = whole, least
    return multiples, exponents


def numbers(multiples, exponents) -> np.ndarray:
    """(..., M, P) what `integers` took."""
    values = np.array(multiples, float)
    for kind, rows in enumerate(KINDS):
        values[..., rows, :] = np.ldexp(values[..., rows, :], np.asarray(exponents[..., kind, :], int)[..., None, :])
    return values
