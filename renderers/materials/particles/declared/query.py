"""Queries of cylinders and spheres, as the paper has them."""

import math

import numpy as np

from renderers.materials.particles.declaration import ParticleMethod, Passes

_INSIDE = 0.01  # of the box's diagonal: how far from the camera a medium begins that it stands in


def passes(setup, tolerance, seed) -> Passes:
    """Cylinders whose cross section is a share of a pixel where the medium begins (Eq. 23)."""
    from renderers.materials.particles import query, walk

    origin, region, order, footprint = setup.world.camera.origin, setup.region, setup.order, setup.settings.footprint
    nearest = float(np.linalg.norm(np.maximum(np.maximum(region.lo - origin, origin - region.hi), 0.0)))
    nearest = max(nearest, _INSIDE * float(np.linalg.norm(region.hi - region.lo)))
    pixel = math.sqrt(np.linalg.norm(np.cross(setup.world.camera.right, setup.world.camera.down)))
    radius = math.sqrt(footprint * pixel**2 / math.pi) * nearest
    classes = setup.classes
    within = 4 / 3 * math.pi * radius**3 * float(np.sum(classes.density[order]))
    if within > query.MOST:
        fits = 0.95 * footprint * (query.MOST / within) ** (2 / 3)
        message = f"found {footprint:g}, with which a query holds {within:.2g} particles, and {query.MOST:,} are possible; " \
                  f"{fits:.2g}, smaller pixels, or method: continuous would do"
        raise setup.scene.wrong("materials[0].footprint", message)
    reach = np.broadcast_to(math.pi * (classes.radius[order] + radius) ** 2, classes.extinction.shape)
    cylinders = query.Query(setup.medium._replace(discs=setup.discs(reach, classes.density[order], order)),
                            np.ascontiguousarray(classes.extinction[:, order].T),
                            np.ascontiguousarray(classes.scattering[:, order].T), radius)
    return Passes([("walk", walk.one_pass, cylinders)], None, (f"cylinders of {footprint:g} pixels",))


METHOD = ParticleMethod(
    name="query", words="queries of cylinders and spheres, for comparison", keys=("footprint", "peak"), passes=passes,
    brings="the paper's cylinder and sphere as printed",
    leaves_out="queries of the paper: their mean is not the continuous medium's")
