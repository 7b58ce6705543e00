"""The keys of a grain's shape: the keywords of the function of `bakery.physics.shapes.build` that makes it, with its ranges."""

# no annotations from __future__: pydantic would have to compile each of them again, some 3 ms in all
from typing import Annotated

from pydantic import AfterValidator, Field, Tag

from bakery.grammar.fields import Path, number, numbers, three, whole, word
from bakery.grammar.section import Section, pick
from bakery.physics.shapes import limits


def _between(bounds, **options):
    return number(least=bounds[0], most=bounds[1], **options)


Three = three(number(least=1e-6, most=1e6))
Two = Annotated[
    numbers(least=limits.EXPONENTS[0], most=limits.EXPONENTS[1], most_entries=2),
    AfterValidator(lambda values: (values[0], values[-1])),  # one number stands for both
]
Seed = whole(*limits.SEED)
Sharpness = _between(limits.SHARPNESS, words={"inf": "inf"})


class SphereShape(Section):
    type: word("sphere") = Field(description="An exact ball.")


class BoxShape(Section):
    type: word("box") = Field(description="A cuboid.")
    size: Three = Field((1.0, 1.0, 1.0), description="Proportions of its edges.")


class EllipsoidShape(Section):
    type: word("ellipsoid") = Field(description="An ellipsoid.")
    axes: Three = Field((1.0, 0.8, 0.65), description="Proportions of its axes.")


class SuperellipsoidShape(Section):
    type: word("superellipsoid") = Field(description="Between box, ellipsoid and octahedron.")
    axes: Three = Field((1.0, 1.0, 1.0), description="Proportions of its axes.")
    exponents: Two = Field(
        (0.5, 0.5), description="From pole to pole and around, or one for both: towards 0 a box, 1 an ellipsoid, 2 an octahedron."
    )


class RockShape(Section):
    type: word("rock") = Field(description="A worn fragment: sand, gravel, pebbles.")
    seed: Seed = Field(0, description="Another seed gives another grain of the same kind.")
    axes: Three = Field((1.0, 0.8, 0.65), description="Proportions.")
    corners: whole(*limits.CORNERS) = Field(45, description="Few give a splinter, many a pebble.")
    sharpness: Sharpness = Field(24.0, description="Sharpness of the edges; inf: not rounded.")
    roughness: _between(limits.NOISE) = Field(0.02, description="Approximate height of the bumps over the radius.")


class CrystalShape(Section):
    type: word("crystal") = Field(description="A crystal with chipped corners: salt, sugar.")
    seed: Seed = Field(0, description="Another seed gives another grain of the same kind.")
    habit: word(*limits.HABITS) = Field("cube", description="Perfect form: cube (salt), octahedron, prism (ice) or sucrose.")
    axes: Three = Field((1.0, 1.0, 1.0), description="Proportions, by which the perfect form is stretched.")
    chips: whole(*limits.CHIPS) = Field(2, description="Corners cut off.")
    depth: _between(limits.DEPTH) = Field(0.2, description="Largest depth of a chip, as a share of the height.")
    sharpness: Sharpness = Field(60.0, description="Sharpness of the edges; inf: not rounded.")
    roughness: _between(limits.NOISE) = Field(0.004, description="Approximate height of the bumps over the radius.")


class AggregateShape(Section):
    type: word("aggregate") = Field(description="Balls or rods grown together: snow, flour.")
    seed: Seed = Field(0, description="Another seed gives another grain of the same kind.")
    arrangement: word(*limits.ARRANGEMENTS) = Field(
        "cluster", description="cluster: each grows somewhere on another; star: rods outward from the first."
    )
    bodies: whole(*limits.BODIES) = Field(6, description="Number of balls or rods.")
    smallest: _between(limits.SMALLEST) = Field(0.6, description="Radius of the smallest body over the largest.")
    length: _between(limits.LENGTH) = Field(0.0, description="Length of a rod over its radius; 0: balls.")
    overlap: _between(limits.OVERLAP) = Field(
        0.35, description="How far two bodies of a cluster overlap, over the smaller radius."
    )
    blend: _between(limits.BLEND) = Field(0.05, description="Width over which grooves are filled, over the largest radius.")


class MeshShape(Section):
    type: word("mesh") = Field(description="A closed mesh from a file.")
    file: Path = Field(description="ply, obj, stl or off file.")
    repair: word(*limits.REPAIRS) | None = Field(
        None, description="Program that closes holes and similar defects before the mesh is checked (extra `repair`)."
    )


Shape = Annotated[
    Annotated[SphereShape, Tag("sphere")]
    | Annotated[BoxShape, Tag("box")]
    | Annotated[EllipsoidShape, Tag("ellipsoid")]
    | Annotated[SuperellipsoidShape, Tag("superellipsoid")]
    | Annotated[RockShape, Tag("rock")]
    | Annotated[CrystalShape, Tag("crystal")]
    | Annotated[AggregateShape, Tag("aggregate")]
    | Annotated[MeshShape, Tag("mesh")],
    pick("type", ("sphere", "box", "ellipsoid", "superellipsoid", "rock", "crystal", "aggregate", "mesh")),
]
