"""A checked recipe: what the rest of the house sees.  Immutable; arrays are read-only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from bakery.errors import Problem
from bakery.grammar.files import DataFile


@dataclass(frozen=True, eq=False)
class Index:
    """Optical constants n + ik at the recipe's wavelengths, relative to vacuum; `n` (L,), `k` (L,)."""

    name: str
    n: np.ndarray
    k: np.ndarray


@dataclass(frozen=True)
class Size:
    """A distribution of radii; lengths in um.

    `distribution` is single, lognormal (`radius` = geometric mean, `sigma`), gamma (`radius`, `variance` = effective radius and
    variance), table (`table` = radii and number density in any scale) or mixture (`of` = shares and sizes).  `min` and `max` cut
    the density.
    """

    distribution: str
    radius: float | None = None
    sigma: float | None = None
    variance: float | None = None
    min: float | None = None
    max: float | None = None
    table: tuple[np.ndarray, np.ndarray] | None = None
    of: tuple[tuple[float, Size], ...] = ()


@dataclass(frozen=True)
class Component:
    """One kind of particle; `fraction` is its share of the particle number."""

    name: str
    material: Index
    fraction: float
    size: Size


@dataclass(frozen=True)
class Particles:
    """Suspended spheres; one of `number_density` (1/m^3) and `volume_fraction` is None."""

    host: Index
    number_density: float | None
    volume_fraction: float | None
    components: tuple[Component, ...]


@dataclass(frozen=True)
class SingleScattering:
    """Options of the single-scattering stage; None where the recipe says auto (`edge`: none)."""

    method: str
    orders: int
    polarized: bool
    switch: float | None
    edge: str | None
    rainbow: bool
    axis: bool
    radii: int | None
    angles: int | None


@dataclass(frozen=True, eq=False)
class Phase:
    """Phase function of a medium: `g` (L,) for hg, `spread` rad for gaussian, `table` = theta (rad, 0 to pi) and value for
    table."""

    type: str
    g: np.ndarray | None = None
    spread: float | None = None
    table: tuple[np.ndarray, np.ndarray] | None = None


@dataclass(frozen=True, eq=False)
class Medium:
    """A continuous medium: `sigma_t` (L,) 1/m, `albedo` (L,)."""

    sigma_t: np.ndarray
    albedo: np.ndarray
    phase: Phase


@dataclass(frozen=True)
class Radii:
    """Radii of a tile's spheres: `distribution` is equal, list (`of` = shares by number and relative radii) or lognormal
    (`sigma`, geometric standard deviation)."""

    distribution: str
    of: tuple[tuple[float, float], ...] = ()
    sigma: float | None = None


@dataclass(frozen=True)
class Packing:
    """Tiles of spheres, one for each of `fraction`; `growth` and `equilibration` are None where the recipe says auto."""

    fraction: tuple[float, ...]
    count: int
    cell: tuple[float, float, float]
    radii: Radii
    growth: float | None
    equilibration: int | None
    seed: int


@dataclass(frozen=True, eq=False)
class GrainSurface:
    """Surface of a grain: `type` is dielectric, conductor (`index`, relative to vacuum; `roughness`, GGX's alpha) or diffuse
    (`reflectance` (L,))."""

    type: str
    index: Index | None
    roughness: float
    reflectance: np.ndarray | None


@dataclass(frozen=True, eq=False)
class Grain:
    """One kind of grain; `weight` is its share by number, `shape` what `grains.shapes.build` takes, `absorption` (L,) 1/m that
    of its interior."""

    name: str
    weight: float
    shape: Mapping[str, Any] = field(repr=False)
    surface: GrainSurface
    absorption: np.ndarray


@dataclass(frozen=True)
class Grains:
    """Packed grains; `radius` um of the bounding sphere, its mean by number where the packing has several."""

    radius: float
    host: Index
    components: tuple[Grain, ...]


@dataclass(frozen=True)
class Scatterometer:
    """Options of the grain stage; `paths` is None where the recipe says auto."""

    tolerance: float
    triangles: int
    paths: int | None
    depth: int
    engine: str


@dataclass(frozen=True)
class EffectiveMedium:
    """Options of the medium that stands for packed grains, None where the recipe says auto."""

    sigma_t: str | None
    walks: int | None


@dataclass(frozen=True)
class MultipleScattering:
    """Tables of multiple scattering; `extent` (mean free paths), `orders` and `photons` are None where the recipe says auto.

    `aim` is the error with which tables are made, `tolerance` the one that they have to meet.
    """

    sources: tuple[str, ...]
    extent: float | None
    length: float
    tolerance: float
    aim: float
    orders: int | None
    method: str
    photons: int | None


@dataclass(frozen=True)
class Beam:
    """Kernels of narrow beams; `depth` in mean free paths, `photons` is None where the recipe says auto."""

    depth: float
    tolerance: float
    photons: int | None


@dataclass(frozen=True)
class Recipe:
    """A recipe whose values are all checked; see docs/architecture.md."""

    path: Path
    name: str
    description: str
    text: str
    seed: int
    tolerance: float
    measure: str
    wavelength: tuple[float, ...]
    particles: Particles | None
    phase: SingleScattering
    medium: Medium | None
    packing: Packing | None
    grains: Grains | None
    scatterometer: Scatterometer
    effective_medium: EffectiveMedium
    multiple_scattering: MultipleScattering | None
    beam: Beam | None
    leaves: Mapping[str, str | int | float | bool]
    files: tuple[DataFile, ...]
    places: Mapping[str, str] = field(repr=False)
    warnings: tuple[Problem, ...] = ()  # what is legal and probably not meant

    def where(self, key: str) -> str:
        """`recipes/fog.yaml:12`, where a key stands; of a default, where the nearest key above it stands."""
        while key and key not in self.places:
            cut = max(key.rfind("."), key.rfind("["))
            key = key[:cut] if cut > 0 else ""
        return self.places.get(key, str(self.path))
