"""Paths from grain to grain."""

from __future__ import annotations

from renderers.materials.grains.declaration import GrainMethod

# Grains that light meets, from which on a draft takes less in the medium: two passes among 22 took 14 s of a core (medium 17 s),
# among 183 more than 118 s (25 s)
_MANY = 80


def lacks(assets, world) -> str:
    """Light samples do not reach smooth grains, and no ray meets a light without extent."""
    surfaces = [exemplar.surface for asset in assets for exemplar in asset.grains.exemplars.values()]
    smooth = any(surface["type"] != "diffuse" and surface["roughness"] == 0 for surface in surfaces)
    return "smooth grains cannot show the light of lamps without extent one by one" if smooth and world.without_extent else ""


def slow(scene, assets, world) -> str:
    """Each grain that a path meets takes a microsecond or more."""
    from renderers.materials.grains import material

    number = max(material.meetings(asset, *mesh) for asset, mesh in zip(assets, material.meshes_of(scene)))
    return f"ept takes long where light meets some {number:.0f} grains" if number > _MANY else ""


METHOD = GrainMethod(name="ept", words="paths from grain to grain", exact=True, beside=True, lacks=lacks, slow=slow,
                     brings="reflection, refraction and absorption at each grain's own surface")
