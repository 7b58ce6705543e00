"""Paths from grain to grain."""

from __future__ import annotations

from renderers.materials.grains.declaration import GrainMethod

LITTLE, MUCH = 0.02, 0.5  # of the light, from small lamps: it may be left to chance; it may not


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
    return "" if world.small_share < MUCH else "hardly a path meets small lamps by way of smooth grains, and most light is theirs"


METHOD = GrainMethod(name="ept", words="paths from grain to grain", exact=True, beside=True, lacks=lacks,
                     brings="reflection, refraction and absorption at each grain's own surface")
