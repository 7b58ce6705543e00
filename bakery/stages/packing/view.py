"""The tiles that a group `packing` holds."""

import numpy as np

from bakery.physics.packing import tiles as tiles_of_physics
from bakery.store.tree import Group


def tiles(packing: Group) -> dict[str, Group]:
    """The tiles of a `packing` group by name: one named "" where the group is a tile itself."""
    if "centers" in packing.members:
        return {"": packing}
    return {name: member for name, member in packing.members.items() if isinstance(member, Group)}


def tile_name(fraction: float) -> str:
    """Name of a tile in a dictionary: its wished fraction in percent, `f60`, `f62_5`."""
    return f"f{100 * fraction:g}".replace(".", "_")


def nearest_denser(packing: Group, fraction: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centers (N, 3), radii (N,), cell (3,), in mean radii, of the least dense tile that fills at least a fraction of its cell,
    widened until it fills just that; of the densest tile as it is where none is as dense."""
    held = list(tiles(packing).values())
    index, wider = tiles_of_physics.nearest_denser([float(tile["fraction"].data[0]) for tile in held], fraction)
    return held[index]["centers"].data * wider, held[index]["radii"].data, held[index]["cell"].data * wider
