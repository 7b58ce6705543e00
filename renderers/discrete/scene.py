"""What a scene of the renderer of particles may say: where the medium is, how it is rendered, how it moves."""

# no annotations from __future__: pydantic would have to compile each of them again
import math
from collections.abc import Iterator
from typing import Annotated

from pydantic import Discriminator, Field, Tag

from bakery.errors import Problem
from bakery.grammar.fields import Path, leaf, number, scalar, word
from bakery.grammar.section import Section
from bakery.grammar.text import Mapping, owner, show
from bakery.grammar.units import ANGLE, Quantity, Wrong, parse
from renderers.common import LENGTH, Common, Grid, Position, box_problems, node_at, vector

METHODS = ("auto", "particles", "continuous", "query", "explicit")
NEEDS = ("discrete",)  # stages of the asset
FILES = ("discrete.where.mesh", "discrete.where.grid")
BODIES = ""  # lists of bodies: none
UNUSED: dict[str, str] = {}  # common keys
RESUMES = True
CHOICE = "discrete.method", METHODS  # the key of the method, and what it may be
# of `bake trade`: without an error of their own; meant to keep within a scene's tolerance; all that are tried
EXACT, KEPT = ("particles",), ("auto",)
POINTS = (*EXACT, "auto", "auto:peak=keep", "continuous", "continuous:peak=keep", "query")
# s of a core that a pixel takes to a relative variance of 1: 3e-4 to 3e-3 in shipped scenes (drive_in_drizzle 5e-2)
PACE = 5e-4

TIME = Quantity("time", "times", "s", {"ms": -3, "s": 0}, "s")
SPEED = Quantity("speed", "speeds", "m/s", {"um/s": -6, "mm/s": -3, "cm/s": -2, "m/s": 0, "km/s": 3}, "m/s")


def approximations(values: Common, tolerance: float) -> float:
    """Error that the continuous medium may make where it takes the place of particles; other methods state none."""
    return 0.5 * tolerance if values.discrete.method == "auto" else 0.0


class Box(Section):
    lo: Position = Field(description="Corner of the box.")
    hi: Position = Field(description="The opposite corner.")


class InBox(Section):
    box: Box = Field(description="All of a box.")


class InMesh(Section):
    mesh: Path = Field(description="PLY or OBJ file of a closed mesh: what is inside.")
    unit: number(LENGTH, above=0) = Field(1.0, description="Length of one unit of the mesh.")


_KINDS = ("box", "mesh", "grid")
Where = Annotated[
    Annotated[InBox, Tag("box")] | Annotated[InMesh, Tag("mesh")] | Annotated[Grid, Tag("grid")],
    Discriminator(lambda node: next((kind for kind in _KINDS if isinstance(node, Mapping) and kind in node), None),
                  custom_error_type="choice", custom_error_message="|{box: {lo: …, hi: …}}|{mesh: …}|{grid: …, lo: …, hi: …}"),
]


def _peak(node):
    """`keep`, `auto`, or an angle in rad."""
    value = scalar(node, "keep, auto, or an angle such as 0.1 deg")
    if value.text in ("keep", "auto"):
        return value.text
    angle = parse(value.text, ANGLE)
    if not 0 <= angle <= math.pi:
        raise Wrong(f"found {show(value.text)}", "expected keep, auto, or an angle from 0 to 180 deg")
    return angle


class Discrete(Section):
    """Particles that can be seen."""

    where: Where | None = Field(None, description="Where the particles are; the asset's own box from the origin if absent.")
    method: word(*METHODS) = Field(
        "auto", description="auto: particles where they can be told apart, the continuous medium elsewhere."
    )
    footprint: number(above=0, most=100) = Field(
        0.5, description="Of method query: cross section of the cylinder, in pixels (k of the paper)."
    )
    peak: leaf(_peak, {"type": ["string", "number"]}) = Field(
        "auto", description="Peak of the phase functions within this angle counts as unscattered; auto: half a pixel; keep."
    )
    velocity: vector(SPEED, "[0, 0, -1] m/s") = Field((0.0, 0.0, 0.0), description="Of all particles.")
    time: number(TIME) = Field(0.0, description="At which the moving particles are seen.")


class SceneFile(Common):
    """A scene of the renderer of particles."""

    discrete: Discrete = Field(description="Particles that can be seen.")


def problems(root: Mapping, values: dict) -> Iterator[Problem]:
    """What has to hold between keys."""
    for key in ("discrete.where.box", "discrete.where"):
        yield from box_problems(root, values, key)
    method = values.get("discrete.method", "auto")
    if node_at(root, "discrete.footprint") is not None and method != "query":
        yield owner(node_at(root, "discrete.footprint")).problem(f"found a footprint, which method {method} does not use",
                                                                  "expected it with method: query")
    if node_at(root, "discrete.peak") is not None and method == "explicit":
        yield owner(node_at(root, "discrete.peak")).problem("found a peak, which spheres of glass do not have",
                                                             "expected another method")
