"""A medium as other software takes it: without what leaves a collision in its old direction."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from bakery.errors import AssetError
from bakery.stages.optics.elements import ELEMENTS
from bakery.store.tree import Dataset, Group

_LOOSE = 1e-3  # relative, or of 1: coefficients and tables by other hands may be rounded


def medium_of(root: Group, name: str) -> Group:
    """The group that a renderer needs; AssetError, naming the asset, where there is none."""
    medium = root.members.get("medium")
    if not isinstance(medium, Group):
        raise AssetError(f"{name}: holds no stage `medium`, which a renderer needs; bake it from a recipe with `particles`, "
                         "`grains` or `medium`")
    return medium


def impossible(medium: Group) -> Iterator[str]:
    """What no program can compute with, in words that begin with the dataset; `bake verify` is a thousand times as strict."""
    from bakery.physics.medium.phase import phase_integral

    sigma_t, sigma_s, albedo, theta, phase, cdf = (
        np.asarray(medium[name].data, float) for name in ("sigma_t", "sigma_s", "albedo", "theta", "phase", "cdf"))
    if not np.allclose(albedo * sigma_t, sigma_s, rtol=_LOOSE, atol=0):
        yield "medium/sigma_s: is not albedo times sigma_t"
    if not np.allclose(phase_integral(theta, phase), 1, rtol=0, atol=_LOOSE):
        yield "medium/phase: does not integrate to 1 over the sphere"
    if (np.diff(cdf) < 0).any() or not np.allclose(cdf[:, [0, -1]], [0, 1], rtol=0, atol=_LOOSE):
        yield "medium/cdf: does not rise from 0 to 1"


@dataclass(frozen=True)
class Scattering:
    """A medium as other software takes it: light that leaves a collision in its old direction counts as unscattered."""

    # sigma_t, sigma_s: (L,) 1/m
    sigma_t: np.ndarray
    sigma_s: np.ndarray
    # theta, phase: (A,) rad, (L, A) 1/sr, linear in cos theta between the angles, integrating to 1
    theta: np.ndarray
    phase: np.ndarray
    delta: np.ndarray  # (L,) 1, forward delta, the share of the asset's scattered light that was taken out; exact
    peak: np.ndarray  # (L,) 1, share of what is then scattered that was taken out by `without_peak`, an approximation
    within: float = 0.0  # rad, largest deflection in that peak
    # (L, 3, A) 1/sr, elements s12, s33, s34 of the scattering matrix in the scale of phase, as docs/conventions.md says; None
    # where the asset lacks them, or its medium had a delta
    matrix: np.ndarray | None = None

    @property
    def albedo(self) -> np.ndarray:
        """(L,) sigma_s / sigma_t, 0 where there is nothing."""
        return np.divide(self.sigma_s, self.sigma_t, out=np.zeros_like(self.sigma_t), where=self.sigma_t > 0)

    def at(self, rows: slice | np.ndarray) -> Scattering:
        """Some of its wavelengths, or all in another order."""
        by_wavelength = ("sigma_t", "sigma_s", "phase", "delta", "peak", *(() if self.matrix is None else ("matrix",)))
        return replace(self, **{name: getattr(self, name)[rows] for name in by_wavelength})


def scattering_of(medium: Group) -> Scattering:
    """A medium without its forward delta, which the tables of packed grains hold as a peak at their first angle.

    Exact, see `bakery.physics.medium.similarity.without_delta`.  No regular grid resolves that peak.
    """
    from bakery.physics.medium.similarity import without_delta

    sigma_t, sigma_s, theta, phase = (medium[name].data for name in ("sigma_t", "sigma_s", "theta", "phase"))
    share = medium.members.get("forward_delta")
    if not isinstance(share, Dataset) or share.data.shape != sigma_t.shape or not share.data.any():
        return Scattering(sigma_t, sigma_s, theta, phase, np.zeros_like(sigma_t), np.zeros_like(sigma_t), matrix=_matrix(medium))
    delta = np.clip(share.data, 0.0, 1.0)
    sigma_t, sigma_s, phase = without_delta(sigma_t, sigma_s, theta, phase, delta)
    return Scattering(sigma_t, sigma_s, theta, phase, delta, np.zeros_like(sigma_t))


def _matrix(medium: Group) -> np.ndarray | None:
    """Elements s12, s33, s34 of a group `medium`, where it has all of them."""
    if not all(isinstance(medium.members.get(name), Dataset) for name in ELEMENTS):
        return None
    return np.stack([medium[name].data for name in ELEMENTS], axis=1)


def without_peak(medium: Scattering, end: int) -> Scattering:
    """A medium whose forward peak counts as unscattered: what exceeds the value at an angle, at smaller angles.

    medium : without such a cut
    end : index of that angle in `theta`; 0 changes nothing

    An approximation, unlike `scattering_of`: that light is deflected, by less than the angle, and is no longer.  The cap is flat,
    so that what remains is continuous and no smaller than it was at larger angles.
    """
    from bakery.physics.medium.phase import normalised, phase_integral

    smooth = medium.phase.copy()
    smooth[:, :end] = np.minimum(smooth[:, :end], smooth[:, end:end + 1])
    peak = np.clip(1 - phase_integral(medium.theta, smooth), 0.0, 1.0)
    return replace(medium, sigma_t=medium.sigma_t - peak * medium.sigma_s, sigma_s=(1 - peak) * medium.sigma_s,
                   phase=normalised(medium.theta, smooth)[0], peak=peak, within=float(medium.theta[end]), matrix=None)
