"""`bake report ASSET`: one self-contained page."""

from __future__ import annotations

from pathlib import Path

import click

from bakery.cli.options import json_option, overwrite_option, print_json, print_paths


@click.command(name="report", short_help="write one self-contained page about an asset")
@click.argument("asset", type=click.Path(), metavar="ASSET")
@click.option("-o", "--output", type=click.Path(), metavar="FILE.html", help="The page.  Default: NAME.html beside the asset.")
@overwrite_option
@json_option
def command(asset, output, overwrite, as_json):
    """Write one HTML page about ASSET: pictures, tables, recipe, provenance.  It links to nothing outside of itself."""
    import bakery
    from bakery.report.page import page
    from bakery.store.outputs import PAGE, check_outputs
    from bakery.store.put import put

    root = bakery.open(asset).tree
    path = Path(output) if output else Path(asset).with_suffix(".html")
    check_outputs([(path, PAGE)], [asset], overwrite)
    put(path, page(root))
    if as_json:
        print_json({"file": str(path), "bytes": path.stat().st_size})
    else:
        print_paths([path])
