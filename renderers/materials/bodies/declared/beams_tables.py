"""Two events by beams that are joined with lines of sight, later ones from the asset's tables."""

from renderers.materials.bodies.declaration import FEW, FEWEST_GATHERED, GATHERED, JOINED, BodyMethod
from renderers.materials.bodies.declared import vrl_tables

METHOD = BodyMethod(
    name="beams+tables", words="up to two events by such beams, later ones from the asset's tables", keys=("boundary.tables",),
    reads_tables=True, tabled=True, parts=(FEW, JOINED, GATHERED), second=lambda world, body: False, beams_of_events=True,
    blurred=(True, False), fewest_beams=FEWEST_GATHERED, error=vrl_tables.METHOD.error,
    brings="up to two events by beams in bodies whose boundary turns light, else as in paths; later ones as in vrl+tables")
