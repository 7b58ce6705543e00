"""Meshes that entries of a scene name."""

from functools import lru_cache


def of_entry(scene, number):
    """Vertices (V, 3) m and triangles (F, 3) of the mesh of an entry; UsageError with the key where it is no closed mesh."""
    where = scene.values.materials[number].where
    path = scene.file(where.mesh)
    try:
        vertices, faces = _closed(path.read_bytes(), path.suffix.lstrip(".").lower())
    except ValueError as fault:
        raise scene.wrong(f"materials[{number}].where.mesh", fault) from None
    return where.unit * vertices, faces.copy()


@lru_cache(maxsize=8)  # what a scene requires, its choice and its render ask for them in turn
def _closed(data, kind):
    from bakery import kernels

    return kernels.closed_mesh(data, kind)
