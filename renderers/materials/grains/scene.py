"""What a scene of the renderer of grains may say: its methods, and what they take."""

from collections.abc import Iterator

from bakery.errors import Problem
from bakery.grammar.text import Mapping
from renderers.materials.grains.declared import methods
from renderers.scene import declaration
from renderers.scene.common import differing

METHODS = methods()
NEEDS = ("grains", "packing", "medium")  # stages of the asset
UNUSED = {"film.wavelengths": "none: grains are rendered at the wavelengths of the asset"}  # common keys
RESUMES = True
CHOICE = "method", tuple(METHODS)  # the key of the method, and what it may be
# of `bake trade`: without an error of their own; meant to keep within a scene's tolerance; all that are tried
EXACT, KEPT, POINTS = declaration.points(METHODS)
PACE = 3e-4  # s of a core that a pixel takes to a relative variance of 1: 3e-5 to 8e-4 in shipped scenes


def problems(root: Mapping, values: dict) -> Iterator[Problem]:
    """What has to hold between keys of the entries, which have one method."""
    yield from declaration.unused(root, values, METHODS)
    yield from differing(root, values, "spread", 4.0)
    yield from differing(root, values, "widen", None)
