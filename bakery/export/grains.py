"""Exemplar grains for other software: meshes as PLY and OBJ, one file a component.

Coordinates are in radii of the bounding sphere, which is the unit sphere, with all their digits.
"""

from bakery.errors import AssetError
from bakery.stages.grains.view import Exemplar, exemplar
from bakery.store import ply
from bakery.store.tree import Dataset, Group


def meshes_of(root: Group) -> dict[str, Exemplar]:
    """Name of component -> its grain; empty where the asset has none."""
    grains = root.members.get("grains")
    return {name: exemplar(part) for name, part in grains.groups.items()} if isinstance(grains, Group) else {}


def ply_meshes(root: Group) -> dict[str, bytes]:
    """End of file name -> each exemplar as binary PLY, corners as doubles; comments say the scale and whether it is a ball."""
    return {f"-{name}.ply": ply.mesh(grain.vertices, grain.faces, _remarks(root, grain))
            for name, grain in meshes_of(root).items()}


def obj_meshes(root: Group) -> dict[str, str]:
    """End of file name -> each exemplar as Wavefront OBJ.

    Raises AssetError : there is no grain
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


def _remarks(root: Group, grain: Exemplar) -> list[str]:
    radius = root["grains"].members.get("radius")
    remarks = ["lengths in radii of the bounding sphere, which is the unit sphere"]
    if isinstance(radius, Dataset) and radius.data.size:
        low, high = float(radius.data.min()), float(radius.data.max())
        remarks.append(f"radius {low!r} m" if low == high else f"radius {low!r} to {high!r} m")
    return remarks + (["exactly the unit ball: these triangles stand for it in pictures only"] if grain.ball else [])
