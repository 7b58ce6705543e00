"""Recipe section `packing`: spheres in a periodic tile."""

# no annotations from __future__: pydantic would have to compile each of them again, some 3 ms in all
import math
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Discriminator, Field, Tag

from bakery.grammar.fields import AUTO, SUM_OF_SHARES, GeometricDeviation, Share, number, numbers, three, whole, word
from bakery.grammar.section import Section
from bakery.grammar.text import Mapping, Node, Sequence, mappings
from bakery.grammar.units import FRACTION
from bakery.physics.packing.law import Law
from bakery.stages.declaration import RecipeSection

if TYPE_CHECKING:
    from bakery.recipe.checker import Checker


class RadiusShare(Section):
    share: Share = Field(description="Share of the spheres.")
    radius: number(least=1e-6, most=1e6) = Field(description="Radius relative to the others.")


class RadiusLaw(Section):
    distribution: word("lognormal") = Field(description="ln r is normally distributed.")
    sigma: GeometricDeviation = Field(description="Geometric standard deviation by number, above 1.")


_OTHER_RADII = "a list of {share, radius}, or {distribution: lognormal, sigma}"
Radii = Annotated[
    Annotated[word("equal", otherwise=_OTHER_RADII), Tag("word")]
    | Annotated[list[RadiusShare], Field(min_length=1, max_length=256), Tag("list")]
    | Annotated[RadiusLaw, Tag("law")],
    Discriminator(lambda node: "list" if isinstance(node, Sequence) else "law" if isinstance(node, Mapping) else "word"),
]


class Packing(Section):
    """Spheres in a periodic tile."""

    fraction: numbers(FRACTION, least=1e-6, below=1) = Field(
        description="Share of the volume in spheres, up to 0.64 for equal ones; a list bakes a dictionary of tiles."
    )
    count: whole(1, 10**6) = Field(500, description="Spheres in the tile.")
    cell: three(number(least=1e-6, most=1e6)) = Field(
        (1.0, 1.0, 1.0), description="Proportions of the cell."
    )
    radii: Radii = Field("equal", description=f"equal, {_OTHER_RADII}.")
    growth: number(least=1e-5, most=1, words=AUTO) = Field(
        "auto", description="Slowest growth rate of the diameters over the thermal speed; auto: by the tolerance."
    )
    equilibration: whole(0, 10**6, words=AUTO) = Field(
        "auto", description="Collisions a sphere at the final size, at fractions up to 0.5; auto: by the tolerance."
    )
    seed: whole(0, 2**53) | None = Field(None, description="Seed of the tiles; default: the recipe's.")


# ---- what holds between the keys


def check(checker: "Checker", section: Mapping) -> None:
    """Fractions that can be reached, in a cell that holds the spheres."""
    beside = next((name for name in ("particles", "medium") if name in checker.tree), None)
    if beside:
        checker.report_section(section, f"found packing beside {beside}, which it has no effect on",
                             "expected it alone or with grains")
    node = section.get("fraction")
    fractions = checker.several(node) or ()
    shown = [f"{100 * f:g}" for f in fractions]
    for i, f in enumerate(shown):
        if f in shown[:i]:
            checker.report(node[i] if isinstance(node, Sequence) else node, f"found {f} % more than once",
                         "expected distinct fractions")
    radii = _radii(checker, section)
    cell = checker.several(section.get("cell"))
    if radii is not None and ("cell" not in section or cell is not None and len(cell) == 3):
        for i, f in enumerate(fractions):
            _tile(checker, node[i] if isinstance(node, Sequence) else node, f, radii, cell or (1.0, 1.0, 1.0))


def _radii(checker: "Checker", section: Mapping) -> np.ndarray | None:
    """Relative radii of the spheres of a tile, (count,)."""
    from bakery.physics.packing import radii

    node = section.get("radii")
    count = checker.value(section, "count") if "count" in section else 500
    if isinstance(node, Sequence):
        parts = list(mappings(*node))
        shares, sizes = ([checker.value(part, name) for part in parts] for name in ("share", "radius"))
        if len(parts) < len(node) or not parts or None in shares or None in sizes:
            return None
        checker.shares(node, "share", parts, None)
        if count is None or abs(math.fsum(shares) - 1) > SUM_OF_SHARES:
            return None
        try:
            return radii.species(shares, sizes, count)
        except ValueError as error:
            checker.report_section(node, f"found {error}", "expected shares of at least one sphere, or a larger packing.count")
            return None
    if count is None:
        return None
    if isinstance(node, Mapping):
        sigma = checker.value(node, "sigma")
        return None if sigma is None else radii.lognormal(sigma, count)
    return np.ones(count)


def _tile(checker: "Checker", node: Node, fraction: float, radii: np.ndarray, cell: tuple) -> None:
    """Whether spheres can be packed so far, in a cell of these proportions."""
    from bakery.physics.packing.ceiling import limit
    from bakery.physics.packing.radii import room

    most = limit(radii)
    if fraction > most:
        equal = np.ptp(radii) < 1e-9
        noun = "equal spheres" if equal else "these radii"
        hint = "; several sizes reach more (packing.radii)" if equal else ""
        checker.report(node, f"found {fraction:g}", f"expected at most {most:.4g}, as far as {noun} are packed at random{hint}")
        return
    width = room(fraction, radii, cell)
    if width <= 1 + 1e-6:
        spheres = f"the largest of {radii.size:,} spheres" if radii.size > 1 else "the sphere"
        most = 0.999 * fraction * width**3
        checker.report(
            node,
            f"found {fraction:g}, where {spheres} meets its own image: the cell is {width:.3g} of its diameter wide",
            f"expected less than {most:.3g}, a larger packing.count, or a packing.cell nearer to a cube",
        )


# ---- values


def radii_law(radii) -> Law:
    """What a recipe says of the radii as `bakery.physics.packing.radii` takes it."""
    if radii == "equal":
        return Law("equal")
    if isinstance(radii, tuple):
        return Law("list", tuple((part.share, part.radius) for part in radii))
    return Law("lognormal", sigma=radii.sigma)


PACKING = RecipeSection("packing", Packing, "Periodic tiles of packed spheres; alone or with grains.", check,
                        completed=lambda model, recipe: model if model.seed is not None else model.model_copy(
                            update={"seed": recipe.seed}), alone=True)
