"""Normals at the vertices of meshes, the same whatever the threads.

Where a file has none, Mitsuba adds up those of the faces around a vertex by all its threads at once, in an order that changes
from run to run: normals differ in their last bits, and with them pictures.
"""

from contextlib import contextmanager

import drjit as dr
import mitsuba as mi
import numpy as np

from renderers.threads import one_of_drjit

_COMPUTED = 1e-5  # normals added up in another order differ by less; a file's own differ by more, or mean the same


@contextmanager
def one_kernel():
    """While meshes are loaded: Dr.Jit's threads add to the same numbers, not each to its own, whose kernel is compiled anew for
    each number of vertices, 0.07 s."""
    threshold = dr.expand_threshold()
    dr.set_expand_threshold(0)
    try:
        yield
    finally:
        dr.set_expand_threshold(threshold)


def settle(scene):
    """Adds up the normals of a scene's meshes again, by one thread; those that a file states stay.

    Of meshes in shape groups Mitsuba gives nothing out: these keep what they have.
    """
    loaded = []
    for mesh in scene.shapes():
        if mesh.is_mesh() and mesh.has_vertex_normals() and "vertex_normals" in (parameters := mi.traverse(mesh)):
            loaded.append((mesh, parameters, np.array(parameters["vertex_normals"])))
    if not loaded:
        return
    threads = dr.thread_count()
    try:
        while dr.thread_count() > 1:
            one_of_drjit()
        for mesh, _, _ in loaded:
            mesh.recompute_vertex_normals()
            dr.eval(mesh.vertex_normals_buffer())
        dr.sync_thread()
    finally:
        dr.set_thread_count(threads)
    for mesh, parameters, normals in loaded:
        if not np.allclose(normals, np.array(mesh.vertex_normals_buffer()), rtol=0, atol=_COMPUTED, equal_nan=True):
            parameters["vertex_normals"] = normals
            parameters.update()
