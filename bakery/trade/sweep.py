"""The sweep over the knobs of one stage: converged values, then settings until the front is known or the time is up."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from statistics import median

from bakery.errors import StageError, UsageError
from bakery.run.progress import Progress
from bakery.system.resources import duration
from bakery.trade.process import Died, OutOfTime, Worker
from bakery.trade.result import Sweep, seen_of
from bakery.trade.runs import Run, Store
from bakery.trade.search import Setting, proposals, start_of
from bakery.trade.settings import Job, Settings
from bakery.trade.tables import said
from bakery.trade.times import least_repeats, repeat_again

TIGHTER = (4.0, 2.0, 1.0)  # converged values have the tightest tolerance requested over one of these: the first that is in reach
CHECK = 3.0  # times that tolerance: second converged values, whose distance from the first bounds the error of the first
SHARE = 0.5  # of the budget that the converged values may take
HOPELESS = 2.0  # times slower than a more accurate setting: then its time need not be known better
ENDLESS = 20.0  # times longer than expected: a run is stopped
GRACE = 5.0  # seconds beyond the budget that a run may take to end


class Sweeper:
    """Measures one stage.

    budget : seconds
    bench : `Worker`, or what answers like it
    now : seconds, for the budget
    verbose : report each run
    rank : name of the error that ranks; the stage's first by default
    """

    def __init__(self, job: Job, budget: float, progress: Progress | None = None, bench: Callable = Worker,
                 now: Callable[[], float] = time.monotonic, verbose: bool = False,
                 rank: str | None = None):
        self.job, self.progress, self.settings = job, progress or Progress(), Settings(job)
        self._budget, self._now, self._started = budget, now, now()
        self._make_bench, self._bench = bench, None
        self._store = Store(job.folder / "runs")
        self._began, self._coming = self._started, budget
        self._measured: dict[Setting, Run] = {}
        self._reused, self._speed, self._verbose, self._rank = 0, 1.0, verbose, rank

    @property
    def left(self) -> float:
        """Seconds of the budget that are left."""
        return self._budget - (self._now() - self._started)

    def close(self) -> None:
        """End the worker."""
        if self._bench is not None:
            self._bench.close()
            self._bench = None

    def sweep(self) -> Sweep:
        """Measure until no further run can change what is recommended, or the budget is spent.

        Raises
        ------
        StageError : no converged values can be had
        UsageError : they would take more than the budget
        """
        settings, stage = self.settings, self.settings.stage
        presets = {name: settings.preset(name) for name in self.job.presets}
        preset_tolerances = {name: stage.tolerance(settings.load(overrides)) for name, overrides in self.job.presets.items()}
        limits = sorted({stage.tolerance(settings.recipe), *preset_tolerances.values()})
        self.progress.stage(stage.name, stage.title, 0.0, self._budget)
        reference, floor = self._reference(limits[0])
        self._began = self._now()
        too_long: set[Setting] = set()
        refused: set[Setting] = set()
        while True:
            seen = seen_of(self._measured) | dict.fromkeys(too_long | refused)
            proposed = proposals(settings.ladders, list(presets.values()), limits, seen, next(iter(floor.values())))
            if not proposed:
                break
            if not settings.allowed(settings.overrides(proposed[0])):
                refused.add(proposed[0])
                continue
            self._show(proposed)
            run = self._run(proposed[0], reference["input_hash"])
            if run is None:
                too_long.add(proposed[0])
            else:
                self._measured[proposed[0]] = run
        return self._result(presets, preset_tolerances, reference, floor, too_long)

    # ---- converged values

    def _reference(self, tightest: float) -> tuple[dict, Mapping[str, float]]:
        """Converged values, kept on disk, and how far they are from others that should be as good: a floor for each error."""
        refusal, kind = "", StageError
        for part in TIGHTER:
            tolerance = tightest / part
            upstream = self.settings.upstream(tolerance)
            stage = self.settings.stage
            pair = [{**stage.reference, "tolerance": f"{at:.10g}", stage.tolerance_key: f"{at:.10g}"}
                    for at in (tolerance, min(CHECK * tolerance, 0.5))]
            keys = [self.settings.hash(overrides) for overrides in pair]
            folder = self.job.folder / "reference"
            seconds = sum(self.settings.expected(overrides) for overrides, key in zip(pair, keys, strict=True)
                          if not (folder / f"{self.settings.stage.name}-{key}.h5").is_file())
            if seconds > SHARE * self.left:
                kind = UsageError
                refusal = f"they take about {duration(seconds)}; use --budget {-(-seconds // (60 * SHARE)):.0f}"
                self._say(f"no converged values at a tolerance of {tolerance:.2g}: {refusal}")
                continue
            self._open(upstream, str(folder))
            try:
                converged = [self._bench.keep(overrides, key, limit=self.left + GRACE)
                             for overrides, key in zip(pair, keys, strict=True)]
                floor = self._ranked(self._bench.compare(keys[1], keys[0], limit=self.left + GRACE))
            except OutOfTime:
                refusal, kind = "they were not ready in time; use a larger --budget", UsageError
            except StageError as error:
                self.settings.refuse_changes()
                refusal, kind = str(error), StageError
            else:
                self._say(f"converged values at a tolerance of {tolerance:.2g}: {duration(converged[0]['seconds'])}, "
                          f"claimed error {converged[0]['achieved']:.2g}, true error within {next(iter(floor.values())):.2g}")
                leaves = self.settings.recipe.leaves
                reference_leaves = self.settings.load(pair[0]).leaves
                changed = {key: text for key, text in pair[0].items() if reference_leaves.get(key) != leaves.get(key)}
                return {"setting": changed, "input_hash": keys[0], "check": pair[1], **converged[0]}, floor
            self._say(f"no converged values at a tolerance of {tolerance:.2g}: {refusal}")
        raise kind(f"{self.job.recipe}: {self.settings.stage.name}: there are no converged values to compare with: {refusal}")

    def _open(self, upstream: Mapping[str, str], folder: str) -> None:
        self.close()
        job, settings = self.job, self.settings
        self._baseline = dict(next(iter(job.presets.values())))
        loosest = {ladder.key: ladder.texts[0] for ladder in settings.ladders if ladder.key == settings.stage.tolerance_key}
        self._bench = self._make_bench(
            recipe=str(job.recipe), stage=job.stage, base=dict(job.base), upstream=upstream, baseline=self._baseline,
            loosest=loosest, folder=folder, stages=job.stages, share=lambda share: self._show(()))

    # ---- runs

    def _run(self, setting: Setting, reference: str) -> Run | None:
        """Measure a setting, or read it; None where the time does not suffice."""
        overrides = self.settings.overrides(setting)
        key = self.settings.hash(overrides)
        path = self._store.path(self.job.stage, key, reference, self.settings.hash(self._baseline))
        stored = self._store.load(path, self.job.stage, key)
        run = stored or Run(self.job.stage, key, overrides)
        run = replace(run, setting=overrides)  # one input may have been reached by other words
        patience, lasting = self.left, True
        try:
            while not run.failed and repeat_again(run.seconds, run.ratios, self._hopeless(run)):
                expected = run.seconds[0] if run.seconds else self._speed * self.settings.expected(overrides)
                if expected * (1 if run.seconds else least_repeats(expected)) > self.left:
                    break
                patience = ENDLESS * max(expected, 1.0) + 30
                repeat = self._bench.run(overrides, key, None if run.seconds else reference,
                                         limit=min(patience, self.left + GRACE))
                run = run.with_repeat(repeat)
                self._store.save(path, run)
        except OutOfTime:
            if patience <= self.left and not run.seconds:
                run = replace(run, failed=f"stopped after {duration(patience)}, more than {ENDLESS:g} times as long as expected")
        except StageError as error:
            self.settings.refuse_changes()
            run = replace(run, failed="" if run.seconds else str(error))
            lasting = not isinstance(error, Died)
        if run.failed and not stored and lasting:
            self._store.save(path, run)
        if not run.failed and not run.seconds:
            return None
        run = replace(run, errors=self._ranked(run.errors)) if run.errors else run
        self._reused += stored is not None
        self._tell(run, stored is not None)
        return run

    def _hopeless(self, run: Run) -> bool:
        if not run.seconds:
            return False
        ratio, error = median(run.ratios), next(iter(self._ranked(run.errors).values()))
        return any(setting.error <= error and HOPELESS * median(setting.ratios) < ratio for setting in self._good())

    def _ranked(self, errors: Mapping[str, float]) -> dict[str, float]:
        """The errors with the one that ranks first."""
        rank = self._rank or next(iter(errors))
        if rank not in errors:
            raise UsageError(f'--measure: found "{rank}"; {self.settings.stage.name} measures {", ".join(errors)}')
        return {rank: errors[rank], **errors}

    def _good(self) -> list[Run]:
        return [run for run in self._measured.values() if not run.failed]

    # ---- words

    def _tell(self, run: Run, reused: bool) -> None:
        good = [r for r in (*self._good(), run) if not r.failed and self.settings.expected(r.setting) > 0]
        if good:
            self._speed = median(median(r.seconds) / self.settings.expected(r.setting) for r in good)
        if not self._verbose:
            return
        outcome = f"failed: {run.failed}" if run.failed else f"{duration(median(run.seconds))}, error {run.error:.2g}"
        self._say(f"{said(run.setting)}: {outcome}{' (kept from before)' if reused else ''}")

    def _say(self, text: str) -> None:
        self.progress.say(f"{self.settings.stage.name}: {text}")

    def _show(self, proposed: Sequence[Setting]) -> None:
        """How far it is: the values of each knob alone are still to come, at the pace so far, or what is left of the budget."""
        if proposed:
            alone = sum(len(ladder.texts) - 1 for ladder in self.settings.ladders)
            finished = len(self._measured) - self._reused
            pace = (self._now() - self._began) / finished if finished else self._budget
            self._coming = pace * max(alone - len(self._measured), len(proposed), 1)
        spent = self._now() - self._started
        self.progress.update(spent / (spent + max(min(self._coming, self.left), 0.1)))

    def _result(self, presets, preset_tolerances, reference, floor, too_long) -> Sweep:
        settings = list(self._measured)
        if start_of(self.settings.ladders) not in settings:
            raise UsageError(f"{self.job.recipe}: {self.settings.stage.name}: the time was not enough for the recipe as it "
                             "stands; the same call with a larger --budget continues")
        if self._measured[start_of(self.settings.ladders)].failed:
            raise StageError(f"{self.job.recipe}: as it stands: {self._measured[start_of(self.settings.ladders)].failed}")
        self.progress.done(self.settings.stage.name, f"{len(settings)} settings, {self._reused} of them kept from before")
        stage = self.settings.stage
        return Sweep.of(
            stage=stage, tolerance=stage.tolerance(self.settings.recipe), preset_tolerances=preset_tolerances,
            ladders=self.settings.ladders,
            measured=self._measured, presets={name: settings.index(at) for name, at in presets.items() if at in settings},
            reference=reference, floor=floor, baseline=self._baseline, refused=self.settings.refused,
            untried=[self.settings.overrides(setting) for setting in sorted(too_long)], reused=self._reused)
