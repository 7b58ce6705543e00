"""Grains as meshes, as OBJ."""

from bakery.export.declaration import Exporter, Job, Written
from bakery.export.formats.shapes import written
from bakery.store.outputs import FileKind, begins_as_text


def write(job: Job) -> Written:
    from bakery.export.grains import obj_meshes

    return written(job, obj_meshes(job.asset.tree), {})


EXPORTER = Exporter("obj", "grains as meshes", "meshes", ("grains",), "grains", "surfaces, statistics", write,
    kinds={".obj": FileKind("OBJ file", begins_as_text(r"^[ov] "))})
