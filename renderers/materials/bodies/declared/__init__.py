"""The methods of the renderer of translucent bodies, in the order of messages."""

from functools import cache

from renderers.materials.bodies.declaration import BodyMethod
from renderers.scene.declaration import table

METHODS = (
    "renderers.materials.bodies.declared.auto:METHOD",
    "renderers.materials.bodies.declared.paths:METHOD",
    "renderers.materials.bodies.declared.shells:METHOD",
    "renderers.materials.bodies.declared.vrl:METHOD",
    "renderers.materials.bodies.declared.vrl_tables:METHOD",
    "renderers.materials.bodies.declared.beams:METHOD",
    "renderers.materials.bodies.declared.beams_tables:METHOD",
    "renderers.materials.bodies.declared.dipole:METHOD",
    "renderers.materials.bodies.declared.surface:METHOD",
    "renderers.materials.bodies.declared.paths_surface:METHOD",
    "renderers.materials.bodies.declared.metropolis:METHOD",
    "renderers.materials.bodies.declared.metropolis_tables:METHOD",
)


@cache
def methods() -> dict[str, BodyMethod]:
    """Every declared method by its name."""
    return table(METHODS)
