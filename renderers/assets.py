"""The assets of a scene: those that it names, or what its recipes bake."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

from bakery.run.ensure import ensured
from renderers.scene import Scene


def baked(scene: Scene, progress=None) -> Scene:
    """The scene with its assets.

    A recipe is baked where its asset, NAME.h5 beside the scene, is missing, out of date or lacks a stage that the renderer needs.

    Parameters
    ----------
    progress : a `bakery.run.progress.Progress`, or None

    Raises
    ------
    BakeryError : a recipe is wrong, a stage fails, an asset cannot be written
    """
    if scene.assets:
        return scene
    named = [body if body.asset or body.recipe else scene.values for body in scene.bodies]
    recipes = {one.recipe: None for one in named if one.recipe}
    for recipe in recipes:
        recipes[recipe] = Path(ensured(scene.file(recipe), os.path.join(scene.path.parent, ""), needs=scene.rules.NEEDS,
                                       progress=progress).output)
    found = tuple(scene.file(one.asset) if one.asset else recipes[one.recipe] for one in named)
    return dataclasses.replace(scene, asset=found[0], assets=found)
