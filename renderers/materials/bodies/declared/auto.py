"""The cheapest method that keeps the tolerance, by pilots."""

from renderers.materials.bodies.declaration import BodyMethod
from renderers.materials.bodies.declared import vrl_tables

METHOD = BodyMethod(
    name="auto", words="the cheapest of paths, a baked surface, of all or of what is far, vrl+tables, metropolis, "
                       "metropolis+tables, shells and vrl that keeps the tolerance, by pilots; else paths",
    keeps=True, keys=("boundary.tables", "layer", "surface_from"), points=(),
    candidates=("paths", "vrl+tables", "metropolis", "metropolis+tables", "shells", "vrl"),
    error=vrl_tables.METHOD.error, brings="as the method that it takes")
