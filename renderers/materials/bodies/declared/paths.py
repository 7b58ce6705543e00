"""Event by event, from the eye."""

from __future__ import annotations

from renderers.materials.bodies.declaration import BodyMethod

METHOD = BodyMethod(
    name="paths", words="event by event", exact=True, beside=True,
    brings="from the eye, event by event; lights are sampled at each event where the boundary is matched, and small "
           "lamps where it is of smooth glass")
