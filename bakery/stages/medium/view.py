"""What the group `medium` can be asked: its phase function at any angle, and the same medium without its forward delta."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bakery.physics.medium.similarity import without_delta
from bakery.physics.moments import Expansion, Series
from bakery.stages.coordinates import wavelengths
from bakery.stages.medium import expansion
from bakery.stages.medium.between import at_wavelengths
from bakery.stages.members import Members, Phase
from bakery.stages.optics.quantities import table
from bakery.stages.optics.quantity_table import QuantityTable
from bakery.store.tree import Dataset, Group


def view(root: Group) -> Medium:
    """The group as `bakery.open` gives it."""
    return Medium(root["medium"], "medium", wavelength=root["wavelength"].data)


def _alone(group: Group, wavelength) -> Group:
    """The tree of a medium and nothing else."""
    return Group({"wavelength": Dataset(np.asarray(wavelength, float), "um", "wavelengths in vacuum"), "medium": group})


@dataclass(frozen=True)
class Deflecting:
    """A medium whose every scattering event deflects.

    Attributes
    ----------
    sigma_t : (L,) 1/m
    albedo : (L,) 1, 0 where nothing is left
    phase : can be called with angles; integrates to 1
    """

    sigma_t: np.ndarray
    albedo: np.ndarray
    phase: Phase


class Medium(Members):
    """The group `medium`: coefficients and phase function.

    Attributes
    ----------
    phase : can be called with angles, and wavelengths between the baked ones, and drawn: `phase.plot()`
    """

    def at(self, wavelength) -> Medium:
        """The medium at one or more wavelengths between the baked ones: its members are those of this one, over (W,) wavelengths.

        Parameters
        ----------
        wavelength : um, a number or several, or text with its unit, `"500 nm"`

        Returns
        -------
        medium : `bias` of each figure (`medium.at(0.5).bias["g"]`) is its error as baked and what the interpolation adds, as
            leaving out neighbouring wavelengths shows it; not a number where only two are baked, for nothing is known then

        Raises
        ------
        UsageError : a wavelength outside of the baked ones

        Examples
        --------
        >>> asset.medium.at("500 nm").sigma_t                                                       # doctest: +SKIP
        """
        wanted = np.atleast_1d(wavelengths(wavelength, self._wavelength))
        group = at_wavelengths(self._group, np.asarray(self._wavelength), wanted)
        medium = Medium(group, self._path, wavelength=wanted)
        if self._labelled is not None:
            medium.within(_alone(group, wanted), self._labelled)
        return medium

    def table(self, length=None, density=None, wavelength=None) -> QuantityTable:
        """The optical quantities of the medium, as `asset.optics.table` gives them where there are particles."""
        return table(self._root or _alone(self._group, self._wavelength), length, density, wavelength)

    def moments(self, orders: int | None = None, tolerance: float | None = None) -> Series:
        """Legendre moments chi_l of the phase function, (L, N + 1), chi_0 = 1 and chi_1 = g, and what is cut with the others.

        Parameters
        ----------
        orders : the highest l; or else
        tolerance : 1, largest integral over the sphere of |phase - its series|; by default the tolerance of the bake

        See `bakery.physics.moments.legendre_moments`.
        """
        return expansion.moments(self._group, orders, tolerance)

    def expansion(self, orders: int | None = None, tolerance: float | None = None) -> Expansion:
        """Coefficients of the scattering matrix in generalised spherical functions, alpha1 to beta2, (L, N + 1) each.

        Arguments as of `moments`; UsageError where the asset lacks s12, s33 and s34.
        See `bakery.physics.moments.expansion_coefficients`.
        """
        return expansion.expansion(self._group, orders, tolerance)

    def without_delta(self) -> Deflecting:
        """The medium without unscattered (delta) transmission, a peak that no regular grid resolves; itself where it has none.

        Exact: see `bakery.physics.medium.similarity.without_delta`.
        """
        sigma_t, sigma_s, phase = (np.asarray(self[name], float) for name in ("sigma_t", "sigma_s", "phase"))
        if "forward_delta" in self:
            delta = np.asarray(self["forward_delta"], float)
            sigma_t, sigma_s, phase = without_delta(sigma_t, sigma_s, self.theta, phase, delta)
        albedo = np.divide(sigma_s, sigma_t, out=np.zeros_like(sigma_t), where=sigma_t > 0)
        return Deflecting(sigma_t, albedo, Phase(self.theta, phase, wavelength=self._wavelength))
