"""The tiles that a group `packing` holds."""

from __future__ import annotations

import numpy as np

from bakery.store.tree import Group


def tiles(packing: Group) -> dict[str, Group]:
    """The tiles of a `packing` group by name: one named "" where the group is a tile itself."""
    if "centers" in packing.members:
        return {"": packing}
    return {name: member for name, member in packing.members.items() if isinstance(member, Group)}


def tile_name(fraction: float) -> str:
    """Name of a tile in a dictionary: its wished fraction in percent, `f60`, `f62_5`."""
    return f"f{100 * fraction:g}".replace(".", "_")


def nearest_denser(group: Group, fraction: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, str]:
    """The least dense tile that fills at least a fraction of its cell, with the cell widened until it fills just that.

    Parameters
    ----------
    group : `packing`, one tile or a dictionary
    fraction : 1, wished

    Returns
    -------
    centers : (N, 3), radii : (N,), cell : (3,) in mean radii; positions are scaled, radii are not
    name : of the tile, "" where there is only one

    Raises
    ------
    ValueError : no tile is as dense
    """
    fractions = {name: float(tile["fraction"].data[0]) for name, tile in tiles(group).items()}
    dense = {name: f for name, f in fractions.items() if f >= fraction * (1 - 1e-9)}
    if not dense:
        raise ValueError(f"found no tile as dense as {fraction:g}; the densest fills {max(fractions.values(), default=0):.4g}")
    name = min(dense, key=dense.get)
    tile = tiles(group)[name]
    wider = (dense[name] / fraction) ** (1 / 3) if dense[name] > fraction else 1.0
    return tile["centers"].data * wider, tile["radii"].data, tile["cell"].data * wider, name
