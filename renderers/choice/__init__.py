"""What `auto` is for a scene: the cheapest of the candidates that its method declares, by pilots of each.

The first candidate is the one that is taken where no pilots are worth their time.  The others are tried while pilots together
take less than a tenth of the render, that of the first, whose kernels the render needs most likely, apart.  A candidate with an
error of its own has to fit the share of the tolerance that such errors have (`renderers.scene.budget.ROOM`): by its pilot,
against one without an error, or, where so few passes cannot tell, by what it declares.  A choice is kept in the cache of bakes
by all that it was made of, so that the same scene is rendered alike as long as that is there: clocks decide, and another
machine may choose otherwise.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import bakery
from bakery.errors import AssetError, UsageError
from renderers.choice import remembered, trial
from renderers.choice.trial import Trial
from renderers.mitsuba import bitmaps
from renderers.pictures.engine import Stop
from renderers.pictures.progressive import fingerprint, made_of
from renderers.scene import budget, entries
from renderers.scene.budget import percent

TEXT = "bakery_method"  # attribute of the pictures
_VERSION = 1  # of the rules below; another one does not go by what was kept
_SHARE = 0.1  # of the render, that pilots of others than the first may take together
_LONGEST = 1.5  # s of passes of a pilot
_LEAST_PIXELS, _LEAST_SAMPLES = 128**2, 1 << 21  # of pictures; smaller ones take no longer than pilots
_CHEAPER = 1.25  # times, that a later candidate has to be: clocks differ
_ORDER_SURE = 4.0  # standard errors, of a difference in one of four orders


class Choice(NamedTuple):
    """What was chosen.

    Attributes
    ----------
    method : name
    table : of each candidate a dict: `method`, `seconds` (of processors, to the noise that is asked for), `bias` and `error`
        (over the picture's mean; 0 of one without), `chosen`, `why`; None of what is not known
    approximations : error of the method in this scene with what two standard errors may add; None where the pilots do not tell
    sentence : how it was chosen
    """

    method: str
    table: list[dict]
    approximations: float | None
    sentence: str

    @property
    def row(self) -> dict:
        """Of the table, the method's."""
        return next(row for row in self.table if row["chosen"])

    @property
    def reasons(self) -> list[str]:
        """Sentences of a report."""
        return [self.sentence, *(f"  {row['method']}: {_figures(row)}{row['why']}" for row in self.table)]

    def text(self) -> dict[str, str]:
        """Attributes of the pictures: no seconds, so that the same scene gives the same bytes."""
        return {TEXT: self.method}


class Opened(NamedTuple):
    """A scene and its assets, as `prepare` of a renderer takes them."""

    scene: Any
    assets: list
    asset: Any

    @classmethod
    def of(cls, scene) -> Opened:
        """Of a scene whose assets are there."""
        opened = {path: bakery.open(path) for path in dict.fromkeys(scene.assets)}
        listed = [opened[path] for path in scene.assets]
        return cls(scene, listed, listed[0])


def candidates(scene) -> tuple[str, ...]:
    """Names of the methods that the method of a scene chooses from; () of one that is taken as it is."""
    if scene.renderer not in entries.PACKAGES.values():
        return ()
    return entries.declared(scene.values.materials[0].kind)[scene.values.method].candidates


def of_scene(scene, quality: str | None = None, variant: str | None = None) -> Choice | None:
    """The choice that a render of a scene makes or finds; None where its method chooses from none.  Errors as below.

    scene : `renderers.scene.Scene` with its assets
    """
    if not candidates(scene):
        return None
    from renderers.mitsuba.world import World

    prepare = import_module(f"{scene.renderer}.methods").prepare
    return chosen(prepare, Opened.of(scene), World.of(scene, variant), quality)


def with_method(scene, name: str):
    """The scene by another method."""
    listed = [entry.model_copy(update={"method": name}) for entry in scene.values.materials]
    return dataclasses.replace(scene, values=scene.values.model_copy(update={"materials": listed, "method": name}))


def stop_of(scene, quality) -> Stop:
    """What ends the passes of a scene."""
    values = scene.values
    return Stop.of(budget.of(scene), values.measure, time=values.stop.time, samples=values.stop.samples, quality=quality)


def chosen(prepare: Callable, opened, world, quality: str | None = None, picture: Path | None = None) -> Choice | None:
    """The choice for a scene; None where its method chooses from none.

    Parameters
    ----------
    prepare : of the renderer, (opened, world, seed) -> `renderers.pictures.passes.Method`
    opened : `Opened`
    world : `renderers.mitsuba.world.World` of the picture
    quality : of the render
    picture : EXR that is gone on with, whose choice holds; None of a render from the beginning

    Raises
    ------
    BakeryError : the scene cannot be rendered by the first candidate
    Interrupted : a pilot was interrupted
    """
    names = candidates(opened.scene)
    if not names:
        return None
    declared = entries.declared(opened.scene.values.materials[0].kind)
    lacks = {name: reason for name in names if (reason := declared[name].lacks(opened.assets, world))}
    names = tuple(name for name in names if name not in lacks) or names
    if picture is not None and (earlier := _of_picture(picture)) in names:
        return _taken(earlier, "the picture that is gone on with is by it")
    stop = stop_of(opened.scene, quality)
    if alone := _without_pilots(opened.scene, names, world, stop):
        return _taken(names[0], alone)
    key = remembered.key_of(_VERSION, bakery.__version__, fingerprint(*made_of(opened.scene)), list(world.size), names,
                            [asset.content_hash for asset in opened.assets], dataclasses.astuple(stop))
    kept = _choice_of(remembered.get("choice", key), names)
    if kept:
        return kept._replace(sentence=f"{kept.sentence} (of an earlier render)")
    choice = _Pilots(prepare, opened, world, stop, names, lacks).choice()
    remembered.put("choice", key, choice._asdict())
    return choice


def _without_pilots(scene, names, world, stop) -> str:
    """Why the first candidate is taken without a pilot; "" where pilots are worth their time."""
    pixels, declared = world.size[0] * world.size[1], entries.declared(scene.values.materials[0].kind)
    if world.dark:
        return "nothing shines"
    if pixels < _LEAST_PIXELS or stop.samples is not None and stop.samples * pixels < _LEAST_SAMPLES:
        return "pilots of other methods would take longer than so small a picture"
    shortest = min((declared[name].pilot for name in names[1:]), default=math.inf)
    if stop.time is not None and _SHARE * stop.time < shortest:
        return f"pilots of other methods take {shortest:.2g} s and more, and the picture {stop.time:.3g} s"
    return ""


def _taken(name, why) -> Choice:
    row = {"method": name, "seconds": None, "bias": None, "error": None, "chosen": True, "why": "taken without a pilot"}
    return Choice(name, [row], None, f"auto is {name} here: {why}")


def _of_picture(path) -> str | None:
    """The method that a picture was made by; None where it does not say."""
    try:
        return bitmaps.read(path)[1].get(TEXT)
    except (UsageError, OSError):
        return None  # `renderers.pictures.progressive` says what is wrong with the picture


def _choice_of(kept, names) -> Choice | None:
    """A choice that was kept; None where it is none."""
    try:
        choice = Choice(**kept)
        return choice if choice.method in names and choice.row["method"] == choice.method else None
    except (TypeError, KeyError, StopIteration):
        return None


def _figures(row):
    if row["seconds"] is None:
        return ""
    bias = "" if not row["bias"] and not row["error"] else f", bias {percent(row['bias'])} +- {percent(row['error'])}"
    return f"{row['seconds']:.3g} s{bias}; "


class _Pilots:
    """The pilots of a scene's candidates."""

    def __init__(self, prepare, opened, world, stop, names, lacks=MappingProxyType({})):
        self._lacks = lacks
        self._prepare, self._opened, self._world, self._stop = prepare, opened, world, stop
        self._declared = {name: entries.declared(opened.scene.values.materials[0].kind)[name] for name in names}
        self._pixels = world.size[0] * world.size[1]
        self._noise = stop.noise or budget.of(opened.scene).noise  # of a scene that asks for none
        self._tolerance = opened.scene.values.tolerance or budget.DEFAULT
        self._trials: dict[str, Trial] = {}
        self._why: dict[str, str] = {}
        first, *others = names
        limit = math.inf if stop.time is None else stop.time
        self._try(first, min(_LONGEST, 0.3 * _SHARE * limit))
        whole = min(limit, self._seconds_to_end(self._trials[first]))
        left = _SHARE * whole
        for name in others:
            needed = self._declared[name].pilot
            if left < needed:
                self._why[name] = f"not tried: a pilot takes {needed:.2g} s, and the picture {whole:.2g} s"
                continue
            try:
                self._try(name, min(_LONGEST, 0.5 * left))
                left -= self._trials[name].seconds
            except (AssetError, UsageError) as fault:
                self._why[name] = f"not possible: {fault}"

    def _try(self, name, seconds):
        opened = self._opened._replace(scene=with_method(self._opened.scene, name))
        self._trials[name] = trial.of(lambda world, seed: self._prepare(opened, world, seed), self._world, seconds)

    def _seconds_to_end(self, tried) -> float:
        """Until noise or samples end the passes."""
        ends = [self._seconds(tried)] if self._stop.noise and tried.level > 0 else []
        ends += [] if self._stop.samples is None else [tried.of_samples(self._pixels, self._stop.samples)]
        return min(ends, default=math.inf)

    def _seconds(self, tried, missing=0.0) -> float:
        """Processor seconds of a render to the noise that is asked for."""
        return tried.setup + tried.rate(self._pixels, missing) / self._noise**2

    def choice(self) -> Choice:
        """The cheapest that fits."""
        others = {name: {other: one for other, one in self._trials.items() if other != name} for name in self._trials}
        without_error = {name for name in self._trials if self._declared[name].exact}
        missing = {name: trial.missing(one, others[name], without_error) for name, one in self._trials.items()}
        exact = {name: self._trials[name] for name in without_error if self._trials[name].level > 0 and not missing[name]}
        table = [self._row(name, None, None, f"not possible: {why}") for name, why in self._lacks.items()]
        best, room = (next(iter(self._declared)), math.inf), {}
        for name in self._declared:
            if name not in self._trials:
                table.append(self._row(name, None, None, self._why[name]))
                continue
            tried = self._trials[name]
            cost = self._seconds(tried, missing[name])
            fits, bias, why, room[name] = self._fits(name, exact)
            table.append(self._row(name, cost, bias, why))
            if not fits:
                continue
            if math.isinf(best[1]) or cost * self._margin(name, best[0]) < best[1]:
                best = name, cost
        for row in table:
            row["chosen"] = row["method"] == best[0]
        return Choice(best[0], table, room.get(best[0]),
                      f"auto is {best[0]} here, by pilots: seconds of a processor to a noise of {percent(self._noise)}")

    def _margin(self, name, other) -> float:
        """By how much a candidate has to be cheaper than one before it."""
        return _CHEAPER * math.exp(math.hypot(self._trials[name].spread, self._trials[other].spread))

    def _row(self, name, seconds, bias, why) -> dict:
        size, error = (None, None) if bias is None else (bias.size, bias.error)
        seconds = seconds if seconds is not None and math.isfinite(seconds) else None  # JSON has no infinity
        return {"method": name, "seconds": seconds, "bias": size, "error": error, "chosen": False, "why": why}

    def _fits(self, name, exact: Mapping[str, Trial]):
        """Whether a candidate's own error fits, `trial.Bias` or None, in words, and the error to make room for, or None."""
        declared, tried = self._declared[name], self._trials[name]
        if not tried.level > 0:
            return False, None, "its pilot found no light", None
        if declared.exact:
            lacking = ", and has not found all of the light" if name not in exact else ""
            return True, trial.NO_BIAS, f"without an error of its own{lacking}", 0.0
        allowed, stated = budget.ROOM * self._tolerance, declared.error(self._tolerance)
        by_statement = (stated <= allowed, f"it states {percent(stated)}, of {percent(allowed)} that it may have")
        if not exact:
            return True, None, "how far it is off is not known: none without an error has found all of the light", None
        reference = min(exact.values(), key=lambda one: float(one.light[""].variance.sum()) / one.level**2)
        bias = trial.bias(tried, reference)
        if bias.size + bias.error <= allowed:
            return True, bias, f"within the {percent(allowed)} that it may be off", bias.size + bias.error
        order, (shift, error) = max(bias.by_order.items(), key=lambda item: abs(item[1][0]) - _ORDER_SURE * item[1][1])
        if bias.resolved or abs(shift) - _ORDER_SURE * error > allowed:
            where = f", {percent(abs(shift))} +- {percent(error)} of it in layer {order}"
            return False, bias, f"off by more than the {percent(allowed)} that it may be{where}", None
        return by_statement[0], bias, f"the pilot does not tell more: {by_statement[1]}", None
