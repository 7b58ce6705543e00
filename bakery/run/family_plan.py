"""Plans of swept recipes: what a family takes, by the plans of some of its points, and whether it stands already."""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from bakery.errors import AssetError, RecipeError, StageError, StoreError, UsageError
from bakery.family.axes import file_name, points, settings
from bakery.family.members import fault_of, listed
from bakery.family.tree import VERSION, departures, is_family
from bakery.plan import RUN, Plan
from bakery.plan.asked import EVERYTHING, Asked
from bakery.run import files_of, prepare, target_of
from bakery.run.cache import Cache
from bakery.run.progress import Progress
from bakery.run.standing import asset_at, check_recipe
from bakery.stages.conform import FAMILY
from bakery.store.files import free_space
from bakery.store.missed import missed
from bakery.store.read import read
from bakery.store.tree import Group, read_text
from bakery.system import resources

SAMPLES = 8  # points that are planned for an estimate of all
EACH = 0.12  # seconds that a place takes besides its stages: recipe, plan, cache, file


class Expected(NamedTuple):
    """What a pilot says of a refinement that is to come."""

    points: int  # that become members
    places: int  # that are baked: points, and places between them
    complete: bool  # whether the pilot came to its end; else there will be more


@dataclass(frozen=True)
class FamilyPlan:
    """The bake of a family."""

    recipe: object  # of the first point, with what is swept
    output: Path  # where the family's file goes; members go into the folder of its name
    samples: tuple[Plan, ...]  # plans of some of the points, the first one first
    write: bool  # whether there is anything to do
    missed: tuple[str, ...]  # a line for each target that the family which stands there misses, where there is not
    input_hash: str  # of everything that decides it
    options: Mapping = field(repr=False)
    read: tuple[Path, ...] = ()  # no scene decides families
    expected: Expected | None = None  # by `bakery.run.family_pilot`, where it was asked

    @property
    def folder(self) -> Path:
        """Of the members."""
        return self.output.with_suffix("")

    def path_of(self, point) -> Path:
        """Of the member at a point."""
        return self.folder / file_name(self.recipe.sweep.axes, point)

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
        """Expected time of the places that are known of, compiling included."""
        due = [[step.cost for step in plan.steps if plan.write and step.action == RUN] for plan in self.samples]
        per_place = EACH + sum(cost.seconds - cost.startup for costs in due for cost in costs) / len(due)
        once = max(sum(cost.startup + cost.compiling for cost in costs) for costs in due)
        return once + per_place * (self.expected.places if self.expected else self.points + self.middles)

    @property
    def memory(self) -> float:
        """Expected peak memory of the process in bytes."""
        return max(plan.memory for plan in self.samples) + 2 * self._members * self._table

    @property
    def file(self) -> float:
        """Expected size of the members and the family's file in bytes."""
        return self._members * (sum(plan.file for plan in self.samples) / len(self.samples) + self._table)

    @property
    def _members(self) -> int:
        return self.expected.points if self.expected else self.points

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
                "refine": self.recipe.sweep.refine, "expected": self.expected and self.expected._asdict(),
                "seconds": self.seconds, "memory": self.memory, "file": self.file, "missed": list(self.missed),
                "warnings": [warning.as_dict() for warning in self.recipe.warnings]}


def prepare_family(recipe, output=None, *, asked: Asked = EVERYTHING, force: bool = False, cache: Cache | None = None,
                   jobs: int | None = None, overwrite: bool = False, progress: Progress | None = None) -> FamilyPlan:
    """Plan the bake of a swept recipe; arguments as of `bakery.run.prepare`.

    Raises
    ------
    RecipeError : with every problem of the points, where all of them are wrong
    UsageError : an output cannot be written, or the family is larger than this machine
    """
    from bakery.store.outputs import ASSET, check_outputs

    cache, progress = cache or Cache(), progress or Progress()
    target = target_of(output, recipe)
    check_outputs([(target, ASSET)], files_of(recipe), overwrite)
    if not overwrite and (root := asset_at(target)) is not None:
        check_recipe(target, root, recipe)
    if target.suffix == "":
        raise UsageError(f"{target}: the members of a family go into a folder of its name without the ending, and it has none; "
                         f"name it {target}.h5")
    kept = {key: value for key, value in asked.settings.items() if key.partition(".")[0] != "sweep"}
    options = {"stages": asked.stages, "kept": kept, "force": force, "jobs": jobs, "overwrite": overwrite}
    axes = recipe.sweep.axes
    every = list(points([axis.first.values for axis in axes]))
    chosen = [every[round(i * (len(every) - 1) / (SAMPLES - 1))] for i in range(SAMPLES)] if len(every) > SAMPLES else every
    plan = FamilyPlan(recipe, target, (), True, (), "", options)
    with progress.during(f"planning {recipe.path.name}"):
        first, samples = _samples(plan, chosen, cache, force)
        _refuse_idle(plan, first, samples[0], cache)
    key = [VERSION, {step.stage.name: step.input_hash for step in samples[0].steps}, recipe.sweep.tolerance, recipe.sweep.refine,
           recipe.measure, [[key.key, *map(repr, key.values)] for axis in axes for key in axis.keys], len(axes)]
    plan = replace(plan, samples=samples, input_hash=hashlib.sha256(json.dumps(key).encode()).hexdigest())
    standing = None if force else _standing(plan)
    if standing is not None:
        return replace(plan, write=False, missed=misses(standing))
    _refuse_too_large(plan)
    return plan


def plan_of(plan: FamilyPlan, point, path: Path, cache: Cache, force: bool = False) -> Plan:
    """The plan of one point, as if beside the family where the folder of the members is not there yet."""
    from bakery.recipe import load

    options = plan.options
    path = path if path.parent.is_dir() else plan.output
    recipe = load(plan.recipe.path, options["kept"] | settings(plan.recipe.sweep.axes, point))
    return prepare(recipe, path, asked=Asked(stages=options["stages"]), force=force, cache=cache, jobs=options["jobs"],
                   overwrite=options["overwrite"])


def _samples(plan: FamilyPlan, chosen: Sequence[tuple], cache: Cache, force: bool) -> tuple[tuple, tuple[Plan, ...]]:
    """The first of some points that can be baked, and the plans of those that can; others are named when their turn comes, unless
    all are."""
    plans, refused = {}, None
    for point in chosen:
        try:
            plans[point] = plan_of(plan, point, plan.path_of(point), cache, force)
        except (RecipeError, StageError) as error:
            refused = error
    if not plans:
        raise refused
    return next(iter(plans)), tuple(plans.values())


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


def misses(root: Group) -> tuple[str, ...]:
    return tuple(f"{name}: {line}" for name, line in missed(root).items())


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
                return plan_of(plan, moved, plan.path_of(moved), cache)
        except (RecipeError, StageError):
            continue  # it is named when its turn comes
    return None


def _refuse_too_large(plan: FamilyPlan) -> None:
    space = free_space(plan.output)
    if 1.2 * plan.file > space:
        raise UsageError(f"{plan.output}: {plan.points:,} points take about {resources.in_words(plan.file)}, but only "
                         f"{resources.in_words(space)} are free there; use fewer points")
