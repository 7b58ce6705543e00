"""Where a scene puts an asset's particles, and the particles there."""

import numpy as np

from bakery import kernels
from renderers.scene import grids, meshes

_SAME = 1e-6  # relative difference of boxes that count as equal


def region_of(scene, group, number=0) -> kernels.Region:
    """The region that an entry of the scene says, by its number, else the asset's own with its corner at the origin.

    Raises UsageError, with the key, where a stored realisation is asked to fill another region than its own, or a file is not
    what it should be.
    """
    where, key = scene.values.materials[number].where, f"materials[{number}].where"
    baked = _own(group)
    if where is None:
        return baked
    stored = "position" in group
    if hasattr(where, "box"):
        lo, hi = np.array(where.box.lo), np.array(where.box.hi)
        edges = baked.hi - baked.lo
        if np.allclose(hi - lo, edges, rtol=_SAME, atol=0):
            return baked._replace(lo=lo, hi=hi, centre=baked.centre + lo)
        if stored or baked.kind != kernels.BOX:
            kind = "its places are stored" if stored else "it is not a whole box"
            raise scene.wrong(f"{key}.box", f"found a box of {_edges(hi - lo)} m, but the asset's is {_edges(edges)} "
                              f"m and {kind}; that box, or an asset with method: procedural, would do")
        return kernels.region_box(lo, hi)
    if stored:
        raise scene.wrong(key, "found a mesh or a grid, but the asset's places are stored; an asset with "
                          "method: procedural would do, or a recipe whose discrete section has the mesh or the grid")
    if hasattr(where, "mesh"):
        try:
            return kernels.region_mesh(*meshes.of_entry(scene, number))
        except ValueError as fault:
            raise scene.wrong(f"{key}.mesh", fault) from None
    values, lo, hi = grids.relative(scene, key, where)
    return kernels.region_grid(lo, hi, values)


def _edges(edges):
    return " x ".join(f"{edge:.6g}" for edge in edges)


def _own(group):
    """The asset's region."""
    zero, box = np.zeros(3), np.asarray(group.box, float)
    if "density" in group:
        return kernels.region_grid(zero, box, group.density)
    if "mesh_vertices" in group:
        return kernels.region_mesh(group.mesh_vertices, group.mesh_faces)
    return kernels.region_box(zero, box)


def check_motion(scene, group, region, number=0):
    """Raises UsageError where stored particles would move out of the mesh or the grid that they were chosen for."""
    settings = scene.values.materials[number]
    if "position" in group and region.kind != kernels.BOX and np.any(np.asarray(settings.velocity) * settings.time):
        raise scene.wrong(f"materials[{number}].velocity", "found stored particles of a mesh or a grid that move; particles of a "
                          "whole box, or an asset with method: procedural, would do")


def discs_of(group, region, velocity, time):
    """Function of (extinction (L, K), density (K,), order (K,)) that gives the asset's particles as `kernels.Discs`.

    `order` says which class of the asset each is; velocity (3,) m/s, time s.
    """

    def discs(extinction, density, order):
        moves = np.tile(np.asarray(velocity, float), (len(order), 1))
        if "position" not in group:
            return kernels.procedural_discs(region, extinction, density, group.key, moves, time)
        rank = np.empty(len(order), np.int64)
        rank[order] = np.arange(len(order))
        centres = np.asarray(group.position)
        centres = centres + region.lo if region.lo.any() else centres  # float32 as stored: 1e8 particles are a gigabyte
        return kernels.stored_discs(region, extinction, centres, rank[group.kinds()], moves, time)

    return discs
