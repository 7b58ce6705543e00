"""What a scene of the renderer of grains may say: its methods, and what they take."""

from __future__ import annotations

from collections.abc import Iterator

from bakery.errors import Problem
from bakery.grammar.text import Mapping, Sequence, owner
from renderers.common import differing

METHODS = ("auto", "ept", "vpt", "ept+vpt", "ept+vpt+da", "teleport")
NEEDS = ("grains", "packing", "medium")  # stages of the asset
UNUSED = {"film.wavelengths": "none: grains are rendered at the wavelengths of the asset"}  # common keys
RESUMES = True
CHOICE = "method", METHODS  # the key of the method, and what it may be
# of `bake trade`: without an error of their own; meant to keep within a scene's tolerance; all that are tried
EXACT, KEPT = ("ept",), ("auto",)
PACE = 3e-4  # s of a core that a pixel takes to a relative variance of 1: 3e-5 to 8e-4 in shipped scenes
# against paths from grain to grain, largest of eight scenes (docs/granular.md): another scene may have more
STATED = {"ept+vpt": 0.024, "ept+vpt+da": 0.024, "teleport": 0.019, "vpt": 0.264}
ROOM = 0.5  # of a tolerance, that `auto` may be off by where it goes on in the medium; in squares a quarter
POINTS = (*EXACT, "ept+vpt", "ept+vpt:spread=1", "ept+vpt+da", "ept+vpt+da:spread=1", "vpt", "teleport")


def approximations(values, tolerance: float) -> float:
    """Error of the method; of `auto` the most that it lets itself have, before it has measured it."""
    return ROOM * tolerance if values.method == "auto" else STATED.get(values.method, 0.0)


def problems(root: Mapping, values: dict) -> Iterator[Problem]:
    """What has to hold between keys of the entries, which have one method."""
    entries, method = root.get("materials"), values.get("method", "auto")
    for entry in entries if isinstance(entries, Sequence) else ():
        if isinstance(entry, Mapping) and "spread" in entry and method in ("ept", "vpt", "teleport"):
            yield owner(entry["spread"]).problem(f"found a spread, which method {method} does not use",
                                                 "expected it with a method of grains and medium, such as ept+vpt")
    yield from differing(root, values, "spread", 4.0)
