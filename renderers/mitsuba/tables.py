"""Phase functions of an asset as tables in s = sin^2(theta/2), ready for look-up and exact sampling.

The asset's phase function is linear in cos(theta) between its angles, hence linear in s = (1 - cos(theta)) / 2, with
dOmega = 2 ds dphi.  s keeps its relative precision in the forward direction, where float32 cosines resolve 0.02 degrees only.
"""

from __future__ import annotations

import functools
import os
from dataclasses import dataclass, replace

import numpy as np

from bakery.errors import AssetError, UsageError
from renderers import colour

ELEMENTS = ("s12", "s33", "s34")


@dataclass(frozen=True)
class Tables:
    """Phase functions on common nodes.

    wavelength : (L,) um, as in the asset
    sigma_s : (L,) 1/m, weights wherever tables are averaged
    s : (A,) 1, float32 values, strictly ascending from 0 (forward) to 1 (backward)
    value : (L, A) 1/sr, linear in s between the nodes; 4 pi times the integral over s is 1 to rounding
    elements : None or (3, L, A) 1/sr, Mueller elements s12, s33, s34 (s11 is `value`)
    """

    wavelength: np.ndarray
    sigma_s: np.ndarray
    s: np.ndarray
    value: np.ndarray
    elements: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.value)

    def combined(self, weight) -> Tables:
        """Tables that are means over wavelengths with (N, L) weights, which are scaled to add up to 1 in each row."""
        weight = np.atleast_2d(weight)
        weight = weight / weight.sum(axis=1, keepdims=True)
        elements = None if self.elements is None else np.einsum("nl,ela->ena", weight, self.elements)
        return replace(self, wavelength=weight @ self.wavelength, sigma_s=weight @ self.sigma_s,
                       value=np.einsum("nl,la->na", weight, self.value), elements=elements)

    def selected(self, channel=-1, wavelength=None, bands="mono") -> Tables:
        """Those that parameters of a plugin ask for, see `weights`, weighted by sigma_s where they are of several wavelengths; of
        `spectral` all, in ascending order."""
        weight = weights("bakedphase", self.wavelength, channel, wavelength, bands)
        if weight is not None:
            return self.combined(weight * self.sigma_s if channel == -1 and wavelength is None else weight)
        order = np.argsort(self.wavelength)
        return replace(self, wavelength=self.wavelength[order], sigma_s=self.sigma_s[order], value=self.value[order],
                       elements=None if self.elements is None else self.elements[:, order])

    def cdf(self) -> np.ndarray:
        """(L, A) 1, integral of `value` over the sphere from s = 0, exact for the interpolant; ends at 1."""
        area = 2 * np.pi * (self.value[:, 1:] + self.value[:, :-1]) * np.diff(self.s)
        cdf = np.concatenate([np.zeros((len(self), 1)), np.cumsum(area, axis=1)], axis=1)
        return cdf / cdf[:, -1:]


def weights(plugin, knots, channel, wavelength, bands):
    """(N, L) weights of an asset's L wavelengths in the N channels that a plugin is asked for; None: each ray has its own.

    plugin : its name, for messages
    knots : (L,) um, of the asset
    channel, wavelength : parameters of the plugin: position of one wavelength, -1: all;  um of one, clamped, or None
    bands : mono, rgb or spectral, of the variant

    Raises UsageError where there is no such channel or wavelength.
    """
    count = len(knots)
    if wavelength is not None:
        if not wavelength > 0:
            raise UsageError(f"{plugin}: wavelength {wavelength:g}: give micrometres, 0.55 for instance")
        return colour.interpolate(knots, wavelength)
    if channel != -1:
        if not 0 <= channel < count:
            raise UsageError(f"{plugin}: channel {channel}: the asset has {count} wavelengths; give 0 to {count - 1}, or -1 for "
                             "all")
        return np.eye(count)[[channel]]
    if bands == "mono":
        return np.full((1, count), 1 / count)
    return None if bands == "spectral" else np.ones((1, 1)) if count == 1 else colour.band_matrix(knots)


def tables_from(asset) -> Tables:
    """The tables of anything that has `wavelength` and `medium` with `theta`, `phase(theta)`, `sigma_t`, `albedo`.

    Angles whose s falls on the same float32 number (backward of 179.97 degrees, or closer than 1e-7 relative) are merged:
    the first is kept, and the last at theta = pi.  The tables are then scaled so that the interpolant on the float32 nodes
    integrates to 1; at size parameter 1000 the scale differs from 1 by less than 1e-6.
    """
    medium = asset.medium
    theta = np.asarray(medium.theta, dtype=float)
    value = np.asarray(medium.phase(theta), dtype=float)
    s = np.sin(theta / 2) ** 2
    single = s.astype(np.float32).astype(float)
    single[0], single[-1] = 0.0, 1.0
    keep = np.flatnonzero(np.concatenate([[True], np.diff(single) > 0]))
    keep[-1] = theta.size - 1 if single[keep[-1]] == 1.0 else keep[-1]
    names = [getattr(medium, name, None) for name in ELEMENTS]
    elements = None if any(array is None for array in names) else np.array(names, dtype=float)[:, :, keep]
    wavelength = np.asarray(asset.wavelength, dtype=float)
    sigma_s = np.asarray(medium.sigma_t, dtype=float) * np.asarray(medium.albedo, dtype=float)
    # Where nothing scatters there still is a table; a weight next to nothing keeps its means defined.
    sigma_s = sigma_s if np.all(sigma_s > 0) else sigma_s + 1e-12 * max(sigma_s.max(), 1.0)
    tables = Tables(wavelength, sigma_s, single[keep], value[:, keep], elements)
    scale = 2 * np.pi * np.sum((tables.value[:, 1:] + tables.value[:, :-1]) * np.diff(tables.s), axis=1)
    if not (np.all(np.isfinite(scale)) and np.all(np.abs(scale - 1) < 1e-2) and np.all(tables.value >= 0)):
        raise AssetError(f"medium/phase is no phase function: it integrates to {scale} over the sphere; 1 is right; "
                         "run `bake verify` on the asset")
    return replace(tables, value=tables.value / scale[:, None],
                   elements=None if elements is None else elements / scale[None, :, None])


def open_asset(path, stages=("medium",)):
    """`bakery.open`; raises AssetError, naming a stage and how to bake it, where the asset has none of `stages`."""
    import bakery

    asset = bakery.open(path)
    if not any(stage in asset.stages for stage in stages):
        _ = getattr(asset, stages[-1])  # raises where there is none
    return asset


def load(path) -> Tables:
    """The tables of an asset file; kept in memory until the file changes."""
    return _load(*state_of(path))


def state_of(path) -> tuple[str, int, int]:
    """An asset file's path, time and size; AssetError where it cannot be read."""
    try:
        state = os.stat(path)
    except OSError as error:
        raise AssetError(f"{path}: cannot be read: {error.strerror}; give the path of a baked asset, "
                         "`bake RECIPE` makes one") from None
    return os.path.abspath(path), state.st_mtime_ns, state.st_size


@functools.lru_cache(maxsize=16)
def _load(path, modified, size):
    return tables_from(open_asset(path))
