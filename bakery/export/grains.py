"""Exemplar grains for other software: meshes as PLY and OBJ, one file a component, and their figures as CSV.

Coordinates are in radii of the bounding sphere, which is the unit sphere, with all their digits.
"""

from __future__ import annotations

import numpy as np

from bakery.draw.files import csv_text
from bakery.errors import AssetError
from bakery.stages.grains.pictures import Exemplar, components_of, exemplar
from bakery.store.tree import Dataset, Group


def meshes_of(root: Group) -> dict[str, Exemplar]:
    """Name of component -> its grain; empty where the asset has none."""
    grains = root.members.get("grains")
    return {name: exemplar(name, part) for name, part in components_of(grains).items()} if isinstance(grains, Group) else {}


def ply_meshes(root: Group) -> dict[str, bytes]:
    """End of file name -> each exemplar as binary PLY, corners as doubles; comments say the scale and whether it is a ball."""
    files = {}
    for name, grain in meshes_of(root).items():
        head = ["ply", "format binary_little_endian 1.0", *(f"comment {line}" for line in _remarks(root, grain)),
                f"element vertex {len(grain.vertices)}", *(f"property double {axis}" for axis in "xyz"),
                f"element face {len(grain.faces)}", "property list uchar int vertex_indices", "end_header", ""]
        rows = np.empty(len(grain.faces), np.dtype([("count", "u1"), ("corner", "<i4", 3)]))
        rows["count"], rows["corner"] = 3, grain.faces
        files[f"-{name}.ply"] = "\n".join(head).encode() + np.ascontiguousarray(grain.vertices, "<f8").tobytes() + rows.tobytes()
    return files


def obj_meshes(root: Group) -> dict[str, str]:
    """End of file name -> each exemplar as Wavefront OBJ.

    Raises
    ------
    AssetError : there is no grain
    """
    meshes = meshes_of(root)
    if not meshes:
        raise AssetError(f"{root.attributes.get('name')}: holds no stage `grains`; bake it from a recipe with `grains`")
    files = {}
    for name, grain in meshes.items():
        lines = [f"# {line}" for line in _remarks(root, grain)] + [f"o {name}"]
        lines += ["v " + " ".join(map(repr, row)) for row in grain.vertices.astype(float).tolist()]
        lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in grain.faces.tolist()]
        files[f"-{name}.obj"] = "\n".join([*lines, ""])
    return files


def csv_figures(root: Group) -> tuple[dict[str, str], set[str]]:
    """File name -> text of the single figures of grains and of their medium, and of figures by size; the paths that they hold."""
    files, exported = {}, set()
    grains, medium = root.members.get("grains"), root.members.get("medium")
    if not isinstance(grains, Group):
        return files, exported
    groups = {f"grains/{name}": part for name, part in components_of(grains).items()}
    if isinstance(medium, Group):
        groups["medium"] = medium
        groups |= {f"medium/{name}": part for name, part in medium.members.items() if isinstance(part, Group)}
    for place, group in groups.items():
        single = {key: member for key, member in group.members.items() if isinstance(member, Dataset)
                  and member.data.shape == (1,) and member.data.dtype.kind in "fiu"}
        rows = [(key, float(member.data[0]), float(single[f"{key}_error"].data[0]) if f"{key}_error" in single else "",
                 member.units, member.description) for key, member in single.items() if key.removesuffix("_error") not in single
                or not key.endswith("_error")]
        if rows:
            head = ("figure", "value", "standard error", "unit", "what it is")
            files[f"{place.replace('/', '_')}_figures.csv"] = csv_text(list(zip(head, zip(*rows, strict=True), strict=True)))
            exported |= {f"{place}/{key}" for key in single}
        table, names = _by_radius(root, grains, group)
        if table:
            files[f"{place.replace('/', '_')}_by_radius.csv"] = csv_text(table)
            exported |= {f"{place}/by_radius/{name}" for name in names}
    return files, exported


def _by_radius(root: Group, grains: Group, part: Group) -> tuple[list, list[str]]:
    """Columns of a component's figures by size (S, L): one a figure and wavelength; and their names."""
    sized, radius, um = part.members.get("by_radius"), grains.members.get("radius"), root["wavelength"].data
    if not isinstance(sized, Group) or not isinstance(radius, Dataset):
        return [], []
    names = [name for name, member in sized.members.items() if isinstance(member, Dataset)
             and member.data.shape == (radius.data.size, um.size)]
    columns = [(f"radius [{radius.units}]", radius.data)]
    columns += [(f"{name} at {x:g} um [{sized[name].units}]", sized[name].data[:, k]) for name in names for k, x in enumerate(um)]
    return columns if names else [], names


def _remarks(root: Group, grain: Exemplar) -> list[str]:
    radius = root["grains"].members.get("radius")
    remarks = ["lengths in radii of the bounding sphere, which is the unit sphere"]
    if isinstance(radius, Dataset) and radius.data.size:
        low, high = float(radius.data.min()), float(radius.data.max())
        remarks.append(f"radius {low!r} m" if low == high else f"radius {low!r} to {high!r} m")
    return remarks + (["exactly the unit ball: these triangles stand for it in pictures only"] if grain.ball else [])
