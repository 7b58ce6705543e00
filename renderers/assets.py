"""The asset of a scene: the one that it names, or what its recipe bakes."""

from __future__ import annotations

import dataclasses
import os

from bakery.run.ensure import ensured
from renderers.scene import Scene


def baked(scene: Scene, progress=None) -> Scene:
    """The scene with its asset.

    A recipe is baked where its asset, NAME.h5 beside the scene, is missing, out of date or lacks a stage that the renderer needs.

    Parameters
    ----------
    progress : a `bakery.run.progress.Progress`, or None

    Raises
    ------
    BakeryError : the recipe is wrong, a stage fails, the asset cannot be written
    """
    if scene.asset is not None:
        return scene
    result = ensured(scene.file(scene.values.recipe), os.path.join(scene.path.parent, ""), needs=scene.rules.NEEDS,
                   progress=progress)
    return dataclasses.replace(scene, asset=result.output)
