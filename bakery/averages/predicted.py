"""What averages over sizes will take: angles, nodes, seconds, memory and file, from the recipe's figures alone.

Seconds are operation counts times rates.  The counts were fitted to runs of 16 varied distributions at tolerances of 3, 1 and
0.3 % (docs/averages.md gives the spread); the rates hold for one core of the machine named below.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bakery.sizes.distributions import Population
from bakery.sizes.nodes import Nodes

# seconds on one core of an AMD EPYC (Zen 5, AVX-512): benchmarks/averages.py --rates
CROSS = 2e-9  # per term of a sphere's series, cross sections only
COEFFICIENT = 11e-9  # per term, where angles follow
INTENSITY = 0.13e-9  # per term and angle
MUELLER = 0.15e-9
LOADING, COMPILING = 0.6, 12.0  # seconds, same machine
FIRST_LEVEL = 2  # level before which nothing has converged: steps in size parameter of ~1
HELD = 64 * 2**20  # bytes of block results held at a time
_DAMPED, _RIPPLES, _RESONANT, _PASSES = 3.5, 5.0, 400.0, 4.0  # fitted


@dataclass(frozen=True)
class Component:
    """One kind of sphere.  `m` (L,) complex index n + ik relative to the host, k >= 0."""

    name: str
    m: np.ndarray
    sizes: Population


@dataclass(frozen=True)
class Channel:
    """One component at one wavelength: index relative to the host, wavenumber in the host (1/um), nodes."""

    component: str
    wavelength: float
    m: complex
    k: float
    nodes: Nodes


def startup() -> tuple[float, str]:
    """Seconds before the first sphere, and why: compiled kernels are loaded, or compiled when a machine meets them first."""
    here = Path(__file__).parents[1] / "mie"
    kept = Path(os.environ.get("NUMBA_CACHE_DIR") or here / "__pycache__")
    source = (here / "_kernels.py").stat().st_mtime
    compiled = [path for path in kept.rglob("_kernels.*intensity_block*.nbi") if path.stat().st_mtime >= source]
    return (LOADING, "kernels loaded") if compiled else (COMPILING, "kernels compiled first, once")


def terms(x):
    """Terms of the series at size parameter x."""
    return x + 7.5 * np.cbrt(x) + 2


def features_of(channel):
    """(size parameter, relative width) of each part, at the channel's own wavelength."""
    longest = max(x for x, _ in channel.nodes.features)
    scale = channel.k / channel.nodes.wavenumber if longest > 0 else 1.0
    return [(x * scale, width) for x, width in channel.nodes.features]


@dataclass(frozen=True)
class Prediction:
    """What averages are expected to take: seconds of one core, bytes of memory, bytes stored, number of angles, of spheres."""

    seconds: float
    memory: float
    file: float
    angles: int
    spheres: int


def predict(components: Sequence[Component], wavelength, host, tolerance: float, polarized: bool = False) -> Prediction:
    """Predicted work of `averages`, same arguments; fitted to 30 varied runs (docs/averages.md gives the spread)."""
    k = 2 * math.pi * np.asarray(host, float) / np.asarray(wavelength, float)
    nodes = [Nodes(component.sizes, k, tolerance) for component in components]
    channels = [Channel(c.name, float(w), complex(m), float(q), n)
                for c, n in zip(components, nodes) for w, m, q in zip(wavelength, c.m, k)]
    angles = predicted_angles([f for c in channels for f in features_of(c)], tolerance)
    per_angle = MUELLER if polarized else INTENSITY
    seconds, spheres, rows = 0.02 + 0.005 * len(channels), 0, 0
    for channel in channels:
        fixed = terms(channel.k * channel.nodes.fixed()[0])
        seconds += float(np.sum(fixed)) * (5 * COEFFICIENT + per_angle * 2.3 * angles)
        spheres += len(fixed)
        rows += len(fixed)
        if channel.nodes.refinable:
            fresh = terms(channel.k * channel.nodes.fresh(0)[0])
            most, last = _doublings(channel, tolerance)
            seconds += float(np.sum(fresh)) * (last * _PASSES * COEFFICIENT + most * per_angle * 2.3 * angles)
            spheres += int(len(fresh) * last)
            rows += len(fresh) * 2**FIRST_LEVEL
    elements = 4 if polarized else 1
    memory = 8 * angles * len(channels) * (8 * elements + 20) + 2 * HELD + 100 * spheres
    file = 8 * (len(channels) * angles * (elements + 1) + 4 * rows)
    return Prediction(seconds, memory, file, int(angles), spheres)


def _doublings(channel, tolerance):
    """Nodes that most angles take, and that the last one takes, over the nodes of the first level.

    Spheres that absorb, and bubbles, are smooth once the ripples are resolved; in others resonances decide, and nodes go like
    the square root of the size parameter and nearly like 1/tolerance.
    """
    fine = 0.01 / tolerance
    absorption = 4 * channel.m.imag
    last = 2.0 ** (channel.nodes.levels - 1)
    most, resonant = 2.0**FIRST_LEVEL * max(1.0, fine) ** 0.6, False
    for (x, width), first in zip(features_of(channel)[len(channel.nodes.fixed()[0]) :], channel.nodes.first):
        if channel.m.real > 1:
            need = _RESONANT * math.sqrt(x) * fine**0.8 / (1 + 5 * absorption * x) * min(1.0, width / 0.05) / first
            most, resonant = max(most, need), resonant or need > most
    return min(most, last), min(4 * most * (fine if resonant else 1.0), last)


def predicted_angles(features, tolerance):
    """Angles that a tolerance takes, from (size parameter, relative width) of each distribution."""
    fine = math.sqrt(0.01 / tolerance)
    smooth = 180 + 60 * fine * math.log10(max(1.0, *(x for x, _ in features)))
    ripples = 0.0
    for x, width in features:
        if x > 1:
            reach = min(math.pi, _DAMPED / (x * max(width, 1e-300)))
            ripples = max(ripples, _RIPPLES * x * reach * fine)
    return smooth + ripples
