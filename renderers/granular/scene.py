"""What a scene of the renderer of grains may say: the mesh that they fill, how they are rendered."""

# no annotations from __future__: pydantic would have to compile each of them again
from collections.abc import Iterator
from typing import Annotated

from pydantic import Discriminator, Field, Tag

from bakery.errors import Problem
from bakery.grammar.fields import Path, number, word
from bakery.grammar.section import Section
from bakery.grammar.text import Mapping, Sequence, owner
from renderers.common import Common, Grid, Length, box_problems, names_at, node_at

METHODS = ("auto", "ept", "vpt", "ept+vpt", "ept+vpt+da", "teleport")
NEEDS = ("grains", "packing", "medium")  # stages of the asset
FILES = ("granular.where.mesh", "granular.where.fraction.grid", "granular.where.mixture.*.grid")
BODIES = "granular.where"  # may be a list, each with its own asset
UNUSED = {"film.wavelengths": "none: grains are rendered at the wavelengths of the asset"}  # common keys
RESUMES = True
CHOICE = "granular.method", METHODS  # the key of the method, and what it may be
# of `bake trade`: without an error of their own; meant to keep within a scene's tolerance; all that are tried
EXACT, KEPT = ("ept",), ("auto",)
PACE = 3e-4  # s of a core that a pixel takes to a relative variance of 1: 3e-5 to 8e-4 in shipped scenes
# against paths from grain to grain, largest of eight scenes (docs/granular.md): another scene may have more
STATED = {"ept+vpt": 0.024, "ept+vpt+da": 0.024, "teleport": 0.019, "vpt": 0.264}
ROOM = 0.5  # of a tolerance, that `auto` may be off by where it goes on in the medium; in squares a quarter
POINTS = (*EXACT, "ept+vpt", "ept+vpt:spread=1", "ept+vpt+da", "ept+vpt+da:spread=1", "vpt", "teleport")


def approximations(values: Common, tolerance: float) -> float:
    """Error of the method; of `auto` the most that it lets itself have, before it has measured it."""
    return ROOM * tolerance if values.granular.method == "auto" else STATED.get(values.granular.method, 0.0)


class InMesh(Section):
    """A mesh full of grains."""

    mesh: Path = Field(description="PLY, OBJ, STL or OFF file of a closed mesh: grains whose centre is inside are there.")
    unit: Length = Field(1.0, description="Length of one unit of the mesh.")
    fraction: Grid | None = Field(None, description="Local packing fraction, of volume; the asset's everywhere if absent.")
    mixture: Annotated[dict[str, Grid], Field(min_length=1)] | None = Field(
        None, description="Component of the asset -> its local share of the number of grains; the asset's if absent."
    )


class Body(InMesh):
    """One of several bodies of grains."""

    asset: Path | None = Field(None, description="Asset of its grains; the scene's if absent.")
    recipe: Path | None = Field(None, description="Instead of the asset: its recipe.")


Bodies = Annotated[list[Body], Field(min_length=1, max_length=256)]
Where = Annotated[
    Annotated[InMesh, Tag("one")] | Annotated[Bodies, Tag("list")],
    Discriminator(lambda node: "list" if isinstance(node, (Sequence, list)) else "one"),
]


class Granular(Section):
    """Grains that fill meshes."""

    where: Where = Field(description="The mesh that they fill, or a list of meshes, each with the asset of its own grains.")
    method: word(*METHODS) = Field(
        "auto", description="ept: paths from grain to grain; vpt: the medium that stands for them; ept+vpt: from grain to grain, "
        "and in the medium once the paths of neighbouring pixels have come apart; +da: diffusion deep inside; teleport: grains "
        "without places; auto: ept, or ept+vpt+da where that is measured to be as good, or ept does not find the light."
    )
    spread: number(above=0, most=1e6) = Field(
        4.0, description="Radii of the largest sphere by which paths of neighbouring pixels come apart before they switch."
    )

    @property
    def bodies(self):
        """Of the scene, each with `mesh` and `unit`."""
        return self.where if isinstance(self.where, list) else [self.where]

    def key(self, body: int) -> str:
        """Of a body in the scene."""
        return f"granular.where[{body}]" if isinstance(self.where, list) else "granular.where"


class SceneFile(Common):
    """A scene of the renderer of grains."""

    granular: Granular = Field(description="Grains that fill meshes.")


def problems(root: Mapping, values: dict) -> Iterator[Problem]:
    """What has to hold between keys."""
    method = values.get("granular.method", "auto")
    if (node := node_at(root, "granular.spread")) is not None and method in ("ept", "vpt", "teleport"):
        yield owner(node).problem(f"found a spread, which method {method} does not use",
                                  "expected it with a method of grains and medium, such as ept+vpt")
    bodies = node_at(root, BODIES)
    for i in range(len(bodies) if isinstance(bodies, Sequence) else 1):
        key = f"{BODIES}[{i}]" if isinstance(bodies, Sequence) else BODIES
        for one in ("fraction", *(f"mixture.{name}" for name in names_at(node_at(root, f"{key}.mixture")))):
            yield from box_problems(root, values, f"{key}.{one}")
