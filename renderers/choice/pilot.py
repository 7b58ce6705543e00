"""What a render of a scene will take and give, by pilots: small pictures of a few passes, or a few passes of a filter's picture.

What passes take and the noise that they leave are those by which `auto` chose, of the same pilot, or of a longer one where that
tells little; of a renderer that is no material's, seconds by the pixels, and noise at as many samples a pixel.  What comes before
the passes takes as long as in a small picture.  Memory is at most what that held a pixel, and what the process had.
"""

from __future__ import annotations

import dataclasses
import math
import time
import tracemalloc
from collections.abc import Mapping
from functools import partial
from typing import NamedTuple

import numpy as np

from bakery.errors import Interrupted
from bakery.store import scratch
from bakery.system import resources
from renderers import choice
from renderers.choice import trial
from renderers.mitsuba import variants
from renderers.pictures import denoise, reached
from renderers.pictures.engine import TRUSTED, in_time, shares
from renderers.pictures.means import LEAST
from renderers.pictures.pace import shared_out
from renderers.scene import OF_MATERIALS, candidates

TINY, LARGE = 16**2, 96**2  # pixels: to compile, and of the pilots; smaller ones are not linear yet
SECONDS = 2.0  # of the passes of each
LONGER, _VAGUE = 6.0, 0.5  # s of a pilot, where the shorter one knows seconds to a noise no better than by that logarithm
_PASSES = 16  # that extrapolated parts have: as many as tell the concentration of their noise (`renderers.pictures.pace`)


class Forecast(NamedTuple):
    """What a picture is expected to be.

    Attributes
    ----------
    size : pixels (width, height)
    seconds : of the clock, of the whole render; without compiling and bakes
    passes : of these, those of the passes
    noise : relative, of what the scene's `measure` says; None where it is not known
    wanted : noise that ends the passes; None where none does
    spread : standard error of the logarithm of the time to a noise
    stopped_by : `noise`, `samples` or `time`; "" of a renderer without passes
    memory : bytes of the process at its peak
    method : of the renderer
    missed : sentences, what the scene asks for and will not get
    remarks : sentences, what it gets less of than by default
    pilot : what was measured: `size`, `passes`, `seconds`, `noise`
    choice : sentences, how `auto` chose the method; () where it did not
    """

    size: tuple[int, int]
    seconds: float
    passes: float
    noise: float | None
    wanted: float | None
    spread: float
    stopped_by: str
    memory: float
    method: str
    missed: tuple[str, ...]
    remarks: tuple[str, ...]
    pilot: dict
    choice: tuple[str, ...] = ()


def forecast(scene, *, quality=None, variant=None, seed=None) -> Forecast:
    """Renders pilots of a scene.

    Parameters
    ----------
    scene : `renderers.scene.Scene` with its assets
    quality, variant, seed : as renderers take them

    Raises
    ------
    BakeryError : as the renderer
    """
    taken = choice.of_scene(scene, quality, variant)
    if taken is not None:  # with what was chosen, so that pilots choose nothing again
        scene = dataclasses.replace(candidates.by_methods(scene, taken.methods), choice=taken)
    reasons = () if taken is None else tuple(taken.reasons)
    measure = _by_passes if scene.rules.RESUMES else _of_filter
    with scratch.folder("pilot") as folder:
        return measure(scene, choice.stop_of(scene, quality), quality, {"variant": variant, "seed": seed},
                       folder / "pilot.png")._replace(choice=reasons)


# ---- of a renderer by passes


def _by_passes(scene, stop, quality, options, picture_path):
    width, height = _size(scene, options["variant"])
    tiny, larger = (trial.shrunk(width, height, pixels) for pixels in (TINY, LARGE))
    shortest, pixels, told = {"samples": 1}, larger[0] * larger[1], []

    def passed(_fraction, noise=None):
        if noise is not None:
            told.append((time.monotonic(), time.process_time()))

    _drawn(scene, tiny, shortest, options, picture_path)  # compiles
    report = _drawn(scene, larger, {"time": SECONDS}, options | {"progress": passed}, picture_path)
    if scene.section in OF_MATERIALS:
        # how quickly the clock goes: a machine is not as busy as when a kept choice was made
        clock, processors = (last - first for first, last in zip(told[0], told[-1])) if told else (0.0, 0.0)
        parts = _tried(scene, stop, options["variant"], clock / processors if processors > 0 else None)
    else:
        parts = {name: part | {"seconds": part["seconds"] * width * height / pixels} for name, part in report["parts"].items()}
    memory = resources.peak_memory() + _held(scene, larger, shortest, options, picture_path) * (width * height - pixels)
    ends = _ends(parts, stop, report)
    stopped_by, (passes, noise) = min(ends.items(), key=lambda end: end[1][0])
    noise *= _of_pixels(report) if stop.pixels else 1.0
    setup = report["seconds"]["total"] - report["seconds"].get("passes", 0.0)
    return _forecast(scene, quality, stop, report, size=(width, height), seconds=setup + passes, passes=passes, noise=noise,
                     spread=_spread(parts), stopped_by=stopped_by, memory=memory)


def _size(scene, variant):
    film = scene.values.film
    if film.width:
        return film.width, film.height
    from renderers.mitsuba.world import World

    height, width = World.of(scene, variant).size
    return width, height


def _drawn(scene, size, stop, options, picture_path) -> dict:
    """The report of a pilot of a scene, which stops as `stop` says and not by its noise."""
    values = scene.values
    stop = values.stop.model_copy(update={"noise": 0.0, "time": None, "samples": None} | stop)
    film = values.film.model_copy(update=dict(zip(("width", "height"), size)))
    small = denoise.without(dataclasses.replace(scene, values=values.model_copy(update={"stop": stop, "film": film})))
    try:
        return scene.drawn_by.render(small, picture_path, **options)
    except Interrupted as fault:  # what it names is gone with the pilot
        raise Interrupted("interrupted during a pilot; no picture was written").ending(fault.exit_status) from None


def _held(scene, size, stop, options, picture_path) -> float:
    """Bytes a pixel that a pilot holds at most from its first pass on; not timed, as Python then notes each array."""
    start = []

    def passed(_fraction, _noise=None):
        if not start:
            start.append(tracemalloc.get_traced_memory()[0])
            tracemalloc.reset_peak()

    tracemalloc.start()
    try:
        _drawn(scene, size, stop, options | {"progress": passed}, picture_path)
        return (tracemalloc.get_traced_memory()[1] - start[0]) / (size[0] * size[1])
    finally:
        tracemalloc.stop()


def _tried(scene, stop, variant, clock=None) -> dict[str, Mapping]:
    """What the passes of a picture of materials will report of its parts, by the pilot of its choice; by one of its own, which is
    longer, where that does not tell enough or there is none.

    clock : seconds of it to one of processors, as they are now; None: as in the pilot
    """
    from renderers.mitsuba.world import World

    opened, world = choice.Opened.of(scene), World.of(scene, variant)
    with world.as_it_is():
        whole = scene.prepare(opened, world, 0).parts
    samples, shared = {part.name: part.samples for part in in_time(whole, stop.time)}, shares(whole, stop.time)
    # the pilots of a choice follow all paths
    foretold = scene.choice and scene.choice.foretold if min(shared.values(), default=1) == 1 else None
    now = {"clock": clock} if clock and not variants.on_gpu(world.variant) else {}
    parts = _extrapolated(foretold | now, samples) if foretold else {}
    if parts and _spread(parts) <= _VAGUE:
        return parts
    with world.as_it_is():
        pilot = trial.of(lambda smaller, seed: scene.prepare(opened, smaller, seed), world, LONGER if parts else SECONDS,
                         shares=shared)
    missing = foretold["missing"] if foretold else 0.0
    return _extrapolated(pilot.summary(world.size[0] * world.size[1], stop, missing), samples)


def _extrapolated(foretold, samples: Mapping[str, int]) -> dict[str, Mapping]:
    """Parts of a picture whose passes have so many samples of each, by `renderers.choice.trial.Trial.summary`."""
    parts = {}
    for (name, of_pass), kind in zip(samples.items(), foretold["passes"], strict=True):
        ratio = of_pass / kind["samples"]
        parts[name] = {"samples": of_pass, "passes": _PASSES, "concentration": kind["spread"],
                       "seconds": (kind["fixed"] + kind["pixels"] * ratio) * foretold["clock"],
                       "noise": math.sqrt(kind["pixel"] / ratio / _PASSES), "region": math.sqrt(kind["region"] / ratio / _PASSES)}
    return parts


def _spread(parts):
    """Standard error of the logarithm of the time to a noise."""
    return shared_out(parts, _spent(parts))[2]


def _spent(parts):
    return sum(part["passes"] * part["seconds"] for part in parts.values())


def _of_pixels(report):
    """Noise of 99 of 100 pixels over that of the picture."""
    return report["pixel_noise"] / report["noise"] if report["noise"] else 1.0


def _ends(parts, stop, report) -> dict[str, tuple[float, float]]:
    """Seconds of passes, and noise of the picture then, for whatever may end them."""
    least, rate, _ = shared_out(parts, _spent(parts))
    one_each = max(least, 1e-6) / LEAST

    def after(seconds):
        return seconds, math.sqrt(_variance_after(parts, seconds))

    noise = stop.noise / (_of_pixels(report) if stop.pixels else 1.0)
    regions = {name: part | {"noise": part.get("region", 0.0)} for name, part in parts.items()}
    slowest = max(rate, shared_out(regions, _spent(parts))[1])
    seconds, reached_then = after(max(slowest / noise**2 if noise else math.inf, TRUSTED * one_each))
    ends = {"noise": (seconds, min(reached_then, noise or math.inf))}
    if stop.time is not None:
        ends["time"] = after(max(stop.time, LEAST * one_each))
    if stop.samples is not None:
        counts = {name: max(LEAST, math.ceil(stop.samples / part["samples"])) for name, part in parts.items()}
        variance = sum(part["noise"] ** 2 * part["passes"] / counts[name] for name, part in parts.items())
        ends["samples"] = sum(counts[name] * part["seconds"] for name, part in parts.items()), math.sqrt(variance)
    return ends


def _variance_after(parts, seconds) -> float:
    """Least squared noise after so many seconds of passes, if each kind has two at least: the rate of `shared_out` is of long
    renders, and a draft of cheap noisy passes beside dear quiet ones has fewer of the first than it says."""
    variance, cost = np.array([(part["noise"] ** 2 * part["passes"], max(part["seconds"], 1e-9)) for part in parts.values()]).T
    fixed = variance <= 0
    while not fixed.all():
        for_others = seconds - LEAST * cost[fixed].sum()
        shared = for_others / np.sqrt(variance * cost)[~fixed].sum()
        counts = np.where(fixed, LEAST, np.sqrt(np.where(fixed, 1.0, variance) / cost) * shared)
        short = ~fixed & (counts < LEAST)
        if not short.any():
            return float(np.sum(variance / counts))
        fixed |= short
    return float(variance.sum() / LEAST)


# ---- of a filter


def _of_filter(scene, stop, quality, options, picture_path):
    """Of a renderer that does not go on by passes: a picture of full size, in which Mitsuba gets little time."""
    values = scene.values
    short = dataclasses.replace(scene, values=values.model_copy(update={
        "stop": values.stop.model_copy(update={"time": SECONDS})}))
    of_files = getattr(values, "picture", None) is not None and not hasattr(values.picture, "mitsuba")
    for _ in range(1 if of_files else 2):  # the first one compiles
        resources.reset_peak()
        report = scene.drawn_by.render(short, picture_path, overwrite=True, **({} if of_files else options))
    picture, seconds, noise = report.get("picture", {}), report["seconds"]["total"], report["noise"]
    predicted = partial(_forecast, scene, quality, stop, report, size=tuple(report["size"]), spread=0.0,
                        memory=resources.peak_memory())
    if not noise or not picture.get("at_most"):
        return predicted(seconds=seconds, passes=0.0, noise=noise, stopped_by="")
    a_sample = report["seconds"]["picture"] / report["samples"]
    ends = {"samples": max(1, round(picture["at_most"] / reached.coarser(quality) ** 2))}
    if reached.asked(values):
        ends["noise"] = report["samples"] * (noise / stop.noise) ** 2
    if stop.time is not None:
        ends["time"] = max(stop.time / a_sample, 2)
    stopped_by = min(ends, key=ends.get)
    passes = a_sample * ends[stopped_by]
    return predicted(seconds=seconds - a_sample * report["samples"] + passes, passes=passes, stopped_by=stopped_by,
                     noise=noise * math.sqrt(report["samples"] / ends[stopped_by]))


def _forecast(scene, quality, stop, report, *, noise, stopped_by, **predicted) -> Forecast:
    """The figures of a `Forecast` with what is said of them."""
    wanted = stop.noise if scene.rules.RESUMES or reached.asked(scene.values) else None
    unreached = () if noise is None else reached.unreached(stopped_by, wanted, noise, stop.pixels)
    missed, remarks = reached.verdict(scene.values, quality, unreached, report["bias"])
    measured = {"size": list(report["size"]), "samples": report["samples"], "noise": report["noise"],
                "seconds": report["seconds"]["total"]}
    return Forecast(**predicted, noise=noise, stopped_by=stopped_by, wanted=wanted, method=report["method"], missed=missed,
                    remarks=remarks, pilot=measured)
