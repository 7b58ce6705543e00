"""Wavelengths that all materials of a scene are rendered at: those of their assets, or three bands where these differ."""

import math
from typing import NamedTuple

import numpy as np

from bakery import kernels
from renderers import colour
from renderers.materials.particles.medium import in_bands
from renderers.transport.paths import Colours
from renderers.transport.scattering import Scatterer, scatterer

BANDS = ("the assets have different wavelengths: all are rendered as means over red, green and blue, with an unknown bias; "
         "with the same wavelengths in all recipes, such as rgb, each is kept")


class Spectra(NamedTuple):
    """Of assets, of none linear sRGB; bands : whether their wavelengths differ."""

    colours: Colours
    bands: bool

    @classmethod
    def of(cls, assets) -> "Spectra":
        if not assets:
            return cls(Colours(np.eye(3), np.eye(3)), False)
        waves = [np.asarray(asset.wavelength, float) for asset in assets]
        if any(not np.array_equal(wavelengths, waves[0]) for wavelengths in waves):
            return cls(Colours(np.eye(3), np.eye(3)), True)
        return cls(Colours.of(waves[0]), False)

    def _matrix(self, asset):
        return colour.band_matrix(np.asarray(asset.wavelength, float))

    def medium(self, asset, sigma_t, albedo, phase) -> Scatterer:
        """Of sigma_t (L,) 1/m, albedo (L,) and phase functions (L, A) 1/sr at the angles of the asset's medium."""
        theta = np.asarray(asset.medium.theta, float)
        if self.bands:
            matrix, scattering = self._matrix(asset), sigma_t * albedo
            total = matrix @ scattering
            phase = matrix @ (scattering[:, None] * phase) / np.maximum(total, 1e-300)[:, None]
            phase[total <= 0] = 1 / (4 * math.pi)
            phase /= kernels.phase_integral(theta, phase)[:, None]
            sigma_t = matrix @ sigma_t
            albedo = total / np.maximum(sigma_t, 1e-300)
        return scatterer(sigma_t, albedo, theta, phase)

    def classes(self, asset, classes):
        """Classes of particles (`renderers.materials.particles.medium.Classes`)."""
        return in_bands(classes, self._matrix(asset)) if self.bands else classes

    def grains(self, asset, grains):
        """Grains (`renderers.materials.grains._grains.Grains`): reflectances and absorption."""
        if not self.bands:
            return grains
        matrix = self._matrix(asset)
        return grains._replace(channels=np.ascontiguousarray(grains.channels @ matrix.T),
                               absorption=np.ascontiguousarray(grains.absorption @ matrix.T))
