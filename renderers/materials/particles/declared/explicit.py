"""Spheres of glass."""

import math

import numpy as np

from renderers.materials.particles.declaration import ParticleMethod, Passes


def passes(setup, tolerance, seed) -> Passes:
    """Spheres of the classes' radii and their components' indices."""
    from renderers.materials.particles import explicit, walk

    parts = [setup.group[name] for name in setup.group.classes().names]
    host, middle = np.asarray(setup.group.host, float), int(np.argsort(setup.waves)[len(setup.waves) // 2])
    index = np.array([part.n[middle] / host[middle] for part in parts], float)
    absorption = np.array([4 * math.pi * np.asarray(part.k, float) / (setup.waves * 1e-6) for part in parts]) @ setup.bands.T
    order = setup.order
    reach = np.broadcast_to(math.pi * setup.baked.radius[order] ** 2, setup.baked.extinction.shape)
    medium = setup.medium._replace(discs=setup.discs(reach, setup.baked.density[order], order))
    component = setup.baked.component[order]
    spheres = explicit.Spheres(medium, index[component], np.ascontiguousarray(absorption[component]))
    return Passes([("walk", walk.one_pass, spheres)])


METHOD = ParticleMethod(
    name="explicit", words="spheres of geometrical optics, for comparison", passes=passes, peak=False, points=(),
    brings="paths through the spheres themselves; no light is sampled from a sphere, so lights have to be large",
    leaves_out="spheres of geometrical optics: without diffraction, and with the index of the middle wavelength")
