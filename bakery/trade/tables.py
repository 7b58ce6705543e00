"""A sweep in words and columns, from its machine-readable form."""

import shlex
from collections.abc import Iterable, Mapping, Sequence

from bakery.system.resources import duration, in_words
from bakery.system.terminal import table


def said(setting: Mapping[str, str]) -> str:
    """A setting as people read it."""
    return ", ".join(f"{key}={text}" for key, text in setting.items()) or "as it stands"


def options(setting: Mapping[str, str]) -> str:
    """A setting as options of `bake`."""
    return " ".join("--set " + shlex.quote(f"{key}={text}") for key, text in setting.items())


def columns(stages: Sequence[Mapping]) -> list[tuple[str, list]]:
    """trade.csv: one row a setting; empty cells where a setting failed or an error belongs to another stage."""
    names = list(dict.fromkeys(name for stage in stages for name in stage["errors"]))
    rows = [(stage, i, run) for stage in stages for i, run in enumerate(stage["runs"])]
    plain = ("seconds", "mad", "least", "largest", "repeats", "memory", "achieved_error")
    headings = {name: f"{name} [s]" for name in ("seconds", "mad", "least", "largest")} | {"memory": "memory [B]"}
    return [
        ("stage", [stage["stage"] for stage, _, _ in rows]),
        ("setting", [" ".join(f"{key}={text}" for key, text in run["setting"].items()) for _, _, run in rows]),
        *((headings.get(name, name), [run.get(name, "") for _, _, run in rows]) for name in plain),
        *((f"true {name}" if name != "error" else "true error", [run.get("errors", {}).get(name, "") for _, _, run in rows])
          for name in names),
        ("below_floor", [run.get("below_floor", "") for _, _, run in rows]),
        ("on_front", [run.get("on_front", "") for _, _, run in rows]),
        ("knee", [i == stage["knee"] for stage, i, _ in rows]),
        ("preset", [" ".join(name for name, at in stage["presets"].items() if at["run"] == i) for stage, i, _ in rows]),
        ("input_hash", [run["input_hash"] for _, _, run in rows]),
        ("failed", [run.get("failed", "") for _, _, run in rows]),
    ]


def report(stage: Mapping, recipe: str) -> Iterable[str]:
    """The lines that `bake trade` prints for a stage."""
    runs, floor = stage["runs"], stage["reference"]["floor"]
    yield f"{stage['stage']}: {stage['title']}"
    marks = _marks(stage)
    rows = [("front", "time", "memory", *stage["errors"], "")]
    for i in stage["front"]:
        run = runs[i]
        rows.append((said(run["setting"]), duration(run["seconds"]), in_words(run["memory"]),
                     *(_error(run["errors"][name], floor[name]) for name in stage["errors"]), ", ".join(marks.get(i, ()))))
    yield from ("  " + line for line in table(rows, right=range(1, len(rows[0]) - 1)))
    if stage["knee"] is None:
        yield "  knee: none, the front has no bend"
    else:
        yield f"  knee: {said(runs[stage['knee']]['setting'])}"
    for run in dict.fromkeys(entry["run"] for entry in stage["recommended"]):
        tolerances = [entry["tolerance"] for entry in stage["recommended"] if entry["run"] == run]
        yield "  " + _recommendation(stage, tolerances, run, recipe)
    for name, preset in stage["presets"].items():
        yield f"  {name} ({said(runs[preset['run']]['setting'])}): {_standing(stage, preset)}"
    yield from ("  " + line for line in _remarks(stage))


def _marks(stage: Mapping) -> dict[int, list[str]]:
    """What else a run is, by its index."""
    marks: dict[int, list[str]] = {}
    for name, preset in stage["presets"].items():
        marks.setdefault(preset["run"], []).append(name)
    if stage["start"] not in marks:
        marks[stage["start"]] = ["as it stands"]
    if stage["knee"] is not None:
        marks.setdefault(stage["knee"], []).append("knee")
    return marks


def _error(error: float, floor: float) -> str:
    return f"<{floor:.1g}" if error < floor else f"{error:.2g}"


def _recommendation(stage: Mapping, tolerances: Sequence[float], at: int | None, recipe: str) -> str:
    target = f"{next(iter(stage['errors']))} of {' or '.join(f'{100 * share:.4g} %' for share in sorted(tolerances))}: "
    if at is None:
        return target + "no setting that was run reaches it"
    run, start = stage["runs"][at], stage["runs"][stage["start"]]
    command = " ".join(filter(None, ("bake", shlex.quote(recipe), options(run["setting"]))))
    error = _error(run["errors"][stage["errors"][0]], stage["reference"]["floor"][stage["errors"][0]])
    against = f", {start['seconds'] / run['seconds']:.2g} times as fast as it stands" if run is not start else ""
    return f"{target}{command}  ({duration(run['seconds'])}, error {error}{against})"


def _standing(stage: Mapping, preset: Mapping) -> str:
    if preset["dominated_by"] is None:
        return "on the front"
    run, better = stage["runs"][preset["run"]], stage["runs"][preset["dominated_by"]]
    return (f"beaten by {said(better['setting'])}: {run['seconds'] / better['seconds']:.2g} times as fast, "
            f"error {next(iter(better['errors'].values())):.2g} instead of {next(iter(run['errors'].values())):.2g}")


def _remarks(stage: Mapping) -> Iterable[str]:
    reference, baseline = stage["reference"], stage["baseline"]
    name, floor = next(iter(reference["floor"].items()))
    yield (f"{name}: against converged values ({said(reference['setting'])}, {duration(reference['seconds'])}, which claim "
           f"{reference['achieved']:.1g}); below {floor:.1g} errors are not distinguished")
    yield (f"times: of one core, medians relative to {said(baseline['setting'])}, which took {duration(baseline['seconds'])} "
           f"and drifted between {baseline['least']:.2f} and {baseline['largest']:.2f} of that; "
           f"noise of a run {100 * stage['noise']:.1f} %")
    count = len(stage["runs"])
    yield f"{count} settings" + (f", {stage['reused']} of them kept from before" if stage["reused"] else "")
    if stage["without_effect"]:
        yield "no effect as the recipe stands: " + ", ".join(stage["without_effect"])
    for run in stage["runs"]:
        if "failed" in run:
            yield f"failed: {said(run['setting'])}: {run['failed']}"
    for entry in stage["refused"]:
        yield f"not for this recipe: {said(entry['setting'])}: {entry['message']}"
    if stage["untried"]:
        yield (f"not finished: {len(stage['untried'])} more settings would take longer than the --budget; "
               "the same call with a larger one continues")
