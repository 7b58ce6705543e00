"""Stages of a recipe by name, and the hashes of what they depend on: the same in the parent and in the worker."""

from collections.abc import Mapping
from importlib import import_module

from bakery.plan import chosen, wanted
from bakery.plan.inputs import input_hash, parts
from bakery.stages.declaration import Stage


def all_of(stages: str) -> tuple[Stage, ...]:
    """All stages, by the name `module:function` of what returns them."""
    module, _, function = stages.partition(":")
    return getattr(import_module(module), function)()


def find(stages: str, recipe, name: str) -> Stage:
    """The stage of that name which the recipe asks for."""
    return next(stage for stage in all_of(stages) if stage.name == name and stage.applies(recipe))


def above(stages: str, recipe, name: str) -> list[Stage]:
    """The stages that a stage needs, directly or not, upstream ones first."""
    return chosen(recipe, (name,), all_of(stages))[:-1]


def hashes_above(stages: str, recipe, name: str) -> dict[str, str]:
    """Input hashes of those stages."""
    return {step.stage.name: step.input_hash for step in wanted(recipe, (name,), all_of(stages))[:-1]}


def hash_of(stage: Stage, recipe, upstream: Mapping[str, str]) -> str:
    """The input hash of a stage, as a bake has it."""
    return input_hash(parts(stage, recipe, upstream))
