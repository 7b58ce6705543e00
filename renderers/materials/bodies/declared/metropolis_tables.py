"""Third and later events from the asset's tables, by chains of mutations."""

from __future__ import annotations

from renderers.materials.bodies.declaration import FEW, FEWEST_GATHERED, MUTATED, BodyMethod
from renderers.materials.bodies.declared import vrl_tables

METHOD = BodyMethod(
    name="metropolis+tables", words="later events from the asset's tables, by chains of places on beams and lines of sight",
    keys=("boundary.tables",), reads_tables=True, tabled=True, parts=(FEW, MUTATED), fewest_beams=FEWEST_GATHERED,
    error=vrl_tables.METHOD.error, pilot=2.0,
    brings="up to two events as in paths, later ones from the tables of beams and negative beams, joined with lines of sight by "
           "Metropolis's algorithm")
