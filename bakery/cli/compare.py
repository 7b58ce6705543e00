"""`bake compare SCENE --methods a,b,c`: one scene by several methods, beside one another on one page."""

from __future__ import annotations

import re
import time
from pathlib import Path

import click

from bakery.cli import offers
from bakery.cli.options import json_option, overwrite_option, print_json, print_paths, quiet_option, settings_of
from bakery.errors import Interrupted, UsageError

PASSES = 2  # that a picture has at least
TOLERANCE = 0.05  # of scenes that say none, as renderers take it


@click.command(name="compare", short_help="render a scene by several methods, and show them beside one another")
@click.argument("source", type=click.Path(), metavar="SCENE")
@click.option("--methods", required=True, metavar="A,B,C",
              help="As the scene's section takes them; METHOD:KEY=VALUE also sets a key beside that of the method.")
@click.option("--reference", metavar="METHOD|FILE.exr", help="What the others are held against.  [default: the first method]")
@click.option("-o", "--output", type=click.Path(), metavar="FILE.html",
              help="The page; the pictures lie in a folder of its name beside it.  Default: NAME_compare.html beside the scene.")
@click.option("--time", "seconds", metavar="TIME", help="For each method, such as 60s: --set stop.time.")
@click.option("--noise", metavar="X", help="For each method, such as 2%: --set stop.noise.")
@click.option("--quality", metavar="draft|preview|final", shell_complete=offers.among(offers.QUALITIES),
              help="Noise against time.  [default: what the scene asks for]")
@click.option("--variant", metavar="NAME", help="Mitsuba variant (such as llvm_ad_rgb); the best that runs by default.")
@click.option("--seed", type=click.IntRange(0), metavar="N", help="Seed; each method has its own from it.  [default: 0]")
@click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Override one value of the scene; repeatable.")
@click.option("--resume", is_flag=True, help="Go on also from samples that were enough for an earlier call.")
@click.option("--force", is_flag=True, help="Render every method anew.")
@overwrite_option
@json_option
@quiet_option
def command(source, methods, reference, output, seconds, noise, quality, variant, seed, settings, resume, force, overwrite,
            as_json, quiet):
    """Render SCENE (.yaml) by several methods, and write one page: the pictures with a slider between any two, signed differences
    from the reference, errors beneath the noise, FLIP, error against time, and what the methods say of themselves.

    Methods whose pictures are there are not rendered again; what was interrupted is gone on with.  Prints the paths of the page
    and of the pictures.
    """
    from bakery.run.progress import choose

    if Path(source).suffix.lower() not in (".yaml", ".yml"):
        raise UsageError(f'found "{source}", which is no scene (.yaml); only scenes have methods to compare')
    if resume and force:
        raise UsageError("--resume goes on with what is there, --force begins anew; one of them would do")
    if quality is not None and quality not in offers.QUALITIES:
        raise UsageError(f'--quality: found "{quality}"; {", ".join(offers.QUALITIES)} would do')
    stop = [f"stop.{key}={value}" for key, value in (("time", seconds), ("noise", noise)) if value is not None]
    values = settings_of(None, None, None, [*settings, *stop])
    jobs, page, file = _planned(source, methods, reference, output, values, seed, resume, overwrite)
    progress = choose(quiet)
    try:
        summary = _compared(jobs, page, reference or jobs[0].name, file, progress, quality=quality, variant=variant,
                            resume=resume, force=force, overwrite=overwrite)
    except KeyboardInterrupt:
        raise Interrupted("interrupted; pictures that are finished are kept, the same call goes on") from None
    finally:
        progress.close()
    if as_json:
        print_json(summary)
        return
    print_paths([summary["page"], *(path for one in summary["methods"] for path in one["files"])])
    for line in _lines(summary):
        progress.say(line)


def _planned(source, methods, reference, output, values, seed, resume, overwrite):
    """Jobs, the page, and the reference where it is a file; everything that can be wrong before work is said here."""
    from bakery.store.outputs import PAGE, by_suffix, check_outputs
    from renderers import comparison, scene

    named = [name.strip() for name in re.split(r",(?![^\[]*\])", methods) if name.strip()]  # not at commas of [lists]
    file = Path(reference) if reference and reference.lower().endswith(".exr") else None
    if reference and file is None and reference not in named:
        named.insert(0, reference)
    if file is not None and not file.is_file():
        raise UsageError(f'--reference: found "{reference}", and there is no such file')
    if len(named) + (file is not None) < 2:
        raise UsageError(f"--methods: found {len(named) or 'none'}; two or more, or a --reference, would do")
    loaded = scene.load(source, values)
    page = Path(output) if output else loaded.picture.with_name(f"{loaded.values.name}_compare.html")
    if page.suffix.lower() != ".html":
        raise UsageError(f"{page}: a page's name ends in .html; the pictures go into a folder of its name without it")
    if resume and not loaded.rules.RESUMES:
        raise UsageError(f"--resume: the renderer {loaded.section} cannot go on from an EXR; leave the option out")
    jobs = comparison.jobs(source, named, page.with_suffix(""), values, seed)
    inputs = [*loaded.inputs, *([file] if file else [])]
    check_outputs([(page, PAGE)], inputs, overwrite)
    if page.with_suffix("").is_dir():
        check_outputs(by_suffix(path for job in jobs for path in (*job.pair, job.record)), inputs, overwrite)
    return jobs, page, file


def _compared(jobs, page, reference, file, progress, **options) -> dict:
    """Renders, measures and writes; what `--json` prints."""
    from bakery.draw.files import folder_for
    from bakery.report import comparison as report
    from bakery.store.put import put
    from bakery.trade import methods as trade
    from renderers import differences

    other = None if file is None else differences.read(file, file.name)
    folder_for(page.with_suffix(""))
    made, pictures = [], []
    for job in jobs:
        made.append(_made(job, progress, options))
        pictures.append(differences.read(job.pair[1], job.name))
        differences.same_size(pictures[-1], other or pictures[0], file or jobs[0].name)
    base = other or next(one for one in pictures if one.name == reference)
    with progress.during("measuring differences"):
        found = differences.compared([*([other] if other else []), *pictures], base, dict(jobs[0].scene.values.display))
        summary = _summary(made, found, base, file)
        curves = _curves(summary)
        summary["trade"] = trade.compared(curves, jobs[0].scene.values.tolerance or TOLERANCE) if curves else None
        shown, limit = _shown(found)
        text = report.page(summary, shown, limit, _drawing(curves, summary["trade"]["knee"]) if curves else None)
    put(page, text)
    return summary | {"page": str(page), "bytes": len(text.encode())}


def _made(job, progress, options):
    """The pictures of a method, with their progress."""
    from bakery.run import compiling
    from renderers import comparison

    job, spent = comparison.baked(job, progress), [0.0]  # processor seconds of compiling

    def tell(active):
        spent[0] += -time.process_time() if active else time.process_time()
        progress.compiling(active)

    progress.stage("render", f"{job.scene.values.name} by {job.name}", 0.0, 0.0)
    with compiling.watched(("renderers",), tell) as clock:
        return comparison.render(job, **options, progress=progress.update, compiled=lambda: (clock.seconds, spent[0]))


def _summary(made, found, base, file) -> dict:
    """All numbers and words of the comparison."""
    from renderers import differences

    first = made[0].job.scene
    by_name = {one.name: one for one in found}
    common = {key: value for key, value in first.overrides.items() if key != first.rules.CHOICE[0]
              and all(one.job.scene.overrides.get(key) == value for one in made)}
    methods = []
    for one in made:
        report, seen = one.report, by_name[one.job.name]
        difference = None if seen.difference is None else {
            key: value for key, value in seen.difference._asdict().items() if key != "map"}
        methods.append({"overrides": {key: value for key, value in one.job.scene.overrides.items() if key not in common}}
                       | {key: report.get(key) for key in ("method", "files", "samples", "noise", "mean", "mean_error", "seconds",
                                                         "passes", "stopped_by", "reasons")}
                       | {"name": one.job.name, "seed": one.job.seed, "stated_bias": report["bias"], "processor": one.processor,
                          "compiling": one.compiling, "taken": one.taken, "difference": difference, "flip": seen.flip})
    remarks = [differences.flip_missing()]
    unknown = dict.fromkeys(name for seen in found if seen.difference for name in seen.difference.left_in)
    remarks += [f"Noise that is not known is not taken off: that of {', '.join(unknown)}."] if unknown else []
    remarks += [f"{base.name} is black: nothing is relative to it."] if base.luminance.mean() <= 0 else []
    return {"scene": str(first.path), "name": first.values.name, "description": first.values.description,
            "renderer": first.section, "asset": made[0].report["asset"], "size": made[0].report["size"],
            "overrides": common,
            "reference": base.name, "reference_file": None if file is None else str(file),
            "flip": differences.flip_missing() or None, "remarks": [remark for remark in remarks if remark], "methods": methods}


def _curves(summary) -> list:
    """Error against time of each method, where it is known; of two or more."""
    from bakery.trade.methods import Curve

    curves = []
    for one in summary["methods"]:
        found = one["difference"]
        known = one["name"] == summary["reference"] or (found is not None and not found["left_in"])
        if one["noise"] and one["passes"] and known:
            error, most = (found["error"] if found["resolved"] else 0.0, found["most"]) if found else (0.0, 0.0)
            first = min(1.0, PASSES / min(one["passes"].values())) * one["processor"]
            curves.append(Curve(one["name"], one["processor"], first, one["noise"], error, most))
    return curves if len(curves) > 1 else []


def _drawing(curves, knee):
    """Error against time, with the knee of the front."""
    from bakery.draw import times
    from bakery.trade import methods

    grid = methods.times(curves)
    seconds = {curve.name: grid[grid >= curve.first * (1 - 1e-9)] for curve in curves}
    return times.picture(
        {curve.name: (seconds[curve.name], *(curve.after(seconds[curve.name], error) for error in (curve.error, curve.most)))
         for curve in curves},
        {curve.name: (curve.seconds, float(curve.after(curve.seconds, curve.error))) for curve in curves},
        knee and (knee["seconds"], knee["error"]))


def _shown(found):
    """PNGs of pictures and maps, and the difference at the ends of the signed maps' colours."""
    from bakery.draw import maps
    from bakery.report.comparison import Shown
    from renderers.images import eight_bits

    limit = maps.limit([one.difference.map for one in found if one.difference])
    return [Shown(one.name, maps.picture(eight_bits(one.display)),
                  maps.coloured(one.difference.map, -limit, limit, maps.SIGNED) if one.difference else b"",
                  maps.coloured(one.flip_map, 0.0, 1.0, maps.SHARE) if one.flip_map is not None else b"") for one in found], limit


def _lines(summary) -> list[str]:
    """For people, on standard error."""
    from bakery.report.comparison import difference_text

    lines = []
    for one in summary["methods"]:
        error, bias = difference_text(one)
        words = ["reference"] if one["name"] == summary["reference"] else []
        words += [f"error {error}"] * bool(error) + [f"bias {bias}"] * bool(bias)
        words += [f"FLIP {one['flip']:.3f}"] if one["flip"] is not None else []
        words += [f"noise {100 * one['noise']:.2g} %"] if one["noise"] is not None else []
        words += [f"{one['seconds']['total'] - one['compiling']:.3g} s" + " (rendered before)" * one["taken"]]
        lines.append(f"{one['name']}: {', '.join(words)}")
    return lines + (summary["trade"]["advice"] if summary["trade"] else []) + summary["remarks"]
