"""Bakes of swept recipes: a member for each point, by the machinery of any bake, and one file for the family.

Members stand in a folder beside the family's file, of its name without the ending.  Places that are only compared with what the
points give there leave nothing but entries in the cache.
"""

import os
import time
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from pathlib import Path

import numpy as np

import bakery
from bakery.errors import AssetError, RecipeError, StageError, StoreError, UsageError
from bakery.family.axes import in_words, points
from bakery.family.members import listed
from bakery.family.refine import Refined, given, refined
from bakery.family.tree import (
    INTEGRATED,
    MEASURE,
    POINTWISE,
    Member,
    Optics,
    departures,
    is_family,
    optics_of,
    physics,
    tree_of,
)
from bakery.run import Baked, execute, files_of, origin, touch
from bakery.run.cache import Cache
from bakery.run.dask import cluster
from bakery.run.family_plan import FamilyPlan, misses, plan_of
from bakery.run.messages import ClusterLost
from bakery.run.progress import Progress
from bakery.stages.conform import FAMILY
from bakery.store import scratch
from bakery.store.hashes import HASH, seal
from bakery.store.image import packed
from bakery.store.read import read
from bakery.store.tree import Dataset, Group, text
from bakery.store.write import check_target, place, unchanged
from bakery.system import resources
from bakery.system.memory import give_back

_READ_AGAIN = object()  # stands for a medium that lies in the file of its member
SAID = 8  # failed points, and others, that are named one by one


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
            raise UsageError(f"{plan.folder}: the folder of the members cannot be made: {error.strerror}; "
                             "write the family into another folder (-o)") from None
        progress.stage(FAMILY, f"{plan.points} points", *((sweep.tolerance, 0.0) if sweep.refine else (0.0, plan.seconds)))
        folder = stack.enter_context(scratch.folder("family"))
        baking = _Baking(plan, folder, {"cache": cache, "jobs": jobs, "executor": executor}, progress)
        if sweep.refine:
            result = refined(sweep.axes, baking.medium, sweep.tolerance, plan.recipe.measure == "integrated", baking.told)
        else:
            result = given(sweep.axes, baking.medium)
        members = {point: baking.member(point) for point in points(result.values)}
    baking.release()
    method, reached = result.method, result.error
    tree = [_root(plan, result, members, baking)]
    del result
    lines = misses(tree[0])
    written = _write(plan.output, tree, progress)
    now = _files(plan, members.values())
    _remove({file: digest for file, digest in baking.own.items() if file not in now}, progress)
    count = sum(not member.reason for member in members.values())
    progress.done(FAMILY, f"{count} of {len(members)} points, {method} between them"
                  + (f", error {reached:.2g} of {sweep.tolerance:.2g}" if reached is not None and sweep.refine else "")
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
        """The medium at a place; None where it cannot be baked.

        Where nothing is refined each is asked for twice, and read again: 50 of 500 wavelengths are 36 MB.
        """
        if self._media.get(point) is _READ_AGAIN:
            give_back()  # beside the tables, which are being filled: some 30 MB that bakes and files left
            return optics_of(read(self._plan.path_of(point))["medium"])
        if point not in self._media:
            path = self._plan.path_of(point)
            # a middle may be no member in the end: it takes the place of a member, never that of a file of someone else
            self._bake(point, path if point in self._given or path in self.own else self._scratch, self._plan.options["force"])
            done = len(self._media)
            # how many places a refinement takes is not known before its end
            share = 0.0 if self._plan.recipe.sweep.refine else done / self._plan.points
            self._progress.update(share, self._error, f"{done} places")
        optics = self._media[point]
        if optics is not None and not self._plan.recipe.sweep.refine:
            self._media[point] = _READ_AGAIN
        return optics

    def release(self) -> None:
        """Forget the media: all are in the tables."""
        self._media.clear()

    def told(self, error: float | None) -> None:
        """The error of the interpolation so far."""
        self._error = error

    def member(self, point) -> Member:
        """The asset of a point in the family's folder."""
        if point not in self._members:  # it was baked as a middle; what took time is in the cache
            self._bake(point, self._plan.path_of(point), False)
        return self._members[point]

    def _bake(self, point, path: Path, force: bool) -> None:
        name = self._plan.path_of(point).relative_to(self._plan.output.parent).as_posix()
        try:
            baked = execute(plan_of(self._plan, point, path, self._options["cache"], force),
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


def _write(path: Path, tree: list[Group], progress: Progress) -> bool:
    """Whether the file was written: one that holds the same is touched.

    tree : the root, which is taken out: its tables would take memory beside those that are read back from the disk
    """
    check_target(path)
    root = tree.pop()
    try:
        same = read(path).attributes.get(HASH) == root.attributes[HASH]
    except AssetError:
        same = False
    if same:
        touch(path)
        return False
    with progress.during(f"writing {path.name}"):
        give_back()  # what the bakes of the points left
        try:
            with packed(root, os.path.dirname(os.path.realpath(path))) as file:
                del root
                place(path, file, check=lambda root: departures(root) or physics(root))
        except OSError as error:
            raise StoreError(f"{path}: not written: {error.strerror or error}{unchanged(path)}") from error
    return True


def _listed(plan: FamilyPlan) -> dict[Path, str]:
    """Files in the folder of the members that the family at the output says are its own, with the content hash that it gives of
    each; none where no family is readable."""
    try:
        root = read(plan.output)
        return _files(plan, [member for _, _, member in listed(root)] if is_family(root) else [])
    except (AssetError, StoreError, LookupError, ValueError):
        return {}


def _files(plan: FamilyPlan, members: Iterable[Member]) -> dict[Path, str]:
    """Those in the folder of the members, with their content hash."""
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
