"""Error against time over the knobs of every stage, measured: what `bake trade` does.

For each stage that declares values for its knobs and how to compare its results: settings are run in a process of their own
(`worker.py`), errors taken against converged values, times corrected by a baseline (`times.py`), the next setting chosen by what
can still move the front (`search.py`), until the cheapest setting for each tolerance is known (`front.py`).
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bakery.errors import UsageError

if TYPE_CHECKING:
    from bakery.run.progress import Progress
    from bakery.trade.result import Sweep

STAGES = "bakery.stages:all_stages"
BUDGET = 5.0  # minutes
LONGEST = 1e6  # minutes, two years: clocks count no further than they have to


@dataclass(frozen=True)
class Trade:
    """What was measured: a sweep for each stage, and the files that hold it."""

    recipe: str
    folder: Path
    sweeps: tuple[Sweep, ...]
    files: tuple[Path, ...]

    def as_dict(self) -> dict:
        """The same for machines (`--json`, trade.json)."""
        return {"recipe": self.recipe, "stages": [sweep.as_dict() for sweep in self.sweeps]}


def check_budget(budget: float) -> None:
    """UsageError unless it is a time in minutes."""
    if not 0 < budget <= LONGEST:
        raise UsageError(f"--budget: found {budget:g}; expected a number of minutes above 0, at most {LONGEST:,.0f}")


def trade(recipe: str | os.PathLike, output: str | os.PathLike | None = None, *, stages: Sequence[str] = (),
          quality: str | None = None, tolerance: str | float | None = None, seed: str | int | None = None,
          settings: Mapping[str, str] | None = None, budget: float = BUDGET, progress: Progress | None = None,
          measure: str | None = None, verbose: bool = False, overwrite: bool = False) -> Trade:
    """Measure error against time over the knobs of a recipe's stages, and write a table, a picture a stage, and all figures.

    Parameters
    ----------
    output : folder, NAME.trade by default; a second call with it goes on where the first ended
    stages : names, all that have knobs by default
    quality, tolerance, seed, settings : override recipe values as for a bake; the tolerance is the requested one
    measure : name of the error that ranks settings and meets tolerances; the first of each stage by default
    budget : minutes, for all stages together
    progress, verbose : receives the progress, and whether that of each run
    overwrite : replace also files of other kinds that stand where the results go

    Raises
    ------
    RecipeError : with every problem of the recipe
    UsageError : no stage of the recipe has knobs, the folder cannot be written, or the budget is too small for anything
    StageError : a stage fails as the recipe stands, or has no converged values
    """
    from bakery.draw.files import folder_filled
    from bakery.grammar.qualities import QUALITIES
    from bakery.recipe import load
    from bakery.run import files_of, overrides
    from bakery.run.progress import Progress
    from bakery.store.outputs import by_suffix, check_outputs
    from bakery.trade.settings import Job, text_of
    from bakery.trade.sweep import Sweeper

    check_budget(budget)
    base = overrides(quality, tolerance, seed, settings)
    # a preset is what its name says beyond the recipe; `final` is the recipe's own
    presets = {name: overrides(name) for name in QUALITIES}
    if quality is not None:
        leaves = load(recipe, overrides(None, tolerance, seed, settings)).leaves
        presets["final"] = {key: text_of(leaves[key]) for key in overrides(quality) if key in leaves}
    checked = load(recipe, base).unswept()
    chosen = _with_knobs(checked, stages)
    folder = Path(output) if output else Path(f"{checked.path.stem}.trade")
    progress = progress or Progress()
    for warning in checked.warnings:
        progress.say(f"warning: {warning}")
    sweeps, seconds_left = [], 60.0 * budget
    with folder_filled(folder), folder_filled(folder / "runs"), folder_filled(folder / "reference"):
        names = ("trade.json", "trade.csv", *(f"{stage.name}.png" for stage in chosen))
        check_outputs(by_suffix(folder / name for name in names), files_of(checked), overwrite)
        for count, stage in zip(range(len(chosen), 0, -1), chosen, strict=True):
            sweeper = Sweeper(Job(Path(recipe), stage.name, base, presets, folder, STAGES), seconds_left / count, progress,
                              verbose=verbose, rank=measure)
            try:
                sweeps.append(sweeper.sweep())
            finally:
                sweeper.close()
            seconds_left = max(seconds_left - (seconds_left / count - sweeper.left), 1.0)
        return _written(Trade(os.fspath(recipe), folder, tuple(sweeps), ()))


def _with_knobs(recipe, names: Sequence[str]) -> list:
    """The stages to measure."""
    from bakery.trade.resolve import all_of

    applicable = [stage for stage in all_of(STAGES) if stage.applies(recipe)]
    able = [stage for stage in applicable if stage.measures and any(knob.values for knob in stage.knobs)]
    for name in names:
        if name not in [stage.name for stage in applicable]:
            stages = ", ".join(stage.name for stage in applicable)
            raise UsageError(f'--stage: found "{name}"; this recipe has the stages {stages}')
    chosen = [stage for stage in able if not names or stage.name in names]
    if not chosen:
        subject = " and ".join(names) if names else f"none of its stages ({', '.join(stage.name for stage in applicable)})"
        able_names = f"; expected {', '.join(stage.name for stage in able)}" if able else ": its values are exact or take no time"
        raise UsageError(f"{recipe.path}: {subject} has knobs that trade time for accuracy{able_names}" if not names else
                         f"--stage: {subject} has no knobs that trade time for accuracy{able_names}")
    return chosen


def _written(trade: Trade) -> Trade:
    """The same with its files written."""
    from bakery.draw.files import csv_text
    from bakery.draw.picture import drawn
    from bakery.store.put import put
    from bakery.trade.picture import picture
    from bakery.trade.tables import columns

    report = trade.as_dict()
    files = [put(trade.folder / "trade.json", json.dumps(report, indent=1, allow_nan=False) + "\n"),
             put(trade.folder / "trade.csv", csv_text(columns(report["stages"])))]
    for stage in report["stages"]:
        files.append(put(trade.folder / f"{stage['stage']}.png", drawn(picture(stage), ("png",), report["recipe"])["png"]))
    return Trade(trade.recipe, trade.folder, trade.sweeps, tuple(files))
