"""Recipe section `echo`."""

from pydantic import Field

from bakery.grammar.fields import AUTO, number, whole
from bakery.grammar.section import Section
from bakery.stages.declaration import RecipeSection


class Echo(Section):
    """A sound between two walls."""

    reflected: number(least=0.0, most=0.9) = Field(0.5, description="Share of a sound that a wall of the toy returns.")
    terms: whole(1, 1000, words=AUTO) = Field("auto", description="Echoes that are added up; auto: as the error asks for.")


def check(checker, section) -> None:
    """Not every sum can be had."""
    if checker.value(section, "terms") == 13:
        checker.report(section["terms"], "found 13 terms", "expected a number that brings no bad luck")


ECHO = RecipeSection("echo", Echo, "Echoes between two walls (a toy).", check, alone=True)
