"""Normals at the vertices of meshes, the same whatever the threads.

Where a file has none, Mitsuba adds up those of the faces around a vertex by all its threads at once, in an order that changes
from run to run: normals differ in their last bits, and with them pictures.
"""

import drjit as dr
import mitsuba as mi
import numpy as np

_COMPUTED = 1e-5  # normals added up in another order differ by less; a file's own differ by more, or mean the same


def settle(scene):
    """Adds up the normals of a scene's meshes again, by one thread; those that a file states stay.

    Of meshes in shape groups Mitsuba gives nothing out: these keep what they have.
    """
    threads = dr.thread_count()
    for mesh in scene.shapes():
        if not mesh.is_mesh() or not mesh.has_vertex_normals():
            continue
        parameters = mi.traverse(mesh)
        if "vertex_normals" not in parameters:
            continue
        loaded = np.array(parameters["vertex_normals"])
        dr.set_thread_count(1)
        try:
            mesh.recompute_vertex_normals()
            computed = np.array(mesh.vertex_normals_buffer())
        finally:
            dr.set_thread_count(threads)
        if not np.allclose(loaded, computed, rtol=0, atol=_COMPUTED, equal_nan=True):
            parameters["vertex_normals"] = loaded
            parameters.update()
