"""What a scene of the renderer of particles may say: its methods, and what they take."""

from __future__ import annotations

from collections.abc import Iterator

from bakery.errors import Problem
from bakery.grammar.text import Mapping, owner
from renderers.common import node_at

METHODS = ("auto", "particles", "continuous", "query", "explicit")
NEEDS = ("discrete",)  # stages of the asset
UNUSED: dict[str, str] = {}  # common keys
RESUMES = True
CHOICE = "method", METHODS  # the key of the method, and what it may be
# of `bake trade`: without an error of their own; meant to keep within a scene's tolerance; all that are tried
EXACT, KEPT = ("particles",), ("auto",)
POINTS = (*EXACT, "auto", "auto:peak=keep", "continuous", "continuous:peak=keep", "query")
# s of a core that a pixel takes to a relative variance of 1: 3e-4 to 3e-3 in shipped scenes (drive_in_drizzle 5e-2)
PACE = 5e-4


def approximations(values, tolerance: float) -> float:
    """Error that the continuous medium may make where it takes the place of particles; other methods state none."""
    return 0.5 * tolerance if values.method == "auto" else 0.0


def problems(root: Mapping, values: dict) -> Iterator[Problem]:
    """What has to hold between keys of the one entry."""
    entry = node_at(root, "materials[0]")
    if not isinstance(entry, Mapping):
        return
    method = values.get("method", "auto")
    if "footprint" in entry and method != "query":
        yield owner(entry["footprint"]).problem(f"found a footprint, which method {method} does not use",
                                                "expected it with method: query")
    if "peak" in entry and method == "explicit":
        yield owner(entry["peak"]).problem("found a peak, which spheres of glass do not have", "expected another method")
