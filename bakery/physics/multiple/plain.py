"""Look-ups of a table in plain NumPy, for pictures: a few thousand positions, for which loading compiled kernels takes longer.

As `lookup`, but for the interpolation of the basis: integrals sum over fewer directions, lobes in the plane of source and
position interpolate by cubics between the stored ones.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bakery.physics.multiple import frame
from bakery.physics.multiple.kinds import POINT
from bakery.physics.multiple.table import Table, margins

_DIRECTIONS = (24, 11)  # rings and half meridians that an integral sums: at worst 1 % off, 0.1 % as a rule
_AT_ONCE = 256  # positions, whose lobes fit into the processor's cache


class Plain(NamedTuple):
    """A table laid out for look-ups.

    Attributes
    ----------
    grid : (U + 2, V + 2, K + 1) a_0 .. a_K with margins
    basis : (K + 1, A, B) B_0 .. B_K
    """

    table: Table
    grid: np.ndarray
    basis: np.ndarray


def plain(table: Table) -> Plain:
    """Lays a table of a medium that scatters out for look-ups."""
    return Plain(table, margins(table.coefficients()), table.functions())


def singular(table: Table, rho, z):
    """The singular part at positions, 1/mfp; finite everywhere."""
    return _places(table, rho, z)[2]


def integral(ready: Plain, rho, z):
    """Integral of the table's own source over directions at positions (N,), mfp^-3."""
    a, scale = _coefficients(ready, rho, z)
    coarse = ready.basis
    for axis in (1, 2):
        coarse = _thinned(coarse, axis, min(coarse.shape[axis], _DIRECTIONS[axis - 1]))
    basis = coarse.astype(np.float32).reshape(len(coarse), -1)
    weight = frame.solid_angles(coarse.shape[1:]).ravel().astype(np.float32)
    sums = np.empty(len(scale))
    for part in (slice(i, i + _AT_ONCE) for i in range(0, len(scale), _AT_ONCE)):
        lobes = np.repeat(basis[:1], len(a[part]), axis=0)
        for coefficient, function in zip(a[part].astype(np.float32).T, basis[1:], strict=True):
            lobes += coefficient[:, None] * function  # not by BLAS, whose waiting threads take ten times the processor's time
        sums[part] = (np.exp(lobes) * weight).sum(axis=1)
    return scale * sums


def in_plane(ready: Plain, rho, z, turn):
    """The source at positions (N,) into directions (T,) in the plane of source and position, mfp^-3 sr^-1, (N, T).

    turn : rad, from +z towards growing rho
    """
    rings = ready.basis.shape[1]
    around = np.concatenate([ready.basis[:, :, 0], ready.basis[:, -2:0:-1, -1]], axis=1)  # once around: out at t = 0, back at 1
    a, scale = _coefficients(ready, rho, z)
    # at azimuth 0 of a position's frame is +z
    polar = np.arctan2(rho, z)[:, None] - turn
    s = (2 / math.pi) * np.arctan(frame.SHARP * np.tan(np.arccos(np.clip(np.cos(polar), -1, 1)) / 2))
    at = np.where(np.sin(polar) >= 0, s, 2 - s) * (rings - 1)
    first = np.floor(at).astype(int)
    lobes = np.zeros(at.shape)
    for n, weight in enumerate(_catmull_rom(at - first)):
        basis = around[:, (first + n - 1) % around.shape[1]]
        lobes += weight * (basis[0] + np.einsum("nk,knt->nt", a, basis[1:]))
    return scale[:, None] * np.exp(lobes)


def _places(table: Table, rho, z):
    """m, tan(angle / 2) and the singular part of positions, as `locate.place`."""
    rho = np.maximum(rho, frame.CLOSEST)
    ends = (z,) if table.kind == POINT else (z, z - table.length)
    away, ahead, behind = [], [], []
    for along in ends:
        r = np.hypot(rho, along)
        farther = r + np.abs(along)
        away.append(r)
        ahead.append(np.where(along > 0, farther, rho**2 / farther))  # r + z, r - z without cancellation
        behind.append(np.where(along > 0, rho**2 / farther, farther))
    if table.kind == POINT:
        return away[0], rho / ahead[0], 1 / away[0]
    beyond = behind[0] + ahead[1]
    return (np.sqrt(beyond * (2 * table.length + beyond)) / 2, np.sqrt(sum(behind) / sum(ahead)),
            np.log(1 + 2 * table.length / beyond))


def _coefficients(ready: Plain, rho, z):
    """a_1 .. a_K at positions, (N, K), and the factor (N,) of the exponential of all that depends on directions."""
    table = ready.table
    m, tangent, near = _places(table, rho, z)
    v = (2 / math.pi) * np.arctan(frame.SKEW[table.kind] * tangent)
    beyond = np.maximum(m - table.extent, 0)
    m = m - beyond
    a = _interpolated(ready, m, v)
    far = np.flatnonzero(beyond)
    inner = _interpolated(ready, frame.INSIDE * m[far], v[far])
    inner[:, 0] -= table.k0 * (1 - frame.INSIDE) * m[far]
    share = beyond[far] / (m[far] + beyond[far]) * frame.INSIDE / (1 - frame.INSIDE)
    a[far] += share[:, None] * (a[far] - inner)
    return a[:, 1:], near * np.exp(a[:, 0] - table.k0 * beyond)


def _interpolated(ready: Plain, m, v):
    """a_0 .. a_K at places, (N, K + 1)."""
    grid, core = ready.grid, frame.CORE[ready.table.kind]
    u = np.arcsinh(m / core) / math.asinh(ready.table.extent / core) * (grid.shape[0] - 3)
    v = v * (grid.shape[1] - 3)
    i, j = (np.minimum(at.astype(int), size - 4) for at, size in ((u, grid.shape[0]), (v, grid.shape[1])))
    total = np.zeros((len(u), grid.shape[2]))
    for n, down in enumerate(_catmull_rom(u - i)):
        for k, across in enumerate(_catmull_rom(v - j)):
            total += (down * across)[:, None] * grid[i + n, j + k]
    return total


def _thinned(values, axis, count):
    """Values at equidistant points, ends included and even there, at fewer of them."""
    last = values.shape[axis] - 1
    at = np.linspace(0, last, count)
    first = np.minimum(at.astype(int), last - 1)
    shape = [-1 if k == axis else 1 for k in range(values.ndim)]
    coarse = np.zeros([count if k == axis else size for k, size in enumerate(values.shape)])
    for n, weight in enumerate(_catmull_rom(at - first)):
        index = last - np.abs(last - np.abs(first + n - 1))
        coarse += weight.reshape(shape) * np.take(values, index, axis)
    return coarse


def _catmull_rom(t):
    return t * (-0.5 + t * (1 - 0.5 * t)), 1 + t * t * (1.5 * t - 2.5), t * (0.5 + t * (2 - 1.5 * t)), t * t * (0.5 * t - 0.5)
