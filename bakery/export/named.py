"""A medium and what is said of it in a file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from bakery.export.medium import Scattering


class Named(NamedTuple):
    """A medium and what is said of it in a file."""

    wavelength: np.ndarray  # (L,) um, in vacuum
    medium: Scattering  # without its forward delta
    # name, content_hash, version: of the asset
    name: str
    content_hash: str
    version: str
    errors: Mapping[str, np.ndarray]  # name of a dataset of the group -> (L,) or (L, A) its stated error
    # tolerance, achieved, measure: of the asset's medium, and what measures them
    tolerance: float
    achieved: float
    measure: str

    @property
    def attributes(self) -> dict[str, str]:
        """Of a file."""
        return {"title": f"{self.name}: optical properties of a scattering medium", "source": f"bakery {self.version}",
                "asset": self.name, "asset_content_hash": self.content_hash}

    def ascending(self) -> Named:
        """The same by ascending wavelength, as the formats of others are."""
        order = np.argsort(self.wavelength)
        return self._replace(wavelength=self.wavelength[order], medium=self.medium.at(order),
                             errors={name: error[order] for name, error in self.errors.items()})
