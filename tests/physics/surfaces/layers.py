"""Layers whose reflectance tests look up: solved once, without a bake."""

import math
from functools import cache

import numpy as np

from bakery.physics.surfaces.corrected import Corrected, Factors
from bakery.physics.surfaces.slab import Slab
from bakery.physics.surfaces.solution import solve
from tests.physics.surfaces.test_layers import henyey_greenstein

RGB = (0.61, 0.55, 0.465)
# name -> albedos of one wavelength or three, g, depth, index, base, roughness
LAYERS = {"half space": ((1.0,), 0.0, math.inf, 1.0, None, 0.0), "white": ((1.0,), 0.5, math.inf, 1.5, None, 0.0),
          "tinted": ((0.999, 0.9, 0.5), 0.7, math.inf, 1.0, None, 0.0), "sheet": ((1.0,), 0.5, 3.0, 1.4, None, 0.0),
          "bare": ((1.0, 0.9, 0.3), 0.3, 0.4, 1.0, None, 0.0), "paint": ((0.999, 0.99, 0.9), 0.6, 5.0, 1.5, 0.2, 0.0),
          "matt": ((0.99,), 0.4, math.inf, 1.5, None, 0.25), "lighter": ((0.9,), 0.3, math.inf, 0.8, None, 0.0)}


@cache
def solutions(name: str) -> list:
    """Of each wavelength; `grains`: a half space with smooth factors, as if counted among grains."""
    if name == "grains":
        a, b, c = np.meshgrid((np.arange(48) + 0.5) / 48, *2 * [(np.arange(8) + 0.5) / 8], indexing="ij")
        cells = 1 + 0.4 * np.cos(3 * a) * np.cos(2 * c) + 0.3 * b * b * (1 - a)
        return [Corrected(solutions("tinted")[0], Factors(3 * (cells,), np.linspace(0.8, 1.1, 48).reshape(3, 16), 0.01))]
    albedos, g, *slab = LAYERS[name]
    return [solve(Slab(*henyey_greenstein(g), albedo, *slab), g ** np.arange(33.0), 32, 1e-3) for albedo in albedos]


@cache
def table(name: str):
    """The table of `solutions`, and its errors."""
    from bakery.physics.surfaces.table import surface_table

    return surface_table(solutions(name))
