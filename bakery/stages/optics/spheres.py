"""Components of a recipe as spheres: grown with the humidity, in their shells, with what they weigh dry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bakery.errors import StageError
from bakery.stages.optics.layers import AS_SHELL
from bakery.stages.optics.size_keys import sizes

if TYPE_CHECKING:
    from bakery.physics.sizes import Population


@dataclass(frozen=True)
class Sphere:
    """One component."""

    whole: Population  # sizes of the particles as they are, shell and water included
    volume: float  # um^3, mean of the dry particles with their coatings: what amounts count
    mass: float  # um^3 kg/m^3, mean of the same; nan where a density is missing
    water: float = 0.0  # share of the volume of what takes up water, the particle or its coating
    # ratio, thickness: of the core to the whole, and um of the shell; None and 0 without a shell
    ratio: float | None = None
    thickness: float = 0.0


def sphere(part, humidity: float | None) -> Sphere:
    """Sizes and amounts of a component; StageError where nothing is left of its sizes."""
    from bakery.physics.sizes import moved, population

    try:
        core = population(sizes(part.size))
    except ValueError as error:
        raise StageError(f"{part.name}: {error}") from None
    grown = _growth_factor(part, humidity)
    water, density = 1 - grown**-3, np.nan if part.density is None else part.density
    if part.coating is None:
        whole, volume = moved(core, grown), core.mean_volume
        shell = part.growth is not None and part.growth.mixing == AS_SHELL
        return Sphere(whole, volume, density * volume, water, 1 / grown if shell and grown > 1 else None)
    coating, inside = part.coating, core.mean_volume
    of_shell = np.nan if coating.density is None else coating.density
    if coating.thickness is not None:
        whole = moved(core, 1.0, coating.thickness)
        mass = density * inside + of_shell * (whole.mean_volume - inside)
        return Sphere(whole, whole.mean_volume, mass, thickness=coating.thickness)
    ratio = coating.ratio if coating.ratio is not None else (1 - coating.volume_share) ** (-1 / 3)
    volume, factor = ratio**3 * inside, (1 + grown**3 * (ratio**3 - 1)) ** (1 / 3)
    mass = density * inside + of_shell * (volume - inside)
    return Sphere(moved(core, factor), volume, mass, water, 1 / factor if factor > 1 else None)


def _growth_factor(part, humidity) -> float:
    """Radius over the dry one, of the particle or, by its volume, of its coating."""
    from bakery.physics.materials.humidity import growth_factor, tabulated

    if part.growth is None:
        return 1.0
    if part.growth.kappa is not None:
        return growth_factor(part.growth.kappa, humidity)
    return tabulated(*part.growth.file, humidity)


def index(material) -> np.ndarray:
    """(L,) n + ik."""
    return np.asarray(material.n, float) + 1j * np.asarray(material.k, float)


def _wet(dry, part, share) -> np.ndarray:
    """Index of what has taken up water."""
    from bakery.physics.materials.mixing import mixed

    if share == 0:
        return index(dry)
    rule, water = part.growth.mixing, index(part.growth.material)
    if rule == "maxwell_garnett":
        return mixed(rule, [index(dry)], [1 - share], water)
    return mixed(rule, [water, index(dry)], [share, 1 - share])


def component(part, host, humidity: float | None):
    """What averages take; host (L,) real index, to which the indices are relative: an absorbing host is `medium`'s affair."""
    from bakery.physics.averages import Coat, Component

    of = sphere(part, humidity)
    try:
        if part.coating is not None:
            shell = _wet(part.coating.material, part, of.water) / host
            bare = of.ratio is None and of.thickness == 0
            coat = None if bare else Coat(shell, of.ratio, of.thickness)
            return Component(part.name, index(part.material) / host, of.whole, coat)
        if of.ratio is not None:
            return Component(part.name, index(part.material) / host, of.whole, Coat(index(part.growth.material) / host, of.ratio))
        wet = part.growth is not None and part.growth.mixing != AS_SHELL
        return Component(part.name, (_wet(part.material, part, of.water) if wet else index(part.material)) / host, of.whole)
    except ValueError as error:
        raise StageError(f"{part.name}: {error}") from None


def dry(particles) -> tuple[list[float], list[float]]:
    """Mean volumes (K,) um^3 and masses (K,) um^3 kg/m^3 of the components, which amounts count."""
    of = [sphere(part, particles.relative_humidity) for part in particles.components]
    return [s.volume for s in of], [s.mass for s in of]
