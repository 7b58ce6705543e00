"""Every particle is one."""

import numpy as np

from renderers.materials.particles.declaration import ParticleMethod, Passes


def passes(setup, tolerance, seed) -> Passes:
    depth = np.full(setup.world.size, np.inf)
    return Passes(walk_and_splat(setup, depth, later=np.inf, drawn=False), depth)


def walk_and_splat(setup, depth, later, drawn):
    """Walks, and splats of the particles up to a depth.

    later : m, up to which later events are at particles;  drawn : whether what hides particles is drawn by chance
    """
    from renderers.materials.particles import splat, walk

    eye = setup.world.camera.origin if drawn else None
    walks = ("walk", walk.one_pass, walk.Discs(setup.medium, later=later, splatted=True, eye=eye))
    if not (depth.max() > 0 and setup.world.light_names):
        return [walks]
    plan = splat.plan(setup.medium, setup.world.camera, *setup.world.size, depth, drawn)
    return [walks, ("splat", splat.one_pass, (setup.medium, plan))]


METHOD = ParticleMethod(
    name="particles", words="particles everywhere, one by one", exact=True, beside=True, keys=("peak",), passes=passes, pilot=1.5,
    brings="splats of all particles that the camera can see; walks from particle to particle, next event from each to the lights")
