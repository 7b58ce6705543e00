"""Beams of light between two events, joined with lines of sight by second events."""

from renderers.materials.bodies.declaration import FEW, FEWEST_GATHERED, GATHERED, BodyMethod

METHOD = BodyMethod(
    name="vrl", words="beams of light, of which each event begins one", exact=True, reads_tables=True, parts=(FEW, GATHERED),
    second=lambda world, body: True, fewest_beams=FEWEST_GATHERED,
    pilot=5.0,
    brings="from the lights, event by event; each way between two events is a beam, joined with lines of sight by second events")
