"""OpenPBR surfaces around a medium, as MaterialX."""

from __future__ import annotations

from bakery.export.declaration import Exporter, Job, Written
from bakery.export.formats.lobes import WITHIN, written
from bakery.store.outputs import FileKind, begins_as_text


def write(job: Job) -> Written:
    from bakery.export.one_lobe import one_lobe
    from bakery.export.openpbr import materialx_text, surfaces

    bands = job.colour.band_matrix(job.asset.wavelength)
    return written(job, one_lobe, "mtlx",
                   lambda medium: materialx_text(job.medium_name, surfaces(medium, bands), medium.remarks()))


EXPORTER = Exporter(
    "materialx", "OpenPBR surfaces around the medium (.mtlx)", "programs with MaterialX and OpenPBR", ("medium",),
    "coefficients in RGB, one g",
    "as `pbrt`; spectra; absorption below 1e-7 of sigma_t", write, (WITHIN,),
    kinds={".mtlx": FileKind("MaterialX document", begins_as_text(r"<materialx\b"))})
