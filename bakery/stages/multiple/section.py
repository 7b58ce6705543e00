"""Recipe section `multiple_scattering`: tables of the light that is scattered three times and more."""

# no annotations from __future__: pydantic would have to compile each of them again, some 3 ms in all
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from bakery.grammar.fields import AUTO, number, whole, word
from bakery.grammar.section import Section
from bakery.grammar.text import Mapping
from bakery.grammar.units import FRACTION
from bakery.physics.multiple.budget import REACHED
from bakery.physics.multiple.kinds import KINDS
from bakery.stages.declaration import RecipeSection, own_tolerance

if TYPE_CHECKING:
    from bakery.recipe.checker import Checker


class MultipleScattering(Section):
    """Precomputed multiple scattering."""

    sources: Annotated[list[word(*KINDS)], Field(min_length=1, max_length=2)] = Field(KINDS, description="Kinds of sources.")
    extent: number(least=0.5, most=200, words=AUTO) = Field(
        "auto", description="Distance that the tables cover, in mean free paths; auto: all but 1e-4 of the light."
    )
    length: number(least=0.1, most=10) = Field(2.0, description="Length of the tabulated segment, in mean free paths.")
    tolerance: number(FRACTION, least=1e-4, most=0.5) | None = Field(
        None, description="Relative error of a lobe; default: the recipe's tolerance, but at least 1 %."
    )
    orders: whole(2, 128, words=AUTO) = Field("auto", description="Legendre orders that are solved; narrower peaks are left out.")
    method: word("auto", "solver", "photons") = Field(
        "auto", description="How tables are computed; auto: photons if the solver refuses or its error is above 20 %."
    )
    photons: whole(1000, 10**10, words=AUTO) = Field(
        "auto", description="Most photons for a wavelength; auto: until they have flown 4e7 times."
    )


def check(checker: "Checker", section: Mapping) -> None:
    """Something scatters, each source stands once, and photons are followed where their number is given."""
    checker.needs_scattering(section)
    sources = checker.several(section.get("sources"))
    if sources and len(set(sources)) < len(sources):
        checker.report(section["sources"], "found a source twice", "expected point and segment once each")
    if checker.value(section, "method") == "solver" and checker.value(section, "photons") not in ("auto", None):
        checker.report(section["photons"], "found a number of photons beside method: solver", "expected method: photons or auto")


MULTIPLE = RecipeSection("multiple_scattering", MultipleScattering, "Tables of the light that is scattered three times and more.",
                         check, completed=own_tolerance(REACHED))
