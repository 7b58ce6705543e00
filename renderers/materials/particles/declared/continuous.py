"""The medium that particles make on average."""

import numpy as np

from renderers.materials.particles.declaration import ParticleMethod, Passes


def passes(setup, tolerance, seed) -> Passes:
    from renderers.materials.particles import continuum, walk

    part = continuum.part(setup, seed) or ("walk", walk.one_pass, walk.Discs(setup.medium, later=0.0))
    return Passes([part], np.zeros(setup.world.size))


def deviation(*entry) -> float:
    """Of one realisation from the mean of all, by Campbell's theorem."""
    from renderers.materials.particles import detail

    return detail.deviation(*entry)


METHOD = ParticleMethod(
    name="continuous", words="the continuous medium everywhere", keys=("peak",), points=("", "peak=keep"), passes=passes,
    continuous=True, beside=True, deviation=deviation, brings="paths in the medium that the particles make on average")
