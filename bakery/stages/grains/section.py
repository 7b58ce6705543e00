"""Recipe sections `grains` and `scatterometer`: packed grains, and options of their measurement."""

# no annotations from __future__: pydantic would have to compile each of them again, some 3 ms in all
import math
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field, Tag

from bakery.grammar.fields import AUTO, GrainName, Length, Share, number, numbers, whole, word
from bakery.grammar.section import HostOf, MaterialOf, Section, given, pick
from bakery.grammar.text import Mapping, Node, show
from bakery.grammar.units import COEFFICIENT, FRACTION, Wrong
from bakery.grammar.values import Index, Values
from bakery.physics.shapes import limits
from bakery.stages.declaration import RecipeSection
from bakery.stages.grains.shape_keys import AggregateShape, Shape

if TYPE_CHECKING:
    from bakery.recipe.checker import Checker

RAYS = 30  # smallest size parameter of a grain: below it nothing about rays holds
LARGEST = 1e9  # um
MESHES = 512 << 20  # bytes of all mesh files of a recipe

Roughness = number(FRACTION, least=0, most=1)


class Dielectric(Section):
    type: word("dielectric") = Field(description="Lets light in: ice, glass, salt.")
    material: MaterialOf = Field(description="A material of assets/materials, {n, k}, or {file}; only n counts here.")
    roughness: Roughness = Field(0.0, description="GGX alpha, 0.0001 to 1; 0 is smooth.")


class Diffuse(Section):
    type: word("diffuse") = Field(description="Opaque and matt (Lambertian).")
    reflectance: numbers(FRACTION, least=0, most=1) = Field(
        description="Share of the light that is reflected; one value, or one a wavelength.")


class Conductor(Section):
    type: word("conductor") = Field(description="Opaque and shiny: metals.")
    material: MaterialOf = Field(description="A material of assets/materials, {n, k}, or {file}.")
    roughness: Roughness = Field(0.0, description="GGX alpha, 0.0001 to 1; 0 is smooth.")


Surface = Annotated[Annotated[Dielectric, Tag("dielectric")] | Annotated[Diffuse, Tag("diffuse")]
                    | Annotated[Conductor, Tag("conductor")],
                    pick("type", ("dielectric", "diffuse", "conductor"))]


class Interior(Section):
    """Absorption inside a dielectric: absorption or material."""

    absorption: numbers(COEFFICIENT, least=0, most=1e12) | None = Field(
        None, description="Absorption coefficient, such as [0.1, 0.2, 0.4] /mm; one value, or one a wavelength."
    )
    material: MaterialOf | None = Field(None, description="Material whose k absorbs (4 pi k / wavelength).")


class Grain(Section):
    name: GrainName = Field(description="Name of the group in the asset.")
    weight: Share = Field(1.0, description="Share of the grains by number; the weights of all components add up to 1.")
    shape: Shape = Field(description="Shape of the grain, scaled to the bounding sphere.")
    surface: Surface = Field(description="Surface of the grain.")
    interior: Interior | None = Field(None, description="Absorption inside a dielectric; default: clear.")


class Grains(Section):
    """Packed grains."""

    radius: Length = Field(description="Radius of the bounding sphere, such as 0.5 mm; the mean if packing.radii gives several.")
    host: HostOf = Field("vacuum", description="Medium between the grains: a material, {n}, or {file}.")
    components: list[Grain] = Field(min_length=1, max_length=256, description="The kinds of grains.")


class Scatterometer(Section):
    """Options of the grain stage."""

    tolerance: number(FRACTION, least=1e-6, most=0.5) | None = Field(
        None, description="Error allowed in each statistic of a grain; default: half of the recipe's tolerance."
    )
    triangles: whole(*limits.TRIANGLES, words=limits.LEVELS) = Field(
        limits.LEVELS["middle"], description="Triangles of a grain: coarse (1,300), middle (20,000), fine (200,000) or a number."
    )
    paths: whole(1_000, 10**12, words=AUTO) = Field("auto", description="Number of paths, whatever the error.")
    depth: whole(1, 10**9) = Field(100_000, description="Surface interactions after which a path is cut.")
    # one word since there is one walk: with the key older recipes are read, and input hashes stay what they were
    engine: word("numba") = Field("numba", description="What traces the paths.")


# ---- what holds between the keys


def check(checker: "Checker", section: Mapping) -> None:
    """Grains, their packing, shapes and surfaces."""
    if "packing" not in checker.tree:
        checker.report_section(section, "found grains without packing", "expected packing: {fraction: 0.6} or the like")
    host = checker.host(section, "vacuum")
    _radius(checker, section, host)
    for part in checker.components(section, "weight"):
        shape, surface, interior = (part.get(name) for name in ("shape", "surface", "interior"))
        if isinstance(shape, Mapping):
            _shape(checker, shape)
        if isinstance(surface, Mapping):
            _surface(checker, surface, host)
        if isinstance(interior, Mapping):
            _interior(checker, interior, surface)


def _radius(checker: "Checker", section: Mapping, host: Index | None) -> None:
    radius = checker.value(section, "radius")
    if radius is None or host is None:
        return
    least = RAYS * (np.array(checker.wavelength) / (2 * math.pi * host.n)).max()
    if radius < least:
        checker.report(section["radius"], f"found grains of {radius:g} um, too small for rays",
                       f"expected at least {least:.3g} um (size parameter {RAYS}), or particles instead of grains")
    elif radius > LARGEST:
        checker.report(section["radius"], f"found grains of {radius:g} um", f"expected at most {LARGEST:g} um")


def _shape(checker: "Checker", shape: Mapping) -> None:
    for name in ("axes", "size"):
        values = checker.several(shape.get(name))
        if values is not None and len(values) == 3 and max(values) > limits.ASPECT * min(values):
            checker.report_section(shape[name], f"found {name} that differ by a factor of {max(values) / min(values):,.0f}",
                                   f"expected at most {limits.ASPECT:,.0f}")
        elif values is not None and len(values) == 3 and (kind := checker.value(shape, "type")) in ("box", "ellipsoid"):
            share = limits.share_hit({"type": kind, name: values})
            if share < limits.SHARE_HIT:
                checker.report_section(shape[name], f"found a grain that {share:.2g} of the rays through its bounding sphere hit",
                                       f"expected at least {limits.SHARE_HIT:g}, as of the {name} [1, 0.0013, 0.0013]")
    if checker.value(shape, "type") == "mesh":
        mesh_file(checker, shape.get("file"))
    elif checker.value(shape, "type") == "aggregate":
        _aggregate(checker, shape)


def _aggregate(checker: "Checker", shape: Mapping) -> None:
    """One whose bodies a grid resolves."""
    from bakery.physics.shapes import rods

    keys = {name: checker.value(shape, name) if name in shape else field.default
            for name, field in AggregateShape.model_fields.items() if name != "type"}
    if None in keys.values():
        return
    try:
        rods.grown(**keys).step  # noqa: B018
    except ValueError as fault:
        checker.report_section(shape, f"found an aggregate whose {fault}",
                               "expected a larger smallest, a shorter length or fewer bodies")


def mesh_file(checker: "Checker", node: Node | None) -> None:
    """Read the mesh file that a key names; whether it makes a body is for the stage to say, which builds it."""
    name = None if node is None else checker.values.get(node.place.key)
    if name is None:
        return
    kind = PurePosixPath(name).suffix[1:].lower()
    if kind not in limits.KINDS:
        kinds = ", ".join(f".{each_kind}" for each_kind in limits.KINDS[:-1])
        checker.report(node, f"found {show(name)}", f"expected a file that ends in {kinds} or .{limits.KINDS[-1]}")
        return
    try:
        data, file = checker.folder.read(node.place.key, name, limits.BYTES, "mesh")
    except Wrong as wrong:
        checker.report(node, wrong.found, wrong.expected)
        return
    if not data or data.isspace():
        checker.report(node, f"found {show(name)}, which is empty", f"expected a {kind} file with triangles")
        return
    checker.files.append(file)
    checker.found[node.place.key] = checker.meshes[node.place.key] = data, kind
    different = {id(each_kind): len(each_kind) for each_kind, _ in checker.meshes.values()}
    if sum(different.values()) > MESHES >= sum(different.values()) - len(data):
        checker.report(node, f"found meshes of more than {MESHES >> 20} MiB together with {show(name)}", "expected smaller files")


def _surface(checker: "Checker", surface: Mapping, host: Index | None) -> None:
    kind = checker.value(surface, "type")
    roughness = checker.value(surface, "roughness")
    if roughness is not None and 0 < roughness < limits.ALPHA_MIN:
        checker.report(surface["roughness"], f"found {show(surface['roughness'].text)}",
                       f"expected 0 (smooth) or {limits.ALPHA_MIN:g} to 1")
    if kind == "diffuse":
        checker.one_each(surface, "reflectance")
    if kind not in ("dielectric", "conductor") or "material" not in surface:
        return
    index = checker.index(surface, "material")
    if kind == "conductor" or index is None or host is None:
        return
    relative = index.n / host.n
    least, most = limits.INDEX
    outside = relative[(relative < least) | (relative > most)]
    if outside.size:
        checker.report_section(surface["material"], f"found an index of {outside[0]:.4g} relative to the host",
                               f"expected {least:g} to {most:g}, as dielectrics have it")
    contrast = (relative - 1)[relative != 1]
    near = contrast[np.abs(contrast) < (1 - 1e-9) * limits.CONTRAST_MIN]
    if near.size:
        checker.report_section(
            surface["material"],
            f"found an index of 1 {near[0]:+.2g} relative to the host, which hardly turns light",
            f"expected one that differs by at least {limits.CONTRAST_MIN:g}, or the host's own, which turns none",
        )


def _interior(checker: "Checker", interior: Mapping, surface: Node | None) -> None:
    kind = checker.value(surface, "type") if isinstance(surface, Mapping) else None
    if kind in ("diffuse", "conductor"):
        checker.report_section(interior, f"found an interior below a {kind} surface, which lets no light in",
                               "expected none, or a dielectric surface")
    sources = given(interior, "absorption", "material")
    if len(sources) != 1:
        fault, expected = ("absorption beside material", "only one of them") if sources else (
            "neither absorption nor material", "one of them")
        checker.report_section(interior, f"found {fault}", f"expected {expected}")
    if "absorption" in interior:
        checker.one_each(interior, "absorption")
    if "material" in interior:
        checker.index(interior, "material")


# ---- values


def absorption(interior: Values | None, wavelength) -> np.ndarray:
    """Absorption coefficient of the inside of a grain at the wavelengths (um), (L,) 1/m."""
    if interior is None:
        return np.zeros(len(wavelength))
    if interior.material is None:
        return interior.absorption
    return 4e6 * np.pi * interior.material.k / np.array(wavelength)


def shape_keys(shape: Values) -> dict:
    """A shape as `bakery.physics.shapes.build.build` takes it."""
    keys = dict(vars(shape))
    if shape.type == "mesh":
        data, kind = keys["file"]
        return {"type": "mesh", "data": data, "kind": kind} | ({"repair": shape.repair} if shape.repair else {})
    return {name: math.inf if isinstance(value, str) and value == "inf" else value for name, value in keys.items()}


def check_scatterometer(checker: "Checker", section: Mapping) -> None:
    """It measures grains."""
    checker.only_with(section, "grains")


def _completed(scatterometer: Scatterometer, recipe) -> Scatterometer:
    if scatterometer.tolerance is not None:
        return scatterometer
    return scatterometer.model_copy(update={"tolerance": recipe.tolerance / 2})


GRAINS = RecipeSection("grains", Grains, "Packed grains: sand, snow, sugar.", check, scatters=True)
SCATTEROMETER = RecipeSection("scatterometer", Scatterometer, "Options of the grain stage.", check_scatterometer,
                              completed=_completed, beside="grains")
