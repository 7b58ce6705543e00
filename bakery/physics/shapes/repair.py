"""Holes closed and knots undone by pymeshlab, where a recipe asks for it: `repair: pymeshlab`.

pymeshlab is under the GPL and 280 MB large, therefore an extra that nothing else imports.  It sees arrays that `mending.checked`
has passed, never a file, and what it gives back passes through `mending.mended` like any other mesh.
"""

import numpy as np

from bakery.errors import UsageError
from bakery.physics.shapes.mending import checked, size
from bakery.physics.shapes.quality import area

HOLE_EDGES, HOLE_AREA = 64, 0.1  # largest hole that is closed: edges of its rim; what all closed holes may add to the surface
_WELD = 1e-6  # of the size: vertices that are one
# in this order: turning corners away and closing holes need a surface with two triangles at an edge, one fan at a vertex
_STEPS = (
    ("meshing_remove_duplicate_faces", {}),
    ("meshing_repair_non_manifold_edges", {"method": "Remove Faces"}),
    ("meshing_repair_non_manifold_vertices", {}),
    ("meshing_remove_t_vertices", {"method": "Edge Flip", "threshold": 1e6}),  # longest side over height: only what is flat
    ("meshing_remove_null_faces", {}),
)


def require():
    """The module pymeshlab; UsageError, saying what to install, where it is missing."""
    try:
        import pymeshlab
    except ImportError as error:
        raise UsageError(f"repair: pymeshlab: {error}; get it by: pip install \".[repair]\" in the folder of bakery's "
                         "sources, or leave the key out") from None
    return pymeshlab


def repaired(vertices, faces):
    """A mesh with fewer faults, for `mending.mended` to judge.

    Parameters
    ----------
    vertices : (V, 3) any length
    faces : (F, 3) indices of vertices

    Returns
    -------
    vertices : (V', 3), faces : (F', 3) int32
    notes : tuple of texts: what was changed

    Raises
    ------
    ValueError : numbers that are none, or a mesh that pymeshlab gives up; UsageError : pymeshlab is missing

    Notes
    -----
    Vertices within 1e-6 of the size become one; triangles that are double or without area go, as do the smallest at edges with
    more than two; corners on a side are turned away; holes of up to 64 edges are closed where that crosses nothing.
    """
    vertices, faces = checked(vertices, faces)
    pymeshlab = require()
    middle, unit = vertices.mean(axis=0), size(vertices)  # its tolerances are absolute
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh((vertices - middle) / unit, faces))
    try:
        meshes.meshing_merge_close_vertices(threshold=pymeshlab.PureValue(_WELD))
        for name, options in _STEPS:
            meshes.apply_filter(name, **options)
        before = _area(meshes)
        meshes.meshing_close_holes(maxholesize=HOLE_EDGES)
        meshes.meshing_remove_unreferenced_vertices()
    except pymeshlab.PyMeshLabException as error:
        raise ValueError(f"pymeshlab cannot repair it: {' '.join(str(error).split())}") from None
    if _area(meshes) > (1 + HOLE_AREA) * before:
        raise ValueError(f"not closed: its holes take more than {HOLE_AREA:.0%} of the surface")
    mesh = meshes.current_mesh()
    repaired, triangles = mesh.vertex_matrix() * unit + middle, mesh.face_matrix().astype(np.int32)
    if np.array_equal(triangles, faces):
        return repaired, triangles, ()
    return repaired, triangles, (f"repaired by pymeshlab: {len(vertices):,} vertices and {len(faces):,} triangles became "
                                 f"{len(repaired):,} and {len(triangles):,}",)


def _area(meshes):
    mesh = meshes.current_mesh()
    return area(mesh.vertex_matrix(), mesh.face_matrix())
