"""The methods of media, which only scenes of several materials have."""

from functools import cache

from renderers.scene.declaration import SceneMethod, table

METHODS = (
    "renderers.mixed.declared.auto:METHOD",
    "renderers.mixed.declared.paths:METHOD",
)


@cache
def methods() -> dict[str, SceneMethod]:
    """Every declared method by its name."""
    return table(METHODS)
