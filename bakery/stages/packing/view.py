"""The tiles that a group `packing` holds."""

from bakery.store.tree import Group


def tiles(packing: Group) -> dict[str, Group]:
    """The tiles of a `packing` group by name: one named "" where the group is a tile itself."""
    if "centers" in packing.members:
        return {"": packing}
    return packing.groups


def tile_name(fraction: float) -> str:
    """Name of a tile in a dictionary: its wished fraction in percent, `f60`, `f62_5`."""
    return f"f{100 * fraction:g}".replace(".", "_")
