"""From a recipe to the ordered stages that a bake runs: what, why, at what cost.

`bake` executes the very object that `bake plan` prints.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from bakery.errors import UsageError
from bakery.plan.inputs import differences, input_hash, parts
from bakery.plan.suffice import Held
from bakery.stages.declaration import Cost, Stage

RUN, REUSE = "run", "reuse"
FRAME = 12_000  # bytes of an asset besides its stages' arrays: names, attributes, recipe, provenance


@dataclass(frozen=True)
class Step:
    """One stage of a plan.

    `action` is "run" or "reuse"; `why` gives the reasons, in words; `force` says that it runs whatever the cache holds.
    """

    stage: Stage
    input_hash: str
    parts: dict
    action: str
    why: tuple[str, ...]
    cost: Cost
    force: bool

    def as_dict(self) -> dict:
        """The same for machines (`--json`)."""
        return {"stage": self.stage.name, "title": self.stage.title, "version": self.stage.version,
                "input_hash": self.input_hash, "action": self.action, "why": list(self.why),
                "seconds": self.cost.seconds, "compiling": self.cost.compiling, "memory": self.cost.memory,
                "file": self.cost.file, "basis": self.cost.basis, "remarks": list(self.cost.remarks)}


@dataclass(frozen=True)
class Plan:
    """The ordered steps of a bake.

    `write` is false where the asset is up to date as it stands, `missed` then a line for each of its stages that misses its
    tolerance or another target; `loaded` is the memory of the process before any stage, in bytes; `needs` says why scenes need
    its stages or do not (`renderers.scene.requirements.Need`), () where no scene was given; `remarks` what could not be found
    out of them, and what they ask for in vain; `read` the files that they are made of.
    """

    recipe: object
    output: Path
    steps: tuple[Step, ...]
    write: bool
    loaded: float = 0.0
    missed: tuple[str, ...] = ()
    needs: tuple = ()
    remarks: tuple[str, ...] = ()
    read: tuple[Path, ...] = ()

    def kept(self, stage: Stage) -> list[str]:
        """Knobs of a stage that no scene decides: they stay as the recipe has them."""
        decided = {knob.key for need in self.needs for knob in need.knobs}
        return list(dict.fromkeys(knob.key for knob in stage.knobs if knob.key not in decided))

    @property
    def seconds(self) -> float:
        """Expected wall time of what runs, compiling included."""
        return sum(step.cost.seconds + step.cost.compiling for step in self.steps if step.action == RUN)

    @property
    def memory(self) -> float:
        """Expected peak memory of the process in bytes: stages run one after another, on top of what is loaded."""
        return self.loaded + max((step.cost.memory for step in self.steps if step.action == RUN), default=0.0)

    @property
    def file(self) -> float:
        """Expected size of the asset in bytes."""
        return FRAME + sum(step.cost.file for step in self.steps)

    def needs_as_dicts(self) -> list[dict]:
        """The needs for machines, each with the keys that stay `as_recipe`."""
        stages = {step.stage.name: step.stage for step in self.steps}
        return [need.as_dict() | {"as_recipe": self.kept(stages[need.stage]) if need.stage in stages and need.needed else []}
                for need in self.needs]

    def as_dict(self) -> dict:
        """The same for machines (`--json`)."""
        return {"recipe": str(self.recipe.path), "output": str(self.output), "write": self.write, "seconds": self.seconds,
                "memory": self.memory, "file": self.file, "missed": list(self.missed),
                "steps": [step.as_dict() for step in self.steps], "needs": self.needs_as_dicts(), "remarks": list(self.remarks),
                "warnings": [warning.as_dict() for warning in self.recipe.warnings]}


def chosen(recipe, only: Sequence[str] = (), stages: Sequence[Stage] = ()) -> list[Stage]:
    """The stages that a recipe asks for, upstream ones first; with `only`, those and what they need; of `stages`, else of all."""
    from bakery.stages import all_stages

    applicable = [stage for stage in stages or all_stages() if stage.applies(recipe)]
    names = [stage.name for stage in applicable]
    for name in only:
        if name not in names:
            raise UsageError(f'--stage: found "{name}"; this recipe has the stages {", ".join(names)}')
    if not only:
        return applicable
    needed = set(only)
    for stage in reversed(applicable):
        if stage.name in needed:
            needed |= set(stage.needs)
    return [stage for stage in applicable if stage.name in needed]


class Wanted(NamedTuple):
    """A stage that a recipe asks for, everything that it depends on, and the hash over that."""

    stage: Stage
    parts: dict
    input_hash: str


def wanted(recipe, only: Sequence[str] = (), stages: Sequence[Stage] = ()) -> list[Wanted]:
    """What `chosen` gives, with hashes."""
    listed, hashes = [], {}
    for stage in chosen(recipe, only, stages):
        inputs = parts(stage, recipe, hashes)
        hashes[stage.name] = input_hash(inputs)
        listed.append(Wanted(stage, inputs, hashes[stage.name]))
    return listed


def make(
    recipe,
    output: Path,
    *,
    only: Sequence[str] = (),
    force: bool = False,
    held: Mapping[str, Held] | None = None,
    in_cache: Callable[[str, str], bool] = lambda name, key: False,
    price: Callable[[Stage, str, Cost], Cost] = lambda stage, key, cost: cost,
    same_recipe: bool = False,
    loaded: float = 0.0,
) -> Plan:
    """Order the stages and say of each whether and why it runs.

    only : names of stages, empty for all
    force : run every stage whatever is known
    held : the stages of the intact asset that stands at `output`; None where there is none
    in_cache : (stage name, input hash) -> whether the cache holds that stage
    price : (stage, input hash, cost model) -> what to expect of it on this machine
    same_recipe : whether the asset at `output` holds this recipe's very text
    loaded : memory of the process before any stage, in bytes
    """
    current = {name: stage.input_hash for name, stage in (held or {}).items()}
    steps = []
    for stage, inputs, key in wanted(recipe, only):
        if force:
            action, why = RUN, ["--force"]
        elif current.get(stage.name) == key:
            action, why = REUSE, [f"unchanged in {output}"]
        elif in_cache(stage.name, key):
            action, why = REUSE, ["in the cache"]
        else:
            action = RUN
            before = held[stage.name].parts if stage.name in current else None
            why = differences(before, inputs) if before else []
            if not why:
                why = [f"not in {output}" if held is not None else f"no {output} yet", "not in the cache"]
        steps.append(Step(stage, key, inputs, action, tuple(why), price(stage, key, stage.cost(recipe)), force))
    held = same_recipe and not force and {step.stage.name: step.input_hash for step in steps} == current
    return Plan(recipe, output, tuple(steps), write=not held, loaded=loaded)
