"""What is averaged: spheres of some index and size distribution at some wavelengths, by series or by rays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bakery.physics.sizes.distributions import Population
from bakery.physics.sizes.nodes import Nodes


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


@dataclass(frozen=True)
class Rays:
    """How rays (`bakery.goa`) take part.

    `method` is "mie" (never), "goa" (from `switch` on, or from x = 30) or "auto" (where their measured error allows and where
    they save time); the other fields are the options of `bakery.goa.amplitudes`.
    """

    method: str = "auto"
    orders: int = 3
    rainbow: bool = True
    axis: bool = True
    edge: str | None = "narrow"
    switch: float | None = None

    @property
    def options(self) -> dict:
        """Keyword arguments for `bakery.goa`."""
        return {"rainbow": self.rainbow, "axis": self.axis, "edge": self.edge}


def channels_of(components: Sequence[Component], wavelength, host, tolerance: float, radii: int | None = None,
                coarse: bool = False) -> list[Channel]:
    """Every component at every wavelength, component by component; `radii` (its `count`) and `coarse` as in `Nodes`."""
    k = 2 * np.pi * np.asarray(host, float) / np.asarray(wavelength, float)
    nodes = [Nodes(component.sizes, k, tolerance, radii, coarse) for component in components]
    return [Channel(c.name, float(w), complex(m), float(q), n)
            for c, n in zip(components, nodes) for w, m, q in zip(wavelength, c.m, k)]


def terms(x):
    """Terms of the series at size parameter x."""
    return x + 7.5 * np.cbrt(x) + 2


def features_of(channel):
    """(size parameter, relative width) of each part, at the channel's own wavelength."""
    longest = max(x for x, _ in channel.nodes.features)
    scale = channel.k / channel.nodes.wavenumber if longest > 0 else 1.0
    return [(x * scale, width) for x, width in channel.nodes.features]
