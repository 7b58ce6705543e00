"""Grains without an arrangement."""

from renderers.materials.grains.declaration import GrainMethod


def grains(*parameters):
    """Flights to grains by chance; parameters as those of `teleport.Teleports`."""
    from renderers.materials.grains import teleport

    return teleport.Teleports(*parameters)


METHOD = GrainMethod(
    name="teleport", words="grains without an arrangement, for comparison", grains=grains,
    error=lambda tolerance: 0.019,  # largest of eight scenes
    brings="light at grains as in ept, each of them met by the law of flights")
