"""What a scene of the renderer of particles may say: its methods, and what they take."""

from collections.abc import Iterator

from bakery.errors import Problem
from bakery.grammar.text import Mapping
from renderers.materials.particles.declared import methods
from renderers.scene import declaration

METHODS = methods()
NEEDS = ("discrete",)  # stages of the asset
UNUSED: dict[str, str] = {}  # common keys
RESUMES = True
CHOICE = "method", tuple(METHODS)  # the key of the method, and what it may be
# of `bake trade`: without an error of their own; meant to keep within a scene's tolerance; all that are tried
EXACT, KEPT, POINTS = declaration.points(METHODS)
# s of a core that a pixel takes to a relative variance of 1: 3e-4 to 3e-3 in shipped scenes (drive_in_drizzle 5e-2)
PACE = 5e-4


def problems(root: Mapping, values: dict) -> Iterator[Problem]:
    """What has to hold between keys of the one entry."""
    yield from declaration.unused(root, values, METHODS)
