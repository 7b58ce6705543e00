"""What `auto` is for a scene: the cheapest of its candidates (`renderers.scene.candidates`), by pilots of each.

The first candidate is the one that is taken where no pilots are worth their time. The others are tried while pilots together
take less than 8 % of the render, but for compiling; one that ends long paths has half of that where the first one has used all.
Cheapest is that whose seconds are at most fewest, by standard errors of what its pilot tells: one of which little is known is not
preferred to one that is well known, nor, unless its pilot is cheaper too, to an earlier one of which as little is known. A
candidate with an error of its own has to fit the share of the tolerance that such errors have (`renderers.scene.budget.ROOM`):
by its pilot, against one without an error, or, where so few passes cannot tell, by what it declares. A choice is kept in the
cache of bakes by all that it was made of, so that the same scene is rendered alike as long as that is there: clocks decide, and
another machine may choose otherwise.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from bakery.errors import AssetError, UsageError
from renderers.choice import remembered, surfaces, trial
from renderers.choice.decision import TEXT, Choice
from renderers.choice.trial import Trial
from renderers.mitsuba import bitmaps
from renderers.pictures import reached
from renderers.pictures.engine import Stop
from renderers.pictures.progressive import fingerprint, made_of
from renderers.scene import budget, candidates, entries, meshes
from renderers.scene.assets import opened
from renderers.scene.budget import percent
from renderers.scene.candidates import Candidate

# Of the render, that pilots may take together, and that each is given; two passes of each size take what they take.  A tenth
# beside the first was more than they saved (a jelly whose first candidate is the cheapest), and a twentieth left no time for two
# passes through grains (fine salt from afar, of which another one is 1.8 times as cheap).  At 1.25 % each the pilots of a sand
# castle took 5 % of a minute, by processor time, and at 0.8 % 3.4 %: in both its candidates are alike
_SHARE, _EACH = 0.08, 0.008
_LONGEST = 1.5  # s of passes of a pilot
_LONGER = 30.0  # times as long are pilots at most that have to tell an error
_LEAST_PIXELS, _LEAST_SAMPLES = 128**2, 1 << 21  # of pictures; smaller ones take no longer than pilots
_CHEAPER = 1.25  # times, that a later candidate has to be: clocks differ
# Times cheaper, up to which a second pilot has to say so too.  On a busy machine one of four choices for a heap of sand was
# `ept+vpt`, 1.3 times as dear as `ept`: seconds of a pixel are by the difference of two passes, and were half of what others told
_LITTLE = 3.0
_UNTRIED = "taken without a pilot"
# Standard errors, by which a candidate may take longer than its pilot tells, and times as long at most: of what few passes hardly
# tell (dots of particles), their standard error tells nothing either; such a candidate has to be as much cheaper than an earlier
# one is by its pilot, whatever is not known of that
_SURE, _DOUBT = 2.0, 10.0
# Times as well known, by its standard error, that a candidate has to be which is taken for being cheaper at most alone: of two
# that are known as badly chance decides that (particles in dust were taken, 2.9 times as dear as the first candidate)
_KNOWN = 2.0
_ORDER_SURE = 4.0  # standard errors, of a difference in one of four orders


class Opened(NamedTuple):
    """A scene and its assets, as `prepare` of a renderer takes them."""

    scene: Any
    assets: list
    asset: Any

    @classmethod
    def of(cls, scene) -> Opened:
        """Of a scene whose assets are there."""
        listed = opened(scene)
        return cls(scene, listed, listed[0])


def of_scene(scene, quality: str | None = None, variant: str | None = None, picture: Path | None = None) -> Choice | None:
    """The choice that a render of a scene makes or finds; None where its method chooses from none.  Errors as below.

    scene : `renderers.scene.Scene` with its assets
    picture : as of `chosen`
    """
    if not (candidates.of(scene) or candidates.surfaces(scene)):
        return None
    world = meshes.world_of(scene, variant)
    if world.camera is None:
        raise scene.no_camera()
    return chosen(Opened.of(scene), world, quality, picture)


def stop_of(scene, quality) -> Stop:
    """What ends the passes of a scene."""
    values = scene.values
    return Stop.of(budget.of(scene), values.measure, time=values.stop.time, samples=values.stop.samples, quality=quality)


def chosen(opened, world, quality: str | None = None, picture: Path | None = None) -> Choice | None:
    """The choice for a scene; None where its method chooses from none.

    Parameters
    ----------
    opened : `Opened`
    world : `renderers.mitsuba.world.World` of the picture
    quality : of the render
    picture : EXR that is gone on with, whose choice holds; None of a render from the beginning

    Raises
    ------
    BakeryError : the scene cannot be rendered by the first candidate
    Interrupted : a pilot was interrupted
    """
    offered, lacks = surfaces.beside(opened, world, candidates.of(opened.scene))
    if not offered:
        return None
    lacks |= {candidate.name: reason for candidate in offered if (reason := candidate.lacks(opened.assets, world))}
    offered = tuple(candidate for candidate in offered if candidate.name not in lacks) or offered
    stop, tolerance = stop_of(opened.scene, quality), opened.scene.values.tolerance or budget.DEFAULT
    key = remembered.key_of(remembered.of_code(), fingerprint(*made_of(opened.scene)), list(world.size),
                            [candidate.name for candidate in offered], [asset.content_hash for asset in opened.assets],
                            dataclasses.astuple(stop), world.variant)
    kept = _choice_of(remembered.get("choice", key), offered)
    earlier = _of_picture(picture, offered) if picture is not None else None
    if earlier is not None and (kept is None or kept.method != earlier):
        return _taken(offered, earlier, "the picture that is continued used it", tolerance)
    if alone := _without_pilots(world, offered, stop):
        return _taken(offered, *_unpiloted(opened, world, offered, alone, quality), tolerance)
    if kept:
        return kept._replace(sentence=f"{kept.sentence} (of an earlier render)")
    possible, seen = _unseen(opened, offered, world)
    choice = _Pilots(opened, world, stop, possible, lacks | seen).choice()
    choice = choice._replace(sentence=f"{_said(offered, choice.method)}, {choice.sentence}")
    remembered.put("choice", key, choice._asdict())
    return choice


def _unseen(opened, offered, world) -> tuple[list[Candidate], dict[str, str]]:
    """Candidates whose media hide nothing that would be seen, with what they state of that; of the others by name what would."""
    scene = opened.scene
    methods = {number: candidate.methods[number] for candidate in offered for number in candidate.media}
    deviations = {number: entries.declared(scene.values.materials[number].kind)[method].deviation(
        scene, number, opened.assets[number], world) for number, method in methods.items()}
    allowed, unseen, seen = budget.ROOM * (scene.values.tolerance or budget.DEFAULT), [], {}
    for candidate in offered:
        if math.hypot(*(deviations[number] for number in candidate.replaced)) > allowed:
            figures = ", ".join(f"materials[{number}] {percent(deviations[number])}" for number in candidate.replaced)
            seen[candidate.name] = f"single particles and grains are seen, by which pixels deviate: {figures}"
        else:
            unseen.append(candidate.off_by(*(deviations[number] for number in candidate.media)))
    return unseen, seen


def _without_pilots(world, offered, stop) -> str:
    """Why the first candidate is taken without a pilot; "" where pilots are worth their time."""
    pixels = world.size[0] * world.size[1]
    if world.dark:
        return "nothing shines"
    if len(offered) == 1:
        return "there is no other candidate"
    if pixels < _LEAST_PIXELS or stop.samples is not None and stop.samples * pixels < _LEAST_SAMPLES:
        return "pilots of other methods would take longer than so small a picture"
    shortest = min((candidate.pilot for candidate in offered[1:]), default=math.inf)
    if stop.time is not None and _SHARE * stop.time < shortest:
        return f"pilots of other methods take {shortest:.2g} s and more, and the picture {stop.time:.3g} s"
    return ""


def _unpiloted(opened, world, offered, alone, quality) -> tuple[str, str]:
    """The candidate that is taken without a pilot, and why: the first one, or of a draft, where that takes long, the
    first other one, if what it states is within what a draft may be off by."""
    slow = offered[0].slow(opened.scene, opened.assets, world) if quality == "draft" else ""
    tolerance = opened.scene.values.tolerance or budget.DEFAULT
    allowed = budget.ROOM * reached.coarser(quality) * tolerance
    within = [candidate.name for candidate in offered[1:] if candidate.eligible and candidate.stated(tolerance) <= allowed]
    return (within[0], f"{alone}, which is a draft, and {slow}") if slow and within else (offered[0].name, alone)


def _taken(offered, name, why, tolerance) -> Choice:
    candidate = next(candidate for candidate in offered if candidate.name == name)
    row = {"method": name, "seconds": None, "at_most": None, "bias": None, "error": None, "chosen": True,
           "why": _untried(candidate, tolerance)}
    return Choice(name, list(candidate.methods), [row], None, f"{_said(offered, name)}: {why}")


def _untried(candidate, tolerance) -> str:
    if not candidate.surfaces:
        return _UNTRIED
    return f"{_UNTRIED}; by how far light spreads an error of {percent(candidate.stated(tolerance))} is expected"


def _said(offered, name) -> str:
    open_to_choice = sum(candidate.eligible for candidate in offered) > 1 or any(candidate.surfaces for candidate in offered)
    return f"auto is {name} here" if open_to_choice else f"{name}, as asked for"


def _eligible(offered) -> list[str]:
    return [candidate.name for candidate in offered if candidate.eligible]


def _of_picture(path, offered) -> str | None:
    """The candidate that a picture was made by, the first one where it does not say; None where it cannot be gone on with."""
    try:
        name = bitmaps.read(path)[1].get(TEXT, offered[0].name)
    except (UsageError, OSError):
        return None  # `renderers.pictures.progressive` says what is wrong with the picture
    return name if name in _eligible(offered) else None


def _choice_of(kept, offered) -> Choice | None:
    """A choice that was kept; None where it is none."""
    try:
        choice = Choice(**kept)
        return choice if choice.method in _eligible(offered) and choice.row["method"] == choice.method else None
    except (TypeError, KeyError, StopIteration):
        return None


class _Pilots:
    """The pilots of a scene's candidates; lacks : of others by name why they are none."""

    def __init__(self, opened, world, stop, offered: Sequence[Candidate], lacks=MappingProxyType({})):
        self._lacks, self._opened, self._world, self._stop = lacks, opened, world, stop
        self._offered = {candidate.name: candidate for candidate in offered}
        self._pixels = world.size[0] * world.size[1]
        self._noise = stop.noise or budget.of(opened.scene).noise  # of a scene that asks for none
        self._tolerance = opened.scene.values.tolerance or budget.DEFAULT
        self._trials: dict[str, Trial] = {}
        self._why: dict[str, str] = {}
        self._spent = 0.0
        if len(self._offered) > 1:
            self._run()

    def _run(self):
        first, *others = self._offered
        limit = math.inf if self._stop.time is None else self._stop.time
        late = f"not tried: pilots take more than {_SHARE * limit:.2g} s"
        if self._try(first, min(_LONGEST, _EACH * limit), _SHARE * limit / 2):
            whole, spent = min(limit, self._seconds_to_end(self._trials[first])), self._trials[first].seconds
        else:
            whole, spent = limit, _SHARE * limit
        for name in others:
            seconds_left, needed = _SHARE * whole - spent, self._offered[name].pilot
            if early := self._offered[name].ends_early:  # most so where the first one takes long
                seconds_left = max(seconds_left, _SHARE * whole / 2)
            else:  # two passes of each size take about as long as those of the first, where those took longer than they should
                needed = max(needed, self._trials[first].seconds if first in self._trials else math.inf)
            if seconds_left < needed:
                about = f"not tried: a pilot takes {needed:.2g} s, and the picture {whole:.2g} s"
                self._why[name] = about if first in self._trials else late
                continue
            try:
                if not self._try(name, min(_LONGEST, _EACH * whole), seconds_left if early else math.inf):
                    self._why[name] = late
                    continue
                spent += self._trials[name].seconds
                if self._offered[name].eligible and self._fits(name, self._exact())[0]:
                    # now that this may be what is taken, others have less time for their pilots
                    whole = min(whole, self._seconds_to_end(self._trials[name]))
            except (AssetError, UsageError) as fault:
                self._why[name] = f"not possible: {getattr(fault, 'brief', '') or fault}"
        if first in self._trials:
            self._tell_more(_SHARE * whole - spent)
            self._try_again(_SHARE * whole - spent)
        elif self._trials:
            self._why[first] = late

    def _try(self, name, seconds, most=math.inf) -> bool:
        """Whether a pilot of a candidate took no longer than `most`."""
        scene = candidates.by_methods(self._opened.scene, self._offered[name].methods)
        opened = self._opened._replace(scene=scene)
        with self._world.as_it_is():
            tried = trial.of(lambda world, seed: scene.prepare(opened, world, seed), self._world, seconds, most=most)
        if tried is not None:
            self._trials[name] = tried
            self._spent += tried.processor
        return tried is not None

    def _tell_more(self, seconds_left):
        """Longer pilots, in what is left of their time, of a candidate that is cheaper than those without an error by as much as
        it takes, where they do not tell whether its error fits and would then do so."""
        exact, allowed = self._exact(), budget.ROOM * self._tolerance
        if not exact:
            return
        cheapest = min(map(self._seconds, exact.values()))
        stated = {name: self._offered[name].stated(self._tolerance) for name in self._trials if not self._offered[name].exact}
        # of others the error does not matter
        untold = [name for name in stated if self._seconds(self._trials[name]) * _CHEAPER < cheapest]
        if not untold:
            return
        name = min(untold, key=lambda name: self._seconds(self._trials[name]))
        reference = min(exact, key=lambda name: self._variance(exact[name]))
        bias, trials = trial.bias(self._trials[name], exact[reference]), (self._trials[name], exact[reference])
        if bias.resolved or bias.size + bias.error <= allowed or stated[name] > allowed and bias.size >= allowed:
            return
        # the error goes with the root of the variance
        times = 1.3 * (bias.error / max(abs(allowed - bias.size), 1e-9)) ** 2
        needed = times * sum(pilot.seconds for pilot in trials)
        if needed > seconds_left or times > _LONGER:
            if stated[name] > allowed:
                self._why[name] = f"measuring its error takes {needed:.2g} s, and pilots have {seconds_left:.2g} s left"
            return
        for again, pilot in zip((name, reference), trials):
            self._try(again, max(times, 1.0) * pilot.seconds)

    def _try_again(self, seconds_left):
        """The candidate that is to be taken and the first one, where that is little dearer: passes of a busy machine take longer
        by chance.  The first one counts by its quicker pilot, the other one by its slower."""
        first, name, missing = next(iter(self._offered)), self.choice().method, self._missing()
        pilots = self._trials[first], self._trials[name]
        seconds = [self._seconds(pilot, missing[method]) for method, pilot in zip((first, name), pilots)]
        if name == first or seconds[0] > _LITTLE * seconds[1] or sum(pilot.seconds for pilot in pilots) > seconds_left:
            return
        for method, pilot, counts in zip((first, name), pilots, (min, max)):
            self._try(method, pilot.seconds)
            self._trials[method] = counts(pilot, self._trials[method], key=self._seconds)

    def _seconds_to_end(self, tried) -> float:
        """Until noise or samples end the passes."""
        ends = [self._seconds(tried)] if self._stop.noise and tried.level > 0 else []
        ends += [] if self._stop.samples is None else [tried.of_samples(self._pixels, self._stop.samples)]
        return min(ends, default=math.inf)

    def _seconds(self, tried, missing=0.0) -> float:
        """Processor seconds of a render to the noise that is asked for."""
        return tried.setup + tried.rate(self._pixels, missing, self._noise, self._stop.time) / self._noise**2

    def _missing(self) -> dict[str, float]:
        """What each lacks of the light that the others have found."""
        without_error = {name for name in self._trials if self._offered[name].exact}
        return {name: trial.missing(pilot, self._compared(name), without_error) for name, pilot in self._trials.items()}

    def _compared(self, name) -> dict[str, Trial]:
        """The others, with the layers that say something of one: light that surfaces send on counts as not scattered."""
        others = {key: pilot for key, pilot in self._trials.items() if key != name}
        if not self._offered[name].surfaces:
            return others
        return {key: pilot._replace(light={"": pilot.light[""]}) for key, pilot in others.items()}

    def _exact(self) -> dict[str, Trial]:
        """Those without an error that have found all of the light."""
        missing = self._missing()
        return {name: pilot for name, pilot in self._trials.items()
                if self._offered[name].exact and pilot.level > 0 and not missing[name]}

    @staticmethod
    def _variance(tried) -> float:
        return float(tried.light[""].variance.sum()) / tried.level**2

    def choice(self) -> Choice:
        """The cheapest that fits."""
        missing, exact = self._missing(), self._exact()
        table = [self._row(name, None, None, f"not possible: {why}") for name, why in self._lacks.items()]
        taken, best, deviation, allowed = next(iter(self._offered)), (math.inf, math.inf), math.inf, {}
        for name, candidate in self._offered.items():
            if name not in self._trials:
                table.append(self._row(name, None, None, self._why.get(name, _untried(candidate, self._tolerance))))
                continue
            cost = self._seconds(self._trials[name], missing[name])
            spread = self._trials[name].spread
            doubt = min(math.exp(_SURE * spread), _DOUBT)
            at_most = doubt * cost
            fits, bias, why, allowed[name] = self._fits(name, exact)
            asked = why if candidate.eligible else f"{why}; other methods are asked for"
            table.append(self._row(name, cost, bias, asked, at_most))
            cheaper = at_most * _CHEAPER < best[doubt < _DOUBT] and (cost * _CHEAPER < best[0] or spread * _KNOWN < deviation)
            if fits and candidate.eligible and (math.isinf(best[0]) or cheaper):
                taken, best, deviation = name, (cost, at_most), spread
        for row in table:
            row["chosen"] = row["method"] == taken
        by = "there is no other candidate" if len(self._offered) == 1 else "pilots take too long for so short a render"
        if self._trials:
            by = f"by pilots: seconds of a processor to a noise of {percent(self._noise)}"
        foretold = self._trials[taken].summary(self._pixels, self._stop, missing[taken]) if taken in self._trials else None
        return Choice(taken, list(self._offered[taken].methods), table, allowed.get(taken), by, foretold, self._spent)

    def _row(self, name, seconds, bias, why, at_most=None) -> dict:
        size, error = (None, None) if bias is None else (bias.size, bias.error)
        # JSON has no infinity
        seconds, at_most = (value if value is not None and math.isfinite(value) else None for value in (seconds, at_most))
        return {"method": name, "seconds": seconds, "at_most": at_most, "bias": size, "error": error, "chosen": False, "why": why}

    def _fits(self, name, exact: Mapping[str, Trial]):
        """Whether a candidate's own error fits, `trial.Bias` or None, in words, and the error to make room for, or None."""
        candidate, tried = self._offered[name], self._trials[name]
        if not tried.level > 0:
            return False, None, "its pilot found no light", None
        if candidate.exact:
            lacking = ", and has not found all of the light" if name not in exact else ""
            return True, trial.NO_BIAS, f"without an error of its own{lacking}", 0.0
        allowed, stated = budget.ROOM * self._tolerance, candidate.stated(self._tolerance)
        if not exact:
            why = "its error is unknown: no exact method has found all of the light"
            return not (candidate.media or candidate.surfaces) or stated <= allowed, None, why, None
        bias = trial.bias(tried, min(exact.values(), key=self._variance))
        if candidate.surfaces:
            return self._as_surfaces(name, bias, stated, allowed)
        if bias.size + bias.error <= allowed:
            return True, bias, f"within the {percent(allowed)} allowed", bias.size + bias.error
        order, (shift, error) = max(bias.by_order.items(), key=lambda item: abs(item[1][0]) - _ORDER_SURE * item[1][1])
        if bias.resolved or abs(shift) - _ORDER_SURE * error > allowed:
            where = f", {percent(abs(shift))} +- {percent(error)} of it in layer {order}"
            return False, bias, f"off by more than the {percent(allowed)} allowed{where}", \
                bias.size + bias.error if candidate.media else None
        states = f"it declares an error of {percent(stated)}; {percent(allowed)} is allowed"
        return stated <= allowed, bias, f"the pilot does not tell more: {self._why.get(name, states)}", None

    def _as_surfaces(self, name, bias, stated, allowed):
        """The same of a candidate with surfaces: within pixels of the picture, which are narrower than the pilots', its error is
        known by what is expected."""
        expected = self._offered[name].expected
        expected = stated if expected is None else expected
        words = f"by how far light spreads {percent(expected)} is expected"
        if bias.size + bias.error <= allowed:
            fits, why = expected <= allowed, f"within the {percent(allowed)} allowed; {words}"
        elif bias.resolved:
            fits, why = False, f"off by more than the {percent(allowed)} allowed; {words}"
        else:
            fits, told = stated <= allowed, self._why.get(name, words)
            why = f"the pilot does not tell more: {told}; {percent(allowed)} is allowed"
        return fits, bias, why, max(bias.size + bias.error, stated) if fits and "within" in why else None
