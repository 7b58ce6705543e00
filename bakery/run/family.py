"""Bakes of swept recipes: a member for each point, by the machinery of any bake, and one file for the family.

Members stand in a folder beside the family's file, of its name without the ending.  Places that are only compared with what the
points give there leave nothing but entries in the cache.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import bakery
from bakery.errors import AssetError, RecipeError, StageError, StoreError, UsageError
from bakery.family.axes import file_name, in_words, points, settings
from bakery.family.members import fault_of, listed
from bakery.family.refine import Refined, given, refined
from bakery.family.tree import (
    INTEGRATED,
    MEASURE,
    POINTWISE,
    VERSION,
    Member,
    Optics,
    departures,
    is_family,
    optics_of,
    physics,
    tree_of,
)
from bakery.plan import Plan
from bakery.run import Baked, execute, files_of, origin, prepare, target_of, touch
from bakery.run.cache import Cache
from bakery.run.dask import cluster
from bakery.run.messages import ClusterLost
from bakery.run.progress import Progress
from bakery.run.standing import asset_at, check_recipe
from bakery.stages.conform import FAMILY
from bakery.store import scratch
from bakery.store.files import free_space
from bakery.store.hashes import HASH, seal
from bakery.store.missed import missed
from bakery.store.read import read
from bakery.store.tree import Dataset, Group, read_text, text
from bakery.store.write import write
from bakery.system import resources

SAMPLES = 8  # points that are planned for an estimate of all
EACH = 0.06  # seconds that a place takes besides its stages: recipe, plan, cache, file
SAID = 8  # failed points, and others, that are named one by one


@dataclass(frozen=True)
class FamilyPlan:
    """The bake of a family.

    Attributes
    ----------
    recipe : of the first point, with what is swept
    output : where the family's file goes; members go into the folder of its name
    samples : plans of some of the points, the first one first
    write : whether there is anything to do
    missed : a line for each target that the family which stands there misses, where there is not
    input_hash : of everything that decides it
    """

    recipe: object
    output: Path
    samples: tuple[Plan, ...]
    write: bool
    missed: tuple[str, ...]
    input_hash: str
    options: Mapping = field(repr=False)
    read: tuple[Path, ...] = ()  # no scene decides families

    @property
    def folder(self) -> Path:
        """Of the members."""
        return self.output.with_suffix("")

    @property
    def points(self) -> int:
        """Those of the recipe."""
        return math.prod(len(axis.first.values) for axis in self.recipe.sweep.axes)

    @property
    def middles(self) -> int:
        """Places between them that are baked to measure the interpolation, at least."""
        counts = [len(axis.first.values) for axis in self.recipe.sweep.axes]
        return sum((count - 1) * self.points // count for count in counts) if self.recipe.sweep.refine else 0

    @property
    def seconds(self) -> float:
        """Expected time of the points and middles that are known now, compiling included."""
        per_point = sum(plan.seconds if plan.write else 0.0 for plan in self.samples) / len(self.samples)
        return (EACH + per_point) * (self.points + self.middles)

    @property
    def memory(self) -> float:
        """Expected peak memory of the process in bytes."""
        return max(plan.memory for plan in self.samples) + 2 * self.points * self._table

    @property
    def file(self) -> float:
        """Expected size of the members and the family's file in bytes."""
        return self.points * (sum(plan.file for plan in self.samples) / len(self.samples) + self._table)

    @property
    def _table(self) -> float:
        """Bytes of one point in the family's tables, which take about as much as its own medium."""
        return max(step.cost.file for plan in self.samples for step in plan.steps if step.stage.name == "medium")

    def as_dict(self) -> dict:
        """The same for machines (`--json`)."""
        axes = [{"name": key.name, "key": key.key, "units": key.units, "values": list(key.values)}
                for axis in self.recipe.sweep.axes for key in axis.keys]
        return {"recipe": str(self.recipe.path), "output": str(self.output), "write": self.write, "points": self.points,
                "middles": self.middles, "axes": axes, "tolerance": self.recipe.sweep.tolerance,
                "refine": self.recipe.sweep.refine, "seconds": self.seconds, "memory": self.memory, "file": self.file,
                "missed": list(self.missed),
                "warnings": [warning.as_dict() for warning in self.recipe.warnings]}


def prepare_family(
    recipe_path, output=None, *, stages: Sequence[str] = (), settings: Mapping[str, str] | None = None, force: bool = False,
    cache: Cache | None = None, jobs: int | None = None, overwrite: bool = False, progress: Progress | None = None,
    keep_going: bool = False,
) -> FamilyPlan:
    """Read and check a swept recipe and plan its bake; arguments as of `bakery.run.prepare`.

    keep_going : points that are wrong are named in their turn, and the others are baked

    Raises
    ------
    RecipeError : with every problem of the recipe
    UsageError : an output cannot be written, or the family is larger than this machine
    """
    from bakery.recipe import load
    from bakery.store.outputs import ASSET, check_outputs

    cache, progress = cache or Cache(), progress or Progress()
    recipe = load(recipe_path, dict(settings or {}), keep_going=keep_going)
    target = target_of(output, recipe)
    check_outputs([(target, ASSET)], files_of(recipe), overwrite)
    if not overwrite and (root := asset_at(target)) is not None:
        check_recipe(target, root, recipe)
    if target.suffix == "":
        raise UsageError(f"{target}: the members of a family go into a folder of its name without the ending, and it has none; "
                         f"name it {target}.h5")
    kept = {key: value for key, value in (settings or {}).items() if key.partition(".")[0] != "sweep"}
    options = {"stages": stages, "kept": kept, "force": force, "jobs": jobs, "overwrite": overwrite}
    axes = recipe.sweep.axes
    every = list(points([axis.first.values for axis in axes]))
    chosen = [every[round(i * (len(every) - 1) / (SAMPLES - 1))] for i in range(SAMPLES)] if len(every) > SAMPLES else every
    plan = FamilyPlan(recipe, target, (), True, (), "", options)
    with progress.during(f"planning {Path(recipe_path).name}"):
        first, samples = _samples(plan, chosen, cache, force)
        _refuse_idle(plan, first, samples[0], cache)
    key = [VERSION, {step.stage.name: step.input_hash for step in samples[0].steps}, recipe.sweep.tolerance, recipe.sweep.refine,
           recipe.measure, [[key.key, *map(repr, key.values)] for axis in axes for key in axis.keys], len(axes)]
    plan = FamilyPlan(recipe, target, samples, True, (), hashlib.sha256(json.dumps(key).encode()).hexdigest(), options)
    standing = None if force else _standing(plan)
    if standing is not None:
        return FamilyPlan(recipe, target, samples, False, _misses(standing), plan.input_hash, options)
    _refuse_too_large(plan)
    return plan


def execute_family(plan: FamilyPlan, *, cache: Cache | None = None, jobs: int | None = None, executor: Executor | None = None,
                   address: str | None = None, progress: Progress | None = None) -> Baked:
    """Bake what is not there yet and write the family's file; arguments as of `bakery.run.execute`.

    A point that cannot be baked is left out and named; StageError where all of them fail.  Where the cluster is lost, ClusterLost
    and no family: members that were baked stay, and the same call goes on from there.
    """
    progress, cache = progress or Progress(), cache or Cache()
    for warning in plan.recipe.warnings:
        progress.say(f"warning: {warning}")
    if not plan.write:
        touch(plan.output)
        scratch.sweep()
        return Baked(plan.output, False, (), files_of(plan.recipe), plan.missed, plan.recipe.warnings)
    started = time.monotonic()
    sweep = plan.recipe.sweep
    with ExitStack() as stack:
        if address:  # one call for all points: each would wait for its own answer
            with progress.during(f"calling {address}"):
                executor = stack.enter_context(cluster(address, progress.say))
        try:
            plan.folder.mkdir(exist_ok=True)
        except OSError as error:
            raise UsageError(f"{plan.folder}: the folder of the members cannot be made: {error.strerror}") from None
        progress.stage(FAMILY, f"{plan.points} points", *((sweep.tolerance, 0.0) if sweep.refine else (0.0, plan.seconds)))
        folder = stack.enter_context(scratch.folder("family"))
        baking = _Baking(plan, folder, {"cache": cache, "jobs": jobs, "executor": executor}, progress)
        if sweep.refine:
            result = refined(sweep.axes, baking.medium, sweep.tolerance, plan.recipe.measure == "integrated", baking.told)
        else:
            result = given(sweep.axes, baking.medium)
        members = {point: baking.member(point) for point in points(result.values)}
    root = _root(plan, result, members, baking)
    written = _write(plan.output, root, progress)
    now = _listed(plan)
    _remove({file: digest for file, digest in baking.own.items() if file not in now}, progress)
    lines = _misses(root)
    count = sum(not member.reason for member in members.values())
    progress.done(FAMILY, f"{count} of {len(members)} points, {result.method} between them"
                  + (f", error {result.error:.2g} of {sweep.tolerance:.2g}" if result.error is not None and sweep.refine else "")
                  + f", {resources.duration(time.monotonic() - started)}")
    steps = tuple(baking.steps[point] for point in members if point in baking.steps)
    written |= any(step["source"] == "written" for step in steps)
    return Baked(plan.output, written, steps, files_of(plan.recipe), lines, plan.recipe.warnings)


class _Baking:
    """The media of places, each baked once; those of points as members too.

    `own` is the content hash of each file in the folder of the members that is a member of the family which stood there, also
    where it was baked anew since.
    """

    def __init__(self, plan: FamilyPlan, scratch: Path, options: Mapping, progress: Progress):
        self._plan, self._scratch, self._options, self._progress = plan, scratch / "middle.h5", options, progress
        self._given = set(points([axis.first.values for axis in plan.recipe.sweep.axes]))
        self._media, self._members, self._error = {}, {}, None
        self.own = {file: digest for file, digest in _listed(plan).items() if _hash(file) == digest}
        self.steps: dict[tuple, dict] = {}
        self.missed: dict[tuple, list[str]] = {}

    def medium(self, point) -> Optics | None:
        """The medium at a place; None where it cannot be baked."""
        if point not in self._media:
            path = _member_path(self._plan, point)
            # a middle may be no member in the end: it takes the place of a member, never that of a file of someone else
            self._bake(point, path if point in self._given or path in self.own else self._scratch, self._plan.options["force"])
            done = len(self._media)
            # how many places a refinement takes is not known before its end
            share = 0.0 if self._plan.recipe.sweep.refine else done / self._plan.points
            self._progress.update(share, self._error, f"{done} places")
        return self._media[point]

    def told(self, error: float | None) -> None:
        """The error of the interpolation so far."""
        self._error = error

    def member(self, point) -> Member:
        """The asset of a point in the family's folder."""
        if point not in self._members:  # it was baked as a middle; what took time is in the cache
            self._bake(point, _member_path(self._plan, point), False)
        return self._members[point]

    def _bake(self, point, path: Path, force: bool) -> None:
        name = _member_path(self._plan, point).relative_to(self._plan.output.parent).as_posix()
        try:
            baked = execute(_plan_of(self._plan, point, path, self._options["cache"], force),
                            progress=_Compiling(self._progress), **self._options)
        except ClusterLost:
            raise  # that is no fault of the point
        except (RecipeError, StageError, UsageError) as error:
            reason = str(error).splitlines()[0]
            self._media[point], self._members[point] = None, Member(name, "", 0.0, reason)
            if all(point in self._media and self._media[point] is None for point in self._given):
                raise StageError(f"{self._plan.recipe.path}: no point could be baked: {reason}") from error
            return
        root = read(path)
        self._media[point] = optics_of(root["medium"])
        if path in self.own:
            self.own[path] = str(root.attributes[HASH])
        if path != self._scratch:
            self._members[point] = Member(name, str(root.attributes[HASH]), float(root["medium"].attributes["achieved_error"]))
            words = in_words(self._plan.recipe.sweep.axes, point)
            self.steps[point] = {"stage": words, "source": "written" if baked.written else "unchanged",
                                 "why": ["given by the recipe" if point in self._given else "added between others"]}
            self.missed[point] = [f"{words}: {line}" for line in baked.missed]


class _Compiling(Progress):
    """Passes on that kernels are compiled; of the bakes of single points nothing else is told."""

    def __init__(self, progress: Progress):
        self.compiling = progress.compiling


def _plan_of(plan: FamilyPlan, point, path: Path, cache: Cache, force: bool = False) -> Plan:
    """The plan of one point, as if beside the family where the folder of the members is not there yet."""
    options = plan.options
    path = path if path.parent.is_dir() else plan.output
    return prepare(plan.recipe.path, path, stages=options["stages"], force=force, cache=cache, jobs=options["jobs"],
                   settings=options["kept"] | settings(plan.recipe.sweep.axes, point), overwrite=options["overwrite"])


def _samples(plan: FamilyPlan, chosen: Sequence[tuple], cache: Cache, force: bool) -> tuple[tuple, tuple[Plan, ...]]:
    """The first of some points that can be baked, and the plans of those that can; others are named when their turn comes, unless
    all are."""
    plans, refused = {}, None
    for point in chosen:
        try:
            plans[point] = _plan_of(plan, point, _member_path(plan, point), cache, force)
        except (RecipeError, StageError) as error:
            refused = error
    if not plans:
        raise refused
    return next(iter(plans)), tuple(plans.values())


def _member_path(plan: FamilyPlan, point) -> Path:
    return plan.folder / file_name(plan.recipe.sweep.axes, point)


# ---- the file


def _root(plan: FamilyPlan, result: Refined, members: Mapping[tuple, Member], baking: _Baking) -> Group:
    """The tree of the family's file."""
    recipe, sweep = plan.recipe, plan.recipe.sweep
    first = next(member for member in members.values() if not member.reason)
    medium = read(plan.output.parent / first.file)["medium"].attributes
    attributes = {
        "input_hash": plan.input_hash, "tolerance": sweep.tolerance,
        "error_measure": MEASURE.format(INTEGRATED if recipe.measure == "integrated" else POINTWISE),
        "method": result.method, "refined": sweep.refine, "medium_version": medium["stage_version"],
        "member_tolerance": medium["tolerance"]}
    attributes |= {} if result.error is None else {"achieved_error": result.error}
    family = tree_of(sweep.axes, result.values, result.tables, list(members.values()), result.errors, attributes)
    failed = [f"{in_words(sweep.axes, point)}: {member.reason}" for point, member in members.items() if member.reason]
    missing = [line for point in members for line in baking.missed.get(point, ())]
    lines = [*_first(failed, "point failed: "), *_first(missing, "member: "), *_first(result.limits, "not refined: ")]
    missed_text = {"missed": text("\n".join(lines), "targets that were missed")} if lines else {}
    provenance = Group({FAMILY: Group(missed_text)}, origin(recipe, plan.output))
    return seal(Group({
        "recipe": text(recipe.text, "the recipe's text, with every override applied"),
        "wavelength": Dataset(np.array(recipe.wavelength, dtype=float), "um", "wavelengths in vacuum"),
        FAMILY: family, "provenance": provenance}, {"name": recipe.name, "bakery_version": bakery.__version__}))


def _first(lines: Sequence[str], head: str) -> list[str]:
    """The first of the lines, each after a head, and how many more there are."""
    remark = [f"{head}{len(lines) - SAID} more"] if len(lines) > SAID else []
    return [f"{head}{line}" for line in lines[:SAID]] + remark


def _write(path: Path, root: Group, progress: Progress) -> bool:
    """Whether the file was written: one that holds the same is touched."""
    try:
        same = read(path).attributes.get(HASH) == root.attributes[HASH]
    except AssetError:
        same = False
    if same:
        touch(path)
        return False
    with progress.during(f"writing {path.name}"):
        write(path, root, check=lambda root: departures(root) or physics(root))
    return True


def _listed(plan: FamilyPlan) -> dict[Path, str]:
    """Files in the folder of the members that the family at the output says are its own, with the content hash that it gives of
    each; none where no family is readable."""
    try:
        root = read(plan.output)
        members = [member for _, _, member in listed(root)] if is_family(root) else []
    except (AssetError, StoreError, LookupError, ValueError):
        return {}
    files = {plan.output.parent / member.file: member.content_hash for member in members}
    return {file: digest for file, digest in files.items() if file.parent == plan.folder}


def _hash(file: Path) -> str | None:
    """The content hash of an asset; None where there is none that can be read."""
    try:
        return read(file).attributes.get(HASH)
    except (AssetError, StoreError):
        return None


def _remove(files: Mapping[Path, str], progress: Progress) -> None:
    """Remove members that the family had and has no more: they would look like some of the recipe that stands now."""
    for file, digest in sorted(files.items()):
        try:
            if _hash(file) == digest:  # else it is a file of someone else by that name
                file.unlink()
        except OSError as error:
            progress.say(f"warning: {file}: was a member and is none any more, and could not be removed: {error}")


def _misses(root: Group) -> tuple[str, ...]:
    return tuple(f"{name}: {line}" for name, line in missed(root).items())


def _standing(plan: FamilyPlan) -> Group | None:
    """The family at the output, if it is the one that is wanted, whole, and with all its members."""
    try:
        root = read(plan.output)
        if not is_family(root) or departures(root) or root[FAMILY].attributes.get("input_hash") != plan.input_hash \
                or root.attributes.get("name") != plan.recipe.name or read_text(root["recipe"]) != plan.recipe.text:
            return None
        for _, _, member in listed(root):
            if member.reason or fault_of(plan.output, member):
                return None  # what failed is tried again
        if any("measured" in axis.members and not axis["measured"].data.all() for axis in root[FAMILY]["axes"].members.values()):
            return None  # so is a place between points
    except (AssetError, StoreError, OSError):
        return None
    return root


# ---- what is refused


def _refuse_idle(plan: FamilyPlan, point: tuple, first: Plan, cache: Cache) -> None:
    """UsageError for what has no medium to interpolate, and for a key that changes nothing of it."""
    hashes = {step.stage.name: step.input_hash for step in first.steps}
    axes = plan.recipe.sweep.axes
    where = plan.recipe.sweep.where[axes[0].first.key]
    if "medium" not in hashes:
        raise UsageError(f"{where}: found a sweep without a medium; expected one of a medium, which --stage does not leave out")
    if any(output.path == "phase_error" for step in first.steps if step.stage.name == "medium" for output in step.stage.outputs):
        raise UsageError(f"{where}: found a sweep of packed grains, whose media have statistical errors and are not "
                         "interpolated; expected particles, or a medium given by coefficients")
    for i, axis in enumerate(axes):
        neighbour = _beside(plan, point, i, cache)
        if neighbour and any(step.stage.name == "medium" and step.input_hash == hashes["medium"] for step in neighbour.steps):
            raise UsageError(f"{plan.recipe.sweep.where[axis.first.key]}: found a key that changes nothing of the medium; "
                             "expected one that does")


def _beside(plan: FamilyPlan, point: tuple, axis: int, cache: Cache) -> Plan | None:
    """The plan of a point that differs on one axis alone; None where none of them can be baked."""
    for value in plan.recipe.sweep.axes[axis].first.values:
        moved = (*point[:axis], value, *point[axis + 1:])
        try:
            if moved != point:
                return _plan_of(plan, moved, _member_path(plan, moved), cache)
        except (RecipeError, StageError):
            continue  # it is named when its turn comes
    return None


def _refuse_too_large(plan: FamilyPlan) -> None:
    space = free_space(plan.output)
    if 1.2 * plan.file > space:
        raise UsageError(f"{plan.output}: {plan.points:,} points take about {resources.in_words(plan.file)}, but only "
                         f"{resources.in_words(space)} are free there; fewer points would do")
