"""What a recipe bakes: one asset, or a family of them where it sweeps keys."""

from __future__ import annotations

import atexit
import os
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from bakery.errors import StageError
from bakery.grammar.files import Written
from bakery.plan import Plan
from bakery.plan.asked import EVERYTHING, Asked
from bakery.recipe.written import as_path
from bakery.run import Baked, execute, overrides, prepare
from bakery.run.cache import Cache
from bakery.run.dask import check_address
from bakery.run.family import execute_family
from bakery.run.family_plan import FamilyPlan, prepare_family
from bakery.run.progress import Progress
from bakery.store import scratch

if TYPE_CHECKING:
    from bakery.asset import Asset, Family


def planned(recipe: str | os.PathLike, output: str | os.PathLike | None = None, *, asked: Asked = EVERYTHING,
            keep_going: bool = False, progress: Progress | None = None, **options) -> Plan | FamilyPlan:
    """Read and check a recipe, where that was not done to know what is asked, and plan its bake, whichever it is; arguments and
    errors as of `bakery.run.prepare`.  No scene decides families.

    keep_going : of a sweep the points that are not wrong are baked where others are

    Raises RecipeError with every problem of the recipe
    """
    from bakery.recipe import load

    values = asked.recipe
    if values is None:
        with (progress or Progress()).during(f"reading {os.path.basename(recipe)}"):
            values = load(recipe, asked.settings, keep_going=keep_going)
    make = prepare if values.sweep is None else prepare_family
    return make(values, output, asked=asked, progress=progress, **options)


def executed(plan: Plan | FamilyPlan, **options) -> Baked:
    """What a plan bakes; arguments as of `bakery.run.execute`."""
    return (execute_family if isinstance(plan, FamilyPlan) else execute)(plan, **options)


def bake(
    recipe: str | os.PathLike | Mapping, output: str | os.PathLike | None = None, *, stages: Sequence[str] = (),
    quality: str | None = None, tolerance: str | float | None = None, seed: int | None = None,
    settings: Mapping[str, str] | None = None, jobs: int | None = None, executor: Executor | None = None,
    cluster: str | None = None, force: bool = False, progress: Progress | None = None, overwrite: bool = False,
) -> Asset | Family:
    """Bake a recipe into one asset, or into a family if it sweeps keys; the same as `bake RECIPE`.

    Parameters
    ----------
    recipe : path of the recipe; or its text, of several lines; or a dict of the same keys, `{"bakery": 1, "name": "milk", ...}`.
        Files that a text or a dict names are in the current folder
    output : path of the asset, or of a folder with a closing slash; by default FILE.h5 in the current folder, by the name of the
        recipe's file.  For a text or a dict it is by default a temporary file, until the process ends; the stages stay in the
        cache, so baking it again, with `output=`, takes no time
    stages : names of the only stages to bake (and what they need)
    quality : draft, preview or final
    tolerance, seed : override the recipe's
    settings : other recipe values, dotted key -> text as in the recipe
    jobs : number of threads; all processors by default
    executor : any `concurrent.futures` executor that runs the blocks instead
    cluster : address of a Dask scheduler
    force : compute every stage again
    progress : from `bakery.run.progress`; silent by default
    overwrite : also replace a file at `output` that is no asset, or an asset of another recipe

    Returns
    -------
    asset : as from `bakery.open`; it can be used wherever its path is accepted (`os.fspath(asset)`, `asset.path`)

    Raises
    ------
    RecipeError, UsageError, StageError, StoreError : see `bakery.errors`; StageError also if the asset was written but misses
        its tolerance or another target; the text says which

    Examples
    --------
    >>> bakery.bake("fog.yaml", output="fog.h5").path
    'fog.h5'
    >>> bakery.bake(bakery.open("fog.h5").recipe, tolerance="5%").medium.g                           # doctest: +SKIP
    """
    from bakery.asset import open as opened

    recipe = as_path(recipe)
    if output is None and isinstance(recipe, Written):
        output = tempfile.mkdtemp(dir=_own_folder()) + os.sep
    if cluster is not None:
        check_address(cluster)
    stored = Cache(say=progress.say if progress else lambda text: None)
    asked = Asked(overrides(quality, tolerance, seed, settings), tuple(stages))
    plan = planned(recipe, output, asked=asked, force=force, cache=stored, jobs=jobs, overwrite=overwrite,
                   progress=progress)
    baked = executed(plan, cache=stored, jobs=jobs, executor=executor, address=cluster, progress=progress)
    if baked.missed:
        raise StageError(f"{baked.output} is written, but " + "; ".join(baked.missed))
    return opened(baked.output)


@cache
def _own_folder() -> Path:
    """A folder for assets that nobody gave a place, removed when the process ends."""
    held = ExitStack()
    atexit.register(held.close)
    return held.enter_context(scratch.folder("bake"))
