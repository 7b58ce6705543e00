"""Beams of all flights, joined with lines of sight that pass close by."""

from renderers.materials.bodies.declaration import FEW, FEWEST_MET, JOINED, BodyMethod

METHOD = BodyMethod(
    name="beams", words="beams of all flights, joined with lines of sight that pass close by", reads_tables=True,
    parts=(FEW, JOINED), second=lambda world, body: True, blurred=(True, True), fewest_beams=FEWEST_MET,
    brings="beams of all flights, joined with lines of sight that pass close by; light of lamps that comes in through glass by "
           "multiple importance sampling with paths")
