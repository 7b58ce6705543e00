"""Grains as meshes and tiles as points, as PLY."""

from bakery.export.declaration import Exporter, Job, Written
from bakery.export.formats.shapes import written


def write(job: Job) -> Written:
    from bakery.export.grains import ply_meshes
    from bakery.export.tiles import ply_files

    asset = job.asset
    meshes = ply_meshes(asset.tree)
    return written(job, meshes, ply_files(asset.tree) if not meshes or "packing" in asset.stages else {})


EXPORTER = Exporter("ply", "grains as meshes, tiles as points with radii", "meshes", ("grains", "packing"),
                    "grains, tiles", "surfaces, statistics", write)
