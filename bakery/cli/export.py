"""`bake export ASSET --to FORMAT`: hands an asset to other software and says what was lost."""

from __future__ import annotations

import math
from pathlib import Path

import click

from bakery.cli.options import json_option, print_json
from bakery.errors import UsageError

LATER = ("pbrt",)
FORMATS = {"csv": "every table, units in the headings", "mitsuba": "a medium for stock Mitsuba 3 (XML)"}


@click.command(name="export", short_help="hand an asset to other software")
@click.argument("asset", type=click.Path(), metavar="ASSET")
@click.option("--to", "target", required=True, metavar="FORMAT",
              help="; ".join(f"{name}: {text}" for name, text in FORMATS.items()))
@click.option("-o", "--output", type=click.Path(), metavar="DIR",
              help="Folder of the files.  Default: NAME-FORMAT beside the asset.")
@click.option("--each-wavelength", is_flag=True,
              help="mitsuba: one file a wavelength, instead of one in colour with a mean table.")
@json_option
def command(asset, target, output, each_wavelength, as_json):
    """Write ASSET for other software.  Prints the files and what was lost on the way."""
    import bakery
    from bakery.report.files import folder_for
    from bakery.store.put import put

    if target not in FORMATS:
        what = "not available yet" if target in LATER else "no format of ours"
        raise UsageError(f'--to: found "{target}", which is {what}; there is ' +
                         " and ".join(f"{name} ({text})" for name, text in FORMATS.items()))
    if each_wavelength and target != "mitsuba":
        raise UsageError(f"--each-wavelength: has no effect on {target}, whose tables hold every wavelength; leave it out")
    opened = bakery.open(asset)
    stem = Path(asset).stem
    files, losses = _csv(opened) if target == "csv" else _mitsuba(opened, stem, each_wavelength)
    folder = folder_for(Path(output) if output else Path(asset).with_name(f"{stem}-{target}"))
    paths = [str(put(folder / name, text)) for name, text in files.items()]
    if as_json:
        print_json({"files": paths, "lost": [loss.as_dict() for loss in losses]})
        return
    _print(paths, losses)


def _csv(asset):
    from bakery.export.csv import csv_files

    return {f"{Path(asset.path).stem}_{name}": text for name, text in csv_files(asset.tree).items()}, []


def _mitsuba(asset, stem: str, each: bool):
    from bakery.export.mitsuba import fragments
    from renderers.colour import band_matrix

    made = fragments(asset.tree, asset.name, band_matrix(asset.wavelength), each)
    return {f"{stem}{part.name}.xml": part.xml for part in made}, made


def _print(paths, losses) -> None:
    from bakery.report.text import say, table

    if not losses:
        for path in paths:
            say(path)
        say("nothing is lost: every number has all its digits; provenance stays in the asset")
        return
    for path, part in zip(paths, losses, strict=True):
        say(path)
        say(f"  phase function: {part.values} values over cos theta")
        head = [("  lost against the asset", "mean error", "largest error", "error of g", "forward peak cut")]
        rows = [("  by the regular grid", *_loss(part.resampling))]
        rows += [(f"  by that and one table, at {um:g} um", *_loss(lost)) for um, lost in part.colour.items()]
        for line in table(head + rows):
            say(line)
    say("mean error: |difference| over the sphere; half of it is the share of the light that goes to another angle.")
    say("forward peak: the angles where the phase function is above half of its forward value.")


def _loss(lost) -> tuple[str, ...]:
    return (f"{200 * lost.misdirected:.2g} %", f"{100 * lost.largest:.2g} % at {math.degrees(lost.largest_at):.3g} deg",
            f"{lost.g:+.1e}", f"{100 * lost.peak:.2g} % of {math.degrees(lost.peak_angle):.3g} deg")
