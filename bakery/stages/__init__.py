"""All stages, in the order in which a plan runs them."""

from functools import cache
from importlib import import_module

from bakery.stages.declaration import Stage

STAGES = (
    "bakery.stages.optics.stage:STAGE",
    "bakery.stages.packing.stage:STAGE",
    "bakery.stages.grains.stage:STAGE",
    "bakery.stages.medium.stage:OF_PARTICLES",
    "bakery.stages.medium.stage:OF_COEFFICIENTS",
    "bakery.stages.effective.stage:OF_GRAINS",
    "bakery.stages.multiple.stage:STAGE",
    "bakery.stages.beam.stage:STAGE",
    "bakery.stages.discrete.stage:STAGE",
    "bakery.stages.surface.stage:STAGE",
    "bakery.stages.surface.grains:OF_GRAINS",
)


@cache
def all_stages() -> tuple[Stage, ...]:
    """Every declared stage, upstream ones first."""
    places = (target.partition(":") for target in STAGES)
    return tuple(getattr(import_module(module), name) for module, _, name in places)


def sections_in_words(*names: str) -> str:
    """What `sections_for` gives of some groups: `grains` and `packing` or `particles`, in back quotes."""
    alternatives = (" and ".join(f"`{section}`" for section in sections) for name in names for sections in sections_for(name))
    return " or ".join(dict.fromkeys(alternatives))


def sections_for(name: str) -> tuple[tuple[str, ...], ...]:
    """Recipe sections that make a bake write a group, one tuple for each way of writing it; () for a name that is no stage's.

    A stage without a section of its own runs where those that it needs do; defaults fill a section that stands beside another.
    """
    alternatives = []
    for stage in all_stages():
        if stage.name == name:
            names = tuple(section.name for section in stage.sections if not section.beside)
            alternatives.append(names or tuple(section_name for need in stage.needs for section_name in sections_for(need)[0]))
    return tuple(dict.fromkeys(alternatives))
