"""Runs settings of one stage in a process of its own, where nothing else takes memory or time.

`Bench` does the work; `main` is the process around it: a line of JSON in, a line of JSON out.
"""

import gc
import json
import os
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from statistics import median
from typing import NamedTuple

from bakery.errors import BakeryError, StageError
from bakery.stages.conform import broken
from bakery.store.tree import Group
from bakery.system.memory import give_back
from bakery.trade.resolve import above, find, hash_of, hashes_above

BURST = 0.15  # seconds of baseline around a run, or one run where that takes longer


class Task(NamedTuple):
    """What is measured."""

    recipe: str  # its path
    stage: str  # name
    base: Mapping[str, str]  # overrides of the recipe in every setting (`--set`)
    upstream: Mapping[str, str]  # overrides under which the stages upstream are computed, once
    baseline: Mapping[str, str]  # overrides of the setting that is run around every other
    loosest: Mapping[str, str]  # overrides with which a run is short: one loads the kernels of a setting before its time is taken
    folder: str  # of the converged values and the values upstream
    stages: str  # `module:function` that returns all stages


class Bench:
    """Times and compares settings of one stage of one recipe.

    clock, wall : seconds of the processor and of the wall
    share : receives the share done of a run, 0 to 1
    """

    def __init__(self, task: Task, clock: Callable[[], float] = time.process_time, wall: Callable[[], float] = time.perf_counter,
                 share: Callable[[float], None] = lambda share: None):
        from bakery.run.cache import Cache

        self._task, self._clock, self._wall, self._share = task, clock, wall, share
        self._cache = Cache(Path(task.folder))
        self._groups: dict[str, Group] = {}
        self._hashes: dict[str, str] | None = None
        self._warm: set[str] = set()
        self._warm_baseline = False
        self._burst: float | None = None
        self._resolved: dict[str, tuple] = {}
        self._reference: tuple[str, Group] | None = None

    def keep(self, setting: Mapping[str, str], expected: str) -> dict:
        """Compute a setting and keep its values: seconds and the error that the stage claims."""
        entry = self._cache.get(self._task.stage, expected)
        if entry is None:
            group, seconds = self._compute(setting, expected)
            self._burst = None
            self._cache.put(self._task.stage, expected, group, Group({}, {"seconds": seconds}))
            entry = self._cache.get(self._task.stage, expected)
            if entry is None:
                raise StageError(f"{self._cache.path(self._task.stage, expected)}: the converged values could not be kept")
        return {"seconds": entry[1].attributes["seconds"], "achieved": entry[0].attributes["achieved_error"]}

    def compare(self, found: str, reference: str) -> dict[str, float]:
        """True errors of kept values against other kept values."""
        return self._errors(self._kept_group(found), self._kept_group(reference))

    def run(self, setting: Mapping[str, str], expected: str, reference: str | None) -> dict:
        """One timed run; with the key of a reference also errors and memory, which do not depend on the run."""
        from bakery.store.hashes import content_hash
        from bakery.system import resources

        self._load_kernels(setting)
        before = self._burst or self._around()
        if reference is not None:
            true = self._kept_group(reference)
            gc.collect()
            give_back()  # what earlier runs freed, or this run's peak would not show above it
            resident = resources.resident_memory()
            resources.reset_peak()
        started = self._wall()
        group, seconds = self._compute(setting, expected)
        measured = {"seconds": seconds, "wall": max(self._wall() - started, 1e-9)}
        if reference is not None:
            measured |= {"memory": max(resources.peak_memory() - resident, 0.0), "errors": self._errors(group, true),
                         "achieved": group.attributes["achieved_error"], "content": content_hash(Group(group.members))}
        del group
        self._burst = self._around()
        return measured | {"baseline": (before * self._burst) ** 0.5}

    def _load_kernels(self, setting) -> None:
        kind = json.dumps({key: text for key, text in setting.items() if key not in self._task.loosest})
        if kind in self._warm:
            return
        with suppress(BakeryError):  # the run itself will raise it
            self._compute({**setting, **self._task.loosest}, None)
        self._burst = None
        self._warm.add(kind)

    def _around(self) -> float:
        """Median time of the baseline, run until it has taken a while."""
        fixed = self._resolve(self._task.baseline, None)
        if not self._warm_baseline:
            self._timed(*fixed)  # loads its kernels
            self._warm_baseline = True
        times: list[float] = []
        while sum(times) < BURST and len(times) < 15:
            times.append(self._timed(*fixed)[1])
        return median(times)

    def _compute(self, setting, expected: str | None) -> tuple[Group, float]:
        return self._timed(*self._resolve(setting, expected), self._share)

    def _timed(self, stage, recipe, key: str, share=lambda share: None) -> tuple[Group, float]:
        from bakery.run.executors import Context

        tolerance = stage.tolerance(recipe)
        context = Context(tolerance, recipe.seed, report=lambda done, error=None, state="": share(done))
        started = self._clock()
        try:
            result = stage.compute(stage.inputs(recipe, self._groups), context)
        except MemoryError:
            raise StageError(f"{stage.name}: out of memory; a coarser tolerance or fewer wavelengths take less") from None
        seconds = max(self._clock() - started, 1e-9)
        group = Group(result.members, {"stage": stage.name, "stage_version": stage.version, "input_hash": key,
                                       "tolerance": tolerance, "achieved_error": float(result.achieved_error),
                                       "error_measure": stage.error_measure})
        if faults := broken(stage, group):
            raise StageError(f"{stage.name}: its values break the stage's own rules: " + "; ".join(faults))
        return group, seconds

    def _resolve(self, setting, expected: str | None):
        from bakery.recipe import load

        words = json.dumps(setting, sort_keys=True)
        if words not in self._resolved:
            hashes = self._upstream_hashes()
            recipe = load(self._task.recipe, {**self._task.base, **setting})
            stage = find(self._task.stages, recipe, self._task.stage)
            self._resolved[words] = (stage, recipe, hash_of(stage, recipe, hashes))
        stage, recipe, key = self._resolved[words]
        if expected is not None and key != expected:
            raise StageError(f"{self._task.recipe}: it, or a file that it names, changed while it was measured; start again")
        return stage, recipe, key

    def _upstream_hashes(self) -> dict[str, str]:
        """Hashes of the groups upstream, which are computed on the first call."""
        if self._hashes is None:
            from bakery.recipe import load

            recipe = load(self._task.recipe, {**self._task.base, **self._task.upstream})
            hashes = hashes_above(self._task.stages, recipe, self._task.stage)
            for stage in above(self._task.stages, recipe, self._task.stage):
                entry = self._cache.get(stage.name, hashes[stage.name])
                if entry is None:
                    group, seconds = self._timed(stage, recipe, hashes[stage.name])
                    self._cache.put(stage.name, hashes[stage.name], group, Group({}, {"seconds": seconds}))
                self._groups[stage.name] = entry[0] if entry else group
            self._hashes = hashes
        return self._hashes

    def _kept_group(self, key: str) -> Group:
        if self._reference is None or self._reference[0] != key:
            entry = self._cache.get(self._task.stage, key)
            if entry is None:
                raise StageError(f"{self._cache.path(self._task.stage, key)}: the converged values are gone; start again")
            self._reference = (key, entry[0])
        return self._reference[1]

    def _errors(self, group: Group, reference: Group) -> dict[str, float]:
        stage, _, _ = self._resolve(self._task.baseline, None)
        return {name: float(value) for name, value in stage.measures(group, reference).items()}


def main() -> None:
    """The process: arguments of `Bench` as the first line, then one call a line; ends with its input."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides; it ends this process
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # whatever a library prints must not look like an answer
    calls = _calls()
    last_report = [0.0]

    def share(done: float) -> None:
        if time.monotonic() - last_report[0] > 0.3:
            last_report[0] = time.monotonic()
            print(json.dumps({"share": done}), file=answers, flush=True)

    bench = Bench(Task(**next(calls)), share=share)
    for call in calls:
        try:
            answer = {"found": getattr(bench, call.pop("do"))(**call)}
        except BakeryError as error:
            answer = {"failed": str(error)}
        print(json.dumps(answer), file=answers, flush=True)


def _calls():
    """Calls as they come in; when the parent is gone the process ends at once, whatever it computes."""
    import queue
    import threading

    lines: queue.Queue = queue.Queue()

    def read():
        for line in sys.stdin:
            lines.put(json.loads(line))
        os._exit(0)

    threading.Thread(target=read, daemon=True).start()
    while True:
        yield lines.get()


if __name__ == "__main__":
    main()
