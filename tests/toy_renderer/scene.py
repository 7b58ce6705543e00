"""What a scene of the toy renderer may say."""

from pydantic import Field

from bakery.grammar.fields import word
from bakery.grammar.section import Section
from renderers.scene.common import Camera, Common, Direction, direction_problems

METHODS = ("single", "isotropic")
NEEDS = ("medium",)  # stages of the asset
FILES = ()  # keys of files, besides those of every scene
RESUMES = False  # whether `render` takes `resume`
CHOICE = "toy.method", METHODS  # the key of the method, and what it may be
EXACT, KEPT, POINTS = ("single",), (), METHODS  # of `bake trade`: methods without an error, kept within a tolerance, all
UNUSED = {  # common keys that it does without, and what would do
    "scene": "none: a haze has no surfaces", "film.wavelengths": "none: they are the asset's three",
    "stop": "none: nothing is sampled", "tolerance": "none: nothing is sampled", "denoise": "none: nothing is sampled"}


class Toy(Section):
    method: word(*METHODS) = Field("single", description="isotropic: as if it scattered the same in all directions.")
    sun: Direction = Field(description="In which its light travels.")


class SceneFile(Common):
    """A haze."""

    camera: Camera = Field(description="Where the picture is taken from.")
    toy: Toy = Field(description="The haze; this section chooses the renderer.")


def problems(root, values):
    """What has to hold between keys."""
    yield from direction_problems(root, values, "toy.sun")
