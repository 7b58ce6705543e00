"""Tiles as extended XYZ."""

from bakery.export.declaration import Exporter, Job, Written
from bakery.export.formats.shapes import written
from bakery.store.outputs import FileKind, begins_as_text


def write(job: Job) -> Written:
    from bakery.export.tiles import xyz_files

    return written(job, {}, xyz_files(job.asset.tree))


EXPORTER = Exporter("xyz", "tiles as extended XYZ, for particle viewers", "particle viewers", ("packing",),
                    "tiles", "statistics", write,
    kinds={".xyz": FileKind("XYZ file", begins_as_text(r"\A\d+\n"))})
