"""The interface for compiled renderers: what their own kernels may call of bakery's physics.

`bakery.open` gives arrays and functions of arrays; inside a loop that numba compiles there is no asset.  There the functions here
are called, with what the layouts below make of an asset once, before the loop.  Those marked *compiled* are numba functions.

| what | layout, in Python | compiled |
|---|---|---|
| tables of multiple scattering | `asset.multiple.point.tables()` | `multiple_scratch`, `point_source`, `segment_source` |
| which grain stands where in repeated tiles, and how it is turned | `cumulated_shares` | `instance`, `rotation_matrix` |
| spheres of a repeated tile | `tile_grid` | `flight_to_sphere` |
| triangles of a grain | `Mesh` (`Mesh(vertices, faces).tree`) | `mesh_scratch`, `nearest_triangle`, `triangle_normal` |
| surfaces of grains | `dielectric`, `diffuse`, `conductor` | `fresnel`, `fresnel_conductor`, `at_surface`, `surface_share` |
| phase functions | `phase_layout` | `phase_value`, `phase_sample`, `turned_direction` |
| amplitudes of spheres | `mie_amplitudes`, `goa_amplitudes` | |

Lengths: mean free paths for tables of multiple scattering, mean radii for tiles, radii of the bounding sphere for grains.
Importing this module loads numba and SciPy.
"""

from __future__ import annotations

from numba import njit

from bakery.physics.goa import amplitudes as goa_amplitudes
from bakery.physics.grains.bvh import Mesh
from bakery.physics.grains.bvh import nearest as nearest_triangle
from bakery.physics.grains.bvh import normal as triangle_normal
from bakery.physics.grains.bvh import scratch as mesh_scratch
from bakery.physics.grains.surface import conductor, dielectric, diffuse, fresnel, fresnel_conductor
from bakery.physics.grains.surface import left as surface_share
from bakery.physics.grains.surface import turned as at_surface
from bakery.physics.granular._packed import flight as flight_to_sphere
from bakery.physics.medium._kernels import evaluated as phase_value
from bakery.physics.medium._kernels import layout as phase_layout
from bakery.physics.medium._kernels import sampled as phase_sample
from bakery.physics.medium._kernels import turned as turned_direction
from bakery.physics.mie import amplitudes as mie_amplitudes
from bakery.physics.multiple.lookup import any_length as segment_source
from bakery.physics.multiple.lookup import scratch as multiple_scratch
from bakery.physics.multiple.lookup import value as point_source
from bakery.physics.packing._cells import cells as tile_grid
from bakery.physics.packing.instances import cumulated as cumulated_shares
from bakery.physics.packing.instances import kind, rotation, uniforms
from bakery.physics.packing.instances import matrix as rotation_matrix

__all__ = [
    "Mesh", "at_surface", "conductor", "cumulated_shares", "dielectric", "diffuse", "flight_to_sphere", "fresnel",
    "fresnel_conductor", "goa_amplitudes", "instance", "mesh_scratch", "mie_amplitudes", "multiple_scratch", "nearest_triangle",
    "phase_layout", "phase_sample", "phase_value", "point_source", "rotation_matrix", "segment_source", "surface_share",
    "tile_grid", "triangle_normal", "turned_direction",
]


@njit(cache=True, nogil=True, error_model="numpy")
def instance(seed, i, j, k, sphere, shares):
    """Type and rotation of the grain at a sphere of copy (i, j, k) of a tile; compiled.

    seed : uint64;  i, j, k, sphere : int64;  shares : (T,) from `cumulated_shares`

    Returns the type, 0 to T - 1, and the quaternion (x, y, z, w) that turns the grain's frame into the world's; the same as
    `asset.packing`'s instances and the random walks of the bake.
    """
    a, b, c, d = uniforms(seed, i, j, k, sphere)
    return kind(a, shares), rotation(b, c, d)
