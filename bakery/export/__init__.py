"""Hands assets to other software, and says what was lost on the way.

`mitsuba` writes a scene fragment with a phase function on a regular grid, `csv` writes tables, `hg` fits the lobes that renderers
without tables take.
"""

from __future__ import annotations

from bakery.errors import AssetError
from bakery.store.tree import Group


def medium_of(root: Group, name: str) -> Group:
    """The group that a renderer needs; AssetError, naming the asset, where there is none."""
    medium = root.members.get("medium")
    if not isinstance(medium, Group):
        raise AssetError(f"{name}: holds no stage `medium`, which a renderer needs; bake it from a recipe with `particles` or "
                         "`medium`")
    return medium
