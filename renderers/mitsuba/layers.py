"""Baked layers as plugins take them: tables of the wavelengths in play, and cells by which directions are drawn.

Directions are drawn from a table of its own: constant in cells of both directions and the azimuth, times the cosine, with the
mean of all wavelengths.  Its density is exact for what is drawn, so that it may be coarse.
"""

import functools
import math
from typing import NamedTuple

import numpy as np

from bakery.errors import UsageError
from bakery.kernels import surface_reflectance, surface_transmittance
from bakery.system.compiled import njit
from renderers.mitsuba.tables import open_asset, state_of, weights

CELLS = 32  # of each direction and of the azimuth; a power of two, as they are looked for by halving
_EVEN = 0.1  # share of directions that are drawn by the cosine alone
_INSIDE = np.array([0.25, 0.75])  # places in a cell, for each of its three sides, at which its mean is taken
_SHARES = 65  # incident directions at which shares of the lobes are known
_PLACES = 48  # cosines and azimuths by which these are integrated
_GAIN = 0.02  # light that a layer may send on beyond what it gets, because of the forward peak


class Layer(NamedTuple):
    """One layer of an asset.

    wavelength : (L,) um;  table : `asset.surface.table()`'s;  error : its largest, relative
    table_below : of light from below, where that is another one: of layers on each other over air
    """

    wavelength: np.ndarray
    table: object
    error: float
    table_below: object = None

    @property
    def rough(self) -> bool:
        return self.table.roughness > 0.0

    @property
    def mirrors(self) -> bool:
        """Whether a smooth boundary mirrors light, the uppermost one or one that it reaches unscattered."""
        return self.table.index != 1.0 and not self.rough or bool(np.any(self.table.mirrored > 0))

    @property
    def from_below(self) -> "Layer":
        """As light from below meets it."""
        return self._replace(table=self.table_below, table_below=None)


class Cells(NamedTuple):
    """What directions are drawn by: x is the coordinate of an incident direction whose `cosine` it has.

    below_mu : (2, C, C + 1) chance of a cosine in a cell before, reflected and transmitted, of incident cells of x
    below_phi : (2, C, C, C + 1) of an azimuth, for each cell of cosines
    density : (2, C, C, C) 1/sr over the cosine
    mu : (C + 1,) cosines at the sides of cells;  phi : (C + 1,) rad, azimuths
    shares : (3, S) reflected, transmitted, and what facets reflect once, of the incident light, at equal steps of x
    """

    below_mu: np.ndarray
    below_phi: np.ndarray
    density: np.ndarray
    mu: np.ndarray
    phi: np.ndarray
    shares: np.ndarray


def load(path, layer: int) -> Layer:
    """A layer of an asset file; kept in memory until the file changes."""
    return _load(layer, *state_of(path))


@functools.lru_cache(maxsize=8)
def _load(layer, path, modified, size) -> Layer:
    return layer_of(open_asset(path, ("surface",)), layer)


def layer_of(asset, layer: int = 0) -> Layer:
    """Of an opened asset; UsageError where it has no such layer, or its transmittance is no use, as its forward peak deflects
    light several times."""
    table, errors = asset.surface.table(layer)
    result = Layer(np.asarray(asset.wavelength, float), table, errors.largest)
    if table.free and table.straight.size:
        below, errors_below = asset.surface.table(layer, from_below=True)
        result = result._replace(table_below=below, error=max(errors.largest, errors_below.largest))
    gain = max(gained(side) for side in (table, result.table_below) if side is not None)
    if gain > _GAIN:
        raise UsageError(f"layer {layer} sends on {100 * gain:.2g} % more light than it gets: its forward peak deflects light "
                         "several times, which is counted as if once; use a thicker or a thinner layer, or a base")
    return result


def gained(table) -> float:
    """Largest share of light from a direction that a free layer sends on too much, because of its forward peak."""
    if not table.free:
        return 0.0
    if table.straight.size:
        return float(np.max(-table.straight, initial=0.0))
    path = np.geomspace(1, 1e3, 200)
    return float(np.max((table.peak[:, None] * path - 1) * np.exp(-table.depth[:, None] * path), initial=0.0))


def cosine(x):
    """The cosine at a coordinate."""
    return (1 - (1 - np.asarray(x, float)) ** 2) ** 2


def azimuth(x):
    """Of a coordinate 0 to 1, rad: `look_up`'s, which takes no inverse functions."""
    return 0.5 * math.pi + 2 * np.arcsin((2 * np.asarray(x, float) - 1) * math.sqrt(0.5))


def for_channels(layer: Layer, weights) -> tuple[Layer, list]:
    """A layer of the wavelengths in play, and of each channel its rows and their weights; weights : (N, L), rows add up to 1."""
    if np.isinf(layer.table.depth).all() or layer.rough:
        table = layer.table.combined(weights)
        return layer._replace(table=table, wavelength=weights @ layer.wavelength), [[(row, 1.0)] for row in range(len(weights))]
    return layer, [[(int(row), float(weight)) for row, weight in enumerate(channel) if weight > 0] for channel in weights]


def selected(layer: Layer, channel: int, wavelength: float | None, bands: str) -> tuple[Layer, list]:
    """The same for the parameters of a plugin, as `renderers.mitsuba.tables.weights` takes them; of `spectral` rows are in order
    of the wavelength."""
    weight = weights("bakedbsdf", layer.wavelength, channel, wavelength, bands)
    if weight is not None:
        return for_channels(layer, weight)
    order = np.argsort(layer.wavelength)
    names = ("depth", "once", "peak", "base", "phase", "reflected", "mirrored", "straight")
    table = layer.table._replace(**{name: getattr(layer.table, name)[order] for name in names})
    if table.free:
        table = table._replace(transmitted=table.transmitted[order])
    return layer._replace(wavelength=layer.wavelength[order], table=table), []


def cells_of(layer: Layer) -> Cells:
    """Cells, by the mean of all rows of the table."""
    mu, phi = cosine(np.linspace(0, 1, CELLS + 1)), azimuth(np.linspace(0, 1, CELLS + 1))
    area = np.outer(np.diff(mu**2), np.diff(phi))  # of cells on both sides of the plane of incidence, times the cosine
    at = ((np.arange(CELLS)[:, None] + _INSIDE) / CELLS).ravel()
    # what facets reflect once is drawn by facets
    smooth = layer.table._replace(index=1.0) if layer.rough else layer.table
    values = np.empty((2, CELLS, 2 * CELLS, 2 * CELLS))
    _means(smooth, cosine((np.arange(CELLS) + 0.5) / CELLS), cosine(at), np.cos(azimuth(at)), values)
    mass = values.reshape(2, CELLS, CELLS, 2, CELLS, 2).mean(axis=(3, 5)) * area
    total = mass.sum(axis=(2, 3), keepdims=True)
    mass = (1 - _EVEN) * mass / np.where(total > 0, total, 1) + np.where(total > 0, _EVEN, 1.0) * area / area.sum()
    mass /= mass.sum(axis=(2, 3), keepdims=True)
    of_mu = mass.sum(axis=3)
    return Cells(_cumulative(of_mu), _cumulative(mass / of_mu[..., None]), mass / area, mu, phi, _shares(layer.table, smooth))


def _cumulative(mass):
    total = np.concatenate([np.zeros((*mass.shape[:-1], 1)), np.cumsum(mass, axis=-1)], axis=-1)
    total[..., -1] = 1.0
    return total


def _shares(table, smooth):
    """(3, S) as `Cells.shares`, of incident directions to some 0.01 of grazing."""
    x, weight = np.polynomial.legendre.leggauss(_PLACES)
    x, weight = 0.5 * (1 + x), 0.5 * weight
    mu, slope = cosine(x), 4 * (1 - (1 - x) ** 2) * (1 - x)
    incident = np.maximum(cosine(np.linspace(0, 1, _SHARES)), 1e-4)
    integrals = np.empty((2, 2, _SHARES, _PLACES, _PLACES))
    for part, values in zip((smooth, table), integrals, strict=True):
        _means(part, incident, mu, np.cos(math.pi * x), values)
    reflected, transmitted = integrals[0] @ weight @ (2 * mu * slope * weight)
    return np.stack([reflected, transmitted, integrals[1, 0] @ weight @ (2 * mu * slope * weight) - reflected]).clip(0, 1)


@njit(cache=True, nogil=True, error_model="numpy")
def _means(table, mu0, mu, cos_phi, values):
    """Reflectance and transmittance (2, I, M, P), means over the wavelengths."""
    count = len(table.once)
    for i in range(len(mu0)):
        for j in range(len(mu)):
            for k in range(len(cos_phi)):
                back, through = 0.0, 0.0
                for wave in range(count):
                    back += surface_reflectance(table, wave, mu[j], mu0[i], cos_phi[k])
                    through += surface_transmittance(table, wave, mu[j], mu0[i], cos_phi[k])
                values[0, i, j, k], values[1, i, j, k] = back / count, through / count
