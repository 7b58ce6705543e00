"""How the radii of a tile's spheres are spread: data only, so that it loads nothing."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Law:
    """`distribution` is equal, list (`of` = shares by number and relative radii) or lognormal (`sigma`, geometric standard
    deviation)."""

    distribution: str
    of: tuple[tuple[float, float], ...] = ()
    sigma: float | None = None
