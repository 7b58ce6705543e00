"""A scene by several methods, as comparing and trading have in common: rendering, numbers and words, curves, a page."""

import re
import time
from pathlib import Path

from bakery.draw import maps, times
from bakery.errors import UsageError
from bakery.report.comparison import Shown
from bakery.run import compiling
from bakery.store.outputs import PAGE, by_suffix, check_outputs, named
from bakery.trade.methods import Curve
from bakery.trade.methods import times as time_grid
from renderers.pictures import comparison, differences
from renderers.pictures.images import eight_bits
from renderers.scene.budget import ROOM


def split(names: str) -> list[str]:
    """Methods as `--methods` lists them."""
    parts = [name.strip() for name in re.split(r",(?![^\[]*\])", names)]  # not at commas of [lists]
    if not all(parts):
        raise UsageError(f'--methods: found "{names}", with a name missing; write for example "paths,vrl"')
    return parts


def page_at(output, loaded, ending: str) -> Path:
    """Where the page goes: `output`, or NAME_ENDING.html beside the scene, or in the folder `output/`."""
    page = named(output, loaded.picture.with_name(f"{loaded.values.name}_{ending}.html"))
    if page.suffix.lower() != ".html":
        raise UsageError(f"{page}: a page's name ends in .html; the pictures go into a folder of its name without it")
    return page


def check(page: Path, jobs, inputs, overwrite: bool) -> None:
    """UsageError where the page, or a picture beside it, cannot be written."""
    check_outputs([(page, PAGE)], inputs, overwrite)
    if page.with_suffix("").is_dir():
        check_outputs(by_suffix(path for job in jobs for path in (*job.pair, job.record)), inputs, overwrite)


def made(job, progress, render, *limits, **options):
    """The pictures of a method, with their progress.

    render : `renderers.pictures.comparison.render` or `measured`, with what it takes besides a job
    """
    job, spent = comparison.baked(job, progress), [0.0]  # processor seconds of compiling

    def tell(active):
        spent[0] += -time.process_time() if active else time.process_time()
        progress.compiling(active)

    progress.stage("render", f"{job.scene.values.name} by {job.name}", 0.0, 0.0)
    with compiling.watched(("renderers",), tell) as clock:
        return render(job, *limits, **options, progress=progress.update, compiled=lambda: (clock.seconds, spent[0]))


def summary(renders, comparison, base, file=None) -> dict:
    """All numbers and words of a comparison.

    renders : `renderers.pictures.comparison.Made` of each method
    comparison : `renderers.pictures.differences.Compared` of each picture from the reference
    base : the reference, `renderers.pictures.differences.Picture`
    file : its path where it is no method's
    """
    first = renders[0].job.scene
    by_name = {method.name: method for method in comparison}
    common = {key: value for key, value in first.overrides.items() if key != first.rules.CHOICE[0]
              and all(method.job.scene.overrides.get(key) == value for method in renders)}
    methods = []
    for item in renders:
        report, seen = item.report, by_name[item.job.name]
        missing = report.get("left_out") or []
        difference = None if seen.difference is None else {
            key: value for key, value in seen.difference._asdict().items() if key != "map"}
        methods.append({"overrides": {key: value for key, value in item.job.scene.overrides.items() if key not in common}}
                       | {key: report.get(key) for key in ("method", "files", "samples", "noise", "noise_mean", "mean",
                                                         "mean_error", "seconds", "passes", "stopped_by", "reasons")}
                       | {"name": item.job.name, "scene": str(item.job.scene.path), "seed": item.job.seed,
                          "stated_bias": report["bias"], "processor": item.processor,
                          "compiling": item.compiling, "pace": item.pace._asdict(), "taken": item.taken, "anew": item.anew,
                          "difference": difference,
                          "exact": _exact(item, first.rules) and not missing,
                          "kept": item.job.name in first.rules.KEPT and not missing, "left_out": missing, "flip": seen.flip})
    remarks = [differences.flip_missing()]
    unknown = dict.fromkeys(name for seen in comparison if seen.difference for name in seen.difference.left_in)
    whose = "all pictures" if len(unknown) == len(comparison) else ", ".join(unknown)
    remarks += [f"Unknown noise is not subtracted: that of {whose}."] if unknown else []
    remarks += [f"{base.name} is black: errors relative to it are undefined."] if base.luminance.mean() <= 0 else []
    remarks += [f"{base.name} lacks some light, which errors and bias do not include: {sentence}."
                for method in methods if method["name"] == base.name for sentence in method["left_out"]]
    pixels = any(method.job.scene.values.measure == "pixels" for method in renders)
    remarks += ["Errors, noise and times are those of the picture as a whole; the tolerance is one of pixels (measure: pixels), "
                "which takes longer."] if pixels else []
    return {"scene": str(first.path), "name": first.values.name, "description": first.values.description,
            "renderer": first.section, "asset": renders[0].report["asset"], "size": renders[0].report["size"],
            "overrides": common, "measure": "pixels" if pixels else "picture",
            "reference": base.name, "reference_file": None if file is None else str(file),
            "flip": differences.flip_missing() or None, "remarks": [remark for remark in remarks if remark], "methods": methods}


def _exact(rendered, rules) -> bool:
    """Whether a method has no error of its own, or one that chooses has taken such a one here."""
    name, took = rendered.job.name, rendered.report["method"]
    return name in rules.EXACT or name in rules.KEPT and took in rules.EXACT


def curves(summary) -> list:
    """Error against time of each method of a summary, where it is known; of two or more."""
    reference_noise = next((method["noise"] for method in summary["methods"] if method["name"] == summary["reference"]), None)
    drawn = [curve for method in summary["methods"]
             if (curve := _curve(method, method["name"] == summary["reference"], reference_noise))]
    return drawn if len(drawn) > 1 else []


def _curve(method, is_reference, reference_noise):
    """Of a method; None where its noise, or its difference from the reference, is not known."""
    different, pace = method["difference"], method["pace"]
    if different is None and not is_reference:
        return None
    if not method["passes"]:
        # a filter: what its picture has of noise stays, that of the reference too
        seconds = pace["setup"]
        beside_noise = max(((different["error"] if different else 0.0) ** 2 + (reference_noise or 0.0) ** 2) ** 0.5, 1e-6)
        return Curve(method["name"], seconds, seconds, 0.0, beside_noise, beside_noise, seconds)
    if not method["noise"] or not pace["rate"] or (different and different["left_in"]):
        return None
    error, most = (different["error"] if different["resolved"] else 0.0, different["most"]) if different else (0.0, 0.0)
    seconds = pace["setup"] + pace["rate"] / method["noise"] ** 2
    kept = 0.0 if method["exact"] else ROOM if method["kept"] else None
    return Curve(method["name"], seconds, min(pace["setup"] + pace["least"], seconds), method["noise"], error, most,
                 pace["setup"], pace["spread"], kept)


def drawing(curves, knee):
    """Error against time, with the knee of the front."""
    grid = time_grid(curves)
    seconds = {curve.name: grid[grid >= curve.first * (1 - 1e-9)] for curve in curves}
    return times.picture(
        {curve.name: (seconds[curve.name], *(curve.after(seconds[curve.name], error) for error in (curve.error, curve.most)))
         for curve in curves},
        {curve.name: (curve.seconds, float(curve.after(curve.seconds, curve.error))) for curve in curves},
        knee and (knee["seconds"], knee["error"]))


def shown(methods):
    """PNGs of pictures and maps, and the difference at the ends of the signed maps' colours."""
    limit = maps.limit([method.difference.map for method in methods if method.difference])
    return [Shown(method.name, maps.picture(eight_bits(method.display)),
                  maps.coloured(method.difference.map, -limit, limit, maps.SIGNED) if method.difference else b"",
                  maps.coloured(method.flip_map, 0.0, 1.0, maps.SHARE) if method.flip_map is not None else b"")
            for method in methods], limit
