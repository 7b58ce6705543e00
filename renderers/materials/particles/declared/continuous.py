"""The medium that particles make on average."""

from __future__ import annotations

import numpy as np

from renderers.materials.particles.declaration import ParticleMethod, Passes


def passes(setup, tolerance, seed) -> Passes:
    from renderers.materials.particles import continuum, walk

    part = continuum.part(setup, seed) or ("walk", walk.one_pass, walk.Discs(setup.medium, later=0.0))
    return Passes([part], np.zeros(setup.world.size))


METHOD = ParticleMethod(
    name="continuous", words="the continuous medium everywhere", keys=("peak",), points=("", "peak=keep"), passes=passes,
    continuous=True, beside=True, brings="paths in the medium that the particles make on average")
