"""A script that makes a material for Cycles."""

from __future__ import annotations

from bakery.export.declaration import Exporter, Job, Written
from bakery.export.formats.lobes import WITHIN, written
from bakery.store.outputs import FileKind, begins_as_text


def write(job: Job) -> Written:
    from bakery.export.blender import blender_text, cycles_medium

    bands = job.colour.band_matrix(job.asset.wavelength)
    return written(job, cycles_medium, "py", lambda medium: blender_text(job.medium_name, medium, bands))


EXPORTER = Exporter(
    "blender", "a script that makes a material for Cycles, HG + Draine (.py)", "Cycles in Blender 5", ("medium",),
    "coefficients in RGB, two lobes (HG + Draine) for all wavelengths",
    "the phase function's shape beyond the lobes; its change with wavelength; spectra", write, (WITHIN,),
    kinds={".py": FileKind("Blender script", begins_as_text(r"\A# A baked medium for Cycles "))})
