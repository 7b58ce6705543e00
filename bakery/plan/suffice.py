"""Whether what an asset holds is as good as what a bake would give, or better: read off what its stages were made of.

An asset keeps, stage by stage, every recipe value and file that the stage depends on.  Where those are the ones that are wanted,
or differ in nothing but how good they ask the stage to be, the asset can be used in place of a bake; and a bake that asks for
less would make it worse.
"""

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

_UPSTREAM = "upstream "
# words of a recipe, from the one that asks for least
_WORDS = {"measure": ("integrated", "pointwise")}


class Held(NamedTuple):
    """A stage as an asset holds it."""

    parts: Mapping  # what it depends on, as `bakery.plan.inputs.parts` names it
    input_hash: str  # over all of that
    achieved_error: float  # by the stage's own measure


def lacking(held: Mapping[str, Held], steps: Iterable, recipe_parts: Mapping[str, Mapping], knobs: Iterable, recipe) -> list[str]:
    """Why an asset will not do in place of a bake, in words; nothing where it will.

    steps : of the bake (`bakery.plan.Step`)
    recipe_parts : parts of each stage of the recipe as it stands: what it holds may stay where no more is asked for
    knobs : values that somebody decided (`renderers.scene.requirements.Knob`): `key`, `value`, `demand`
    """
    reasons, knobs = [], list(knobs)
    for step in steps:
        name = step.stage.name
        stage = held.get(name)
        if stage is None:
            reasons.append(f"{name} is missing")
        elif stage.input_hash != step.input_hash:
            reasons += [f"{name}: {key}" for key in _differing(stage.parts, step.parts)
                        if not _as_good(key, stage.parts, step.parts, recipe_parts.get(name, {}), knobs)]
            if stage.achieved_error > step.stage.tolerance(recipe):
                reasons.append(f"{name}: its error of {stage.achieved_error:.2g}")
    return reasons


def lost(held: Mapping[str, Held], steps: Iterable, recipe_parts: Mapping[str, Mapping], knobs: Iterable) -> list[str]:
    """What a bake would make worse of an asset, in words; arguments as of `lacking`.

    A stage that is out of date, because the recipe says another thing than how good it is to be, is nothing to lose.
    """
    knobs, steps = list(knobs), {step.stage.name: step.parts for step in steps}
    wanted, worse = {**recipe_parts, **steps}, []

    def stale(name: str) -> bool:
        if name not in held:
            return True
        parts = held[name].parts
        changed = name in wanted and any(
            _knob(key, knobs) is None and key not in _WORDS and not _is_tolerance(key) for key in _differing(parts, wanted[name]))
        return changed or any(stale(key.removeprefix(_UPSTREAM)) for key in parts if key.startswith(_UPSTREAM))

    for name, stage in held.items():
        if stale(name):
            continue
        if name not in steps:
            worse.append(name)
            continue
        worse += [f"{name} with {key} {stage.parts[key]}" for key in _differing(stage.parts, steps[name])
                  if _demand(key, stage.parts.get(key), knobs) > _demand(key, steps[name].get(key), knobs)]
    return worse


def _differing(held: Mapping, wanted: Mapping) -> list[str]:
    """Names of parts that differ; a stage upstream is compared by itself."""
    return [key for key in sorted({*held, *wanted}) if not key.startswith(_UPSTREAM) and held.get(key) != wanted.get(key)]


def _as_good(key: str, held: Mapping, wanted: Mapping, recipe_parts: Mapping, knobs) -> bool:
    """Whether a part that is another than the one wanted asks for as much."""
    if _demand(key, held.get(key), knobs) >= _demand(key, wanted.get(key), knobs):
        return True
    knob = _knob(key, knobs)
    # the recipe's own value, which may be a list, or left to the stage: it does where the knob does not ask for more
    return knob is not None and held.get(key) == recipe_parts.get(key) \
        and not knob.demand(knob.value) > knob.demand(recipe_parts.get(knob.key))


def _demand(key: str, value, knobs) -> float:
    """What a value asks for: more where it is larger; nan where that cannot be said."""
    knob = _knob(key, knobs)
    if knob is not None and knob.key == key:
        return knob.demand(value)
    if key in _WORDS:
        return _WORDS[key].index(value) if value in _WORDS[key] else math.nan
    return -float(value) if _is_tolerance(key) and isinstance(value, (int, float)) else math.nan


def _knob(key: str, knobs):
    """The one that decided a key, or the list that it is in."""
    return next((knob for knob in knobs if key == knob.key or key.startswith(f"{knob.key}[")), None)


def _is_tolerance(key: str) -> bool:
    return key == "tolerance" or key.endswith(".tolerance")
