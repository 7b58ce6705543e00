"""The methods of the renderer of particles, in the order of messages."""

from functools import cache

from renderers.materials.particles.declaration import ParticleMethod
from renderers.scene.declaration import table

METHODS = (
    "renderers.materials.particles.declared.auto:METHOD",
    "renderers.materials.particles.declared.particles:METHOD",
    "renderers.materials.particles.declared.particles_continuous:METHOD",
    "renderers.materials.particles.declared.continuous:METHOD",
    "renderers.materials.particles.declared.query:METHOD",
    "renderers.materials.particles.declared.explicit:METHOD",
)


@cache
def methods() -> dict[str, ParticleMethod]:
    """Every declared method by its name."""
    return table(METHODS)
