"""The interface for compiled renderers: what their own kernels may call of bakery's physics.

`bakery.open` gives arrays and functions of arrays; inside a loop that numba compiles there is no asset.  There the functions here
are called, with what the layouts below make of an asset once, before the loop.  Those marked *compiled* are numba functions.

| what | layout, in Python | compiled |
|---|---|---|
| tables of multiple scattering | `asset.multiple.point.tables()` | `point_source`, `segment_source` |
| sums of look-ups in them | | `no_look_ups`, `add_look_up`, `add_segment_look_up`, `sum_of_look_ups` |
| light of them along a line of sight | the same | `point_source_seen`, `segment_source_seen` |
| the same on arrays of Dr.Jit | `drjit_tables` | |
| which grain stands where in repeated tiles, and how it is turned | `cumulated_shares` | `instance`, `rotation_matrix` |
| spheres of a repeated tile | `tile_grid` | `flight_to_sphere` |
| its spheres with centres in a mesh | `Aggregate`, `aggregate` | `aggregate_scratch`, `first_sphere`, `enclosing_sphere` |
| of which a part is left out | `Field`, `field`, `uniform_field`; `mean_share` | `share_at` |
| grains whose mixture varies | `field` | `instance_of` |
| a medium that varies | `Varied`, `varied_medium`, `unvaried_medium`, `extinction_at_fraction` | `extinctions_at` |
| its components | `Component`, `whole_medium`, `medium_component` | |
| that mesh | `depth_in_mesh` | `mesh_boundary`, `in_mesh`, `deep_in_mesh`, `deepest_in_mesh`, `within_reach` |
| diffuse light in it | `Diffuse`, `diffuse_in_mesh`, `never_diffuse` | `clear_in_mesh`, `diffuse_share` |
| voxels with triangles | | `mark_voxels` |
| types of grain | `Exemplars`, `exemplars` | |
| triangles of a grain | `Mesh` (`Mesh(vertices, faces).tree`) | `mesh_scratch`, `nearest_triangle`, `triangle_normal` |
| how far they are from a point | the same | `distance_to_triangles` |
| surfaces of grains | `dielectric`, `diffuse`, `conductor` | `fresnel`, `fresnel_conductor`, `at_surface`, `surface_share` |
| their kinds, frames | `DIELECTRIC`, `DIFFUSE`, `CONDUCTOR` | `surface_frame`, `surface_density` |
| phase functions | `phase_layout`, `phase_at`, `phase_integral` | `phase_value`, `phase_sample`, `turned_direction` |
| amplitudes of spheres | `mie_amplitudes`, `goa_amplitudes` | |
| where particles are | `Region`, `BOX`, `region_box`, `region_grid`, `region_mesh` | `relative_density`, `region_densities` |
| its particles, as discs | `disc_order`, `stored_discs`, `procedural_discs` | `first_disc` (or `NO_DISC`), `open_wavelengths` |
| one by one | | `disc_cells`, `discs_of_cell` |
| closed meshes, of files or of triangles | `closed_mesh`, `solid` | |
| hashes | | `hashed` |
| random streams, by name | `stream_key` (seed, a name of `bakery.rng.STREAMS`, its index) | |
| tuples of arrays, uncounted | | `lent` |

Lengths: mean free paths for tables of multiple scattering, mean radii for tiles, radii of the bounding sphere for grains.
Importing this module loads numba and SciPy.
"""

from __future__ import annotations

from bakery.physics.discrete.levels import order as disc_order
from bakery.physics.discrete.levels import procedural as procedural_discs
from bakery.physics.discrete.levels import stored as stored_discs
from bakery.physics.discrete.pencils import NONE as NO_DISC
from bakery.physics.discrete.pencils import cell_range as disc_cells
from bakery.physics.discrete.pencils import first_disc
from bakery.physics.discrete.pencils import particles_of as discs_of_cell
from bakery.physics.discrete.pencils import through as open_wavelengths
from bakery.physics.discrete.region import BOX, Region, relative_density
from bakery.physics.discrete.region import box as region_box
from bakery.physics.discrete.region import densities as region_densities
from bakery.physics.discrete.region import grid as region_grid
from bakery.physics.discrete.region import mesh as region_mesh
from bakery.physics.goa import amplitudes as goa_amplitudes
from bakery.physics.grains._walk import _frame as surface_frame
from bakery.physics.grains.bvh import Mesh
from bakery.physics.grains.bvh import nearest as nearest_triangle
from bakery.physics.grains.bvh import normal as triangle_normal
from bakery.physics.grains.bvh import scratch as mesh_scratch
from bakery.physics.grains.surface import (
    CONDUCTOR,
    DIELECTRIC,
    DIFFUSE,
    conductor,
    dielectric,
    diffuse,
    fresnel,
    fresnel_conductor,
)
from bakery.physics.grains.surface import left as surface_share
from bakery.physics.grains.surface import towards as surface_density
from bakery.physics.grains.surface import turned as at_surface
from bakery.physics.granular._distance import deepest as deepest_in_mesh
from bakery.physics.granular._distance import distance as distance_to_triangles
from bakery.physics.granular._packed import flight as flight_to_sphere
from bakery.physics.granular._voxels import mark as mark_voxels
from bakery.physics.granular.aggregate import (
    Aggregate,
    aggregate,
    enclosing_sphere,
    first_sphere,
    mean_share,
    share_at,
    within_reach,
)
from bakery.physics.granular.aggregate import boundary as mesh_boundary
from bakery.physics.granular.aggregate import deep as deep_in_mesh
from bakery.physics.granular.aggregate import depth as depth_in_mesh
from bakery.physics.granular.aggregate import holds as in_mesh
from bakery.physics.granular.aggregate import scratch as aggregate_scratch
from bakery.physics.granular.diffusion import Diffuse
from bakery.physics.granular.diffusion import clear as clear_in_mesh
from bakery.physics.granular.diffusion import decayed as diffuse_share
from bakery.physics.granular.diffusion import diffuse as diffuse_in_mesh
from bakery.physics.granular.diffusion import never as never_diffuse
from bakery.physics.granular.exemplars import Exemplars
from bakery.physics.granular.exemplars import layout as exemplars
from bakery.physics.granular.field import Field, between, field, first_above
from bakery.physics.granular.field import uniform as uniform_field
from bakery.physics.granular.varied import Component, Varied
from bakery.physics.granular.varied import component as medium_component
from bakery.physics.granular.varied import extinction as extinction_at_fraction
from bakery.physics.granular.varied import extinctions as extinctions_at
from bakery.physics.granular.varied import unvaried as unvaried_medium
from bakery.physics.granular.varied import varied as varied_medium
from bakery.physics.granular.varied import whole as whole_medium
from bakery.physics.lent import lent
from bakery.physics.medium._kernels import evaluated as phase_value
from bakery.physics.medium._kernels import layout as phase_layout
from bakery.physics.medium._kernels import sampled as phase_sample
from bakery.physics.medium._kernels import turned as turned_direction
from bakery.physics.medium.phase import evaluate as phase_at
from bakery.physics.medium.phase import integral as phase_integral
from bakery.physics.mie import amplitudes as mie_amplitudes
from bakery.physics.multiple._look import add as add_look_up
from bakery.physics.multiple._look import emptied as no_look_ups
from bakery.physics.multiple._look import total as sum_of_look_ups
from bakery.physics.multiple._look import value as point_source
from bakery.physics.multiple.lookup import add_beam as add_segment_look_up
from bakery.physics.multiple.lookup import any_length as segment_source
from bakery.physics.multiple.queries import point_seen as point_source_seen
from bakery.physics.multiple.queries import segment_seen as segment_source_seen
from bakery.physics.packing._cells import cells as tile_grid
from bakery.physics.packing.instances import cumulated as cumulated_shares
from bakery.physics.packing.instances import kind, rotation, uniforms
from bakery.physics.packing.instances import matrix as rotation_matrix
from bakery.physics.packing.instances import mix as hashed
from bakery.physics.shapes.files import triangles
from bakery.physics.shapes.mending import mended
from bakery.rng import key64 as stream_key
from bakery.system.compiled import njit

__all__ = [
    "BOX",
    "CONDUCTOR",
    "DIELECTRIC",
    "DIFFUSE",
    "NO_DISC",
    "Aggregate",
    "Component",
    "Diffuse",
    "Exemplars",
    "Field",
    "Mesh",
    "Region",
    "Varied",
    "add_look_up",
    "add_segment_look_up",
    "aggregate",
    "aggregate_scratch",
    "at_surface",
    "clear_in_mesh",
    "closed_mesh",
    "conductor",
    "cumulated_shares",
    "deep_in_mesh",
    "deepest_in_mesh",
    "depth_in_mesh",
    "dielectric",
    "diffuse",
    "diffuse_in_mesh",
    "diffuse_share",
    "disc_cells",
    "disc_order",
    "discs_of_cell",
    "distance_to_triangles",
    "drjit_tables",
    "enclosing_sphere",
    "exemplars",
    "extinction_at_fraction",
    "extinctions_at",
    "field",
    "first_disc",
    "first_sphere",
    "flight_to_sphere",
    "fresnel",
    "fresnel_conductor",
    "goa_amplitudes",
    "hashed",
    "in_mesh",
    "instance",
    "instance_of",
    "lent",
    "mark_voxels",
    "mean_share",
    "medium_component",
    "mesh_boundary",
    "mesh_scratch",
    "mie_amplitudes",
    "nearest_triangle",
    "never_diffuse",
    "no_look_ups",
    "open_wavelengths",
    "phase_at",
    "phase_integral",
    "phase_layout",
    "phase_sample",
    "phase_value",
    "point_source",
    "point_source_seen",
    "procedural_discs",
    "region_box",
    "region_densities",
    "region_grid",
    "region_mesh",
    "relative_density",
    "rotation_matrix",
    "segment_source",
    "segment_source_seen",
    "share_at",
    "solid",
    "stored_discs",
    "stream_key",
    "sum_of_look_ups",
    "surface_density",
    "surface_frame",
    "surface_share",
    "tile_grid",
    "triangle_normal",
    "turned_direction",
    "uniform_field",
    "unvaried_medium",
    "varied_medium",
    "whole_medium",
    "within_reach",
]


def drjit_tables(points, segments, Float):
    """Tables of one wavelength, from `asset.multiple.segment.tables()`, for look-ups in kernels of Dr.Jit.

    points, segments : of both sources; None for segments where only points are asked;  Float : `mitsuba.Float`, or of Dr.Jit

    Returns `bakery.physics.multiple.symbolic.Tables` with `point_to_point`, `segment_to_point`, `point_to_segment` and
    `segment_to_segment`.  Raises UsageError where Dr.Jit, or an LLVM for it, is missing.
    """
    from bakery.physics.multiple.symbolic import Tables

    return Tables(points, segments, Float)


def closed_mesh(data, kind):
    """Vertices (V, 3) and triangles (F, 3) of a mesh file, a solid with outward normals.

    data : bytes of the file;  kind : its ending, such as ply

    Raises ValueError, in words, where it is no such file, or no closed mesh.
    """
    return solid(*triangles(data, kind))


def solid(vertices, faces):
    """Vertices (V, 3) and triangles (F, 3) of a closed mesh with outward normals, equal vertices made one; as `closed_mesh`."""
    vertices, faces, _ = mended(vertices, faces)
    return vertices, faces


@njit(cache=True, nogil=True, error_model="numpy")
def instance(seed, i, j, k, sphere, shares):
    """Type and rotation of the grain at a sphere of copy (i, j, k) of a tile; compiled.

    seed : uint64;  i, j, k, sphere : int64;  shares : (T,) from `cumulated_shares`

    Returns the type, 0 to T - 1, and the quaternion (x, y, z, w) that turns the grain's frame into the world's; the same as
    `asset.packing`'s instances and the random walks of the bake.
    """
    a, b, c, d = uniforms(seed, i, j, k, sphere)
    return kind(a, shares), rotation(b, c, d)


@njit(cache=True, nogil=True, error_model="numpy")
def instance_of(seed, i, j, k, sphere, mixture, x, y, z):
    """As `instance`, with the cumulated shares of a `Field` at the sphere's centre; compiled."""
    a, b, c, d = uniforms(seed, i, j, k, sphere)
    return first_above(mixture, between(mixture, x, y, z), a), rotation(b, c, d)
