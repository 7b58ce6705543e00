"""The assets of a scene: those that it names, or those of its recipes, none of which is made worse."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from bakery.run.ensure import ensured
from renderers.scene import Scene, beside, budget, requirements


def baked(scene: Scene, progress=None) -> Scene:
    """The scene with its assets.

    Of a recipe that is the one beside the scene or beside the recipe, by the name of the recipe's file, where it holds what the
    scene requires; else one that is baked into the cache.  An asset that is named and not there is baked where it is named.
    Nothing that stands is written over.

    Parameters
    ----------
    progress : a `bakery.run.progress.Progress`, or None

    Raises
    ------
    BakeryError : a recipe is wrong, a stage fails, an asset cannot be written
    """
    if scene.assets:
        return scene
    paths, shares = {}, [0.0]
    for one in scene.materials:
        if (key := (one.asset, one.recipe)) in paths:
            continue
        recipe, output, candidates = recipe_of(scene, one)
        if recipe is None:
            paths[key] = output
            shares.append(budget.HALF)
            continue

        def require(*about):
            required = requirements.of_scene(scene, *about)
            shares.append(required.share)
            return required

        paths[key] = ensured(recipe, require=require, candidates=candidates, output=output,
                             progress=progress, by=str(scene.path))
    assets = tuple(paths[one.asset, one.recipe] for one in scene.materials)
    return dataclasses.replace(scene, asset=assets[0], assets=assets, share=max(shares))


def recipe_of(scene: Scene, material) -> tuple[Path | None, Path | None, list[Path]]:
    """Of an entry of a scene: what to bake or None, the asset that it names or None, and where users put the asset of
    the recipe that it names."""
    if not material.recipe:
        asset = scene.file(material.asset)
        return beside(asset), asset, []
    recipe = scene.file(material.recipe)
    return recipe, None, list(dict.fromkeys([scene.path.parent / f"{recipe.stem}.h5", recipe.with_name(f"{recipe.stem}.h5")]))
