"""Recipe section `surface`: reflectance of a plane layer of the medium."""

# no annotations from __future__: pydantic would have to compile each of them again, some 3 ms in all
from typing import TYPE_CHECKING, Annotated

from pydantic import Discriminator, Field, Tag

from bakery.grammar.fields import Path, number, numbers, whole, word
from bakery.grammar.section import Section
from bakery.grammar.text import Mapping
from bakery.grammar.units import FRACTION, LENGTH
from bakery.stages.declaration import RecipeSection, own_tolerance
from bakery.stages.surface import base as bases

if TYPE_CHECKING:
    from bakery.recipe.checker import Checker

INFINITE = "infinite"
SMOOTHEST = 0.05  # roughness: lobes of smoother facets are narrower than the solver's directions can tell
REACHED = 1e-4  # what the solver reaches within its moments: a default below that would miss itself
MOST_LAYERS = 64


class Boundary(Section):
    """A refracting boundary between air and the medium."""

    index: number(least=0.5, most=4) = Field(description="Refractive index of the medium over that of the air.")
    roughness: number(least=0, most=1) = Field(0.0, description="GGX roughness of its facets, 0 (smooth) or 0.05 to 1.")


class Base(Section):
    """What the layer lies on, in contact with the medium: a Lambertian surface, or the surface of another asset or recipe."""

    albedo: numbers(FRACTION, least=0, most=1) | None = Field(
        None, description="Albedo of a Lambertian base; one value, or one a wavelength.")
    asset: Path | None = Field(None, description="Another asset (.h5) with the stage surface: its layers lie under this one.")
    recipe: Path | None = Field(None, description="A recipe with the section surface, in place of its asset.")
    layer: whole(0, MOST_LAYERS - 1) | None = Field(
        None, description="With an asset or a recipe: position of the thickness among several, from 0; default: 0.")


class Surface(Section):
    """A plane layer of the medium."""

    thickness: numbers(LENGTH, words={INFINITE: INFINITE}, most_entries=MOST_LAYERS, least=0, most=1e15) = Field(
        INFINITE, description="Thickness such as 2 mm, a list of them, or infinite."
    )
    boundary: Annotated[
        Annotated[word("none", otherwise="or {index: 1.33}"), Tag("word")] | Annotated[Boundary, Tag("section")],
        Discriminator(lambda node: "section" if isinstance(node, Mapping) else "word"),
    ] = Field("none", description="Boundary on top, and also below if there is no base; none: the index of air.")
    base: Base | None = Field(None, description="What the layer lies on; default: air.")
    method: word("auto", "medium", "grains") = Field(
        "auto", description="grains: a layer of packed grains, counted among the grains themselves; medium: the plane layer of "
        "the medium that stands for them; auto: grains where there are some, under no boundary, on no other asset or recipe."
    )
    tolerance: number(FRACTION, least=1e-5, most=0.5) | None = Field(
        None, description="Relative error of the reflectance; default: the recipe's tolerance, but at least 0.01 %."
    )


def check(checker: "Checker", section: Mapping) -> None:
    """Something scatters; facets are none or rough; a free layer has no rough boundary."""
    checker.needs_scattering(section)
    base, boundary = section.get("base"), section.get("boundary")
    if isinstance(base, Mapping):
        checker.one_each(base, "albedo")
        bases.check(checker, base)
    infinite = "thickness" not in section or checker.value(section, "thickness") == INFINITE
    if base is not None and infinite:
        checker.report_section(base, "found a base under an infinite layer, which no light reaches",
                               "expected a thickness, or no base")
    rough = checker.value(boundary, "roughness") if isinstance(boundary, Mapping) else None
    if rough and rough < SMOOTHEST:
        checker.report(boundary["roughness"], f"found a roughness of {rough:g}", f"expected 0, or {SMOOTHEST:g} to 1")
    elif rough and base is None and not infinite:
        checker.report(boundary["roughness"], "found a rough boundary of a layer on nothing",
                       "expected a base, thickness: infinite, or roughness: 0")
    if isinstance(base, Mapping) and "albedo" not in base and isinstance(boundary, Mapping):
        index = checker.value(boundary, "index")
        if rough and index != 1:
            bases.check_under_facets(checker, base, boundary)
        if index is not None and index < 1:
            checker.report(boundary["index"], f"found an index of {index:g} over the layers of another asset",
                           "expected 1 or more, or a base with an albedo")
    if "method" in section and checker.value(section, "method") == "grains":
        if "grains" not in checker.tree:
            checker.report(section["method"], "found grains, of which this recipe has none", "expected auto or medium")
        elif isinstance(boundary, Mapping) or isinstance(base, Mapping) and "albedo" not in base:
            checker.report(section["method"], "found grains under a boundary, or on another asset or recipe",
                           "expected boundary: none and no base or one with an albedo, or method: medium")


def among_grains(recipe) -> bool:
    """Whether the reflectance of a recipe is counted among its grains."""
    surface = recipe.surface
    return (recipe.grains is not None and surface.method != "medium" and surface.boundary == "none"
            and (surface.base is None or surface.base.albedo is not None))


SURFACE = RecipeSection("surface", Surface, "Reflectance of a plane layer of the medium.", check,
                        completed=own_tolerance(REACHED))
