"""What a sweep found: corrected times, the front, its knee, what to recommend."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from statistics import median

from bakery.trade import front as fronts
from bakery.trade.front import Point
from bakery.trade.runs import Run, machine
from bakery.trade.search import Ladder, Seen, Setting, inert, start_of
from bakery.trade.times import deviation, quantiles, standard_error

ALIKE = 1.3  # times the least, within which runs with the same values count as the same work


def seen_of(measured: Mapping[Setting, Run]) -> dict[Setting, Seen | None]:
    """What runs showed that a search goes by; None of those that failed."""
    return {setting: None if run.failed else Seen(median(run.ratios), run.error, run.content)
            for setting, run in measured.items()}


@dataclass(frozen=True)
class Sweep:
    """What a sweep over one stage found."""

    stage: object  # its declaration
    tolerance: float  # requested
    preset_tolerances: Mapping[str, float]  # name of each preset -> its tolerance
    runs: Sequence[Run]  # every setting that was run, in that order; failed ones too
    start: int  # index of the recipe as it stands
    presets: Mapping[str, int]  # name -> index into `runs`
    inert: Sequence[str]  # keys of knobs that changed nothing
    # of the converged values: `setting`, `input_hash`, `seconds`, `achieved` (the error that they claim), `check`
    reference: Mapping
    floor: Mapping[str, float]  # by name of error, how far two converged groups are apart: smaller errors are not distinguished
    baseline: Mapping[str, str]  # overrides of the setting that was run around every other
    refused: Sequence[tuple[Mapping[str, str], str]]  # (overrides, message) that the recipe does not allow
    # overrides for which the time did not suffice; nothing there means that no further run can change the recommendations
    untried: Sequence[Mapping[str, str]]
    reused: int  # how many runs were on disk

    @classmethod
    def of(cls, *, ladders: Sequence[Ladder], measured: Mapping[Setting, Run], **values) -> Sweep:
        """From runs by setting."""
        seen = seen_of(measured)
        return cls(runs=list(measured.values()), start=list(measured).index(start_of(ladders)),
                   inert=[ladder.key for k, ladder in enumerate(ladders) if inert(ladders, k, seen)], **values)

    @cached_property
    def good(self) -> list[int]:
        """Indices of the runs that did not fail, those in the fewest words first: they are preferred among equals."""
        return sorted((i for i, run in enumerate(self.runs) if not run.failed), key=lambda i: (len(self.runs[i].setting), i))

    @cached_property
    def baseline_seconds(self) -> float:
        """Median over all times of the baseline."""
        return median(seconds for i in self.good for seconds in self.runs[i].baseline)

    @property
    def drift(self) -> tuple[float, float]:
        """Least and largest time of the baseline relative to its median: what the correction took out."""
        times = [seconds / self.baseline_seconds for i in self.good for seconds in self.runs[i].baseline]
        return min(times), max(times)

    @cached_property
    def noise(self) -> float:
        """Standard deviation of ln(time) of a single run, after the correction."""
        return deviation(self.runs[i].ratios for i in self.good)

    @cached_property
    def points(self) -> list[Point]:
        """Time and error of the runs in `good`.

        Settings that gave the very same values in nearly the least time for these did the same work: they share their times, so
        that noise does not choose between them.
        """
        alike: dict[str, list[list[float]]] = {}
        for i in self.good:
            alike.setdefault(self.runs[i].content, []).append(list(self.runs[i].ratios))
        points = []
        for i in self.good:
            ratios, others = self.runs[i].ratios, alike[self.runs[i].content]
            limit = ALIKE * min(median(rival) for rival in others)
            if median(ratios) <= limit:
                ratios = [ratio for rival in others if median(rival) <= limit for ratio in rival]
            spread = deviation([ratios]) if len(ratios) > 4 else 0.0  # fewer repeats say little of their own spread
            seconds = median(ratios) * self.baseline_seconds
            points.append(Point(seconds, self.runs[i].error, standard_error(max(self.noise, spread), len(ratios))))
        return points

    def seconds(self, index: int) -> tuple[float, float, float, float]:
        """Median, median absolute deviation, least and largest corrected time of a run."""
        return quantiles([ratio * self.baseline_seconds for ratio in self.runs[index].ratios])

    @property
    def floor_of_error(self) -> float:
        """The floor of the error that ranks."""
        return next(iter(self.floor.values()))

    @cached_property
    def front(self) -> list[int]:
        """Indices of the runs on the front, fastest first."""
        return [self.good[i] for i in fronts.front(self.points, self.floor_of_error)]

    @property
    def knee(self) -> int | None:
        """The run at the knee of the front."""
        at = fronts.knee([self.point(i) for i in self.front], self.floor_of_error)
        return None if at is None else self.front[at]

    def point(self, index: int) -> Point:
        """Time and error of a run."""
        return self.points[self.good.index(index)]

    def dominating(self, index: int) -> int | None:
        """The run on the front that is at least as accurate and not slower; None for one that is, or equals one, on the front."""
        if any(self.runs[index].content == self.runs[i].content and self.point(index) == self.point(i) for i in self.front):
            return None
        on = [self.good.index(i) for i in self.front]
        position = fronts.dominating(self.points, self.good.index(index), on, self.floor_of_error)
        return None if position is None else self.good[position]

    def recommended(self, tolerance: float) -> int | None:
        """The run on the front with the least time whose true error meets a tolerance."""
        position = fronts.cheapest([self.point(i) for i in self.front], tolerance)
        return None if position is None else self.front[position]

    def as_dict(self) -> dict:
        """The same for machines (`--json`, trade.json)."""
        low, high = self.drift
        return {
            "stage": self.stage.name, "version": self.stage.version, "title": self.stage.title, "tolerance": self.tolerance,
            "errors": list(self.floor), "front": self.front, "knee": self.knee, "start": self.start,
            "presets": {name: {"run": i, "tolerance": self.preset_tolerances[name], "dominated_by": self.dominating(i)}
                        for name, i in self.presets.items() if i in self.good},
            "recommended": [{"tolerance": tolerance, "run": self.recommended(tolerance)} for tolerance in self.tolerances],
            "runs": [self._run(i) for i in range(len(self.runs))],
            "reference": {**self.reference, "floor": dict(self.floor)},
            "baseline": {"setting": dict(self.baseline), "seconds": self.baseline_seconds, "least": low, "largest": high},
            "noise": self.noise, "without_effect": list(self.inert),
            "refused": [{"setting": dict(setting), "message": message} for setting, message in self.refused],
            "untried": [dict(setting) for setting in self.untried], "complete": not self.untried, "reused": self.reused,
            "machine": machine()}

    @property
    def tolerances(self) -> list[float]:
        """The tolerances for which a setting is recommended: the requested one first, then those of the presets."""
        return list(dict.fromkeys([self.tolerance, *self.preset_tolerances.values()]))

    def _run(self, i: int) -> dict:
        run = self.runs[i]
        if run.failed:
            return {"setting": dict(run.setting), "input_hash": run.input_hash, "failed": run.failed}
        middle, mad, least, largest = self.seconds(i)
        return {"setting": dict(run.setting), "input_hash": run.input_hash, "seconds": middle, "mad": mad, "least": least,
                "largest": largest, "repeats": len(run.seconds), "memory": run.memory, "errors": dict(run.errors),
                "below_floor": run.error < self.floor_of_error, "achieved_error": run.achieved, "on_front": i in self.front,
                "content": run.content}
