"""The continuous medium that particles make on average, by the loop of `renderers.transport`."""

import numpy as np

from bakery import kernels
from renderers.scene import meshes
from renderers.transport.scattering import Scatterer


def part(setup, seed):
    """Passes of paths through the medium, or None where the loop has nothing for it: a host that absorbs light in the box of a
    mesh or of a grid, where the medium does not fill it.

    setup : `methods.Setup`
    """
    if np.any(setup.medium.host) and setup.region.kind != kernels.BOX:
        return None
    from renderers.transport import passes
    from renderers.transport.regions import Medium

    entry = Medium(region_of(setup.scene, 0, setup.region, setup.group), scatterer_of(setup.medium), "particles")
    return passes.part("paths", setup.world, [entry], setup.medium, seed, by_light=True)


def scatterer_of(medium) -> Scatterer:
    """What all classes of a `renderers.materials.particles.medium.Medium` and the host are together; the last class is their
    sum."""
    sigma_t = medium.sigma_t + medium.host
    albedo = medium.albedo[-1] * medium.sigma_t / np.maximum(sigma_t, 1e-300)
    return Scatterer(sigma_t, albedo, medium.v, medium.steps, medium.phase[-1], medium.cdf[-1])


def region_of(scene, number, region, group):
    """Where particles of an entry are, by its number, for the loop; region, group : of `place.region_of`."""
    from renderers.transport.regions import Box, Grid, Mesh

    where = scene.values.materials[number].where
    if region.kind == kernels.BOX:
        return Box(region.lo, region.hi)
    as_baked = where is None or hasattr(where, "box")  # which moves the asset's own
    if "density" in group if as_baked else hasattr(where, "grid"):
        return Grid(region.lo, region.hi, region.values)
    if as_baked:
        return Mesh(np.asarray(group.mesh_vertices, float) + region.lo - np.min(group.mesh_vertices, axis=0), group.mesh_faces)
    return Mesh(*meshes.of_entry(scene, number))
