"""One scene by several methods: which there are, their pictures in a folder, and records with which a later call goes on.

Beside the pictures of a method, `METHOD.png` and `METHOD.exr`, stands `METHOD.json`: what they were made of, whether they are
finished, the report, and the time that they took.
"""

import dataclasses
import json
import re
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from zlib import crc32

import bakery
from bakery.errors import Interrupted, UsageError
from bakery.grammar import fields
from bakery.store.put import put
from renderers import choice, scene
from renderers.pictures import denoise
from renderers.pictures.pace import Pace, Paced
from renderers.pictures.progressive import fingerprint, made_of
from renderers.pictures.reached import coarser, limit
from renderers.scene import assets, candidates, entries

_LITTLE = 0.05  # share of the time that compiling may take of what was meant for passes
_OWN = re.compile(r"materials\[\d+\]\.method")
_MOST = 1e15  # of any number in a record
_ENOUGH = 0.8  # share of the time that passes were to take, with which they are not gone on with: each call prepares anew


@dataclasses.dataclass(frozen=True)
class Job:
    """A method that is to be rendered.

    name : of the method, with what else it sets
    scene : with the method set, not baked
    pair : paths (PNG, EXR) of its pictures
    seed : of its passes; None where the renderer takes none
    """

    name: str
    scene: scene.Scene
    pair: tuple[Path, Path]
    seed: int | None

    @property
    def record(self) -> Path:
        """Where its record is kept."""
        return self.pair[0].with_suffix(".json")


@dataclasses.dataclass(frozen=True)
class Made:
    """The pictures of a method.

    job : `Job`
    report : of the renderer; its `seconds` are those of all calls, `earlier` among them those before interruptions
    processor : s, of all processors, without compiling
    compiling : s, of the clock, that went into compiling kernels
    pace : of the passes, `renderers.pictures.pace.Paced`
    taken : whether they were there already
    anew : whether what was there was to be gone on with, and could not, as it is made of something else
    """

    job: Job
    report: dict
    processor: float
    compiling: float
    pace: Paced
    taken: bool
    anew: bool = False

    @property
    def clock(self) -> float:
        """Seconds of the clock, without compiling."""
        return self.report["seconds"]["total"] - self.compiling


def jobs(path, names: Sequence[str], folder, settings, seed=None) -> list[Job]:
    """What is to be rendered, all of it checked; nothing is rendered or baked.

    Parameters
    ----------
    path : of a scene
    names : of methods, all different; `METHOD:KEY=VALUE` also sets keys beside that of the method, or dotted ones, and may stand
        beside the method as it is
    folder : of the pictures; need not be there
    settings : dotted key -> value as text
    seed : of the passes; each method has its own, from this one and its name, so that noise is independent

    Raises
    ------
    UsageError : a method is not known, stands twice, or is set by `settings`
    RecipeError : with every problem of the scene, also of a method's
    """
    loaded = scene.load(path, settings)
    rules, (key, methods) = loaded.rules, loaded.rules.CHOICE
    listed = len(loaded.materials) if loaded.section in scene.OF_MATERIALS else 0
    if given := [setting for setting in settings if setting == key or listed and _OWN.fullmatch(setting)]:
        raise UsageError(f"--set {given[0]}: the methods are those of --methods; leave it out")
    if unknown := [method for method in (name.partition(":")[0] for name in names) if method not in methods]:
        raise UsageError(f'found "{unknown[0]}", which is no method of this scene; expected {fields.one_of(methods)}'
                         f"{fields.nearest(unknown[0], methods)}{_of_entries(loaded)}")
    of_method = {name: _settings(name, key, listed) for name in names}
    stems = [re.sub(r"[^\w.+=-]", "_", name) for name in names]  # of files
    for name, stem in zip(names, stems):
        if stems.count(stem) > 1:
            raise UsageError(f"found {name} twice; use each method once")
    # a filter has no passes: with the same noise in what it filters its methods compare best
    seeds = [(seed or 0) + _place(name, of_method[name][key], methods) if rules.RESUMES else seed for name in names]
    loaded = [denoise.without(scene.load(path, {**settings, **of_method[name]})) for name in names]
    return [Job(name, of_scene, tuple(Path(folder, stem + suffix) for suffix in (".png", ".exr")), own_seed)
            for name, stem, of_scene, own_seed in zip(names, stems, loaded, seeds)]


def _of_entries(loaded) -> str:
    """Of a scene whose method is that of each entry: which these have."""
    if loaded.section != "mixed":
        return ""
    kinds: dict[str, int] = {}
    for number, entry in enumerate(loaded.values.materials):
        kinds.setdefault(entry.kind, number)
    able = {kind: candidates.beside(kind) for kind in kinds}
    listed = "; ".join(f"{entries.KINDS[kind]}: {fields.one_of(names)}" for kind, names in able.items())
    kind, names = max(able.items(), key=lambda pair: len(pair[1]))
    if len(names) == 1:
        return f", which is {names[0]} here, alone or with other settings, such as auto:stop.samples=64"
    return f"; methods of its entries ({listed}) are set beside it, such as auto:materials[{kinds[kind]}].method={names[-1]}"


def _settings(name, key, listed) -> dict[str, str]:
    """Dotted key -> value of `METHOD:KEY=VALUE:…`; keys of entries are set in all of them, of which there are `listed`."""
    method, *further = name.split(":")
    settings, section = {key: method}, key.rpartition(".")[0]
    for setting in further:
        beside, equals, value = setting.partition("=")
        if not equals or not beside:
            raise UsageError(f'found "{name}"; expected METHOD:KEY=VALUE, of a key beside {key}')
        if listed and re.split(r"[.\[]", beside)[0] in entries.Entry.model_fields:
            settings |= {f"materials[{i}].{beside}": value for i in range(listed)}
        else:
            settings[beside if "." in beside or not section else f"{section}.{beside}"] = value
    return settings


def _place(name, method, methods) -> int:
    """A number for each name, which does not depend on what it is compared with."""
    return methods.index(method) + (0 if name == method else len(methods) * (1 + crc32(name.encode()) % 1_000_000))


def render(job: Job, *, quality=None, variant=None, resume=False, force=False, overwrite=False, progress=None,
           compiled: Callable[[], tuple[float, float]] = lambda: (0.0, 0.0), asked: float = 0.0) -> Made:
    """The pictures of a method: those that are there where they are finished, else rendered, on from where they were interrupted.

    Parameters
    ----------
    job : of `jobs`, its scene baked
    quality, variant : as the renderers take them
    resume : go on also with samples that an earlier call thought enough, where they are of the same
    force : render anew
    progress : function of (fraction 0 to 1, noise or None)
    compiled : seconds that went into compiling kernels so far, of the clock and of the processors
    asked : what the record is to keep of how long passes were to take, s

    Raises
    ------
    Interrupted : what is there was written, and the same call goes on with it
    BakeryError : as the renderer
    """
    this, stop = _made_of(job, quality, variant), job.scene.values.stop.model_dump(mode="json") | {"quality": quality}
    kept = {} if force else _kept(job)
    same = kept.get("made_of") == this
    enough = same and kept["finished"] and kept["stop"] == stop
    if enough and kept["display"] == _display(job):
        return _taken(job, kept)
    # the PNG alone is to be another: no passes, or few
    on = same and (not kept["finished"] or resume or enough and job.scene.rules.RESUMES)
    on = on or (resume and not kept and job.pair[1].is_file())  # without a record the EXR says whether it is the same
    spent = {key: kept.get(key, 0.0) if on else 0.0 for key in ("seconds", "processor", "compiling")}
    begin, before = _clocks(compiled), _stamp(job.pair[1])
    pace = Pace(progress, lambda: _clocks(compiled)[1], kept["pace"][0] if on and kept else 0.0)

    def keep(finished, paced, **extra):
        values = {key: spent[key] + end - start for key, start, end in zip(spent, begin, _clocks(compiled))} | {"pace": paced}
        kept = {"made_of": this, "stop": stop, "display": _display(job), "finished": finished,
                "picture": fingerprint(job.pair[1]), **values, **extra}
        put(job.record, json.dumps(kept, indent=1, allow_nan=False) + "\n")
        return values

    def drawn(method, on):
        return method.drawn_by.render(
            method, job.pair[0], quality=quality, variant=variant, seed=job.seed, overwrite=overwrite, progress=pace,
            **({"resume": True} if on else {}))

    try:
        report = drawn(job.scene, on)
        report = _with_lost_time(job, report, compiled()[0] - begin[2], quality, drawn)
    except Interrupted as error:
        if _stamp(job.pair[1]) != before:
            keep(False, pace.interrupted())
        raise Interrupted(f"interrupted while rendering {job.name}; what is rendered is kept in {job.pair[0].parent}, and the "
                          "same call goes on with it").ending(error.exit_status) from None
    if on:
        report["seconds"] = {"earlier": spent["seconds"]} | report["seconds"]
        report["seconds"]["total"] += spent["seconds"]
    paced = pace.paced(report.get("parts") or {})
    if job.scene.choice is not None:  # made before this call, of which a render by itself makes it
        paced = paced._replace(setup=paced.setup + job.scene.choice.spent)
    values = keep(True, paced, report=report, asked=asked)
    return Made(job, report, values["processor"], values["compiling"], values["pace"], False, resume and not on and bool(kept))


def _with_lost_time(job, report, lost, quality, drawn):
    """The report of a render, which went on for as long as kernels were compiled (`lost`, s) where its time stopped it.

    drawn : function of (scene, whether it goes on) -> report
    """
    if report.get("stopped_by") != "time" or lost <= _LITTLE * report["seconds"]["total"]:
        return report
    # its time is for passes: a machine that has the kernels already would have used it for them
    more_time = min(lost, limit(job.scene.values.stop.time, quality)) * coarser(quality) ** 2
    longer = job.scene.values.stop.model_copy(update={"time": more_time})
    return _together(report, drawn(_stopping(job, longer).scene, True))


def measured(job: Job, noise: float, seconds: float, **options) -> Made:
    """The pictures of a method until a noise is reached, or passes took so long, with those of all earlier calls.

    job : of `jobs`, its scene baked; what it says of when to stop does not count
    noise : relative, of what the scene's `measure` says
    seconds : of the clock
    options : as of `render`, without `resume`, `force`, `quality` and `variant`
    """
    kept = _kept(job)
    if kept.get("made_of") != _made_of(job, None, None):
        kept = {}
    resumable = bool(kept) and job.scene.rules.RESUMES
    spent = kept["seconds"] - kept["compiling"] if resumable else 0.0
    if kept and kept["finished"] and kept["display"] == _display(job):
        # the last pass may have been too long for what was left of the time
        longest = max(spent, kept.get("asked", 0.0))
        if not resumable or longest >= _ENOUGH * seconds or _noise(job, kept["report"]) <= noise:
            return _taken(job, kept)
    stop = job.scene.values.stop.model_copy(update={"noise": noise, "time": max(seconds - spent, 0.0), "samples": None})
    # a method that chooses does so for the render that the scene asks for: so short a one would have no pilots
    taken = choice.of_scene(job.scene, picture=job.pair[1] if resumable else None)
    # whole passes: of small ones launches are most of the time.  Of paths through milk, 32 x 24, they foretold 6 times the time
    whole = dataclasses.replace(job, scene=dataclasses.replace(job.scene, whole=True, choice=taken))
    rendered = render(_stopping(whole, stop), resume=resumable, asked=seconds, **options)
    if not job.scene.rules.RESUMES and rendered.clock < seconds / 2:
        return render(whole, force=True, **options)  # without what Mitsuba compiled
    return dataclasses.replace(rendered, job=job)  # the same call again is to choose as this one did


def _noise(job, report) -> float:
    """The one that stops the passes, 0 where it is not known: of pixels, or of the means of regions that share it."""
    pixels = "pixel_noise" if job.scene.values.measure == "pixels" else "noise"
    return max(report.get(key) or 0.0 for key in (pixels, "noise_region", "noise_mean"))


def _taken(job, kept):
    # paths are of this call: an earlier one may have been made from another folder
    assets = dict.fromkeys(map(str, job.scene.assets))
    inputs = {"scene": str(job.scene.path), "asset": ", ".join(assets), "files": [str(path) for path in job.pair]}
    return Made(job, kept["report"] | inputs, kept["processor"], kept["compiling"], Paced(*kept["pace"]), True)


def _stopping(job, stop):
    return dataclasses.replace(job, scene=dataclasses.replace(
        job.scene, values=job.scene.values.model_copy(update={"stop": stop})))


def _together(report, later):
    """The report of a render that went on, with the time of both."""
    parts = {**report["seconds"], **later["seconds"]}
    return later | {"seconds": {name: report["seconds"].get(name, 0.0) + later["seconds"].get(name, 0.0) for name in parts}}


def _clocks(compiled):
    """Seconds of the clock, of the processors without compiling, and of compiling."""
    clock, processors = compiled()
    return time.monotonic(), time.process_time() - processors, clock


def _stamp(path):
    return path.stat().st_mtime_ns if path.exists() else None


def _kept(job) -> dict:
    """The record of a method; {} where none stands beside its pictures, or none that is whole and of the pictures that stand."""
    if not all(path.is_file() for path in job.pair):
        return {}
    try:
        kept = json.loads(job.record.read_text(encoding="utf-8"))
        numbers = [float(value) for value in (*(kept[key] for key in ("seconds", "processor", "compiling")),
                                              *Paced(*kept["pace"]))]
        whole = (kept["picture"] == fingerprint(job.pair[1]) and all(0 <= number < _MOST for number in numbers)
                 and isinstance(kept["made_of"], str))
        return kept if whole and (not kept["finished"] or kept["report"]["seconds"]) else {}
    except (OSError, ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
        return {}


def _made_of(job, quality, variant) -> str:
    """What the passes of a method depend on; not what stops them, which of a renderer of passes is all that the quality does."""
    values, *files = made_of(job.scene)
    return fingerprint(values, [None if job.scene.rules.RESUMES else quality, variant, job.seed, bakery.__version__],
                       [bakery.open(path).content_hash for path in dict.fromkeys(job.scene.assets)], *files)


def _display(job) -> dict:
    """How the PNG of a method shows its picture."""
    return job.scene.values.display.model_dump(mode="json")


def baked(job: Job, progress=None) -> Job:
    """The job with the assets of its scene, as `renderers.scene.assets.baked`."""
    return dataclasses.replace(job, scene=assets.baked(job.scene, progress))
