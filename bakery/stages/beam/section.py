"""Recipe section `beam`: kernels of narrow beams."""

# no annotations from __future__: pydantic would have to compile each of them again, some 3 ms in all
from typing import TYPE_CHECKING

from pydantic import Field

from bakery.grammar.fields import AUTO, number, whole
from bakery.grammar.section import Section
from bakery.grammar.text import Mapping
from bakery.grammar.units import FRACTION
from bakery.stages.declaration import RecipeSection, own_tolerance

if TYPE_CHECKING:
    from bakery.recipe.checker import Checker

LARGEST = 0.5  # that a tolerance may be
REACHED = 0.03  # what the half space of narrow beams reaches (fog: 1.4 %): a default below that would miss itself


class Beam(Section):
    """Narrow-beam kernels."""

    depth: number(least=0.01, most=1000) = Field(32.0, description="Deepest depth, in mean free paths.")
    tolerance: number(FRACTION, least=1e-3, most=LARGEST) | None = Field(
        None, description="Relative error of the fluence; default: the recipe's tolerance, but at least 3 %."
    )
    photons: whole(1000, 10**9, words=AUTO) = Field(
        "auto", description="Photons that measure the error of each wavelength; auto: enough to show that the tolerance is met."
    )


def check(checker: "Checker", section: Mapping) -> None:
    """Something scatters."""
    checker.needs_scattering(section)


BEAM = RecipeSection("beam", Beam, "Kernels of narrow beams: how light spreads.", check, completed=own_tolerance(REACHED))
