"""Packed tiles for other software: PLY and extended XYZ, one file a tile, and their tables as CSV.

Every number has all its digits; lengths are in mean radii.
"""

from __future__ import annotations

import numpy as np

from bakery.draw.files import csv_text
from bakery.errors import AssetError
from bakery.stages.packing.pictures import tiles_of
from bakery.store.tree import Dataset, Group


def ply_files(root: Group) -> dict[str, str]:
    """End of file name -> text of each tile as PLY: one vertex a sphere, with the property `radius`; the cell in a comment.

    Raises
    ------
    AssetError : there is no tile
    """
    files = {}
    for name, tile in _tiles(root).items():
        centers, radii, cell = _form(tile)
        head = ["ply", "format ascii 1.0", "comment periodic cell " + _row(cell), "comment lengths in mean radii",
                f"element vertex {radii.size}", *(f"property double {axis}" for axis in ("x", "y", "z", "radius")), "end_header"]
        files[f"{name}.ply"] = "\n".join([*head, *map(_row, np.column_stack([centers, radii])), ""])
    return files


def xyz_files(root: Group) -> dict[str, str]:
    """End of file name -> text of each tile as extended XYZ, with cell and radii, as OVITO and ASE read it.

    Raises
    ------
    AssetError : there is no tile
    """
    files = {}
    for name, tile in _tiles(root).items():
        centers, radii, cell = _form(tile)
        head = (f'Lattice="{_row(np.diag(cell).reshape(-1))}" Origin="0.0 0.0 0.0" pbc="T T T" '
                "Properties=species:S:1:pos:R:3:radius:R:1")
        rows = ("X " + _row(row) for row in np.column_stack([centers, radii]))
        files[f"{name}.xyz"] = "\n".join([str(radii.size), head, *rows, ""])
    return files


def csv_tables(root: Group) -> dict[str, str]:
    """File name -> text for the group `packing`: spheres, pair correlation, chords and single figures of each tile."""
    files = {}
    for name, tile in tiles_of(root["packing"]).items():
        prefix = f"packing_{name}_" if name else "packing_"
        centers, radii, _ = _form(tile)
        axes = [(f"{axis} [mean radius]", centers[:, k]) for k, axis in enumerate("xyz")]
        files[f"{prefix}spheres.csv"] = csv_text([*axes, ("radius [mean radius]", radii)])
        for group, length in (("pair_correlation", "r"), ("chord_length", "")):
            if group in tile.members:
                files[f"{prefix}{group}.csv"] = csv_text(_bins(tile[group], length))
        single = [(path, member) for path, member in tile.walk() if isinstance(member, Dataset)
                  and (member.data.shape == (1,) or path == "cell")]
        rows = [(path + ("" if member.data.size == 1 else f" {'xyz'[i]}"), float(value), member.description)
                for path, member in single for i, value in enumerate(member.data)]
        columns = zip(("figure", "value", "what it is"), zip(*rows, strict=True), strict=True)
        files[f"{prefix}figures.csv"] = csv_text(list(columns))
    return files


def _bins(group: Group, middle: str) -> list:
    """The columns of a table over bins: lower edge, upper edge, then what has one value a bin."""
    edges = group["edges"].data
    columns = [("from [mean radius]", edges[:-1]), ("to [mean radius]", edges[1:])]
    return columns + [(f"{name} [mean radius]" if name == middle else f"{name} [1]", member.data) for name, member in
                      group.members.items() if isinstance(member, Dataset) and member.data.shape == (edges.size - 1,)
                      and name != "edges"]


def _tiles(root: Group) -> dict[str, Group]:
    """End of file name -> tile."""
    packing = root.members.get("packing")
    tiles = tiles_of(packing) if isinstance(packing, Group) else {}
    if not tiles:
        raise AssetError(f"{root.attributes.get('name')}: holds no stage `packing`; bake it from a recipe with `packing`")
    return {f"_{name}" if name else "": tile for name, tile in tiles.items()}


def _form(tile: Group):
    return tile["centers"].data, tile["radii"].data, tile["cell"].data


def _row(values) -> str:
    return " ".join(map(repr, np.asarray(values, float).tolist()))
