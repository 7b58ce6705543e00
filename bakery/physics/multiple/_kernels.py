"""Transport in Fourier space, and back to space: the loops of `fourier`.

Streaming is tridiagonal in the order l for each azimuthal order M about the wave vector, scattering is diagonal.  Arrays over
the wave number k are contiguous: every loop over k is a vector instruction.  Operators that are symmetric in (l, l') are packed:
for l' = 0, 1, ... and l <= l' and m <= l, element `packed(l', l, m)`.
"""

import math

import numpy as np

from bakery.physics.multiple._products import multiply
from bakery.system.compiled import njit

_LEVELS = 400  # above the last one, where the infinite chain of streaming is started
_HUGE = 1e150
_NONE = 1e-20  # of the largest value of a transform: next to its rounding, nothing


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def packed(j, l, m):
    return j * (j + 1) * (j + 2) // 6 + l * (l + 1) // 2 + m


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def coupling(l, M):
    """Square of the coupling of l - 1 and l by the cosine: (l^2 - M^2) / (4 l^2 - 1)."""
    return (l * l - M * M) / (4.0 * l * l - 1.0)


@njit(cache=True, nogil=True, error_model="numpy")
def pivots(k, c, M):
    """Of 1 - c + k B for azimuthal order M, rows l = M .. L (the others of the arrays are not used).

    Parameters
    ----------
    k : (N,) wave numbers
    c : (L + 1,) albedo p_l; 0 for streaming alone

    Returns
    -------
    up : (L + 1, N) pivots of an elimination that starts at l = M
    down : (L + 1, N) of one that starts at infinity

    Notes
    -----
    All are sums of positive terms.  Above L nothing scatters; the chain down to L + 1 starts `_LEVELS` higher at its local
    fixed point, where the error is of the order M^2 / l^4.
    """
    L, N = len(c) - 1, len(k)
    up, down = np.empty((L + 1, N)), np.empty((L + 1, N))
    top = L + 1 + _LEVELS + M
    tail = np.empty(N)
    for i in range(N):
        tail[i] = 0.5 * (1 + math.sqrt(1 + 4 * k[i] ** 2 * coupling(top + 0.5, M)))
    for l in range(top - 1, L, -1):
        a = coupling(l + 1, M)
        for i in range(N):
            tail[i] = 1 + k[i] ** 2 * a / tail[i]
    for l in range(L, M - 1, -1):
        a = coupling(l + 1, M)
        for i in range(N):
            down[l, i] = 1 - c[l] + k[i] ** 2 * a / (tail[i] if l == L else down[l + 1, i])
    for i in range(N):
        up[M, i] = 1 - c[M]
    for l in range(M + 1, L + 1):
        a = coupling(l, M)
        for i in range(N):
            up[l, i] = 1 - c[l] + k[i] ** 2 * a / up[l - 1, i]
    return up, down


@njit(cache=True, nogil=True, error_model="numpy")
def solve(k, down, M, x):
    """Solves (1 - c + k B) y = x in place, rows M .. L, eliminating from above: 1 - c_0 may be 0."""
    L, N = x.shape[0] - 1, len(k)
    for l in range(L - 1, M - 1, -1):
        a = math.sqrt(coupling(l + 1, M))
        for i in range(N):
            x[l, i] += k[i] * a * x[l + 1, i] / down[l + 1, i]
    for i in range(N):
        x[M, i] /= down[M, i]
    for l in range(M + 1, L + 1):
        a = math.sqrt(coupling(l, M))
        for i in range(N):
            x[l, i] = (x[l, i] - k[i] * a * x[l - 1, i]) / down[l, i]


@njit(cache=True, nogil=True, error_model="numpy")
def streaming(k, up, down, M, j, uncounted, x):
    """Column j of (1 - uncounted + k B)^-1, rows M .. L, into x; uncounted : its element j."""
    L, N = x.shape[0] - 1, len(k)
    for i in range(N):
        x[j, i] = 1 / (up[j, i] + down[j, i] - (1 - uncounted))
    for l in range(j - 1, M - 1, -1):
        a = math.sqrt(coupling(l + 1, M))
        for i in range(N):
            x[l, i] = k[i] * a * x[l + 1, i] / up[l, i]
    for l in range(j + 1, L + 1):
        a = math.sqrt(coupling(l, M))
        for i in range(N):
            x[l, i] = -k[i] * a * x[l - 1, i] / down[l, i]


@njit(cache=True, nogil=True, error_model="numpy")
def clebsch(l, j, lam, v):
    """<l M j -M|lam 0> for M = 0 .. l <= j, up to one sign, into v; normalised over M = -l .. l.

    Eigenvector of J^2 with eigenvalue lam (lam + 1), from |M| = l inwards: there it can only grow.
    """
    a, b, e = l * (l + 1.0), j * (j + 1.0), lam * (lam + 1.0)
    v[l] = 1.0
    above, off = 0.0, 0.0
    for M in range(l, 0, -1):
        below = math.sqrt((a - M * (M - 1.0)) * (b - M * (M - 1.0)))
        v[M - 1] = -((a + b - 2.0 * M * M - e) * v[M] + off * above) / below
        above, off = v[M], below
        if abs(v[M - 1]) > _HUGE:
            for n in range(M - 1, l + 1):
                v[n] /= _HUGE
            above /= _HUGE
    norm = v[0] ** 2
    for M in range(1, l + 1):
        norm += 2 * v[M] ** 2
    norm = math.sqrt(norm)
    for M in range(l + 1):
        v[M] /= norm


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def rows_of(M, L):
    """Where row l of order M stands less l, where only the rows l = M .. L of each M are kept, one M after the other."""
    return M * L - M * (M - 1) // 2


@njit(cache=True, nogil=True, error_model="numpy")
def columns(j, k, c, uncounted, pivots, events, transform, k0, out):
    """Elements (l <= j, j) of the sum over events, as functions of r; element (l, m) at l (l + 1)/2 + m of `out`.

    k : (N,) wave numbers, logarithmic;  c : (L + 1,) albedo p_l
    uncounted : (L + 1,) of each order, light that is turned and not counted
    pivots : of streaming up and down, and of scattering down, each (.., N), row l of M at rows_of(M, L) + l
    events : flights taken one by one before the last, and whether the last solve sums over all further events
    transform : r (R,), and of k f(k) for each lam, (2 L + 1, 2 N), at sums of the indices of k and r
    k0 : decay of diffuse light
    out : (P, R), r^2 T
    """
    r, hankel = transform
    N, R = len(k), out.shape[1]
    spectrum = _spectrum(j, k, c, uncounted, pivots, events)
    v, factors = np.empty((j + 1, j + 1)), np.empty((j + 1, j + 1))
    waves, space = np.empty((j + 1, N)), np.empty((j + 1, R))
    for l in range(j + 1):
        for n in range(l + 1):
            clebsch(l, j, j - l + 2 * n, v[n])
            # the sum over M = -l .. l
            for M in range(l + 1):
                factors[n, M] = v[n, M] * (1 - 2 * (M & 1)) * (2 if M > 0 else 1)
        low = 0 if j < 2 else _first(k, spectrum[l, 0])
        multiply((factors, 0, j + 1, 1), (spectrum, l * (j + 1) * N + low, N), (waves, low, N), l + 1, N - low, l + 1)
        for n in range(l + 1):
            lam, wave = j - l + 2 * n, waves[n]
            if j < 2 and l == 0:
                _take_diffuse(j, k, k0, r, wave, space[n])
            else:
                space[n] = 0.0
            for i in range(low, N):
                wave[i] *= k[i]
            _hankel(wave[low:], hankel[lam][low:], space[n])
            # the sign of the element
            for m in range(l + 1):
                sign = (1 - 2 * (((lam + l - j) // 2) & 1)) * (1 - 2 * (m & 1))
                factors[n, m] = sign * v[n, m] / (2 * math.pi * math.pi)
        multiply((factors, 0, 1, j + 1), (space, 0, R), (out, l * (l + 1) // 2 * R, R), l + 1, R, l + 1)


@njit(cache=True, nogil=True, error_model="numpy")
def _first(k, values):
    """Number of the first wave number that counts: below it k values, which fall as a power of k, are next to nothing."""
    largest, first = 0.0, 0
    for i in range(len(k)):
        largest = max(largest, abs(k[i] * values[i]))
    while first < len(k) - 1 and abs(k[first] * values[first]) <= _NONE * largest:
        first += 1
    return first


@njit(cache=True, nogil=True, error_model="numpy")
def _spectrum(j, k, c, uncounted, pivots, events):
    """Elements (l <= j, M <= l, j) of the sum over events as functions of k, (j + 1, j + 1, N)."""
    (stream_up, stream_down, scatter_down), (alone, closed) = pivots, events
    L, N = len(c) - 1, len(k)
    x = np.empty((L + 1, N))
    spectrum = np.empty((j + 1, j + 1, N))
    for M in range(j + 1):
        at = rows_of(M, L)
        streaming(k, stream_up[at:], stream_down[at:], M, j, uncounted[j], x)
        for flight in range(alone + 1):
            for l in range(M, L + 1):
                for i in range(N):
                    x[l, i] *= c[l]
            last = flight == alone
            solve(k, scatter_down[at:] if closed and last else stream_down[at:], M, x)
        for l in range(M, j + 1):
            for i in range(N):
                spectrum[l, M, i] = c[l] * c[j] * x[l, i]
    return spectrum


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _hankel(values, kernel, space):
    """Adds the sum over i of values[i] kernel[i + n] to space[n], eight at a time."""
    R, whole = len(space), len(values) // 8 * 8
    for i in range(0, whole, 8):
        v0, v1, v2, v3 = values[i], values[i + 1], values[i + 2], values[i + 3]
        v4, v5, v6, v7 = values[i + 4], values[i + 5], values[i + 6], values[i + 7]
        for n in range(R):
            at = i + n
            space[n] = (space[n] + v0 * kernel[at] + v1 * kernel[at + 1] + v2 * kernel[at + 2] + v3 * kernel[at + 3]
                        + v4 * kernel[at + 4] + v5 * kernel[at + 5] + v6 * kernel[at + 6] + v7 * kernel[at + 7])
    for i in range(whole, len(values)):
        for n in range(R):
            space[n] += values[i] * kernel[i + n]


@njit(cache=True, nogil=True, error_model="numpy")
def _take_diffuse(lam, k, k0, r, wave, space):
    """Takes from `wave` what makes it rise towards k = 0, and sets `space` to its transform times r^2.

    A / (k^2 + k0^2) for lam = 0, A k / (k^2 + k0^2) less the same with 2 for k0 (so that it falls off at large k) for lam = 1.
    Without it the ends of the logarithmic range of k do not meet where light is hardly absorbed.
    """
    N, R = len(k), len(r)
    if lam == 0:
        amplitude = wave[0] * (k[0] ** 2 + k0 ** 2)
        for i in range(N):
            wave[i] -= amplitude / (k[i] ** 2 + k0 ** 2)
        for n in range(R):
            space[n] = amplitude * 0.5 * math.pi * r[n] * math.exp(-k0 * r[n])
    else:
        amplitude = wave[0] * (k[0] ** 2 + k0 ** 2) / k[0]
        for i in range(N):
            wave[i] -= amplitude * k[i] / ((k[i] ** 2 + k0 ** 2) * (1 + k[i] ** 2 / 4))
        factor = amplitude * 0.5 * math.pi * 4 / (4 - k0 ** 2)
        for n in range(R):
            space[n] = factor * ((1 + k0 * r[n]) * math.exp(-k0 * r[n]) - (1 + 2 * r[n]) * math.exp(-2 * r[n]))


@njit(cache=True, nogil=True, error_model="numpy")
def below_decay(k, c):
    """Whether all pivots of 1 - c - k A are positive: k is below the decay of diffuse light."""
    # the infinite chain above L: its fixed point at infinity, a few hundred levels higher
    levels = len(c) + 2000
    pivot = 0.5 * (1 + math.sqrt(max(1 - 4 * k * k * coupling(levels + 0.5, 0), 0.0)))
    for l in range(levels - 1, -1, -1):
        pivot = 1 - (c[l] if l < len(c) else 0.0) - k * k * coupling(l + 1, 0) / pivot
        if pivot <= 0:
            return False
    return True
