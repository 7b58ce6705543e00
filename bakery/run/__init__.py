"""Executes plans: stages, cache, locks, progress, and the one asset at the end."""

import json
import os
import shlex
import sys
import time
from collections.abc import Mapping
from concurrent.futures import Executor
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import bakery
from bakery.errors import BakeryError, Problem, StageError, StoreError, UsageError
from bakery.grammar import qualities
from bakery.grammar.files import Written
from bakery.plan import REUSE, RUN, Plan, Step, make
from bakery.plan.asked import EVERYTHING, Asked
from bakery.run import ahead, compiling, standing
from bakery.run.cache import Cache
from bakery.run.dask import cluster
from bakery.run.executors import Context, threads
from bakery.run.progress import Progress
from bakery.stages.conform import broken, violations
from bakery.stages.declaration import Cost, Stage, remembering
from bakery.store.outputs import named
from bakery.store.tree import Dataset, Group
from bakery.system import blas, resources
from bakery.system.memory import free_memory

LARGEST_FILE = 16 << 30
SHARE_OF_MEMORY = 0.8
LIBRARIES = 6e7  # bytes of what the bake loads after it was planned
COMPILER = 1e8  # bytes that compiling takes


@dataclass(frozen=True)
class Baked:
    """What a bake did: where the asset is, whether it was written (or a member, of a family), each step with its seconds and peak
    memory, a line for each stage that misses its tolerance or another target, what the recipe says that is probably not meant,
    and `needs` and `remarks` of its plan."""

    output: Path
    written: bool
    steps: tuple[dict, ...]
    files: tuple[Path, ...]
    missed: tuple[str, ...] = ()
    warnings: tuple[Problem, ...] = ()
    needs: tuple[dict, ...] = ()
    remarks: tuple[str, ...] = ()

    def as_dict(self) -> dict:
        """The same for machines (`--json`)."""
        return {"output": str(self.output), "written": self.written, "steps": list(self.steps), "missed": list(self.missed),
                "needs": list(self.needs), "remarks": list(self.remarks),
                "warnings": [warning.as_dict() for warning in self.warnings]}


def overrides(
    quality: str | None = None, tolerance: str | float | None = None, seed: int | None = None,
    settings: Mapping[str, str] | None = None,
) -> dict[str, str]:
    """The recipe values that options stand for; what is said more exactly wins."""
    values = {}
    if quality is not None:
        values |= qualities.quality(quality).recipe
    if tolerance is not None:
        values["tolerance"] = str(tolerance)
    if seed is not None:
        values["seed"] = str(seed)
    return values | dict(settings or {})


def target_of(output: str | os.PathLike | None, recipe) -> Path:
    """The asset's path: by the recipe's file FILE.h5, or NAME.h5 of a recipe that is no file, in the current folder by default; a
    closing slash marks a folder."""
    return named(output, Path(f"{recipe.name if isinstance(recipe.path, Written) else recipe.path.stem}.h5"))


def files_of(recipe) -> tuple[Path, ...]:
    """Every file that a recipe was read from, itself first."""
    return (recipe.path, *(file.path for file in recipe.files))


def prepare(recipe, output: str | os.PathLike | None = None, *, asked: Asked = EVERYTHING, force: bool = False,
            cache: Cache | None = None, jobs: int | None = None, overwrite: bool = False,
            progress: Progress | None = None) -> Plan:
    """Plan the bake of a checked recipe; runs nothing and writes nothing.

    recipe : a `bakery.recipe.Recipe`, read with the settings that are asked for
    asked : the stages and, where scenes decide what is baked, why; an asset at the output that is as good is then left alone, and
        one that would lose something is not replaced (but for `overwrite`)

    Raises UsageError : the recipe sweeps keys, the output cannot be written, is an input or (but for `overwrite`) no asset of
        this recipe, or the bake is larger than this machine
    """
    cache, progress = cache or Cache(), progress or Progress()
    with progress.during(f"planning {recipe.path.name}"):
        target, present = _destination(recipe.unswept(), output, overwrite, asked.read)
        held = standing.held(present) if present else None
        plan = _priced(recipe, target, asked.stages, present, held, force=force, cache=cache, jobs=jobs, progress=progress)
        plan = replace(plan, needs=asked.needs, remarks=asked.remarks, read=asked.read)
        if asked.recipe_parts is not None and plan.write and held:
            plan = _no_worse(plan, held, asked.recipe_parts, force, overwrite)
    _refuse_too_large(plan)
    return plan if plan.write else replace(plan, missed=_missed(present))


def _destination(recipe, output, overwrite: bool, read):
    """Where the asset of a recipe goes, and the asset that stands there, if any; the same errors as `prepare`."""
    from bakery.store.outputs import ASSET, check_outputs

    target = target_of(output, recipe)
    check_outputs([(target, ASSET)], (*files_of(recipe), *read), overwrite)
    present = standing.asset_at(target)
    if present is not None and not overwrite:
        standing.check_recipe(target, present, recipe)
    return target, present


def _no_worse(plan: Plan, held, recipe_parts: Mapping[str, Mapping], force: bool, overwrite: bool) -> Plan:
    """The plan, or one that writes nothing where what is there is as good; UsageError where it is better in something."""
    from bakery.plan.suffice import lacking, lost

    knobs = [knob for need in plan.needs if need.needed for knob in need.knobs]
    if not force and not lacking(held, plan.steps, recipe_parts, knobs, plan.recipe):
        steps = (replace(step, action=REUSE, why=(f"as good in {plan.output}, or better",)) for step in plan.steps)
        return replace(plan, steps=tuple(steps), write=False)
    if not overwrite and (worse := lost(held, plan.steps, recipe_parts, knobs)):
        raise UsageError(f"{plan.output}: holds more than the scene needs ({', '.join(worse)}), so it is not replaced; name "
                         "another output, or give --overwrite")
    return plan


def _priced(recipe, target: Path, stages, present: Group | None, held, *, force: bool, cache: Cache, jobs: int | None,
            progress: Progress) -> Plan:
    """The plan with what each stage takes on this machine."""
    workers = resources.jobs(jobs)

    def price(stage: Stage, key: str, cost: Cost) -> Cost:
        work = _work(cost, workers)
        ratio, count = cache.speed(_kind(stage, cost), key, work)
        coming = compiling.expected(cost.kernels)
        basis = f"{cost.basis}; {work:.2g} s on {cost.cores(workers):.2g} cores"
        basis += f"; by {count} earlier bakes here {ratio:.2g} times that" if count else ""
        basis += f"; {coming:.2g} s for compiling kernels, once" if coming else ""
        return replace(cost, seconds=work * ratio, startup=cost.startup * ratio, compiling=coming,
                       memory=cost.memory + COMPILER * (coming > 0), basis=basis)

    # a choice between rays and series takes sample spheres, and kernels
    measured = () if recipe.particles is None else ahead.SERIES
    memory = ahead.Measuring(cache) if workers > 1 else cache
    with remembering(memory), compiling.watched(measured, progress.compiling):
        return make(recipe, target, only=stages, force=force, held=held, price=price, in_cache=cache.has,
                    same_recipe=present is not None and standing.is_of(present, recipe),
                    loaded=resources.resident_memory() + LIBRARIES)


def _work(cost: Cost, workers: int) -> float:
    """Seconds that a cost model expects on so many cores of the machine that it was measured on."""
    return cost.startup + cost.seconds / cost.cores(workers)


def _kind(stage: Stage, cost: Cost) -> str:
    return f"{stage.name} {cost.kind}".strip()


def execute(plan: Plan, *, cache: Cache | None = None, jobs: int | None = None, executor: Executor | None = None,
            address: str | None = None, progress: Progress | None = None) -> Baked:
    """Run a plan and write its asset.

    jobs : threads, unless `executor` (any `concurrent.futures` executor) or `address` (a Dask scheduler) is given
    """
    from bakery.store import scratch
    from bakery.store.write import sweep, write

    progress = progress or Progress()
    cache = cache or Cache(say=progress.say)
    for warning in plan.recipe.warnings:
        progress.say(f"warning: {warning}")
    # what killed bakes left goes even where this one has nothing to write
    cache.sweep()
    scratch.sweep()
    sweep(os.path.dirname(os.path.realpath(plan.output)))
    workers = resources.jobs(jobs)
    files = (*files_of(plan.recipe), *plan.read)
    asked = {"needs": tuple(plan.needs_as_dicts()), "remarks": plan.remarks}
    with progress.during(f"reading {plan.output.name}"):
        present = standing.asset_at(plan.output)
    if not plan.write:
        touch(plan.output)
        existing = present or Group()  # gone since the plan was made: nothing is known of it
        steps = tuple(_report(step, "unchanged", 0.0, existing.members.get(step.stage.name)) for step in plan.steps)
        return Baked(plan.output, False, steps, files, _missed(existing), plan.recipe.warnings, **asked)
    if any(step.action == RUN for step in plan.steps):
        pool = nullcontext(executor) if executor else cluster(address, progress.say) if address else threads(workers)
    else:
        pool = nullcontext(None)
    groups, provenances, steps = {}, {}, []
    if workers > 1 and not (executor or address):  # workers of other processes compile for themselves
        ahead.expect([kernel for step in plan.steps if step.action == RUN
                      for kernel in ahead.of(f"stage {step.stage.name}", step.cost.kernels)])
    with ExitStack() as stack:
        stack.enter_context(blas.one_thread())
        with progress.during(f"calling {address}" if address else "starting workers"):
            running = stack.enter_context(pool)
        stack.enter_context(remembering(cache))
        for step in plan.steps:
            group, provenance, report = _finish(step, plan, groups, present, cache, running, workers, progress,
                                                in_process=not (executor or address))
            groups[step.stage.name], provenances[step.stage.name] = group, provenance
            steps.append(report)
    root = _assemble(plan, groups, provenances)
    with progress.during(f"writing {plan.output.name}"):
        write(plan.output, root, check=violations)
    return Baked(plan.output, True, tuple(steps), files, _missed(root), plan.recipe.warnings, **asked)


def _finish(step: Step, plan: Plan, groups, present, cache: Cache, pool, workers, progress: Progress, in_process: bool):
    """One stage: taken from the asset that stands, from the cache, or computed (`in_process`: by this process)."""
    stage = step.stage
    if step.action == REUSE and (reused := standing.stage_of(present, stage.name, step.input_hash)):
        return *reused, _report(step, "unchanged", 0.0, reused[0])
    with cache.lock(stage.name, step.input_hash):
        # looked at again under the lock: another bake may have finished it since the plan was made
        with progress.during(f"reading {stage.name} from the cache"):
            entry = None if step.force else cache.get(stage.name, step.input_hash)
        if entry:
            progress.done(stage.name, "from the cache")
            return *entry, _report(step, "from the cache", 0.0, entry[0])
        group, provenance, seconds, compiled = _compute(step, plan, groups, pool, workers, progress)
        with progress.during(f"writing {stage.name} to the cache"):
            cache.put(stage.name, step.input_hash, group, provenance)
    # other machines say nothing of this one; nor does a bake that compiled for most of its time: that slows the rest as well
    if in_process and compiled < 0.5 * seconds:
        cost = stage.cost(plan.recipe)
        cache.note_speed(_kind(stage, cost), step.input_hash, _work(cost, workers), seconds - compiled)
    return group, provenance, _report(step, "computed", seconds, group)


def _compute(step: Step, plan: Plan, groups, pool, workers: int, progress: Progress) -> tuple[Group, Group, float]:
    from bakery.store.missed import too_large
    from bakery.store.tree import text

    stage, recipe = step.stage, plan.recipe
    tolerance = stage.tolerance(recipe)
    progress.stage(stage.name, stage.title, tolerance, step.cost.seconds)
    resources.reset_peak()
    started = time.monotonic()
    context = Context(tolerance, recipe.seed, pool, progress.update)
    try:
        with compiling.watched(step.cost.kernels, progress.compiling) as clock:
            result = stage.compute(stage.inputs(recipe, groups), context)
    except BakeryError:
        raise
    except MemoryError as error:
        raise StageError(f"{stage.name}: out of memory; the plan expected {resources.in_words(step.cost.memory)}: close other "
                         "programs, take fewer --jobs or a larger tolerance") from error
    seconds = time.monotonic() - started
    peak = resources.peak_memory()
    group = Group(result.members, {
        "stage": stage.name, "stage_version": stage.version, "input_hash": step.input_hash, "tolerance": tolerance,
        "achieved_error": result.achieved_error, "error_measure": stage.error_measure})
    if faults := broken(stage, group):
        # a bug of ours, reported as such: nothing that breaks physics is stored
        raise StageError(f"{stage.name}: its values break the stage's own rules, so nothing is stored: " + "; ".join(faults))
    for note in result.notes:
        progress.say(f"{stage.name}: {note}")
    once = f" ({resources.duration(clock.seconds)} of it compiling kernels, once)" if clock.seconds > 0.1 * seconds else ""
    mark = " MISSED" if too_large(group.attributes) else ""
    progress.done(stage.name, f"{resources.duration(seconds)}{once}, error {result.achieved_error:.2g} of {tolerance:.2g}{mark}, "
                              f"{resources.in_words(peak)} memory")

    provenance = Group(
        {"inputs": text(json.dumps(step.parts, sort_keys=True), "every recipe value and file that the stage depends on (JSON)")}
        | ({"notes": text("\n".join(result.notes), "remarks of the stage")} if result.notes else {})
        | ({"missed": text("\n".join(result.missed), "targets that were missed")} if result.missed else {}),
        {"seconds": seconds, "peak_memory": peak, "workers": workers, "bakery_version": bakery.__version__,
         "finished": _now()})
    return group, provenance, seconds, clock.seconds


def _missed(root: Group) -> tuple[str, ...]:
    """The stages that miss their tolerance or a target, whether computed just now or earlier."""
    from bakery.store.missed import missed

    return tuple(f"{name}: {line}" for name, line in missed(root).items())


def _assemble(plan: Plan, groups: Mapping[str, Group], provenances: Mapping[str, Group]) -> Group:
    """The asset's tree, in the order of the plan."""
    import numpy as np

    from bakery.store.tree import text

    recipe = plan.recipe
    members = {
        "recipe": text(recipe.text, "the recipe's text, with every override applied"),
        "wavelength": Dataset(np.array(recipe.wavelength, dtype=float), "um", "wavelengths in vacuum"),
    }
    members |= groups
    members["provenance"] = Group(dict(provenances), origin(recipe, plan.output))
    return Group(members, {"name": recipe.name, "bakery_version": bakery.__version__})


def _readable(text: str) -> str:
    """File names may hold bytes that are no text; an asset's attributes may not."""
    return os.fsencode(text).decode(errors="replace")[:4096]


def origin(recipe, output: Path) -> dict[str, str]:
    """When, from what and with which versions a file was made."""
    return {"created": _now(), "command": _readable(shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])),
            "recipe_path": _readable(str(recipe.path)), standing.FROM: _readable(standing.seen_from(output, recipe.path)),
            **_versions()}


def _versions() -> dict[str, str]:
    from importlib.metadata import version
    from platform import machine, python_version

    versions = {f"{name}_version": version(name) for name in ("h5py", "numba", "numpy", "scipy")}
    return versions | {"python_version": python_version(), "machine": machine()}


def _now() -> str:
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def _report(step: Step, source: str, seconds: float, group: Group | None) -> dict:
    attributes = group.attributes if group else {}
    return {"stage": step.stage.name, "source": source, "seconds": seconds, "why": list(step.why),
            "input_hash": step.input_hash, "achieved_error": attributes.get("achieved_error"),
            "tolerance": attributes.get("tolerance")}


def touch(path: Path) -> None:
    """Set a file's time to now; StoreError if that is refused."""
    # Make compares times: an up-to-date asset must be newer than what it was made from
    try:
        os.utime(path)
    except OSError as error:
        raise StoreError(f"{path}: is up to date but its time could not be set ({error.strerror})") from error


def _refuse_too_large(plan: Plan) -> None:
    from bakery.store.files import free_space

    free = free_memory()
    needed = plan.memory - plan.loaded
    if free is not None and needed > SHARE_OF_MEMORY * free:
        raise UsageError(f"{plan.recipe.path}: the bake needs about {resources.in_words(needed)} of memory, of which "
                         f"{resources.in_words(free)} are free; a larger tolerance or a narrower size range needs less")
    if plan.file > LARGEST_FILE:
        raise UsageError(f"{plan.recipe.path}: the asset would take about {resources.in_words(plan.file)}; "
                         f"up to {resources.in_words(LARGEST_FILE)} are written; a larger tolerance needs less")
    space = free_space(plan.output)
    if plan.write and 1.2 * plan.file > space:
        raise UsageError(f"{plan.output}: the asset takes about {resources.in_words(plan.file)}, but only "
                         f"{resources.in_words(space)} are free there")
