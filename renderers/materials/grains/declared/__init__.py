"""The methods of the renderer of grains, in the order of messages."""

from functools import cache

from renderers.materials.grains.declaration import GrainMethod
from renderers.scene.declaration import table

METHODS = (
    "renderers.materials.grains.declared.auto:METHOD",
    "renderers.materials.grains.declared.ept:METHOD",
    "renderers.materials.grains.declared.vpt:METHOD",
    "renderers.materials.grains.declared.ept_vpt:METHOD",
    "renderers.materials.grains.declared.ept_vpt_da:METHOD",
    "renderers.materials.grains.declared.ept_vpt_surface:METHOD",
    "renderers.materials.grains.declared.ept_wide:METHOD",
    "renderers.materials.grains.declared.teleport:METHOD",
)


@cache
def methods() -> dict[str, GrainMethod]:
    """Every declared method by its name."""
    return table(METHODS)
