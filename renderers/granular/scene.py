"""What a scene of the renderer of grains may say: the mesh that they fill, how they are rendered."""

# no annotations from __future__: pydantic would have to compile each of them again
from collections.abc import Iterator

from pydantic import Field

from bakery.errors import Problem
from bakery.grammar.fields import Path, word
from bakery.grammar.section import Section
from bakery.grammar.text import Mapping
from renderers.common import Common, Length

METHODS = ("ept", "vpt")
NEEDS = ("grains", "packing", "medium")  # stages of the asset
FILES = ("granular.where.mesh",)
UNUSED = {"film.wavelengths": "none: grains are rendered at the wavelengths of the asset"}  # common keys
RESUMES = True


class InMesh(Section):
    mesh: Path = Field(description="PLY, OBJ, STL or OFF file of a closed mesh: grains whose centre is inside are there.")
    unit: Length = Field(1.0, description="Length of one unit of the mesh.")


class Granular(Section):
    """Grains that fill a mesh."""

    where: InMesh = Field(description="What they fill.")
    method: word(*METHODS) = Field("ept", description="ept: paths from grain to grain; vpt: the medium that stands for them.")


class SceneFile(Common):
    """A scene of the renderer of grains."""

    granular: Granular = Field(description="Grains that fill a mesh.")


def problems(root: Mapping, values: dict) -> Iterator[Problem]:
    """What has to hold between keys: nothing besides."""
    yield from ()
