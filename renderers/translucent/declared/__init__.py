"""The methods of the renderer of translucent bodies, in the order of messages."""

from __future__ import annotations

from functools import cache

from renderers.declaration import table
from renderers.translucent.declaration import BodyMethod

METHODS = (
    "renderers.translucent.declared.auto:METHOD",
    "renderers.translucent.declared.paths:METHOD",
    "renderers.translucent.declared.shells:METHOD",
    "renderers.translucent.declared.vrl:METHOD",
    "renderers.translucent.declared.vrl_tables:METHOD",
    "renderers.translucent.declared.beams:METHOD",
    "renderers.translucent.declared.beams_tables:METHOD",
    "renderers.translucent.declared.dipole:METHOD",
)


@cache
def methods() -> dict[str, BodyMethod]:
    """Every declared method by its name."""
    return table(METHODS)
