"""`bake report ASSET`: one self-contained page."""

from __future__ import annotations

from pathlib import Path

import click

from bakery.cli.options import json_option, overwrite_option, print_json, print_paths
from bakery.errors import RecipeError


@click.command(name="report", short_help="write one self-contained page about an asset")
@click.argument("asset", type=click.Path(), metavar="ASSET")
@click.option("-o", "--output", type=click.Path(), metavar="FILE.html", help="The page.  Default: NAME.html beside the asset.")
@overwrite_option
@json_option
def command(asset, output, overwrite, as_json):
    """Write one HTML page about ASSET: pictures, tables, recipe, provenance.  It links to nothing outside of itself.

    A preview that `bake render ASSET` put beside the asset, NAME.png, stands on top.
    """
    import bakery
    from bakery.draw.files import preview_beside
    from bakery.report.page import page
    from bakery.store.outputs import PAGE, check_outputs
    from bakery.store.put import put

    path = Path(output) if output else Path(asset).with_suffix(".html")
    opened = bakery.open(asset)
    check_outputs([(path, PAGE)], [asset], overwrite)
    put(path, page(opened.tree, _description(opened.recipe), preview_beside(Path(asset), opened.content_hash), Path(asset).name))
    if as_json:
        print_json({"file": str(path), "bytes": path.stat().st_size})
    else:
        print_paths([path])


def _description(recipe: str) -> str:
    """What a recipe's text says of itself; "" where it says nothing, or is not as we write them."""
    from bakery.grammar.text import Mapping, Scalar, Source, parse

    try:
        node = parse(Source("recipe", recipe)).root
    except RecipeError:
        return ""
    description = node.get("description") if isinstance(node, Mapping) else None
    return description.text if isinstance(description, Scalar) else ""
