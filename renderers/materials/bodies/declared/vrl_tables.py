"""Third and later events from the asset's tables of beams and negative beams."""

from renderers.materials.bodies.declaration import FEW, FEWEST_GATHERED, GATHERED, BodyMethod

METHOD = BodyMethod(
    name="vrl+tables", words="third and later events from the asset's tables", keeps=True, keys=("boundary.tables",),
    points=("", "boundary.tables=mirrored"), reads_tables=True, tabled=True, parts=(FEW, GATHERED), fewest_beams=FEWEST_GATHERED,
    error=lambda tolerance: 0.01,  # of tables against paths, in the mean (docs/translucent.md)
    pilot=2.0,
    brings="up to two events as in paths, later ones from the tables of beams and negative beams")
