"""Recipe section `effective_medium`: the medium that stands for packed grains."""

# no annotations from __future__: pydantic would have to compile each of them again, some 3 ms in all
from typing import TYPE_CHECKING

from pydantic import Field

from bakery.grammar.fields import AUTO, whole, word
from bakery.grammar.section import Section
from bakery.grammar.text import Mapping
from bakery.physics.granular.kinds import CHOICES
from bakery.stages.declaration import RecipeSection

if TYPE_CHECKING:
    from bakery.recipe.checker import Checker


class EffectiveMedium(Section):
    """Options of the equivalent medium of packed grains."""

    sigma_t: word("auto", *CHOICES) = Field(
        "auto", description="Length scale: from the mean flight, from its second moment, or matched to a random walk through "
        "explicit grains; auto: random_walk where that comes to an end, else mean_flight."
    )
    walks: whole(1_000, 10**12, words=AUTO) = Field(
        "auto", description="Hits of the random walk through explicit grains that measures the error of sigma_t."
    )


def check(checker: "Checker", section: Mapping) -> None:
    """It stands for grains."""
    checker.only_with(section, "grains")


EFFECTIVE = RecipeSection("effective_medium", EffectiveMedium, "Options of the equivalent medium of packed grains.", check,
                          beside="grains")
