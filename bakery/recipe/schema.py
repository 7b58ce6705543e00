"""What a recipe may say: the keys that every recipe has, and the sections that the stages declare.

The models validate the tree of `bakery.grammar.text` and give the JSON Schema that editors use; the kinds of values are in
`bakery.grammar.fields`, each section with what has to hold between its keys in the package of its stage.
"""

# no annotations from __future__: pydantic would have to compile each of them again, some 3 ms in all
from functools import cache

from pydantic import Field, create_model

from bakery.grammar.fields import Format, Name, Text, describe, leaf, number, numbers, whole, word
from bakery.grammar.section import Section
from bakery.grammar.text import Mapping, Scalar
from bakery.grammar.units import FRACTION, WAVELENGTH, Wrong
from bakery.stages import all_stages
from bakery.stages.declaration import RecipeSection

NAMED_WAVELENGTHS = {"rgb": (0.610, 0.550, 0.465), "visible8": (0.405, 0.455, 0.505, 0.555, 0.605, 0.655, 0.705, 0.755)}


def _sweep(node) -> None:
    """No value of a recipe: what a sweep says is read before (`bakery.recipe.sweep`)."""
    if not isinstance(node, Mapping) and not (isinstance(node, Scalar) and node.text == "none"):
        raise Wrong(f"found {describe(node)}", "expected dotted keys with values, or none")


class Common(Section):
    """Keys of every recipe."""

    bakery: Format = Field(description="Recipe format.")
    name: Name = Field(description="Name of the asset in pages and pictures; its file is named after the recipe's file.")
    description: Text = Field("", description="Free text.")
    wavelengths: numbers(WAVELENGTH, words=NAMED_WAVELENGTHS, steps=True, least=1e-9, most=1e6) = Field(
        NAMED_WAVELENGTHS["rgb"], description="rgb, visible8, a list in um, or {from, to, count} in equal steps; in vacuum."
    )
    seed: whole(0, 2**53) = Field(0, description="All random streams derive from it.")
    tolerance: number(FRACTION, least=1e-6, most=0.5) = Field(0.01, description="Relative error allowed in each baked quantity.")
    measure: word("pointwise", "integrated") = Field(
        "pointwise", description="pointwise: the tolerance of particles' phase functions holds at every angle; integrated: "
        "for the integral of the error over the sphere."
    )
    sweep: leaf(_sweep, {"sweep": ""}) = Field(
        None, description="Several values of some keys: bakes a family of assets; none: the recipe's own values."
    )


@cache
def sections() -> tuple[RecipeSection, ...]:
    """Every section of recipes, those that say what scatters first."""
    declared = dict.fromkeys(section for stage in all_stages() for section in stage.sections)
    return tuple(sorted(declared, key=lambda section: not section.scatters))


@cache
def recipe_file() -> type[Common]:
    """The model of whole recipes."""
    fields = {section.name: (section.model | None, Field(None, description=section.description)) for section in sections()}
    return create_model("RecipeFile", __base__=Common, __doc__="What one material is made of.", **fields)
