"""The asset of a recipe that something else names: one that is there and good enough, else baked into a place of its own.

Nothing that stands is ever written over: an asset that is as good as what is asked for is used as it is, and what has to be baked
goes into the cache, under a name that is the hash of all that decides it.

What is asked is a function of (checked recipe, () -> its medium by a draft bake, seconds) that gives what
`renderers.scene.requirements.of` gives: `needs`, `stages`, `settings`, `remarks`, `read`; seconds is a function of the same
that says how long a bake of it would take.  Nothing here knows of scenes.
"""

import atexit
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from bakery.errors import RecipeError, UsageError
from bakery.grammar.files import Kept, read_recipe
from bakery.plan import Plan, chosen
from bakery.plan import wanted as stages_wanted
from bakery.plan.asked import Asked
from bakery.plan.suffice import lacking
from bakery.run import draft, execute, prepare, standing
from bakery.run.cache import Cache
from bakery.run.entries import asset_key, is_entry
from bakery.run.progress import Progress
from bakery.stages import sections_for
from bakery.store import scratch
from bakery.store.missed import missed
from bakery.store.tree import Group

_UNTIL_THE_END = ExitStack()  # folders of assets that are kept nowhere
atexit.register(_UNTIL_THE_END.close)


def asked(recipe: str | os.PathLike, settings: Mapping[str, str], require: Callable, cache: Cache | None = None,
          progress: Progress | None = None, by: str = "the scene") -> Asked:
    """What to bake of a recipe so that it serves those that `require` it, which messages call `by`; what the settings say wins.

    Raises RecipeError, UsageError, StageError, StoreError : see `bakery.errors`
    """
    cache, recipe = cache or Cache(), Kept.of(recipe, read_recipe(recipe))
    read = partial(_read_once, {}, recipe, by)
    values = read(settings)
    by_default = [stage.name for stage in chosen(values)]

    def overrides(required):
        added = [name for name in required.stages if name not in by_default]
        sections = {sections_for(name)[0][0]: "{}" for name in added}
        # knobs of stages upstream stand in sections of their own, or at the top
        knobs = {key: text for key, text in required.settings.items() if not _is_said(key, settings)}
        return added, sections | knobs | dict(settings), sections | dict(settings)

    def seconds(required):
        added, every, _ = overrides(required)
        return sum(stage.cost(read(every, added)).seconds for stage in chosen(read(every, added), required.stages))

    required = require(values, lambda: draft.medium(values, settings, cache, progress), seconds)
    added, every, whole = overrides(required)
    kept = {stage.name for stage in chosen(read(every, added), required.stages)} if required.stages else set(by_default)
    parts = {need.stage.name: need.parts for need in stages_wanted(read(whole))}
    return Asked(every, tuple(required.stages), read(every), tuple(added), tuple(name for name in by_default if name not in kept),
                 parts, tuple(_as_set(need, settings) for need in required.needs), required.remarks, tuple(required.read))


def _read_once(done: dict, recipe, by: str, settings: Mapping[str, str], added: Sequence[str] = ()):
    """The recipe with settings, and with sections of stages that it does not ask for; UsageError where one of them cannot be left
    to defaults.

    done : what was read already, by the settings
    """
    from bakery.recipe import load

    key = frozenset(settings.items())
    if key in done:
        return done[key]
    try:
        return done.setdefault(key, load(recipe, dict(settings)).unswept())
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
    knobs = (knob if not _is_said(knob.key, settings) else knob._replace(text=settings[knob.key], why="set by hand")
             for knob in need.knobs if knob.key in settings or not _is_said(knob.key, settings))
    return need._replace(knobs=tuple(knobs))


def _is_said(key: str, settings: Mapping[str, str]) -> bool:
    """Whether settings say a key themselves, or the whole section that it is in; or, of a stage's tolerance, that of all."""
    return any(key == prefix or key.startswith((f"{prefix}.", f"{prefix}[")) for prefix in settings) \
        or key.endswith(".tolerance") and "tolerance" in settings


class Planned(NamedTuple):
    """What `ensured` will do."""

    asset: Path  # path of the one that is good enough, or where it will be baked
    plan: Plan | None  # of its bake; None where it is there
    asked: Asked  # what is asked of it
    lines: tuple[str, ...]  # what is to be said of it
    kept: Path  # where the cache has, or would have, the asset with just what is asked


def planned(recipe: str | os.PathLike, *, require: Callable, cache: Cache, progress: Progress, candidates: Sequence[Path] = (),
            output: Path | None = None, by: str = "the scene") -> Planned:
    """What `ensured` will do; arguments and errors as of that."""
    wanted = asked(recipe, {}, require, cache, progress, by)
    values = wanted.recipe
    steps = stages_wanted(values, wanted.stages)
    key = asset_key(values.name, values.text, {step.stage.name: step.input_hash for step in steps})
    kept = cache.asset_path(values.name, key)
    with progress.during(f"looking for an asset of {os.path.basename(recipe)}"):
        ready = _good_enough([*candidates, *([output] if output else [])], wanted, steps, values)
        if ready is None and (root := cache.asset(kept)) is not None:
            ready = kept, root
    if ready:
        misses = (f"{ready[0]}: {name}: {line}" for name, line in missed(ready[1]).items())
        return Planned(ready[0], None, wanted, (*wanted.remarks, *misses), kept)
    if output is None or os.path.lexists(output):
        output = _to_be_written(kept, progress)
    plan = bake_of(wanted, output, output.name == kept.name, cache, progress)
    return Planned(output, plan, wanted, tuple(told(recipe, wanted)), kept)


def bake_of(wanted: Asked, output: Path, in_cache: bool, cache: Cache, progress: Progress) -> Plan:
    """The plan of a bake with just what is asked.

    in_cache : the name of the output is a hash of all that decides the asset: what stands there is the same asset, damaged
    """
    return prepare(wanted.recipe, output, asked=replace(wanted, recipe_parts=None), cache=cache, progress=progress,
                   overwrite=in_cache)


def ensured(recipe: str | os.PathLike, *, require: Callable, candidates: Sequence[Path] = (), output: Path | None = None,
            progress: Progress | None = None, by: str = "the scene") -> Path:
    """The asset of a recipe with what is asked of it.

    require : what is asked of it, see the head of this module
    candidates : paths of assets that are used as they stand where they are good enough; they need not be there
    output : where the asset goes if nothing is there; into the cache if None
    progress : what is baked, remarks and missed targets are told to it
    by : what messages call those that ask

    Returns path : of an asset that is there
    Raises RecipeError, UsageError, StageError, StoreError : see `bakery.errors`
    """
    progress = progress or Progress()
    cache = Cache(say=progress.say)
    due = planned(recipe, require=require, cache=cache, progress=progress, candidates=candidates, output=output, by=by)
    for line in due.lines:
        progress.say(line)
    if due.plan is None:
        return due.asset
    baked = execute(due.plan, cache=cache, progress=progress)
    for miss in baked.missed:
        progress.say(f"{baked.output}: {miss}")
    return baked.output


def _good_enough(paths: Sequence[Path], wanted: Asked, steps: Sequence, recipe) -> tuple[Path, Group] | None:
    """The first asset that is as good as what is wanted, or better."""
    knobs = [knob for need in wanted.needs if need.needed for knob in need.knobs]
    for path in paths:
        root = standing.asset_at(path)
        if root is not None and not lacking(standing.held(root), steps, wanted.recipe_parts, knobs, recipe):
            return path, root
    return None


def _to_be_written(kept: Path, progress: Progress) -> Path:
    """A place in the cache; one that lasts as long as this process where the cache cannot be written."""
    try:
        kept.parent.mkdir(parents=True, exist_ok=True)
        writable = os.access(kept.parent, os.W_OK | os.X_OK)
    except OSError:
        writable = False
    if writable and (is_entry(kept) or not os.path.lexists(kept)):
        return kept
    progress.say(f"cache: {kept} cannot be written; the asset of the scene is baked for this run alone")
    return _UNTIL_THE_END.enter_context(scratch.folder("scene")) / kept.name


def told(recipe: str | os.PathLike, wanted: Asked, by: str = "the scene") -> Sequence[str]:
    """A line for each stage that is baked though the recipe does not ask for it, or not baked though it does, or that cannot
    give what is asked of it: before minutes of work, not in the report after them."""
    why = {need.stage: need.why for need in wanted.needs}
    lines = [f"{recipe}: {name}, because {by} needs it: {why[name]}" for name in wanted.added]
    lines += [f"{recipe}: no {name}, {why.get(name, 'because nothing reads it')}" for name in wanted.left]
    lines += [f"{recipe}: {need.stage}: out of reach: {need.lacking}" for need in wanted.needs if need.needed and need.lacking]
    return [*lines, *wanted.remarks]
