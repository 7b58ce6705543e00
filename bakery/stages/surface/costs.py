"""What a plane layer takes: Legendre moments from what a recipe says, then directions, seconds and bytes.

Measured on one core of an Intel Xeon, in processor time: docs/measurements/surface.md.
"""

import math
from typing import NamedTuple

import numpy as np

from bakery.stages.medium.section import phase_keys

_FEWEST, _MOST, _MOST_NODES = 24, 640, 256  # moments that are carried
_PEAK = 0.6  # share of light that may be left out, over the tolerance (`refine`)
_ORDER, _PRODUCT, _MODES = 3e-4, 1.3e-7, 1.7e-8  # seconds of a Fourier order, over the directions' square, over their cube
_STACKED = 1.6  # layers under one take their share
_ROUNDING = 3e-5  # seconds over the directions' square
# seconds of walks to 1 %: over the root of what is absorbed, at most, and of layers of a thickness at least, a depth, at most
_WALKS, _LOSSLESS, _THIN, _DEEPER, _FINITE = 1e-2, 0.35, 0.02, 4e-3, 0.25


class Expected(NamedTuple):
    """Of one layer at one wavelength."""

    seconds: float
    file: float


def expected(recipe) -> Expected:
    """Seconds of one core and bytes in the file of one layer at one wavelength."""
    surface, infinite = recipe.surface, recipe.surface.thickness == "infinite"
    boundary = surface.boundary if surface.boundary != "none" else None
    rough = boundary is not None and boundary.roughness > 0
    open_below = not infinite and surface.base is None
    count = min(max(moments(recipe), _FEWEST), _MOST_NODES if rough or open_below else _MOST)
    seconds, step = 0.0, count
    while step >= 16:
        nodes = _nodes(step, rough or open_below)
        seconds += step * (_ORDER + _PRODUCT * nodes**2 + (0.0 if infinite else _MODES * nodes**3))
        if infinite and boundary is None and step < count:  # two steps do there
            break
        step = 2 * step // 3
    nodes = _nodes(count, rough or open_below)
    stacked = surface.base is not None and surface.base.albedo is None
    seconds *= _STACKED if stacked else 1.0
    seconds += _ROUNDING * nodes**2 + walks(recipe)
    size = 1.4 * count * nodes**2 * min(0.9, 8 / nodes) * (2 if open_below else 1)
    return Expected(seconds, size)


def _nodes(count: int, as_many: bool) -> int:
    return max(_FEWEST, count + 8 if as_many else min(count + 8, 68 + count // 16))


def moments(recipe) -> int:
    """Legendre moments beyond which less light is in the peak than may be left out."""
    peak = _PEAK * recipe.surface.tolerance
    if recipe.medium is not None and recipe.medium.phase is not None:
        g = phase_keys(recipe.medium.phase)["g"]
        steepest = min(float(np.abs(g).max()), 0.999) if g is not None else 0.5
        return math.ceil(math.log(peak) / math.log(max(steepest, 0.01)))
    if getattr(recipe, "particles", None) is None:
        return 2 * _FEWEST
    from bakery.physics.sizes.distributions import population

    # the diffraction peak of spheres: 3 moments a size parameter at 1 %
    radius = max(population(part.size).effective_radius for part in recipe.particles.components)
    return math.ceil(2 * math.pi * radius / min(recipe.wavelength) * (2 - 0.25 * math.log(peak)))


def walks(recipe) -> float:
    """Seconds of walks that tell the spread."""
    medium = recipe.medium
    if medium is None or medium.albedo is None and (medium.sigma_s is None or medium.sigma_a is None):
        lost = 0.0
    elif medium.albedo is not None:
        lost = 1 - float(np.max(medium.albedo))
    else:
        scattered, absorbed = np.asarray(medium.sigma_s, float), np.asarray(medium.sigma_a, float)
        lost = float(np.min(absorbed / np.maximum(absorbed + scattered, 1e-300)))
    coarser = min(max(recipe.surface.tolerance / 0.01, 1.0), 4.0)
    if recipe.surface.thickness != "infinite":
        return float(np.mean(np.minimum(_THIN + _DEEPER * _depths(recipe), _FINITE))) / max(coarser / 2, 1.0)
    return (min(_LOSSLESS, _WALKS / math.sqrt(lost)) if lost > 0 else _LOSSLESS) / coarser**1.3


def _depths(recipe):
    """(T, L) optical depths of layers of a thickness; without end where a recipe does not say its mean free path."""
    medium, thickness = recipe.medium, np.asarray(recipe.surface.thickness, float)[:, None]  # um
    if medium is None or medium.mean_free_path is None and (medium.sigma_s is None or medium.sigma_a is None):
        return np.full_like(thickness, math.inf)
    if medium.mean_free_path is not None:
        return thickness / np.asarray(medium.mean_free_path, float)
    return 1e-6 * thickness * (np.asarray(medium.sigma_s, float) + np.asarray(medium.sigma_a, float))
