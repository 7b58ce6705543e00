"""Packed tiles for other software: PLY and extended XYZ, one file a tile.

Every number has all its digits; lengths are in mean radii.
"""

import numpy as np

from bakery.errors import AssetError
from bakery.stages.packing.view import tiles
from bakery.store import ply
from bakery.store.tree import Group


def ply_files(root: Group) -> dict[str, str]:
    """End of file name -> text of each tile as PLY: one vertex a sphere, with the property `radius`; the cell in a comment.

    Raises AssetError : there is no tile
    """
    files = {}
    for name, tile in _tiles(root).items():
        centers, radii, cell = _form(tile)
        files[f"{name}.ply"] = ply.points(dict(zip("xyz", centers.T, strict=True)) | {"radius": radii},
                                          ["periodic cell " + _row(cell), "lengths in mean radii"])
    return files


def xyz_files(root: Group) -> dict[str, str]:
    """End of file name -> text of each tile as extended XYZ, with cell and radii, as OVITO and ASE read it.

    Raises AssetError : there is no tile
    """
    files = {}
    for name, tile in _tiles(root).items():
        centers, radii, cell = _form(tile)
        head = (f'Lattice="{_row(np.diag(cell).reshape(-1))}" Origin="0.0 0.0 0.0" pbc="T T T" '
                "Properties=species:S:1:pos:R:3:radius:R:1")
        rows = ("X " + _row(row) for row in np.column_stack([centers, radii]))
        files[f"{name}.xyz"] = "\n".join([str(radii.size), head, *rows, ""])
    return files


def _tiles(root: Group) -> dict[str, Group]:
    """End of file name -> tile."""
    packing = root.members.get("packing")
    by_name = tiles(packing) if isinstance(packing, Group) else {}
    if not by_name:
        raise AssetError(f"{root.attributes.get('name')}: holds no stage `packing`; bake it from a recipe with `packing`")
    return {f"_{name}" if name else "": tile for name, tile in by_name.items()}


def _form(tile: Group):
    return tile["centers"].data, tile["radii"].data, tile["cell"].data


def _row(values) -> str:
    return " ".join(map(repr, np.asarray(values, float).tolist()))
