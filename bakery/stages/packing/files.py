"""Packed tiles as CSV."""

from bakery.draw.files import csv_text
from bakery.stages.packing.view import tiles
from bakery.store.tree import Dataset, Group


def csv_tables(root: Group) -> tuple[dict[str, str], set[str]]:
    """File name -> text for the group `packing`: spheres, pair correlation, chords and single figures of each tile.

    They tell all that the group holds.
    """
    files = {}
    for name, tile in tiles(root["packing"]).items():
        prefix = f"packing_{name}_" if name else "packing_"
        centers = tile["centers"].data
        axes = [(f"{axis} [mean radius]", centers[:, k]) for k, axis in enumerate("xyz")]
        files[f"{prefix}spheres.csv"] = csv_text([*axes, ("radius [mean radius]", tile["radii"].data)])
        for group, length in (("pair_correlation", "r"), ("chord_length", "")):
            if group in tile.members:
                files[f"{prefix}{group}.csv"] = csv_text(_bins(tile[group], length))
        single = [(path, member) for path, member in tile.walk() if isinstance(member, Dataset)
                  and (member.data.shape == (1,) or path == "cell")]
        rows = [(path + ("" if member.data.size == 1 else f" {'xyz'[i]}"), float(value), member.description)
                for path, member in single for i, value in enumerate(member.data)]
        columns = zip(("figure", "value", "what it is"), zip(*rows, strict=True), strict=True)
        files[f"{prefix}figures.csv"] = csv_text(list(columns))
    return files, {f"packing/{path}" for path, _ in root["packing"].walk()}


def _bins(group: Group, middle: str) -> list:
    """The columns of a table over bins: lower edge, upper edge, then what has one value a bin."""
    edges = group["edges"].data
    columns = [("from [mean radius]", edges[:-1]), ("to [mean radius]", edges[1:])]
    return columns + [(f"{name} [mean radius]" if name == middle else f"{name} [1]", member.data) for name, member in
                      group.members.items() if isinstance(member, Dataset) and member.data.shape == (edges.size - 1,)
                      and name != "edges"]
