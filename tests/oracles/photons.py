"""Light of point and segment sources by following photons: for any phase table and albedo, with standard errors.

Photons fly and scatter in an infinite medium; cells are rings around the axis of the source.  At each event that counts, what
is scattered into the chosen directions is added to the cell.  A direction (theta, phi) has its phi from the azimuth of the event.
"""

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bakery import rng
from bakery.physics.medium import phase as tables
from bakery.physics.medium.kernels import phase_layout, phase_sample, phase_value, turned_direction
from bakery.system.compiled import njit

BLOCKS = 32  # random streams, and samples of each mean
_LOW, _KEPT = 0.2, 0.5  # weight below which Russian roulette is played, and the weight of the survivors
_RETURN = 1e-4  # share of the light at the rim that comes back, below which it is dropped


@dataclass(frozen=True)
class Tally:
    """Averages over ring cells, with standard errors from `BLOCKS` independent blocks.

    Attributes
    ----------
    value, error : (R, Z, D) mfp^-3 sr^-1, of the source into each direction
    total, total_error : (R, Z) mfp^-3, its integral over directions
    photons : followed
    bias : upper estimate of what is missing relative to the value, because photons were dropped far outside
    """

    value: np.ndarray
    error: np.ndarray
    total: np.ndarray
    total_error: np.ndarray
    photons: int
    bias: float


def trace(albedo, theta, phase, rho, z, directions, photons, *, seed=0, length=None, first=3, last=None, rim=None,
          threads=1) -> Tally:
    """Follows photons from a point or a segment source.

    Parameters
    ----------
    albedo : 1
    theta, phase : (A,) rad, 1/sr, linear in cos theta, normalised
    rho, z : edges of the cells, (R + 1,) >= 0 and (Z + 1,), ascending, mfp
    directions : (D, 2) theta, phi in rad
    photons : number
    length : of the segment in mfp; None for a point, where power 1 enters its first collision
    first, last : events that count (None: all further ones)
    rim : mfp from the origin, where photons are dropped; None: where less than 1e-4 of what gets there would come back

    Returns
    -------
    Tally : the same for any number of threads

    Raises
    ------
    ValueError : nothing is absorbed and no rim is given: a photon would never end
    """
    rho, z = np.asarray(rho, float), np.asarray(z, float)
    theta, phase = np.asarray(theta, float), np.asarray(phase, float)
    far = math.hypot(rho[-1], np.abs(z).max())
    spread = math.sqrt(3 * (1 - albedo) * max(1 - albedo * float(tables.mean_cosine(theta, phase)), 1e-12))
    if rim is None:
        if albedo >= 1:
            raise ValueError("albedo 1: photons never end; give the rim where they are dropped (what is lost is cell's r / rim)")
        rim = far + -math.log(_RETURN) / spread
    bias = far / rim * math.exp(-spread * max(rim - far, 0.0))
    lobes = np.asarray(directions, float).reshape(-1, 2)
    sine = np.sin(lobes[:, 0])
    lobes = np.column_stack([sine * np.cos(lobes[:, 1]), sine * np.sin(lobes[:, 1]), np.cos(lobes[:, 0])])
    table = phase_layout(theta, phase)
    per_block = -(-int(photons) // BLOCKS)

    def block(index):
        stream = rng.generator(seed, "multiple.photons", index)
        sums = np.zeros((len(rho) - 1, len(z) - 1, len(lobes) + 1))
        _follow(stream, per_block, float(albedo), table, _Cells(rho, z, lobes, sums), -1.0 if length is None else float(length),
                first, 2**62 if last is None else last, float(rim))
        return sums

    with ThreadPoolExecutor(threads) as pool:
        sums = np.array(list(pool.map(block, range(BLOCKS))))
    volume = math.pi * np.diff(rho**2)[:, None] * np.diff(z)
    means = sums / (per_block * volume[:, :, None])
    value, error = means.mean(axis=0), means.std(axis=0, ddof=1) / math.sqrt(BLOCKS)
    return Tally(value[..., :-1], error[..., :-1], value[..., -1], error[..., -1], per_block * BLOCKS, bias)


def cell_averages(source: Callable, rho, z, directions, points=5):
    """What a tally estimates: averages over the cells, weighted by rho, of source(rho, z, theta, phi), by Gauss's rule.

    Returns
    -------
    (R, Z, D)
    """
    x, weight = np.polynomial.legendre.leggauss(points)
    rho, z, directions = np.asarray(rho, float), np.asarray(z, float), np.asarray(directions, float).reshape(-1, 2)
    at_rho = (rho[:-1, None] + rho[1:, None] + np.diff(rho)[:, None] * x) / 2
    at_z = (z[:-1, None] + z[1:, None] + np.diff(z)[:, None] * x) / 2
    values = source(at_rho[:, None, :, None, None], at_z[None, :, None, :, None], directions[:, 0], directions[:, 1])
    weights = weight * at_rho
    weights = weights / weights.sum(axis=1, keepdims=True)
    return np.einsum("rzabd,ra,b->rzd", values, weights, weight / 2)


class _Cells(NamedTuple):
    """Edges (R + 1,) and (Z + 1,), directions (D, 3), sums (R, Z, D + 1)."""

    rho: np.ndarray
    z: np.ndarray
    lobes: np.ndarray
    sums: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy")
def _follow(stream, photons, albedo, table, cells, length, first, last, rim):
    """Photons of a block, added to the cells; length < 0: a point source."""
    v_nodes, steps, f, cdf = table
    entering = 1.0 if length < 0 else -math.expm1(-length)
    for _ in range(photons):
        px, py, pz = 0.0, 0.0, 0.0
        if length >= 0:
            pz = -math.log1p(-stream.random() * entering)
        ux, uy, uz = 0.0, 0.0, 1.0
        weight, event = entering, 1
        while True:
            if event >= first:
                _add(px, py, pz, ux, uy, uz, weight * albedo, table, cells)
                if event >= last:
                    break
            weight *= albedo
            if weight < _LOW * entering:
                if stream.random() * _KEPT * entering >= weight:
                    break
                weight = _KEPT * entering
            # new direction: 1 - cos and azimuth about the old one
            v = phase_sample(v_nodes, steps, f, cdf, stream.random())
            ux, uy, uz = turned_direction(ux, uy, uz, v, 2 * math.pi * stream.random())
            flight = -math.log1p(-stream.random())
            px, py, pz = px + flight * ux, py + flight * uy, pz + flight * uz
            event += 1
            if px * px + py * py + pz * pz > rim * rim:
                break


@njit(cache=True, nogil=True, error_model="numpy")
def _add(px, py, pz, ux, uy, uz, weight, table, cells):
    """Add what an event at p, of light along u, sends into the directions of its cell."""
    rho, z, lobes, sums = cells
    r = math.sqrt(px * px + py * py)
    if r < rho[0] or r >= rho[-1] or pz < z[0] or pz >= z[-1]:
        return
    cell = sums[np.searchsorted(rho, r, side="right") - 1, np.searchsorted(z, pz, side="right") - 1]
    # the direction in the frame that turns with the position: x away from the axis
    x, y = (ux * px + uy * py) / r, (uy * px - ux * py) / r
    for d in range(len(lobes)):
        v = 1 - (x * lobes[d, 0] + y * lobes[d, 1] + uz * lobes[d, 2])
        cell[d] += weight * phase_value(table[0], table[1], table[2], v)
    cell[-1] += weight
