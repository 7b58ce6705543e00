"""Particles where they can be told apart, the continuous medium elsewhere."""

import numpy as np

from renderers.materials.particles.declaration import ParticleMethod, Passes
from renderers.materials.particles.declared import continuous
from renderers.materials.particles.declared.particles import walk_and_splat
from renderers.scene.budget import ROOM


def passes(setup, tolerance, seed) -> Passes:
    from renderers.materials.particles import detail

    depth = detail.depths(setup.world, setup.medium, setup.world.camera, *setup.world.size, tolerance, seed)
    reasons = (f"{100 * float(np.mean(depth > 0)):.3g} % of the pixels show particles as particles; elsewhere, and beyond the "
               f"depths of layer detail, they deviate from the continuous medium by less than {100 * tolerance:.2g} %; "
               "scattering after the first is the continuous medium's",)
    if not depth.any():
        return continuous.passes(setup, tolerance, seed)._replace(reasons=reasons)
    # of a realisation that is known light meets the others: a particle is not in its own surroundings
    others = 1 - 1 / max(float(setup.group.number[0]), 1.0) if "position" in setup.group else 1.0
    setup = setup._replace(medium=setup.medium._replace(others=others))
    return Passes(walk_and_splat(setup, depth, later=0.0, drawn=True), depth, reasons)


METHOD = ParticleMethod(
    name="particles+continuous", words="particles where they can be told apart, the continuous medium elsewhere", keeps=True,
    keys=("peak",), points=("", "peak=keep"), passes=passes, pilot=1.5,
    error=lambda tolerance: ROOM * tolerance,  # that the continuous medium may make where it takes the place of particles
    brings="first scattering by particles up to a depth, for each pixel, by the continuous medium beyond; all later ones "
           "by the medium")
