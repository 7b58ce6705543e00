"""The asset of a recipe that something else names: baked where it is missing or out of date, with the stages asked of it."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence

from bakery.run import Baked, execute, prepare
from bakery.run.cache import Cache
from bakery.run.progress import Progress


def with_stages(recipe: str | os.PathLike, settings: Mapping[str, str], needs: Sequence[str]) -> tuple[dict, list[str]]:
    """Settings with a section of defaults for every stage that is needed and not asked for, and the names of these stages."""
    from bakery.plan import chosen
    from bakery.recipe import load
    from bakery.stages import sections_for

    names = [stage.name for stage in chosen(load(recipe, dict(settings)))]
    missing = [name for name in needs if name not in names]
    return {sections_for(name)[0][0]: "{}" for name in missing} | dict(settings), missing


def ensured(recipe: str | os.PathLike, output: str | os.PathLike, *, needs: Sequence[str] = (),
            progress: Progress | None = None) -> Baked:
    """Bakes a recipe unless its asset is up to date.

    Parameters
    ----------
    recipe : path of the recipe
    output : path of the asset, or of a folder with a closing slash
    needs : stages that the asset must hold, whether or not the recipe asks for them
    progress : what is baked, remarks and missed targets are told to it

    Raises
    ------
    RecipeError, UsageError, StageError, StoreError : see `bakery.errors`
    """
    progress = progress or Progress()
    settings, missing = with_stages(recipe, {}, needs)
    cache = Cache(say=progress.say)
    plan = prepare(recipe, output, settings=settings, cache=cache, progress=progress)
    if plan.write and missing:
        progress.say(f"{recipe}: {', '.join(missing)} besides what it asks for")
    baked = execute(plan, cache=cache, progress=progress)
    for miss in baked.missed:
        progress.say(f"{baked.output}: {miss}")
    return baked
