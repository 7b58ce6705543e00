"""The tiles that a group `packing` holds."""

from __future__ import annotations

from bakery.store.tree import Group


def tiles(packing: Group) -> dict[str, Group]:
    """The tiles of a `packing` group by name: one named "" where the group is a tile itself."""
    if "centers" in packing.members:
        return {"": packing}
    return {name: member for name, member in packing.members.items() if isinstance(member, Group)}
