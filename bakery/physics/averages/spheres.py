"""What is averaged: spheres of some index and size distribution at some wavelengths, by series or by rays."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bakery.physics.sizes.distributions import Population
from bakery.physics.sizes.nodes import Nodes


class Layers(NamedTuple):
    """A sphere in a shell, of any size, at one wavelength: indices relative to the host, and how large the core is.

    `ratio` of its radius to the whole's, or the shell's `thickness` as a size parameter.
    """

    core: complex
    shell: complex
    ratio: float | None
    thickness: float

    def inner(self, x):
        """(R,) size parameters of the cores of spheres x (R,); 0 where the sphere is no larger than the shell is thick."""
        return np.maximum(x - self.thickness, 0.0) if self.ratio is None else self.ratio * x


@dataclass(frozen=True)
class Coat:
    """The shell around the spheres of a component."""

    m: np.ndarray  # (L,) complex index n + ik relative to the host, k >= 0
    ratio: float | None = None  # radius of the core over that of the whole; None where the thickness is given
    thickness: float = 0.0  # um


@dataclass(frozen=True)
class Component:
    """One kind of sphere."""

    name: str
    m: np.ndarray  # (L,) complex index n + ik relative to the host, k >= 0; with a coat that of the core
    sizes: Population  # of the whole spheres
    coat: Coat | None = None

    def spheres(self, wavenumber) -> list[complex | Layers]:
        """What kernels take at each wavelength; wavenumber (L,) 1/um, in the host."""
        if self.coat is None:
            return [complex(m) for m in self.m]
        return [Layers(complex(core), complex(shell), self.coat.ratio, float(q) * self.coat.thickness)
                for core, shell, q in zip(self.m, self.coat.m, wavenumber)]

    def mean_index(self):
        """(L,) index relative to the host, of a mean sphere's core and shell by volume: what work is predicted by."""
        if self.coat is None:
            return self.m
        whole = self.sizes.moment(3) ** (1 / 3)
        ratio = max(whole - self.coat.thickness, 0.0) / whole if self.coat.ratio is None else self.coat.ratio
        return ratio**3 * np.asarray(self.m) + (1 - ratio**3) * np.asarray(self.coat.m)


@dataclass(frozen=True)
class Channel:
    """One component at one wavelength: index relative to the host (of a coated sphere its mean), wavenumber in the host (1/um),
    nodes, and what kernels take as the sphere."""

    component: str
    wavelength: float
    m: complex
    k: float
    nodes: Nodes
    sphere: complex | Layers

    @property
    def coated(self) -> bool:
        return isinstance(self.sphere, Layers)


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


SERIES = Rays("mie")


class Aim(NamedTuple):
    """How good averages are to be, and of what."""

    tolerance: float  # largest relative error of any mean cross section and of the phase function at any angle
    polarized: bool = False  # also S12, S33, S34
    # the tolerance holds for the integral of the phase function's error over the sphere (twice the share of light that goes
    # elsewhere), not for its relative error at every angle
    integrated: bool = False
    # radii, angles: fixed numbers of sizes and of angles, whatever error they leave: it is measured all the same; None: as many
    # as the tolerance takes
    radii: int | None = None
    angles: int | None = None
    rays: Rays = SERIES  # whether and how rays stand for the series of large spheres
    # begin with half as many sizes, and with steps between angles four times as wide; errors are measured and refined all the
    # same
    sparse: bool = False
    # cells of rays are as narrow as the peak of the component of the largest spheres needs; else as that of the smallest does
    peaks: bool = False


def channels_of(components: Sequence[Component], wavelength, host, tolerance: float, radii: int | None = None,
                steps: int | None = None) -> list[Channel]:
    """Every component at every wavelength, component by component; `radii` (its `count`) and `steps` as in `Nodes`."""
    k = 2 * np.pi * np.asarray(host, float) / np.asarray(wavelength, float)
    nodes = [Nodes(component.sizes, k, tolerance, radii, steps) for component in components]
    return [Channel(c.name, float(w), complex(m), float(q), n, sphere)
            for c, n in zip(components, nodes) for w, m, q, sphere in zip(wavelength, c.mean_index(), k, c.spheres(k))]


def terms(x):
    """Terms of the series at size parameter x."""
    return x + 7.5 * np.cbrt(x) + 2


def features_of(channel):
    """(size parameter, relative width) of each part, at the channel's own wavelength."""
    longest = max(x for x, _ in channel.nodes.features)
    scale = channel.k / channel.nodes.wavenumber if longest > 0 else 1.0
    return [(x * scale, width) for x, width in channel.nodes.features]
