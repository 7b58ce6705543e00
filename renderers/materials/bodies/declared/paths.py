"""Event by event, from the eye."""

from __future__ import annotations

from renderers.materials.bodies.declaration import BodyMethod

METHOD = BodyMethod(
    name="paths", words="event by event", exact=True, beside=True, in_one_loop=True,
    brings="from the eye, event by event; lights are sampled at each event where the boundary is matched, or where they stand in "
           "the body")
