"""Paths from grain to grain."""

from __future__ import annotations

from renderers.materials.grains.declaration import GrainMethod


def smooth(assets) -> bool:
    """Whether light samples do not reach some of the grains of assets."""
    surfaces = [exemplar.surface for asset in assets for exemplar in asset.grains.exemplars.values()]
    return any(surface["type"] != "diffuse" and surface["roughness"] == 0 for surface in surfaces)


def lacks(assets, world) -> str:
    """Light samples do not reach smooth grains, and no ray meets a light without extent."""
    return ("smooth grains cannot show the light of lamps without extent one by one"
            if smooth(assets) and world.without_extent else "")


METHOD = GrainMethod(name="ept", words="paths from grain to grain", exact=True, beside=True, lacks=lacks,
                     brings="reflection, refraction and absorption at each grain's own surface")
