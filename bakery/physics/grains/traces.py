"""What has to be traced for a grain: paths that wavelengths and sizes share, what follows them, figures by wavelength and size.

A grain is a mapping: type ("dielectric", "diffuse", "conductor"), index (L,) complex and relative to the host or None, roughness,
absorption (L,) 1/m, reflectance (L,) or None, shape with its type.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bakery.physics.grains import surface

CELLS = 180  # of the phase function


@dataclass(frozen=True)
class Trace:
    """Paths that several wavelengths and sizes share."""

    surface: object  # of the grain, `bakery.physics.grains.surface`
    mu: np.ndarray  # (C,) 1/R
    rows: tuple[int, ...]  # wavelengths that it serves
    channel: np.ndarray  # (S, rows) channels of the radii and wavelengths
    white: int  # the channel in which nothing is absorbed


def traces(grain: Mapping, radii, wavelengths: int, apart: float) -> list[Trace]:
    """What has to be traced for a grain whose bounding spheres have `radii` (S,) m; near indices (`apart`) count as one."""
    every, sizes = tuple(range(wavelengths)), len(radii)
    if grain["type"] == "dielectric":
        dielectrics, real = [], grain["index"].real
        for eta, rows in _alike(real, 0.0 if is_ball(grain) else apart):
            mu, which = np.unique(np.append(0.0, np.outer(radii, grain["absorption"][list(rows)])), return_inverse=True)
            dielectrics.append(Trace(surface.dielectric(eta, grain["roughness"]), mu, rows,
                                      which.ravel()[1:].reshape(sizes, len(rows)), int(which.ravel()[0])))
        return dielectrics
    if grain["type"] == "diffuse":
        values, which = np.unique(np.append(1.0, grain["reflectance"]), return_inverse=True)
        opaque = surface.diffuse(values)
    else:
        values, which = np.unique(np.append(complex(math.inf, 0), grain["index"]), return_inverse=True)
        opaque = surface.conductor(values, grain["roughness"])
    channel = np.broadcast_to(which.ravel()[1:], (sizes, wavelengths))
    return [Trace(opaque, np.zeros(len(values)), every, channel, int(which.ravel()[0]))]


def is_ball(grain: Mapping) -> bool:
    """Whether a closed form knows the answer."""
    return grain["shape"]["type"] == "sphere" and grain["roughness"] == 0


def _alike(index, apart: float) -> list[tuple[float, tuple[int, ...]]]:
    """Indices that stand for those within `apart` above the lowest of them, and the wavelengths of each."""
    groups, order = [], np.argsort(index, kind="stable")
    for row in order.tolist():
        if groups and index[row] - index[groups[-1][0]] <= apart:
            groups[-1].append(row)
        else:
            groups.append([row])
    return [(0.5 * (float(index[rows[0]]) + float(index[rows[-1]])), tuple(rows)) for rows in groups]


def nodes() -> tuple[np.ndarray, np.ndarray]:
    """Angles of the table (A,) and the edges of their cells (A + 1,), at the mean cosines of neighbours."""
    theta = np.linspace(0.0, np.pi, CELLS + 1)
    v = 2 * np.sin(theta / 2) ** 2
    edges = np.concatenate([[0.0], 2 * np.arcsin(np.sqrt((v[1:] + v[:-1]) / 4)), [np.pi]])
    return theta, edges


def tracer_of(grain, trace: Trace, depth: int, tree=None):
    """What follows rays through a grain, or None where a closed form knows the answer."""
    if grain.analytic == "sphere":
        if trace.surface.roughness == 0:
            return None
        from bakery.physics.grains.balls import BallWalker

        return BallWalker(trace.surface, trace.mu, events_max=depth)
    from bakery.physics.grains.walk import Walker

    return Walker(tree, trace.surface, trace.mu, events_max=depth)


def figures(traced: Sequence[Trace], statistics: Sequence, name: str, white=False):
    """A figure of every size and wavelength, from the traces that share them.

    statistics : what was measured of each, `scatterometer.Statistics` or `sphere.Ball`, whose figures have the same names
    white : of light that is not absorbed

    Returns values, errors : (S, L, ...)
    """
    values, errors = [], []
    for trace, stats in zip(traced, statistics):
        value = getattr(stats, name)
        error = np.broadcast_to(stats.errors.get(name, 0.0), value.shape)
        pick = np.full_like(trace.channel, trace.white) if white else trace.channel
        values.append(value[pick])
        errors.append(error[pick])
    order = np.argsort([row for trace in traced for row in trace.rows])
    return np.concatenate(values, axis=1)[:, order], np.concatenate(errors, axis=1)[:, order]
