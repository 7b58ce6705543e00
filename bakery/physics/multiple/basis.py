"""Few functions whose weighted sums give the logarithms of many lobes: a principal component analysis with weights of its own
for every lobe.

A lobe f_n over directions d is exp(a_n0 + B_0d + sum over k of a_nk B_kd) times its integral.  Errors count relative to the norm
of the lobe: weights w_d (f^2/int f^2 + FAINT/4 pi), so that the least squares of logarithms are those of the lobes themselves,
with a little weight where they are dark.
"""

import numpy as np

from bakery.physics.multiple._products import product
from bakery.system.compiled import njit

FAINT = 0.003
ROUNDS = 2
_TOGETHER = 256  # lobes whose normal equations are made at a time


def weights(lobes, solid_angle):
    """Weights of the least squares (N, D) for lobes (N, D) > 0 and solid angles (D,)."""
    square = lobes**2
    return solid_angle * (square / (square * solid_angle).sum(axis=1, keepdims=True) + FAINT / (4 * np.pi))


def start(logs, weight, count):
    """Functions to begin with: the mean, then `count` times the lobe that is represented worst so far, less what is.

    logs : (N, D) with any constant added to each
    weight : (N, D)

    Returns (K + 1, D): B_0, then B_k with mean 0 and mean square 1, orthogonal to each other under the mean weight
    """
    overall = weight.sum(axis=0) / weight.sum()
    basis = np.zeros((count + 1, logs.shape[1]))
    level = (logs * weight).sum(axis=1, keepdims=True) / weight.sum(axis=1, keepdims=True)
    basis[0] = (logs - level).mean(axis=0)
    # under one weight for all lobes: what is found so far is orthogonal, and taken out exactly
    residual, square = np.ascontiguousarray((logs - basis[0]).T), np.empty(len(logs))
    _take_out(residual, overall, np.ones(len(overall)), square)
    for k in range(1, count + 1):
        basis[k] = residual[:, np.argmax(square)]
        _orthogonal(basis, overall, k)
        _take_out(residual, overall, basis[k], square)
    return basis


def improved(basis, logs, weight, rounds=ROUNDS):
    """A basis (K + 1, D) as `start` returns it after rounds of alternating weighted least squares."""
    overall = weight.sum(axis=0) / weight.sum()
    across = np.ascontiguousarray(weight.T)
    for _ in range(rounds if len(basis) > 1 else 0):
        a = coefficients(logs, weight, basis)
        b = solve(np.ascontiguousarray((logs - a[:, :1]).T), across, with_one(np.ascontiguousarray(a.T)))
        basis = np.ascontiguousarray(b.T)
        for k in range(1, len(basis)):
            _orthogonal(basis, overall, k)
    return basis


def solve(values, weight, regressors):
    """Weighted least squares of every row of values (N, D) on regressors (K, D): coefficients (N, K)."""
    out = np.empty((len(values), len(regressors)))
    x = np.ascontiguousarray(regressors.T)
    lower = np.tril_indices(len(regressors))
    pairs = np.ascontiguousarray((regressors[lower[0]] * regressors[lower[1]]).T)
    for n in range(0, len(values), _TOGETHER):  # a block of products of values and weights at a time
        of = slice(n, n + _TOGETHER)
        block = np.ascontiguousarray(weight[of])
        _solve(product(block, pairs), product(block * values[of], x), out[of])
    return out


def coefficients(logs, weight, basis):
    """a_0 .. a_K of lobes, (N, K + 1), in a basis (K + 1, D)."""
    return solve(logs - basis[0], weight, with_one(basis))


def combine(a, functions):
    """Sum over k of a (N, K) times functions (K, D)."""
    return product(np.ascontiguousarray(a), np.ascontiguousarray(functions))


def distance(logs, a, weight, basis):
    """Norm (N,) of logs (N, D) less their representation by a (N, K + 1): the relative error of lobes, for small ones."""
    return np.sqrt((weight * (logs - combine(a, with_one(basis))) ** 2).sum(axis=1))


def with_one(basis):
    """The basis with 1 in place of its mean."""
    regressors = basis.copy()
    regressors[0] = 1.0
    return regressors


def _orthogonal(basis, overall, k):
    """Takes the mean and the functions before it out of function k, and scales it to mean square 1."""
    for _ in range(2):  # twice is enough
        basis[k] -= (overall * basis[k]).sum()
        for j in range(1, k):
            basis[k] -= (overall * basis[k] * basis[j]).sum() * basis[j]
    norm = np.sqrt((overall * basis[k]**2).sum())
    basis[k] = basis[k] / norm if norm > 1e-12 else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _take_out(residual, weight, function, square):
    """Takes a function (D,) of mean square 1 out of residual (D, N), and sets the mean squares (N,) of what is left."""
    share = np.zeros(residual.shape[1])
    for d in range(len(residual)):
        factor, row = weight[d] * function[d], residual[d]
        for n in range(len(share)):
            share[n] += factor * row[n]
    square[:] = 0.0
    for d in range(len(residual)):
        value, of, row = function[d], weight[d], residual[d]
        for n in range(len(share)):
            row[n] -= share[n] * value
            square[n] += of * row[n] * row[n]


@njit(cache=True, nogil=True, error_model="numpy")
def _solve(grams, rights, out):
    """Cholesky of normal equations, lower triangles (N, K (K + 1)/2) and right sides (N, K), into out (N, K).

    A regressor that adds nothing gets coefficient 0.
    """
    N, K = rights.shape
    gram = np.empty((K, K))
    for n in range(N):
        at, right = 0, rights[n]
        for i in range(K):
            for j in range(i + 1):
                gram[i, j] = grams[n, at]
                at += 1
        for i in range(K):
            least = 1e-11 * gram[i, i]
            for j in range(i):
                total = gram[i, j]
                for k in range(j):
                    total -= gram[i, k] * gram[j, k]
                gram[i, j] = total / gram[j, j] if gram[j, j] > 0 else 0.0
            total = gram[i, i]
            for k in range(i):
                total -= gram[i, k] ** 2
            gram[i, i] = np.sqrt(total) if total > least else 0.0
        for i in range(K):
            total = right[i]
            for k in range(i):
                total -= gram[i, k] * out[n, k]
            out[n, i] = total / gram[i, i] if gram[i, i] > 0 else 0.0
        for i in range(K - 1, -1, -1):
            total = out[n, i]
            for k in range(i + 1, K):
                total -= gram[k, i] * out[n, k]
            out[n, i] = total / gram[i, i] if gram[i, i] > 0 else 0.0
