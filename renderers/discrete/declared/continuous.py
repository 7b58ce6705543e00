"""The medium that particles make on average."""

from __future__ import annotations

import numpy as np

from renderers.discrete.declaration import ParticleMethod, Passes


def passes(setup, tolerance, seed) -> Passes:
    from renderers.discrete import walk

    return Passes([("walk", walk.one_pass, walk.Discs(setup.medium, later=0.0))], np.zeros(setup.world.size))


METHOD = ParticleMethod(
    name="continuous", words="the continuous medium everywhere", keys=("peak",), points=("", "peak=keep"), passes=passes,
    continuous=True, brings="walks in the medium that the particles make on average")
