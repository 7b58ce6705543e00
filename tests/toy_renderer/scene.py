"""What a scene of the toy renderer may say."""

from pydantic import Field

from bakery.grammar.fields import whole
from bakery.grammar.section import Section
from renderers.scene import Camera, Common, Direction, direction_problems

NEEDS = ("medium",)  # stages of the asset
FILES = ("asset",)  # keys of the files that a scene names


class Toy(Section):
    sun: Direction = Field(description="In which its light travels.")
    width: whole(1, 4096) = Field(8, description="Of the picture, pixels.")
    height: whole(1, 4096) = Field(6, description="Of the picture, pixels.")


class SceneFile(Common):
    """A haze."""

    camera: Camera = Field(description="Where the picture is taken from.")
    toy: Toy = Field(description="The haze; this section chooses the renderer.")


def problems(root, values):
    """What has to hold between keys."""
    yield from direction_problems(root, values, "toy.sun")
