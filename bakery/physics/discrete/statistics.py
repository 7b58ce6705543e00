"""How far a realisation is from its law: counts in cells and in classes, mean cross sections, and what chance does to each."""

import math
from typing import NamedTuple

import numpy as np
from scipy import special

LEAST = 5.0  # expected particles of a bin; smaller bins are put together
_CELLS = 4096  # at most
_PER_CELL = 10.0  # particles that a cell aims at
_FINE = 8  # points along an edge of a cell that tell whether it lies inside of a mesh
_STEPS = 60  # of a histogram
_CHUNK = 1 << 20


class Figure(NamedTuple):
    """A value and its standard error."""

    value: float
    error: float


def dispersion(observed, probability) -> Figure | None:
    """Pearson's sum of squared deviations over its expectation: 1 for independent particles, and its standard error.

    observed : (B,) particles in each bin
    probability : (B,) of each bin, adds up to 1

    Returns None where fewer than two bins are expected to hold `LEAST` particles.

    For bins of equal probability it is the variance of the counts over their mean (Fisher's index of dispersion).  The error is
    exact: Var X^2 = 2 (B - 1) + (sum 1/p - B^2 - 2 B + 2) / N (Haldane 1937, Biometrika 29, 133).
    """
    observed, probability = np.asarray(observed, float), np.asarray(probability, float)
    total = observed.sum()
    large = total * probability >= LEAST
    if not large.all():  # all small ones are one bin, if that is large enough
        pooled = observed[~large].sum(), probability[~large].sum()
        observed, probability = observed[large], probability[large]
        if total * pooled[1] >= LEAST:
            observed, probability = np.append(observed, pooled[0]), np.append(probability, pooled[1])
        else:
            total = observed.sum()
        probability = probability / probability.sum() if probability.size else probability
    bins = len(observed)
    if bins < 2:
        return None
    expected = total * probability
    square = float(np.sum((observed - expected) ** 2 / expected))
    variance = 2 * (bins - 1) + (float(np.sum(1 / probability)) - bins**2 - 2 * bins + 2) / total
    return Figure(square / (bins - 1), math.sqrt(variance) / (bins - 1))


def histogram(observed, probability):
    """How many bins hold how many particles, beside the Poisson law of their expectations.

    Parameters
    ----------
    observed, probability : (B,) as `dispersion` takes them

    Returns
    -------
    edge : (H + 1,) whole numbers of particles: from each to before the next, at most some 60 steps
    bins, law : (H,) bins that hold so many, and how many are expected to
    """
    expected = np.sum(observed) * probability
    low = max(0, math.floor(min(observed.min(), expected.min() - 4 * math.sqrt(expected.min()))))
    high = math.ceil(max(observed.max(), expected.max() + 4 * math.sqrt(expected.max()))) + 1
    edge = np.arange(low, high + (step := math.ceil((high - low) / _STEPS)), step)
    below = np.array([special.pdtr(k - 1, expected).sum() if k else 0.0 for k in edge.tolist()])
    return edge, np.histogram(observed, edge - 0.5)[0], np.diff(below)


def in_cells(region, position):
    """Particles in each of some thousand cells, and the share of all particles that each expects: what `dispersion` takes.

    region : `bakery.physics.discrete.realise.Region`
    position : (N, 3) m, inside its box

    Shares are exact.  Of a mesh, cells that its surface cuts are one bin with all that lies outside of the others.
    """
    cells = _lattice(region, len(position))
    counted = _counts(position, region.edge, cells).ravel()
    if region.density is not None:
        # the integral of a trilinear density over each cell over that of the box
        along = [_hats(n, length) for n, length in zip(cells, region.density.shape)]
        shares = np.einsum("ai,bj,ck,ijk->abc", *along, region.density.astype(float), optimize=True)
        return counted, (shares / region.density.mean(dtype=float)).ravel()
    if region.vertices is None:
        return counted, np.full(counted.size, 1 / counted.size)
    full = _inside(region, cells).ravel()
    share = math.prod(region.edge) / counted.size / region.volume
    return np.append(counted[full], counted[~full].sum()), np.append(np.full(full.sum(), share), 1 - full.sum() * share)


def _lattice(region, number):
    """Cells (3,): about ten particles each, at most 4096, as cubic as the box allows."""
    wanted = min(max(number * math.prod(region.edge) / region.volume / _PER_CELL, 1.0), _CELLS)
    side = (math.prod(region.edge) / wanted) ** (1 / 3)
    return tuple(int(min(max(1, round(length / side)), _CELLS)) for length in region.edge)


def _counts(position, edge, cells):
    """Particles in each cell (X, Y, Z), a chunk of places at a time."""
    out = np.zeros(math.prod(cells), np.int64)
    scale = np.array(cells) / np.array(edge)
    for start in range(0, len(position), _CHUNK):
        at = np.minimum((position[start:start + _CHUNK] * scale).astype(np.int64), np.array(cells) - 1)
        out += np.bincount(np.ravel_multi_index(at.T, cells), minlength=len(out))
    return out.reshape(cells)


def _hats(cells, values):
    """Integrals (cells, values) of the interpolant's hats over each cell of a line of length 1."""
    middle = (np.arange(values) + 0.5) / values
    wall = np.arange(cells + 1) / cells
    at = np.union1d(wall, middle)
    hat = np.stack([np.interp(at, middle, row) for row in np.eye(values)], axis=1)
    piece = np.diff(at)[:, None] * (hat[1:] + hat[:-1]) / 2  # exact: linear between the points
    out = np.zeros((cells, values))
    np.add.at(out, np.clip(np.searchsorted(wall, (at[1:] + at[:-1]) / 2) - 1, 0, cells - 1), piece)
    return out


def _inside(region, cells):
    """Which cells (X, Y, Z) lie inside of a mesh, by `_FINE`^3 points of each."""
    out = np.empty(cells, bool)
    at = [np.linspace(0, length, n * (_FINE - 1) + 1) for n, length in zip(cells, region.edge)]
    for i in range(cells[0]):
        x, y, z = np.meshgrid(at[0][(_FINE - 1) * i:(_FINE - 1) * (i + 1) + 1], at[1], at[2], indexing="ij")
        inside = region.at(np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)).reshape(x.shape).all(axis=0)
        rows = np.logical_and.reduceat(inside, np.arange(cells[1]) * (_FINE - 1), axis=0)
        out[i] = np.logical_and.reduceat(rows, np.arange(cells[2]) * (_FINE - 1), axis=1)
    return out


def mean_cross_section(number, share, cross_section):
    """Mean cross section of the particles that are there, its standard error about the law, and the law's, (L,) each.

    number : (K,) particles of each class;  share : (K,) that the law expects, adds up to 1
    cross_section : (L, K) mean of each class

    The classes' own means stand for their particles, so the error is that of the classes' numbers alone.
    """
    number, share = np.asarray(number, float), np.asarray(share, float)
    law = cross_section @ share
    mean = cross_section @ number / max(number.sum(), 1.0)
    variance = np.maximum(cross_section**2 @ share - law**2, 0.0)
    return mean, np.sqrt(variance / max(number.sum(), 1.0)), law
