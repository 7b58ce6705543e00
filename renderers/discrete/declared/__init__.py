"""The methods of the renderer of particles, in the order of messages."""

from __future__ import annotations

from functools import cache

from renderers.declaration import table
from renderers.discrete.declaration import ParticleMethod

METHODS = (
    "renderers.discrete.declared.auto:METHOD",
    "renderers.discrete.declared.particles:METHOD",
    "renderers.discrete.declared.particles_continuous:METHOD",
    "renderers.discrete.declared.continuous:METHOD",
    "renderers.discrete.declared.query:METHOD",
    "renderers.discrete.declared.explicit:METHOD",
)


@cache
def methods() -> dict[str, ParticleMethod]:
    """Every declared method by its name."""
    return table(METHODS)
