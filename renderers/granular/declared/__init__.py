"""The methods of the renderer of grains, in the order of messages."""

from __future__ import annotations

from functools import cache

from renderers.declaration import table
from renderers.granular.declaration import GrainMethod

METHODS = (
    "renderers.granular.declared.auto:METHOD",
    "renderers.granular.declared.ept:METHOD",
    "renderers.granular.declared.vpt:METHOD",
    "renderers.granular.declared.ept_vpt:METHOD",
    "renderers.granular.declared.ept_vpt_da:METHOD",
    "renderers.granular.declared.teleport:METHOD",
)


@cache
def methods() -> dict[str, GrainMethod]:
    """Every declared method by its name."""
    return table(METHODS)
