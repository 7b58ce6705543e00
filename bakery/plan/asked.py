"""What a bake is asked for."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class Asked:
    """What a bake is asked for, by options or by scenes."""

    # overrides of the recipe: what was set before, and on top of the recipe the knobs that are asked for
    settings: Mapping[str, str] = field(default_factory=dict)
    stages: tuple[str, ...] = ()  # names of the only stages to bake, with those that they need; all if empty
    recipe: object = None  # as it is with these settings, where it was read to find them; None where it is still to be read
    # added, left: names of stages that the recipe does not ask for, and that it asks for in vain
    added: tuple[str, ...] = ()
    left: tuple[str, ...] = ()
    # where scenes decide what is baked, parts of each stage of the recipe as it stands, with the stages that are added; None
    # otherwise
    recipe_parts: Mapping[str, Mapping] | None = None
    needs: tuple = ()  # why, see `renderers.scene.requirements.Need`
    remarks: tuple[str, ...] = ()  # what could not be found out
    read: tuple[Path, ...] = ()  # files that it was found out from, besides the recipe's


EVERYTHING = Asked()  # every stage, and the recipe as it stands
