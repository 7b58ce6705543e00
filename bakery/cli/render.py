"""`bake render ASSET|SCENE`: the standard preview of an asset, or a scene."""

from __future__ import annotations

import click

from bakery.cli.options import json_option, print_json, quiet_option
from bakery.errors import UsageError
from bakery.report.text import say


@click.command(name="render", short_help="render an asset's preview, or a scene")
@click.argument("source", metavar="ASSET|SCENE")
@click.option("-o", "--output", metavar="IMAGE", help="NAME.png or NAME.exr; both are written.  Default: beside the source.")
@click.option("--quality", default="preview", show_default=True, metavar="draft|preview|final", help="Noise against time.")
@click.option("--variant", metavar="NAME", help="Mitsuba variant (such as llvm_ad_mono); the best that runs by default.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, metavar="N", help="Seed of the renderer.")
@json_option
@quiet_option
def command(source, output, quality, variant, seed, as_json, quiet):
    """Render the standard preview of an ASSET, or a Mitsuba SCENE (.xml) in which bakery's plugins may be used."""
    from pathlib import Path

    from bakery.run.progress import choose

    path = Path(source)
    if not path.is_file():
        raise UsageError(f'found "{source}", which is no file; an asset (.h5) or a Mitsuba scene (.xml) would do')
    import renderers.mitsuba as renderer

    is_scene = path.suffix.lower() == ".xml"
    target = Path(output) if output else path.with_suffix(".png")
    progress = choose(quiet)
    try:
        progress.stage("render", f"picture of {path.name}", 0.0, 0.0)
        draw = renderer.render_scene if is_scene else renderer.preview
        report = draw(path, target, quality=quality, variant=variant, seed=seed, progress=progress.update)
    finally:
        progress.close()
    if as_json:
        print_json(report)
        return
    for line in renderer.describe(report):
        say(line)
