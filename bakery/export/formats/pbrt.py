"""A medium for pbrt-v4."""

from __future__ import annotations

from bakery.export.declaration import Exporter, Job, Written
from bakery.export.formats.lobes import WITHIN, written
from bakery.store.outputs import FileKind, begins_as_text


def write(job: Job) -> Written:
    from bakery.export.one_lobe import one_lobe
    from bakery.export.pbrt import pbrt_text

    return written(job, one_lobe, "pbrt", lambda medium: pbrt_text(job.medium_name, medium), spectra=True)


EXPORTER = Exporter(
    "pbrt", "a medium for pbrt-v4", "pbrt-v4", ("medium",), "spectra of sigma_a and sigma_s, one g",
    "the phase function but for g; g's change with wavelength", write, (WITHIN,),
    kinds={".pbrt": FileKind("pbrt file", begins_as_text(r"^MakeNamedMedium "))})
