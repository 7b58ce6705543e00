"""The same as materials of USD."""

from bakery.export.declaration import Exporter, Job, Written
from bakery.export.formats.lobes import WITHIN, written
from bakery.store.outputs import FileKind


def write(job: Job) -> Written:
    from bakery.export.one_lobe import one_lobe
    from bakery.export.openpbr import surfaces, usd_text

    bands = job.colour.band_matrix(job.asset.wavelength)
    return written(job, one_lobe, "usda", lambda medium: usd_text(job.medium_name, surfaces(medium, bands), medium.remarks()))


EXPORTER = Exporter(
    "usd", "the same as USD materials (.usda)", "the same in USD (Hydra, OpenUSD)", ("medium",),
    "as `materialx`, of the medium alone",
    "as `materialx`", write, (WITHIN,),
    kinds={".usda": FileKind("USD layer", lambda head: head.startswith(b"#usda "))})
