"""What a scene of the renderer of translucent bodies may say: which shapes are bodies, how they are rendered."""

# no annotations from __future__: pydantic would have to compile each of them again
from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from bakery.errors import Problem
from bakery.grammar.fields import Path, Text, number, word
from bakery.grammar.section import Section
from bakery.grammar.text import Mapping, Sequence, owner, show
from renderers.common import Common, node_at

METHODS = ("auto", "paths", "shells", "vrl", "vrl+tables", "beams", "beams+tables", "dipole")
# methods that read the tables: of them vrl and beams only how light decays with distance
READERS = ("vrl", "vrl+tables", "beams", "beams+tables")
BOUNDARIES = ("negative", "mirrored", "none")
NEEDS = ("medium", "multiple")  # stages of the asset
FILES = ()
BODIES = "translucent.bodies"  # a list, each with its own asset
UNUSED = {"film.wavelengths": "none: bodies are rendered at the wavelengths of the asset"}  # common keys
RESUMES = True
CHOICE = "translucent.method", METHODS  # the key of the method, and what it may be
# of `bake trade`: without an error of their own; within the scene's tolerance by tables as it requires them; all that are tried
EXACT, KEPT = ("paths", "shells", "vrl"), ("auto", "vrl+tables")
PACE = 3e-4  # s of a core that a pixel takes to a relative variance of 1: 1e-4 to 3e-3 in shipped scenes
POINTS = (*EXACT, "vrl+tables", "vrl+tables:boundary=mirrored", "beams", "beams+tables", "dipole")


def approximations(values: Common, tolerance: float) -> float:
    """Stated: of tables against paths, in the mean (docs/translucent.md)."""
    return 0.01 if values.translucent.method in ("auto", "vrl+tables", "beams+tables") else 0.0


class Boundary(Section):
    """Between a body and what is around it."""

    index: number(above=0, most=10) = Field(
        description="Refractive index inside over that outside, as the shape's BSDF has it; 1 for a BSDF of type null."
    )


class Body(Section):
    """A shape of the Mitsuba scene that a translucent material fills."""

    shape: Text = Field(description="Its id in the Mitsuba scene: a closed mesh.")
    boundary: Boundary | None = Field(None, description="Its boundary; what the shape's BSDF says if absent.")
    asset: Path | None = Field(None, description="Asset of its material; the scene's if absent.")
    recipe: Path | None = Field(None, description="Instead of the asset: its recipe.")


class Translucent(Section):
    """Translucent bodies."""

    bodies: Annotated[list[Body], Field(min_length=1, max_length=256)] = Field(description="Shapes that are translucent.")
    method: word(*METHODS) = Field(
        "auto", description="paths: light is followed event by event; shells: the same, but far from surfaces it jumps to the "
        "surface of the largest empty sphere by stored exits; vrl: beams of light, of which each event begins one, are joined "
        "with lines of sight; vrl+tables: third and later events from the tables; beams: beams are joined with lines of sight "
        "that pass close by; beams+tables: the same for one and two events in bodies whose boundary turns light, later ones from "
        "the tables; dipole: second and later events by the directional dipole, approximately, for comparison; auto: vrl+tables, "
        "or shells where beams would be sparse."
    )
    boundary: word(*BOUNDARIES) = Field(
        "negative", description="Of the tables, which know none. negative: light that leaves a body is taken away, exactly; "
        "mirrored: by a mirror outside of the boundary, approximately; none: it is not."
    )


class SceneFile(Common):
    """A scene of the renderer of translucent bodies."""

    translucent: Translucent = Field(description="Translucent bodies.")


def index_fault(shape: str, index: float | None, own: float) -> str:
    """What is wrong with the index that a scene says of a shape whose BSDF has `own`; "" where it is that, or none is said."""
    if index is None or abs(index - own) <= 1e-3 * index:
        return ""
    return f"found {index:g}, and the BSDF of {shape} has {own:g}; the same would do"


def problems(root: Mapping, values: dict) -> Iterator[Problem]:
    """What has to hold between keys."""
    method = values.get("translucent.method", "auto")
    if (node := node_at(root, "translucent.boundary")) is not None and method not in ("auto", "vrl+tables", "beams+tables"):
        yield owner(node).problem(f"found a boundary of tables, which method {method} does not use",
                                  "expected it with method: vrl+tables")
    named: dict[str, str] = {}
    bodies = node_at(root, "translucent.bodies")
    for entry in range(len(bodies) if isinstance(bodies, Sequence) else 0):
        key = f"translucent.bodies[{entry}].shape"
        name, node = values.get(key), node_at(root, key)
        if name is not None and named.setdefault(name, key) != key:
            yield node.place.problem(f"found {show(name)}, which is {named[name].removesuffix('.shape')} already",
                                     "expected each shape once")
    if node_at(root, "scene") is None:
        yield owner(root).problem("missing", "expected scene: {mitsuba: …}, with the shapes that are bodies", key="scene")
