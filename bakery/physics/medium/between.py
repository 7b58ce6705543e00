"""Media between media that were computed: tables over one or more swept quantities, on angles that all of them share.

Coefficients and phase functions are interpolated in their logarithm where they are positive, along each axis in turn, linearly or
by monotone cubics (Fritsch and Butland, SIAM J. Sci. Stat. Comput. 5, 300 (1984)), which stay between their neighbours.

Shapes: L wavelengths, A angles, E = 1 (phase function) or 4 (and s12, s33, s34), N1 ... Nk points of k axes.
"""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from bakery.physics.medium import phase

METHODS = ("cubic", "linear")
_BINS = 2048  # of angles towards 0 and towards pi, in which densities of angles are compared
_DENSER = 2  # angles over those of the densest table: a table at other angles is off by a quarter of what its own leave
SAME = 1e-9  # relative distance of two coordinates that are one


class Optics(NamedTuple):
    """One medium."""

    theta: np.ndarray  # (A,) rad
    # sigma_s, sigma_a: (L,) 1/m
    sigma_s: np.ndarray
    sigma_a: np.ndarray
    elements: np.ndarray  # (L, E, A) 1/sr, of which the first is the phase function
    bias: np.ndarray | None = None  # (L, A) 1/sr, error that the phase function is known to have, or None


class Tables(NamedTuple):
    """Media over k axes."""

    axes: tuple[np.ndarray, ...]  # k coordinates (Nk,), ascending, in which is interpolated
    theta: np.ndarray  # (A,) rad
    # sigma_s, sigma_a: (N1, ..., L) 1/m
    sigma_s: np.ndarray
    sigma_a: np.ndarray
    phase: np.ndarray  # (N1, ..., L, A) 1/sr, each integrates to 1
    ratios: np.ndarray  # (N1, ..., L, E - 1, A) 1, the other elements over the phase function
    missing: np.ndarray  # (N1, ...) whether there is no medium at a point


def common_angles(grids: Sequence[np.ndarray]) -> np.ndarray:
    """Angles (A,) everywhere twice as dense as the densest of some grids; that grid where all are one."""
    if all(np.array_equal(grid, grids[0]) for grid in grids):
        return grids[0]
    near = np.geomspace(1e-8, math.pi / 2, _BINS)
    edges = np.concatenate([[0.0], near, math.pi - near[-2::-1], [math.pi]])
    counts = np.zeros(len(edges) - 1)
    for grid in grids:
        counts = np.maximum(counts, np.diff(np.interp(edges, grid, np.arange(len(grid)))))
    passed = np.insert(np.cumsum(counts), 0, 0.0)
    theta = np.unique(np.interp(np.linspace(0.0, passed[-1], 1 + _DENSER * math.ceil(passed[-1])), passed, edges))
    theta[0], theta[-1] = 0.0, math.pi
    return theta


def tabulated(axes: Sequence[np.ndarray], media: Iterable[Optics | None]) -> Tables:
    """Tables of media at all points of the axes, the last axis fastest; None where there is none, of which not all are.

    `media` is gone through twice, and none of them is kept.
    """
    grids, shapes = zip(*((None, None) if medium is None else (medium.theta, medium.elements.shape) for medium in media))
    theta = common_angles([grid for grid in grids if grid is not None])
    shape = tuple(len(axis) for axis in axes)
    count, (wavelengths, kinds, _) = len(grids), next(filter(None, shapes))
    sigma_s, sigma_a = np.zeros((2, count, wavelengths))
    table, ratios = np.zeros((count, wavelengths, len(theta))), np.zeros((count, wavelengths, kinds - 1, len(theta)))
    for i, medium in enumerate(media):
        if medium is not None:
            sigma_s[i], sigma_a[i] = medium.sigma_s, medium.sigma_a
            first, others = medium.elements[:, :1], medium.elements[:, 1:]
            shares = np.divide(others, first, out=np.zeros_like(others), where=first > 0)
            table[i] = phase.normalised(theta, phase.phase_at(medium.theta, first[:, 0], theta))[0]
            ratios[i] = phase.phase_at(medium.theta, shares, theta)
    missing = np.array([grid is None for grid in grids])
    arrays = (array.reshape(shape + array.shape[1:]) for array in (sigma_s, sigma_a, table, ratios, missing))
    return Tables(tuple(axes), theta, *arrays)


def cell(tables: Tables, at: Sequence[float]) -> tuple[slice, ...]:
    """The two points on each axis that coordinates lie between, or the one that they lie on."""
    return tuple(_stencil(axis, value, "linear") for axis, value in zip(tables.axes, at, strict=True))


def hole(tables: Tables, at: Sequence[float]) -> tuple[int, ...] | None:
    """The first missing point that a medium at these coordinates would need; None where there is none."""
    cells = cell(tables, at)
    holes = np.argwhere(tables.missing[cells])
    return tuple(int(nodes.start + i) for nodes, i in zip(cells, holes[0], strict=True)) if len(holes) else None


def interpolated(tables: Tables, at: Sequence[float], method: str) -> Optics:
    """The medium at coordinates (k,) within the axes; at a point of the tables what they hold there.

    method : one of `METHODS`; cubic needs a table without missing points
    """
    sigma_s, sigma_a, table, ratios = (_along(tables.axes, values, at, method)
                                       for values in (tables.sigma_s, tables.sigma_a, tables.phase, tables.ratios))
    table = phase.normalised(tables.theta, table)[0]
    return Optics(tables.theta, sigma_s, sigma_a, np.concatenate([table[:, None], ratios * table[:, None]], axis=1))


def _stencil(nodes: np.ndarray, at: float, method: str) -> slice:
    """The nodes that count at a coordinate."""
    nearest = int(np.argmin(np.abs(nodes - at)))
    if abs(nodes[nearest] - at) <= SAME * max(np.ptp(nodes), abs(at), abs(nodes[nearest])):
        return slice(nearest, nearest + 1)
    i = min(max(int(np.searchsorted(nodes, at)) - 1, 0), len(nodes) - 2)
    # a monotone cubic takes its slopes from one node on either side
    return slice(i, i + 2) if method == "linear" else slice(max(i - 1, 0), i + 3)


def _along(axes, values, at, method: str) -> np.ndarray:
    from scipy.interpolate import PchipInterpolator

    for nodes, where in zip(axes, at, strict=True):
        part = _stencil(nodes, where, method)
        x, y = nodes[part], values[part]
        if len(x) == 1:
            values = y[0]
            continue
        positive = (y > 0).all(axis=0)
        y = np.where(positive, np.log(np.where(positive, y, 1.0)), y)
        if len(x) == 2:
            share = (where - x[0]) / (x[1] - x[0])
            y = (1 - share) * y[0] + share * y[1]
        else:
            y = PchipInterpolator(x, y, axis=0)(where)
        values = np.where(positive, np.exp(np.where(positive, y, 0.0)), y)
    return values


def difference(medium: Optics, truth: Optics, integrated: bool) -> float:
    """Largest error of a medium.

    Relative of sigma_t and sigma_s, absolute of albedo and mean cosine, and of the phase function (and s12, s33, s34 in its
    scale) relative at any angle, beyond the error that the truth is known to have there, or, `integrated`, the integral of the
    error over the sphere.
    """
    errors = [_relative(medium.sigma_s, truth.sigma_s),
              _relative(medium.sigma_s + medium.sigma_a, truth.sigma_s + truth.sigma_a),
              float(np.abs(_albedo(medium) - _albedo(truth)).max())]
    g, g_true = (phase.mean_cosine(table.theta, table.elements[:, 0]) for table in (medium, truth))
    errors.append(float(np.abs(g - g_true).max()))
    theta = np.union1d(medium.theta, truth.theta)
    at, right = (phase.phase_at(table.theta, table.elements, theta) for table in (medium, truth))
    gap = np.abs(at - right)
    if integrated:
        return max(*errors, float(phase.phase_integral(theta, gap).max()))
    bias = 0.0 if truth.bias is None else phase.phase_at(truth.theta, truth.bias, theta)[:, None]
    return max(*errors, _largest(np.maximum(gap - bias, 0.0), np.broadcast_to(right[:, :1], gap.shape)))


def _albedo(medium: Optics) -> np.ndarray:
    sigma_t = medium.sigma_s + medium.sigma_a
    return np.divide(medium.sigma_s, sigma_t, out=np.zeros_like(sigma_t), where=sigma_t > 0)


def _relative(value, truth) -> float:
    return _largest(np.abs(value - truth), truth)


def _largest(gap, scale) -> float:
    """The largest of gap / scale; a gap where the scale is 0 is infinite."""
    return float(np.divide(gap, scale, out=np.where(gap > 0, np.inf, 0.0), where=scale > 0).max())
