"""The cheapest method that keeps the tolerance, by pilots."""

from renderers.materials.particles.declaration import ParticleMethod
from renderers.materials.particles.declared import particles_continuous

METHOD = ParticleMethod(
    name="auto", words="particles+continuous or particles, whichever is cheaper by pilots; else particles+continuous", keeps=True,
    keys=("peak",), candidates=("particles+continuous", "particles"), points=(), passes=particles_continuous.passes,
    error=particles_continuous.METHOD.error, brings="as the method that it takes")
