"""A reflectance as a table over half vectors, in the form in which measured BRDFs are kept, and what that loses.

The form (Dupuy and Jakob, An Adaptive Parameterization for Efficient Material Acquisition and Rendering, 2018) tabulates the
BRDF times the cosine of exitance over the square (u, v) of half vectors, u the root of their angle from the normal over a right
angle, v their azimuth against that of incidence, for angles of incidence and wavelengths: linear in between.  It can warp the
square first; a surface that is baked needs no warp.
"""

import math
from typing import NamedTuple

import numpy as np

from bakery import rng

GRIDS = (16, 32), (32, 64), (48, 96)  # angles of incidence, steps along the square; the first that is good enough is taken
MOST = 1 << 25  # values of a table of many wavelengths, 134 MB, which leave only the first grid where that has more
TOLERANCE = 5e-3  # of the light to another direction
STEEPEST = math.radians(89.9)
PROBES = 4096  # pairs of directions of even light by which the error is measured
_FULL_TURN = 2 * math.pi


class Losses(NamedTuple):
    """What the table loses of light from all sides, largest of all wavelengths."""

    misdirected: float  # share of the reflected light that goes to another direction
    albedo: float  # largest relative error of the albedo from 0, 30, 60 and 80 degrees


class Measured(NamedTuple):
    """A table."""

    nm: np.ndarray  # (L,) ascending
    theta_in: np.ndarray  # (I,) rad
    values: np.ndarray  # (I, L, V, U) BRDF times the cosine of exitance, 1/sr
    losses: Losses  # against what it stands for


def measured(reflectance, um, tolerance: float = TOLERANCE) -> Measured:
    """A reflectance as a table.

    reflectance : function of theta_in, theta_out, phi (Q,) to (L, Q), pi times the BRDF, as `asset.surface.reflectance`
    um : (L,) wavelengths
    tolerance : of `Losses.misdirected`, which the finest grid may miss
    """
    order = np.argsort(um)

    def ascending(*at):
        return reflectance(*at)[order]

    probes = _probes(ascending)
    for angles, steps in [grid for grid in GRIDS if grid[0] * grid[1] ** 2 * len(um) <= MOST] or GRIDS[:1]:
        theta_in = STEEPEST * np.sin(0.5 * math.pi * np.linspace(0, 1, angles))
        table = Measured(1e3 * np.asarray(um, float)[order], theta_in, _sampled(ascending, theta_in, steps), Losses(0, 0))
        table = table._replace(losses=_losses(table, *probes))
        if table.losses.misdirected <= tolerance:
            break
    return table


def _exitant(theta_in: float, u, v):
    """Cosine of exitance, below 0 where there is none, and azimuth of travel (V, U) of light that half vectors turn."""
    theta, turn = 0.5 * math.pi * u * u, math.pi * (2 * v[:, None] - 1)
    x, y, z = np.sin(theta) * np.cos(turn), np.sin(theta) * np.sin(turn), np.broadcast_to(np.cos(theta), (len(v), len(u)))
    onto = math.sin(theta_in) * x + math.cos(theta_in) * z
    # directions point away from the surface: light goes on forward where their azimuths are opposite
    phi = np.arctan2(2 * onto * y, math.sin(theta_in) - 2 * onto * x)
    return np.where(onto > 0, 2 * onto * z - math.cos(theta_in), -1.0), phi


def _sampled(reflectance, theta_in, steps: int):
    """(I, L, V, U) values; both halves of the azimuth are the same."""
    u = v = np.linspace(0, 1, steps)
    rows = []
    for angle in theta_in:
        z, phi = _exitant(angle, u, v[:steps // 2])
        seen = z > math.cos(STEEPEST)
        out = reflectance(np.full(int(seen.sum()), angle), np.arccos(np.minimum(z[seen], 1)), phi[seen])
        values = np.zeros((len(out), *z.shape))
        values[:, seen] = np.maximum(out, 0) * z[seen] / math.pi
        rows.append(np.concatenate([values, values[:, ::-1]], axis=1))
    return np.stack(rows).astype(np.float32)


def looked_up(table: Measured, theta_in, theta_out, phi):
    """(L, Q) pi times the BRDF, as programs make it of the table at its own wavelengths."""
    into, out = (np.stack([np.sin(theta) * np.cos(turn), np.sin(theta) * np.sin(turn), np.cos(theta)])
                 for theta, turn in ((theta_in, np.zeros_like(phi)), (theta_out, math.pi - phi)))
    half = into + out
    half /= np.linalg.norm(half, axis=0)
    u = np.sqrt(2 / math.pi * np.arccos(np.clip(half[2], -1, 1)))
    v = (np.arctan2(half[1], half[0]) / _FULL_TURN + 0.5) % 1.0
    values = 0.0
    (i, x), (j, y), (k, z) = _between(table.theta_in, theta_in), *(
        _between(np.linspace(0, 1, count), at) for count, at in zip(table.values.shape[:1:-1], (u, v), strict=True))
    for a in range(2):
        for b in range(2):
            for c in range(2):
                weight = (x if a else 1 - x) * (y if b else 1 - y) * (z if c else 1 - z)
                values = values + weight * table.values[i + a, :, k + c, j + b].T
    return math.pi * values / np.cos(theta_out)


def _between(nodes, at):
    """Node below, and the share of the way to the next one."""
    low = np.clip(np.searchsorted(nodes, at, side="right") - 1, 0, len(nodes) - 2)
    return low, np.clip((at - nodes[low]) / (nodes[low + 1] - nodes[low]), 0, 1)


def _probes(reflectance):
    """Angles (3, Q) of pairs of directions, first those of even light, then those to and from each angle of an albedo; values."""
    random = rng.generator(0, "surface.probes")
    mu, mu0 = np.sqrt(random.random((2, PROBES)))
    angles = np.repeat(np.radians([0.0, 30.0, 60.0, 80.0]), PROBES // 4)
    theta_in, theta_out = np.append(np.arccos(mu0), angles), np.append(np.arccos(mu), np.arccos(mu))
    at = np.minimum(theta_in, STEEPEST), np.minimum(theta_out, STEEPEST), math.pi * random.random(2 * PROBES)
    return at, reflectance(*at)


def _losses(table: Measured, at, true) -> Losses:
    off = looked_up(table, *at) - true
    even, several = slice(None, PROBES), [slice(PROBES + k * PROBES // 4, PROBES + (k + 1) * PROBES // 4) for k in range(4)]
    light = np.maximum(true[:, even].mean(axis=1), 1e-30)
    albedo = [np.abs(off[:, part].mean(axis=1)) / np.maximum(true[:, part].mean(axis=1), 1e-30) for part in several]
    return Losses(float((0.5 * np.abs(off[:, even]).mean(axis=1) / light).max()), float(np.max(albedo)))
