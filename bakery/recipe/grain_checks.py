"""What has to hold between the keys of packed grains."""

from __future__ import annotations

import math
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from bakery.grammar.section import given
from bakery.grammar.text import Mapping, Node, show
from bakery.grammar.units import Wrong
from bakery.physics.shapes import limits
from bakery.recipe.model import Index

if TYPE_CHECKING:
    from bakery.recipe.checks import Checker

RAYS = 30  # smallest size parameter of a grain: below it nothing about rays holds
LARGEST = 1e9  # um
MESHES = 512 << 20  # bytes of all mesh files of a recipe


def check(checker: Checker, section: Mapping) -> None:
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


def _radius(checker: Checker, section: Mapping, host: Index | None) -> None:
    radius = checker.value(section, "radius")
    if radius is None or host is None:
        return
    least = RAYS * (np.array(checker.wavelength) / (2 * math.pi * host.n)).max()
    if radius < least:
        checker.report(
            section["radius"],
            f"found grains of {radius:g} um, too small for rays",
            f"expected at least {least:.3g} um (size parameter {RAYS}), or particles instead of grains",
        )
    elif radius > LARGEST:
        checker.report(section["radius"], f"found grains of {radius:g} um", f"expected at most {LARGEST:g} um")


def _shape(checker: Checker, shape: Mapping) -> None:
    for name in ("axes", "size"):
        values = checker.several(shape.get(name))
        if values is not None and len(values) == 3 and max(values) > limits.ASPECT * min(values):
            checker.report_section(
                shape[name],
                f"found {name} that differ by a factor of {max(values) / min(values):,.0f}",
                f"expected at most {limits.ASPECT:,.0f}",
            )
    if checker.value(shape, "type") == "mesh":
        _mesh(checker, shape.get("file"))


def _mesh(checker: Checker, node: Node | None) -> None:
    """The content of a mesh file; whether it makes a grain is for the stage to say, which builds it."""
    name = None if node is None else checker.values.get(node.place.key)
    if name is None:
        return
    kind = PurePosixPath(name).suffix[1:].lower()
    if kind not in limits.KINDS:
        kinds = ", ".join(f".{known}" for known in limits.KINDS[:-1])
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
    checker.meshes[node.place.key] = data, kind
    different = {id(known): len(known) for known, _ in checker.meshes.values()}
    if sum(different.values()) > MESHES >= sum(different.values()) - len(data):
        checker.report(node, f"found meshes of more than {MESHES >> 20} MiB together with {show(name)}", "expected smaller files")


def _surface(checker: Checker, surface: Mapping, host: Index | None) -> None:
    kind = checker.value(surface, "type")
    roughness = checker.value(surface, "roughness")
    if roughness is not None and 0 < roughness < limits.ALPHA_MIN:
        checker.report(
            surface["roughness"], f"found {show(surface['roughness'].text)}", f"expected 0 (smooth) or {limits.ALPHA_MIN:g} to 1"
        )
    if kind == "diffuse":
        checker.one_each(surface, "reflectance")
    if kind not in ("dielectric", "conductor") or "material" not in surface:
        return
    found = checker.index(surface, "material")
    if kind == "conductor" or found is None or host is None:
        return
    relative = found.n / host.n
    least, most = limits.INDEX
    wrong = relative[(relative < least) | (relative > most)]
    if wrong.size:
        checker.report_section(
            surface["material"],
            f"found an index of {wrong[0]:.4g} relative to the host",
            f"expected {least:g} to {most:g}, as dielectrics have it",
        )


def _interior(checker: Checker, interior: Mapping, surface: Node | None) -> None:
    kind = checker.value(surface, "type") if isinstance(surface, Mapping) else None
    if kind in ("diffuse", "conductor"):
        checker.report_section(
            interior,
            f"found an interior below a {kind} surface, which lets no light in",
            "expected none, or a dielectric surface",
        )
    found = given(interior, "absorption", "material")
    if len(found) != 1:
        checker.report_section(
            interior,
            "found absorption beside material" if found else "found neither absorption nor material",
            "expected only one of them" if found else "expected one of them",
        )
    if "absorption" in interior:
        checker.one_each(interior, "absorption")
    if "material" in interior:
        checker.index(interior, "material")
