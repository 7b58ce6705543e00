"""Meshes that entries of a scene name."""


def of_entry(scene, number):
    """Vertices (V, 3) m and triangles (F, 3) of the mesh of an entry; UsageError with the key where it is no closed mesh."""
    from bakery import kernels

    where = scene.values.materials[number].where
    path = scene.file(where.mesh)
    try:
        vertices, faces = kernels.closed_mesh(path.read_bytes(), path.suffix.lstrip(".").lower())
    except ValueError as fault:
        raise scene.wrong(f"materials[{number}].where.mesh", fault) from None
    return where.unit * vertices, faces
