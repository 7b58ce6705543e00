"""The asset of a recipe that something else names: baked where it is missing or out of date, with what is asked of it.

What is asked is a function of (checked recipe, () -> its medium by a draft bake, seconds) that gives what
`renderers.requirements.of` gives: `needs`, `stages`, `settings`, `remarks`, `read`; seconds is a function of the same that says
how long a bake of it would take.  Nothing here knows of scenes.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from bakery.errors import RecipeError, UsageError
from bakery.plan import chosen
from bakery.run import Baked, draft, execute, prepare, target_of
from bakery.run.cache import Cache
from bakery.run.progress import Progress
from bakery.stages import sections_for


@dataclass(frozen=True)
class Asked:
    """What a bake is asked for.

    Attributes
    ----------
    settings : overrides of the recipe: what was set before, and on top of the recipe the knobs that are asked for
    stages : names of the only stages to bake, with those that they need
    added, left : names of stages that the recipe does not ask for, and that it asks for in vain
    whole : overrides with which the recipe is baked as it stands, with the stages that are added
    more : whether a knob asks for more than the recipe has
    needs : why, see `renderers.requirements.Need`
    remarks : what could not be found out
    read : files that it was found out from, besides the recipe's
    """

    settings: Mapping[str, str]
    stages: tuple[str, ...]
    added: tuple[str, ...]
    left: tuple[str, ...]
    whole: Mapping[str, str] = field(default_factory=dict)
    more: bool = False
    needs: tuple = ()
    remarks: tuple[str, ...] = ()
    read: tuple[Path, ...] = ()

    @property
    def of_plan(self) -> dict:
        """What `bakery.run.prepare` takes of it, by name."""
        return {name: getattr(self, name) for name in ("stages", "settings", "needs", "remarks", "read")}


def asked(recipe: str | os.PathLike, settings: Mapping[str, str], require: Callable, cache: Cache | None = None,
          progress: Progress | None = None, by: str = "the scene") -> Asked:
    """What to bake of a recipe so that it serves those that `require` it, which messages call `by`; what the settings say wins.

    Raises RecipeError, UsageError, StageError, StoreError : see `bakery.errors`
    """
    from bakery.recipe import load

    values, cache = load(recipe, dict(settings)).unswept(), cache or Cache()
    own = [stage.name for stage in chosen(values)]

    def overrides(required):
        added = [name for name in required.stages if name not in own]
        sections = {sections_for(name)[0][0]: "{}" for name in added}
        # knobs of stages upstream stand in sections of their own, or at the top
        knobs = {key: text for key, text in required.settings.items() if not _said(key, settings)}
        return added, sections | knobs | dict(settings), sections | dict(settings)

    def seconds(required):
        every = _loaded(recipe, *overrides(required)[:2], by)
        return sum(stage.cost(every).seconds for stage in chosen(every, required.stages))

    required = require(values, lambda: draft.medium(values, settings, cache, progress), seconds)
    added, every, whole = overrides(required)
    kept = {stage.name for stage in chosen(_loaded(recipe, added, every, by), required.stages)} if required.stages else set(own)
    leaves = load(recipe, whole).leaves
    more = any(knob.demand(knob.value) > knob.demand(leaves.get(knob.key)) for one in required.needs if one.needed
               for knob in one.knobs)
    return Asked(every, tuple(required.stages), tuple(added), tuple(name for name in own if name not in kept), whole, more,
                 tuple(_as_set(one, settings) for one in required.needs), required.remarks, tuple(required.read))


def _loaded(recipe, added: Sequence[str], settings: Mapping[str, str], by: str):
    """The recipe with sections of stages that it does not ask for; UsageError where one of them cannot be left to defaults."""
    from bakery.recipe import load

    try:
        return load(recipe, settings)
    except RecipeError as error:
        absent: dict[str, str] = {}
        for every in map(sections_for, added):
            names = " or ".join(" and ".join(sections) for sections in every)
            for problem in error.problems:
                if problem.file == f"--set {every[0][0]}":
                    absent.setdefault(names, f"{problem.key}: {problem.expected}")
        if not absent:
            raise
        raise UsageError(f"{recipe}: has no section {' and no section '.join(absent)}, which {by} needs; "
                         f"{'; '.join(absent.values())}") from None


def _as_set(need, settings: Mapping[str, str]):
    """A need with the knobs that hold: those that the settings say are as they say."""
    knobs = (knob if not _said(knob.key, settings) else knob._replace(text=settings[knob.key], why="set by hand")
             for knob in need.knobs if knob.key in settings or not _said(knob.key, settings))
    return need._replace(knobs=tuple(knobs))


def _said(key: str, settings: Mapping[str, str]) -> bool:
    """Whether settings say a key themselves, or the whole section that it is in; or, of a stage's tolerance, that of all."""
    return any(key == said or key.startswith((f"{said}.", f"{said}[")) for said in settings) \
        or key.endswith(".tolerance") and "tolerance" in settings


def ensured(recipe: str | os.PathLike, output: str | os.PathLike, *, require: Callable,
            progress: Progress | None = None, overwrite: bool = False, by: str = "the scene") -> Baked:
    """Bakes a recipe unless its asset is up to date, with what is asked of it or, as it stands, with more.

    Parameters
    ----------
    recipe : path of the recipe
    output : path of the asset, or of a folder with a closing slash
    require : what is asked of it, see the head of this module
    progress : what is baked, remarks and missed targets are told to it
    overwrite : replace what stands at `output` also where it is no asset
    by : what messages call those that ask

    Raises
    ------
    RecipeError, UsageError, StageError, StoreError : see `bakery.errors`
    """
    progress = progress or Progress()
    cache = Cache(say=progress.say)
    wanted = asked(recipe, {}, require, cache, progress, by)
    plan = prepare(recipe, output, settings=wanted.whole, cache=cache, progress=progress, overwrite=overwrite, read=wanted.read)
    if plan.write or wanted.more:
        plan = prepare(recipe, output, cache=cache, progress=progress, overwrite=overwrite, **wanted.of_plan)
    for line in told(recipe, wanted) if plan.write else wanted.remarks:
        progress.say(line)
    baked = execute(plan, cache=cache, progress=progress)
    for miss in baked.missed:
        progress.say(f"{baked.output}: {miss}")
    return baked


def output_of(recipe: str | os.PathLike, output: str | os.PathLike) -> Path:
    """Where `ensured` writes the asset of a recipe."""
    from bakery.recipe import load

    return target_of(output, load(recipe).name)


def told(recipe: str | os.PathLike, wanted: Asked, by: str = "the scene") -> Sequence[str]:
    """A line for each stage that is baked though the recipe does not ask for it, or not baked though it does, or that cannot
    give what is asked of it: before minutes of work, not in the report after them."""
    why = {one.stage: one.why for one in wanted.needs}
    lines = [f"{recipe}: {name}, because {by} needs it: {why[name]}" for name in wanted.added]
    lines += [f"{recipe}: no {name}, {why.get(name, 'because nothing reads it')}" for name in wanted.left]
    lines += [f"{recipe}: {one.stage}: out of reach: {one.lacking}" for one in wanted.needs if one.needed and one.lacking]
    return [*lines, *wanted.remarks]
