"""Third and later events from the asset's tables, by states that are drawn by a guess of their light."""

from renderers.materials.bodies.declaration import FEW, FEWEST_GATHERED, MUTATED, BodyMethod
from renderers.materials.bodies.declared import vrl_tables

METHOD = BodyMethod(
    name="metropolis+tables", words="later events from the tables, by places on beams and lines of sight that a guess draws",
    keys=("boundary.tables",), reads_tables=True, tabled=True, parts=(FEW, MUTATED), fewest_beams=FEWEST_GATHERED,
    error=vrl_tables.METHOD.error, pilot=2.0,
    brings="up to two events as in paths, later ones from the tables of beams and negative beams, joined with lines of sight by "
           "a guess of what each pair brings")
