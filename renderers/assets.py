"""The assets of a scene: those that it names, or what its recipes bake."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

from bakery.run.ensure import ensured, output_of
from renderers import budget, requirements
from renderers.scene import Scene, beside


def baked(scene: Scene, progress=None, overwrite: bool = False) -> Scene:
    """The scene with its assets.

    A recipe is baked where its asset, NAME.h5 beside the scene, is missing, out of date or not what the scene requires; so is
    that beside an asset which is named and not there.

    Parameters
    ----------
    progress : a `bakery.run.progress.Progress`, or None
    overwrite : replace what stands where an asset goes also where it is none

    Raises
    ------
    BakeryError : a recipe is wrong, a stage fails, an asset cannot be written
    """
    if scene.assets:
        return scene
    named = materials(scene)
    _check_apart(scene, named)
    found, shares = {}, [0.0]
    for one in named:
        if (key := (one.asset, one.recipe)) in found:
            continue
        recipe, place = recipe_of(scene, one)
        if recipe is None:
            found[key] = place
            shares.append(budget.HALF)
            continue

        def require(*about):
            required = requirements.of_scene(scene, *about)
            shares.append(required.share)
            return required

        found[key] = Path(ensured(recipe, place, require=require, progress=progress, overwrite=overwrite,
                                  by=str(scene.path)).output)
    paths = tuple(found[one.asset, one.recipe] for one in named)
    return dataclasses.replace(scene, asset=paths[0], assets=paths, share=max(shares))


def materials(scene: Scene) -> list:
    """For each body what names its asset or recipe: the body itself, or the scene."""
    return [body if body.asset or body.recipe else scene.values for body in scene.bodies]


def _check_apart(scene: Scene, named) -> None:
    """UsageError where the asset of a recipe would go where that of another body stands or goes."""
    taken: dict[Path, tuple[str, Path]] = {}
    for number, one in enumerate(named):
        recipe, place = recipe_of(scene, one)
        path = Path(place) if recipe is None else output_of(recipe, place)
        word, of = ("asset", path) if recipe is None else ("recipe", Path(recipe))
        first, other = taken.setdefault(path.resolve(), (word, of.resolve()))
        if other != of.resolve():
            key = f"{scene.rules.BODIES}[{number}].{word}"
            raise scene.wrong(key, f"{of}: its asset {path} is that of the {first} {other} as well; another name in the recipe "
                                   "would do")


def recipe_of(scene: Scene, material):
    """Of what a scene says of a body: what to bake, or None, and where the asset is or goes."""
    if material.recipe:
        return scene.file(material.recipe), os.path.join(scene.path.parent, "")
    asset = scene.file(material.asset)
    return beside(asset), asset
