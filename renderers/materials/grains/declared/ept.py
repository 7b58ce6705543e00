"""Paths from grain to grain."""

from renderers.materials.grains.declaration import GrainMethod

# Grains that light meets, from which on a draft takes less in the medium: two passes among 22 took 14 s of a core (medium 17 s),
# among 183 more than 118 s (25 s)
_MANY = 80
LITTLE = 0.02  # of the light, from small lamps: it may be left to chance
# Times the mean, noise of a sample by chance, from which on lamps may not be left to it: a noise of 5 % takes 40,000 samples.  A
# snowball beside a bulb of 8 mm at 14 cm has 75, bulbs of 16 and 20 mm 38 and 48, shipped scenes of grains 1 to 1.7
_NOISY = 10.0


def smooth(assets) -> bool:
    """Whether light samples do not reach some of the grains of assets."""
    surfaces = [exemplar.surface for asset in assets for exemplar in asset.grains.exemplars.values()]
    return any(surface["type"] != "diffuse" and surface["roughness"] == 0 for surface in surfaces)


def lacks(assets, world) -> str:
    """Light samples do not reach smooth grains, no ray meets a light without extent, and hardly one a small lamp."""
    if not smooth(assets):
        return ""
    if world.without_extent:
        return "smooth grains cannot show the light of lamps without extent one by one"
    return "" if world.noise_by_chance < _NOISY else "hardly a path meets small lamps by way of smooth grains"


def slow(scene, assets, world) -> str:
    """Each grain that a path meets takes a microsecond or more."""
    from renderers.materials.grains import material

    number = max(material.meetings(asset, *mesh) for asset, mesh in zip(assets, material.meshes_of(scene)))
    return f"ept takes long where light meets some {number:.0f} grains" if number > _MANY else ""


METHOD = GrainMethod(name="ept", words="paths from grain to grain", exact=True, beside=True, lacks=lacks, slow=slow,
                     brings="reflection, refraction and absorption at each grain's own surface")
