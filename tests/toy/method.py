"""A small method of particles: walks in their continuous medium."""

from __future__ import annotations

from renderers.materials.particles.declaration import ParticleMethod, Passes
from renderers.materials.particles.declared import continuous


def passes(setup, tolerance, seed) -> Passes:
    return continuous.passes(setup, tolerance, seed)._replace(reasons=(f"a toy with a tolerance of {tolerance:g}",))


METHOD = ParticleMethod(
    name="toy", words="a toy of the tests", keys=("footprint",), points=("", "footprint=2"), passes=passes, continuous=True,
    error=lambda tolerance: 0.25 * tolerance, brings="walks in the medium, for the tests", leaves_out="toys leave out all else")
