"""A medium as solvers of discrete ordinates take it: Legendre moments, single-scattering albedo, optical depth."""

import io
from dataclasses import dataclass

import numpy as np

from bakery.export.medium import Scattering
from bakery.physics.moments import MOST, legendre_moments, legendre_series, series_error

_OF_ANGLES = 0.1  # of the tolerance: at single angles a series is some ten times as far off as its integral over all
FEWEST = 128  # orders that are always there, so that delta-M finds the one behind the last of up to 128 streams


@dataclass(frozen=True)
class Ordinates:
    """A medium by moments."""

    wavelength: np.ndarray  # (L,) um, in vacuum
    sigma_t: np.ndarray  # (L,) 1/m
    omega: np.ndarray  # (L,) 1, single-scattering albedo
    moments: np.ndarray  # (L, N + 1) 1, chi_l of the phase function without the factor 2 l + 1; chi_0 = 1, chi_1 = g
    cut: np.ndarray  # (L,) 1, integral over the sphere of |phase function - series|, a share of the scattered light
    # mu, phase: (A,) 1, cosine of the scattering angle, ascending; (L, A) 1, phase function with the integral 2 over mu
    mu: np.ndarray
    phase: np.ndarray
    thickness: np.ndarray | None = None  # (T,) m

    @property
    def tau(self) -> np.ndarray:
        """(L, T) optical depths; (L,) of a single thickness."""
        depths = np.outer(self.sigma_t, self.thickness)
        return depths[:, 0] if len(self.thickness) == 1 else depths


def ordinates(wavelength, medium: Scattering, tolerance: float, thickness=None, orders: int | None = None) -> Ordinates:
    """A medium by as many moments as a tolerance needs.

    wavelength : (L,) um
    medium : without its forward delta
    tolerance : 1, of the asset; the integral of what is cut is at most a tenth of it, if `MOST` moments do
    thickness : (T,) m of layers
    orders : the highest moment, whatever is cut; None: as many as the tolerance needs, `FEWEST` or more
    """
    if orders is None:
        series = legendre_series(medium.theta, medium.phase, _OF_ANGLES * tolerance, MOST)
        orders, cut = series.moments.shape[-1] - 1, series.cut
    else:
        cut = series_error(medium.theta, medium.phase, orders)
    moments = legendre_moments(medium.theta, medium.phase, max(orders, FEWEST))
    moments /= moments[:, :1]  # 1 to the last bit, as PythonicDISORT asks for
    mu = np.cos(medium.theta)[::-1]
    return Ordinates(np.asarray(wavelength, float), medium.sigma_t, medium.albedo, moments, cut, mu,
                     4 * np.pi * medium.phase[:, ::-1], thickness)


def npz(medium: Ordinates) -> bytes:
    """The arrays of a medium as a file for `numpy.load`."""
    names = ("wavelength", "sigma_t", "omega", "moments", "cut", "mu", "phase")
    arrays = {name: getattr(medium, name) for name in names}
    if medium.thickness is not None:
        arrays |= {"thickness": medium.thickness, "tau": medium.tau}
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()
