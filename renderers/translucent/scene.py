"""What a scene of the renderer of translucent bodies may say: its methods, and what they take."""

from __future__ import annotations

from collections.abc import Iterator

from bakery.errors import Problem
from bakery.grammar.text import Mapping, owner
from renderers.common import differing, node_at

METHODS = ("auto", "paths", "shells", "vrl", "vrl+tables", "beams", "beams+tables", "dipole")
# methods that read the tables: of them vrl and beams only how light decays with distance
READERS = ("vrl", "vrl+tables", "beams", "beams+tables")
NEEDS = ("medium", "multiple")  # stages of the asset
UNUSED = {"film.wavelengths": "none: bodies are rendered at the wavelengths of the asset"}  # common keys
RESUMES = True
CHOICE = "method", METHODS  # the key of the method, and what it may be
# of `bake trade`: without an error of their own; within the scene's tolerance by tables as it requires them; all that are tried
EXACT, KEPT = ("paths", "shells", "vrl"), ("auto", "vrl+tables")
PACE = 3e-4  # s of a core that a pixel takes to a relative variance of 1: 1e-4 to 3e-3 in shipped scenes
POINTS = (*EXACT, "vrl+tables", "vrl+tables:boundary.tables=mirrored", "beams", "beams+tables", "dipole")


def approximations(values, tolerance: float) -> float:
    """Stated: of tables against paths, in the mean (docs/translucent.md)."""
    return 0.01 if values.method in ("auto", "vrl+tables", "beams+tables") else 0.0


def index_fault(shape: str, index: float | None, own: float) -> str:
    """What is wrong with the index that a scene says of a shape whose BSDF has `own`; "" where it is that, or none is said."""
    if index is None or abs(index - own) <= 1e-3 * index:
        return ""
    return f"found {index:g}, and the BSDF of {shape} has {own:g}; the same would do"


def problems(root: Mapping, values: dict) -> Iterator[Problem]:
    """What has to hold between keys of the entries, which have one method."""
    method = values.get("method", "auto")
    for key in [key for key in values if key.startswith("materials[") and key.endswith("].boundary.tables")]:
        if method not in ("auto", "vrl+tables", "beams+tables"):
            yield owner(node_at(root, key)).problem(f"found a boundary of tables, which method {method} does not use",
                                                    "expected it with method: vrl+tables")
    yield from differing(root, values, "boundary.tables", "negative")
