"""A small method of each kind of material: of particles walks in their medium, of grains and bodies what others do already."""

from dataclasses import replace

from renderers.materials.bodies.declared import paths
from renderers.materials.grains.declared import teleport
from renderers.materials.particles.declaration import ParticleMethod, Passes
from renderers.materials.particles.declared import continuous
from renderers.scene.declaration import SceneMethod


def passes(setup, tolerance, seed) -> Passes:
    return continuous.passes(setup, tolerance, seed)._replace(reasons=(f"a toy with a tolerance of {tolerance:g}",))


METHOD = ParticleMethod(
    name="toy", words="a toy of the tests", keys=("footprint",), points=("", "footprint=2"), passes=passes, continuous=True,
    error=lambda tolerance: 0.25 * tolerance, brings="walks in the medium, for the tests", leaves_out="toys leave out all else")

OF_GRAINS = replace(teleport.METHOD, name="toy", words="a toy of the tests", brings="flights by chance, for the tests",
                    leaves_out="toys leave out how grains lie", keys=("spread",), error=lambda tolerance: 0.02)
OF_BODIES = replace(paths.METHOD, name="toy", words="a toy of the tests", brings="paths, for the tests", beside=False,
                    leaves_out="toys leave out nothing")
OF_MEDIA = SceneMethod(name="toy", kind="medium", words="a toy of the tests", brings="nothing yet", exact=True)
