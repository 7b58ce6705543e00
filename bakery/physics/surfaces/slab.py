"""What is solved: a plane layer of a medium, what is on it and under it, at one wavelength."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Slab:
    """A plane layer.

    Attributes
    ----------
    theta, phase : (A,) rad and 1/sr, the phase function, linear in cos theta in between
    albedo : single-scattering albedo
    depth : optical depth, 0 to infinity
    index : of the medium over that of the air, 1 for no boundary; on top, and below too where there is no base
    roughness : of the boundary on top (GGX's alpha), 0 for a smooth one; above 0 the layer has a base or is infinite
    base : albedo of a Lambertian base in contact with the medium; None for air
    """

    theta: np.ndarray
    phase: np.ndarray
    albedo: float
    depth: float
    index: float = 1.0
    base: float | None = None
    roughness: float = 0.0
