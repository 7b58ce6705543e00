"""The assets of a scene: those that it names, or those of its recipes, none of which is made worse."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import bakery
from bakery.errors import AssetError
from bakery.run.ensure import ensured
from renderers.scene import Scene, beside, budget, requirements


def baked(scene: Scene, progress=None) -> Scene:
    """The scene with its assets.

    Of a recipe that is the one beside the scene or beside the recipe, by the name of the recipe's file, where it holds what the
    scene requires; else one that is baked into the cache.  An asset that is named and not there is baked where it is named.
    Nothing that stands is written over.

    progress : a `bakery.run.progress.Progress`, or None

    Raises BakeryError: a recipe is wrong, a stage fails, an asset cannot be written.
    """
    return scene if scene.assets else together([scene], progress)[0]


def together(scenes: Sequence[Scene], progress=None, measured: Sequence[Scene] | None = None) -> list[Scene]:
    """Scenes of one file, such as the frames of a sequence, with assets that are good enough for all of them.

    measured : scenes of the same file that say what an asset has to hold; those themselves if None
    """
    paths, shares, measured = {}, [0.0], scenes if measured is None else measured
    worlds = {} if len(measured) == 1 else None  # those of a sequence are too many to be kept
    for scene in scenes:
        for entry in scene.materials:
            if (key := (entry.asset, entry.recipe)) in paths:
                continue
            recipe, output, candidates = recipe_of(scene, entry)
            if recipe is None:
                paths[key] = output
                shares.append(budget.HALF)
                continue
            asking = [frame for frame in measured if any((same.asset, same.recipe) == key for same in frame.materials)]

            def require(*about, asking=asking or [scene]):
                required = requirements.of_scenes(asking, *about, worlds)
                shares.append(required.share)
                return required

            paths[key] = ensured(recipe, require=require, candidates=candidates, output=output,
                                 progress=progress, by=str(scene.path))
    listed = [tuple(paths[entry.asset, entry.recipe] for entry in scene.materials) for scene in scenes]
    return [dataclasses.replace(scene, asset=assets[0], assets=assets, share=max(shares))
            for scene, assets in zip(scenes, listed)]


def opened(scene: Scene) -> list:
    """The assets of a scene, in the order of its materials, each file read once; AssetError with the key that names a file."""
    by_path = {}
    for number, (entry, path) in enumerate(zip(scene.materials, scene.assets, strict=True)):
        if path in by_path:
            continue
        try:
            by_path[path] = bakery.open(path)
        except AssetError as fault:
            key = f"materials[{number}].asset" if hasattr(scene.values, "materials") else "asset"
            raise AssetError(f"{scene.places.get(key, scene.path)}: {key}: {fault}" if entry.asset else str(fault)) from None
    return [by_path[path] for path in scene.assets]


def recipe_of(scene: Scene, material) -> tuple[Path | None, Path | None, list[Path]]:
    """Of an entry of a scene: what to bake or None, the asset that it names or None, and where users put the asset of
    the recipe that it names."""
    if not material.recipe:
        asset = scene.file(material.asset)
        return beside(asset), asset, []
    recipe = scene.file(material.recipe)
    return recipe, None, list(dict.fromkeys([scene.path.parent / f"{recipe.stem}.h5", recipe.with_name(f"{recipe.stem}.h5")]))
