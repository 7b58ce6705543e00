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
| spheres of a repeated tile | `tile_of`, `tile_grid` | `flight_to_sphere` |
| its spheres with centres in a mesh | `Aggregate`, `aggregate` | `aggregate_scratch`, `first_sphere`, `enclosing_sphere` |
| of which a part is left out | `Field`, `field`, `uniform_field`; `mean_share` | `share_at` |
| grains whose mixture varies | `field` | `instance_of` |
| a medium that varies | `Varied`, `varied_medium`, `unvaried_medium`, `extinction_at_fraction` | `extinctions_at` |
| its components | `Component`, `whole_medium`, `medium_component` | |
| that mesh | `depth_in_mesh` | `mesh_boundary`, `in_mesh`, `deep_in_mesh`, `deepest_in_mesh`, `within_reach` |
| diffuse light in it | `Diffuse`, `diffuse_in_mesh`, `never_diffuse` | `clear_in_mesh`, `diffuse_share` |
| voxels with triangles | | `mark_voxels`, `passes_marked`, `voxel_at` |
| types of grain | `Exemplars`, `exemplars` | |
| triangles of a grain | `Mesh` (`Mesh(vertices, faces).tree`) | `mesh_scratch`, `nearest_triangle`, `triangle_normal` |
| triangles that enclose nothing | `triangle_tree` | the same |
| how far they are from a point | the same | `distance_to_triangles` |
| surfaces of grains | `dielectric`, `diffuse`, `conductor` | `fresnel`, `fresnel_conductor`, `at_surface`, `surface_share` |
| their kinds, frames | `DIELECTRIC`, `DIFFUSE`, `CONDUCTOR` | `surface_frame`, `surface_density` |
| phase functions | `phase_layout`, `phase_at`, `phase_integral` | `phase_value`, `phase_sample`, `turned_direction` |
| reflectance of layers | `asset.surface.table()` | `surface_reflectance`, `surface_transmittance` |
| amplitudes of spheres | `mie_amplitudes`, `goa_amplitudes` | |
| where particles are | `Region`, `BOX`, `region_box`, `region_grid`, `region_mesh` | `relative_density`, `region_densities` |
| particles as discs | `disc_order`, `stored_discs`, `procedural_discs` | `Pencil`, `first_disc` (`NO_DISC`), `open_wavelengths` |
| one by one | | `disc_cells`, `discs_of_cell` (into `Particles`) |
| closed meshes, of files or of triangles | `closed_mesh`, `solid` | |
| hashes | | `hashed` |
| random streams, by name | `stream_key` (seed, a name of `bakery.rng.STREAMS`, its index) | |
| tuples of arrays, uncounted | | `lent` |

Lengths: mean free paths for tables of multiple scattering, mean radii for tiles, radii of the bounding sphere for grains.
Importing this module loads numba and SciPy.
"""

from bakery.physics.discrete.levels import disc_order, procedural_discs, stored_discs
from bakery.physics.discrete.pencils import NO_DISC, Particles, Pencil, disc_cells, discs_of_cell, first_disc, open_wavelengths
from bakery.physics.discrete.region import BOX, Region, region_box, region_densities, region_grid, region_mesh, relative_density
from bakery.physics.goa import amplitudes as goa_amplitudes
from bakery.physics.grains.bvh import Mesh, mesh_scratch, nearest_triangle, triangle_normal, triangle_tree
from bakery.physics.grains.sampling import surface_frame
from bakery.physics.grains.surface import (
    CONDUCTOR,
    DIELECTRIC,
    DIFFUSE,
    at_surface,
    conductor,
    dielectric,
    diffuse,
    fresnel,
    fresnel_conductor,
    surface_density,
    surface_share,
)
from bakery.physics.granular.aggregate import (
    Aggregate,
    aggregate,
    aggregate_scratch,
    deep_in_mesh,
    depth_in_mesh,
    enclosing_sphere,
    first_sphere,
    in_mesh,
    mean_share,
    mesh_boundary,
    share_at,
    within_reach,
)
from bakery.physics.granular.diffusion import Diffuse, clear_in_mesh, diffuse_in_mesh, diffuse_share, never_diffuse
from bakery.physics.granular.distance import deepest_in_mesh, distance_to_triangles
from bakery.physics.granular.exemplars import Exemplars, exemplars
from bakery.physics.granular.field import Field, field, instance_of, uniform_field
from bakery.physics.granular.flights import flight_to_sphere
from bakery.physics.granular.varied import (
    Component,
    Varied,
    extinction_at_fraction,
    extinctions_at,
    medium_component,
    unvaried_medium,
    varied_medium,
    whole_medium,
)
from bakery.physics.granular.voxels import mark_voxels, passes_marked, voxel_at
from bakery.physics.lent import lent
from bakery.physics.medium.kernels import phase_layout, phase_sample, phase_value, turned_direction
from bakery.physics.medium.phase import phase_at, phase_integral
from bakery.physics.mie import amplitudes as mie_amplitudes
from bakery.physics.multiple.lookup import add_segment_look_up, segment_source
from bakery.physics.multiple.queries import point_source_seen, segment_source_seen
from bakery.physics.multiple.sums import add_look_up, no_look_ups, point_source, sum_of_look_ups
from bakery.physics.multiple.symbolic import drjit_tables
from bakery.physics.packing.cells import tile_grid
from bakery.physics.packing.instances import cumulated_shares, hashed, instance, rotation_matrix
from bakery.physics.packing.tiles import tile_of
from bakery.physics.shapes.mending import closed_mesh, solid
from bakery.physics.surfaces.look_up import surface_reflectance, surface_transmittance
from bakery.rng import stream_key

__all__ = [name for name in dir() if not name.startswith("_")]
