"""The cheapest method that keeps the tolerance, by pilots."""

from renderers.materials.grains.declaration import GrainMethod
from renderers.scene.budget import ROOM

METHOD = GrainMethod(
    name="auto", words="ept, ept+wide, ept+vpt+da, ept+vpt or ept+vpt+surface, the cheapest that keeps the tolerance, by pilots; "
          "else ept",
    keeps=True, keys=("spread", "widen", "surface_from"), points=(),
    candidates=("ept", "ept+vpt+da", "ept+vpt", "ept+vpt+surface", "ept+wide"), widens=True, medium=True, diffuses=True,
    error=lambda tolerance: ROOM * tolerance,  # the most that it lets itself have, before it has measured it
    brings="as the method that it takes")
