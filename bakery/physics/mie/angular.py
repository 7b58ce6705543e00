"""Amplitudes of spheres: angular sums over their coefficients, arrays of floats in and out.

p_n = (pi_n + tau_n)/(n(n+1)) and q_n = (pi_n - tau_n)/(n(n+1)) are the Wigner functions d^n_{1,1}, d^n_{1,-1}.  With
v = 2 sin^2(theta/2) their recurrences in difference form are

    e_{n+1} = e_n - (2n+1) v p_n,                    p_{n+1} = p_n + (n+1)/(n(n+2)) e_{n+1},    e_1 = 0, p_1 = 1 - v/2,
    f_{n+1} = f_n + (2n+1) (2/(n(n+1)) - v) q_n,     q_{n+1} = q_n + (n+1)/(n(n+2)) f_{n+1},    f_1 = 0, q_1 = v/2,

stable for v <= 1; S1 + S2 = sum (2n+1)(a_n + b_n) p_n and S1 - S2 = sum (2n+1)(a_n - b_n) q_n.  Beyond 90 degrees
p_n(pi - theta) = (-1)^(n+1) q_n(theta).

Rounding: as in `coefficients`.
"""

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from bakery.physics.mie.coefficients import STRICT, lanes_of, terms, wave_coefficients
from bakery.physics.mie.vector import Memory, Registers, integer
from bakery.system.compiled import njit

ANGLES = 16  # angles whose state stays in registers
BLOCK = 1024  # terms per sweep over all angles: their coefficients (64 kB) stay in the cache

# Rows of an angle tile: v, the recurrences, the four sums.
V, P, E, Q, F, SUM_R, SUM_I, DIF_R, DIF_I = range(9)


@intrinsic
def sweep(typingctx, order, coefficient, first, count, tile):
    """Add `count` terms to one tile of angles (9, ANGLES): rows of order (N, 3) from `first`, of coefficient (.., 4) from 0."""

    def codegen(context, builder, signature, args):
        of_n = Memory(context, builder, signature.args[0], args[0], 1)
        of_sphere = Memory(context, builder, signature.args[1], args[1], 1)
        angles = Memory(context, builder, signature.args[4], args[4], ANGLES)
        v = angles[V]
        state = Registers(builder, p=angles[P], e=angles[E], q=angles[Q], f=angles[F],
                          sr=angles[SUM_R], si=angles[SUM_I], dr=angles[DIF_R], di=angles[DIF_I])

        def columns(memory, row, width):
            for part in range(width):
                yield v.fill(memory.scalar(builder.add(builder.mul(row, integer(width)), integer(part))))

        with cgutils.for_range(builder, args[3]) as loop:
            k, c, step = columns(of_n, builder.add(args[2], loop.index), 3)
            sum_r, sum_i, dif_r, dif_i = columns(of_sphere, loop.index, 4)
            p, q = state.p, state.q
            state.sr, state.si = p.times_plus(sum_r, state.sr), p.times_plus(sum_i, state.si)
            state.dr, state.di = q.times_plus(dif_r, state.dr), q.times_plus(dif_i, state.di)
            w = v * k
            e = (-w).times_plus(p, state.e)
            f = (c - w).times_plus(q, state.f)
            state.e, state.f = e, f
            state.p, state.q = e.times_plus(step, p), f.times_plus(step, q)
        for row, name in zip(range(P, DIF_I + 1), ("p", "e", "q", "f", "sr", "si", "dr", "di")):
            angles[row] = getattr(state, name)
        return context.get_dummy_value()

    return types.void(order, coefficient, first, count, tile), codegen


@njit(**STRICT)
def order_table(rows):
    """What the recurrences need of n alone, row n-1: 2n+1, 2(2n+1)/(n(n+1)), (n+1)/(n(n+2))."""
    table = np.empty((rows, 3))
    for i in range(rows):
        n = i + 1.0
        table[i, 0] = 2.0 * n + 1.0
        table[i, 1] = 2.0 * (2.0 * n + 1.0) / (n * (n + 1.0))
        table[i, 2] = (n + 1.0) / (n * (n + 2.0))
    return table


@njit(**STRICT)
def angular_coefficients(work, j, first, count, ahead, behind):
    """(2n+1)(a+b), (2n+1)(a-b) of lane j for theta <= 90 degrees, and their reflected twins, of rows first..first+count-1."""
    for c in range(count):
        i = first + c
        k = 2.0 * i + 3.0
        sr, si = k * (work[i, 0, j] + work[i, 2, j]), k * (work[i, 1, j] + work[i, 3, j])
        dr, di = k * (work[i, 0, j] - work[i, 2, j]), k * (work[i, 1, j] - work[i, 3, j])
        sign = -1.0 if i % 2 else 1.0
        ahead[c, 0], ahead[c, 1], ahead[c, 2], ahead[c, 3] = sr, si, dr, di
        behind[c, 0], behind[c, 1], behind[c, 2], behind[c, 3] = sign * dr, sign * di, sign * sr, sign * si


@njit(**STRICT)
def tiles_of(theta, ahead):
    """The angles up to 90 degrees (or those beyond, reflected) in tiles (T, 9, ANGLES), and where each came from."""
    count = 0
    for t in range(theta.shape[0]):
        count += (theta[t] <= 0.5 * np.pi) == ahead
    source = np.empty(count, np.int64)
    tiles = np.zeros(((count + ANGLES - 1) // ANGLES, 9, ANGLES))
    count = 0
    for t in range(theta.shape[0]):
        if (theta[t] <= 0.5 * np.pi) == ahead:
            s = np.sin(0.5 * theta[t]) if ahead else np.cos(0.5 * theta[t])
            tiles[count // ANGLES, V, count % ANGLES] = 2.0 * s * s
            source[count] = t
            count += 1
    return tiles, source


@njit(**STRICT)
def reset(tiles):
    """State at n = 1."""
    for t in range(tiles.shape[0]):
        for j in range(ANGLES):
            half = 0.5 * tiles[t, V, j]
            tiles[t, P, j], tiles[t, Q, j] = 1.0 - half, half
            for part in (E, F, SUM_R, SUM_I, DIF_R, DIF_I):
                tiles[t, part, j] = 0.0


@njit(**STRICT)
def gather(tiles, source, swapped, mode, weight, out):
    """Add one sphere's amplitudes (mode 0), weighted intensity (1) or weighted Mueller elements (2) to out (A, ..)."""
    s, d = (DIF_R, SUM_R) if swapped else (SUM_R, DIF_R)
    w = 0.25 * weight
    for c in range(source.shape[0]):
        t, j, o = c // ANGLES, c % ANGLES, source[c]
        sr, si, dr, di = tiles[t, s, j], tiles[t, s + 1, j], tiles[t, d, j], tiles[t, d + 1, j]
        plus, minus = sr * sr + si * si, dr * dr + di * di
        if mode == 0:
            out[o, 0], out[o, 1], out[o, 2], out[o, 3] = 0.5 * (sr + dr), 0.5 * (si + di), 0.5 * (sr - dr), 0.5 * (si - di)
        elif mode == 1:
            out[o, 0] += w * (plus + minus)
        else:
            out[o, 0] += w * (plus + minus)
            out[o, 1] -= 2.0 * w * (sr * dr + si * di)
            out[o, 2] += w * (plus - minus)
            out[o, 3] += 2.0 * w * (si * dr - sr * di)


@njit(**STRICT)
def _spheres(m, x, weight, theta, mode, out):
    """The walk over spheres x (R,) that the public kernels share, in the order of x; out (R or 1, A, ..) starts at zero."""
    if x.shape[0] == 0:
        return
    width = lanes_of(x)
    most = terms(np.max(x)) + 2
    work, lane, xs = np.empty((most, 4, width)), np.empty((27, width)), np.empty(width)
    order, front, back = order_table(most), np.empty((BLOCK, 4)), np.empty((BLOCK, 4))
    ahead, ahead_source = tiles_of(theta, True)
    behind, behind_source = tiles_of(theta, False)
    for first in range(0, x.shape[0], width):
        for j in range(width):
            xs[j] = x[min(first + j, x.shape[0] - 1)]
        wave_coefficients(m, xs, lane, work)
        for j in range(min(width, x.shape[0] - first)):
            r, rows = first + j, terms(xs[j])
            reset(ahead)
            reset(behind)
            for start in range(0, rows, BLOCK):
                count = min(BLOCK, rows - start)
                angular_coefficients(work, j, start, count, front, back)
                for t in range(ahead.shape[0]):
                    sweep(order, front, start, count, ahead[t])
                for t in range(behind.shape[0]):
                    sweep(order, back, start, count, behind[t])
            into = out[r if mode == 0 else 0]
            gather(ahead, ahead_source, False, mode, weight[r], into)
            gather(behind, behind_source, True, mode, weight[r], into)


@njit(**STRICT)
def amplitude_block(m, x, theta, out):
    """S1, S2 of the spheres x (R,) at theta (A,) rad: out (R, A, 4) = Re S1, Im S1, Re S2, Im S2."""
    _spheres(m, x, x, theta, 0, out)


@njit(**STRICT)
def intensity_block(m, x, weight, theta, out):
    """out (A,) = sum over the spheres x (R,) of weight (|S1|^2 + |S2|^2)/2 at theta (A,) rad, summed in the order of x."""
    sums = np.zeros((1, theta.shape[0], 4))
    _spheres(m, x, weight, theta, 1, sums)
    for t in range(theta.shape[0]):
        out[t] = sums[0, t, 0]


@njit(**STRICT)
def mueller_block(m, x, weight, theta, out):
    """out (4, A) = weighted sums of S11, S12, S33, S34 (Bohren & Huffman eq. 4.77) over the spheres x (R,), in their order."""
    sums = np.zeros((1, theta.shape[0], 4))
    _spheres(m, x, weight, theta, 2, sums)
    for t in range(theta.shape[0]):
        for part in range(4):
            out[part, t] = sums[0, t, part]
