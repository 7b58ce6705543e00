"""What a bake is asked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class Asked:
    """What a bake is asked for, by options or by scenes.

    Attributes
    ----------
    settings : overrides of the recipe: what was set before, and on top of the recipe the knobs that are asked for
    stages : names of the only stages to bake, with those that they need; all if empty
    recipe : as it is with these settings, where it was read to find them; None where it is still to be read
    added, left : names of stages that the recipe does not ask for, and that it asks for in vain
    recipe_parts : where scenes decide what is baked, parts of each stage of the recipe as it stands, with the stages that are
        added; None otherwise
    needs : why, see `renderers.scene.requirements.Need`
    remarks : what could not be found out
    read : files that it was found out from, besides the recipe's
    """

    settings: Mapping[str, str] = field(default_factory=dict)
    stages: tuple[str, ...] = ()
    recipe: object = None
    added: tuple[str, ...] = ()
    left: tuple[str, ...] = ()
    recipe_parts: Mapping[str, Mapping] | None = None
    needs: tuple = ()
    remarks: tuple[str, ...] = ()
    read: tuple[Path, ...] = ()


EVERYTHING = Asked()  # every stage, and the recipe as it stands
