"""All formats, in the order of the help."""

from functools import cache
from importlib import import_module

from bakery.export.declaration import Exporter

EXPORTERS = (
    "bakery.export.formats.csv:EXPORTER",
    "bakery.export.formats.mitsuba:EXPORTER",
    "bakery.export.formats.hg:EXPORTER",
    "bakery.export.formats.pbrt:EXPORTER",
    "bakery.export.formats.materialx:EXPORTER",
    "bakery.export.formats.usd:EXPORTER",
    "bakery.export.formats.blender:EXPORTER",
    "bakery.export.formats.disort:EXPORTER",
    "bakery.export.formats.netcdf:EXPORTER",
    "bakery.export.formats.libradtran:EXPORTER",
    "bakery.export.formats.eradiate:EXPORTER",
    "bakery.export.formats.ply:EXPORTER",
    "bakery.export.formats.obj:EXPORTER",
    "bakery.export.formats.xyz:EXPORTER",
)


@cache
def exporters() -> dict[str, Exporter]:
    """Every declared format by its name."""
    places = (target.partition(":") for target in EXPORTERS)
    return {exporter.name: exporter for exporter in (getattr(import_module(module), name) for module, _, name in places)}
