"""From grain to grain, and on in the medium where that is measured to be as good."""

from __future__ import annotations

from renderers.granular.declaration import ROOM, GrainMethod


def chosen(world, assets, meshes, in_medium, tolerance):
    """Whether paths go on in the medium, and by how much that is off; parameters as those of `choice.chosen`."""
    from renderers.granular import choice

    return choice.chosen(world, assets, meshes, in_medium, tolerance)


METHOD = GrainMethod(
    name="auto", words="ept+vpt+da where it is measured to be as good as ept, or ept does not find the light; else ept",
    keeps=True, keys=("spread",), candidates=("ept", "ept+vpt+da"), points=(), medium=True, diffuses=True, measured=chosen,
    error=lambda tolerance: ROOM * tolerance,  # the most that it lets itself have, before it has measured it
    brings="reflection, refraction and absorption at each grain's own surface, later light in the medium")
