"""Symmetric matrices as their upper triangles."""

from __future__ import annotations

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
