"""`bake report ASSET`: one self-contained page."""

from pathlib import Path

import click

from bakery.cli.options import at_option, file_of, json_option, one_asset, overwrite_option, print_json, print_paths
from bakery.errors import RecipeError, UsageError

OTHER_FORMATS = (".pdf", ".ps", ".md", ".rst", ".tex", ".doc", ".docx", ".odt", ".png", ".jpg", ".svg", ".json", ".csv", ".xml")


@click.command(name="report", short_help="write one self-contained page about an asset")
@click.argument("asset", type=click.Path(), metavar="ASSET")
@click.option("-o", "--output", type=click.Path(), metavar="FILE.html or DIR/",
              help="The page, or the folder for it.  Default: NAME.html beside the asset.")
@click.option("--no-render", is_flag=True, help="Do not render a preview if there is none beside the asset.")
@at_option
@overwrite_option
@json_option
def command(asset, output, no_render, coordinates, overwrite, as_json):
    """Write one HTML page about ASSET: pictures, tables, recipe, provenance.  The page has no external links.

    At the top is the preview that `bake render ASSET` wrote beside the asset, NAME.png; without one a draft is rendered.
    """
    from bakery.draw.files import preview_beside
    from bakery.report.page import page
    from bakery.store.outputs import PAGE, check_outputs, named
    from bakery.store.put import put

    opened = one_asset(asset, coordinates)
    path = named(output, Path(opened.path).with_suffix(".html"))
    check_outputs([(path, PAGE)], [asset], overwrite)
    if path.suffix.lower() in OTHER_FORMATS:
        instead = path.with_suffix(".html")
        raise UsageError(f'-o: found "{output}"; the page is HTML: use {instead} (browsers print it to PDF)')
    picture = preview_beside(Path(opened.path), opened.content_hash) or (b"" if no_render else _rendered(opened))
    put(path, page(opened.tree, _description(opened.recipe), picture, Path(opened.path).name))
    if as_json:
        print_json({"file": str(path), "bytes": path.stat().st_size})
    else:
        print_paths([path])


def _rendered(asset) -> bytes:
    """A draft of the standard preview as JPEG; b"" where the asset holds nothing to render or no Mitsuba is installed."""
    from importlib.util import find_spec

    from bakery.draw.files import preview_beside
    from bakery.stages.conform import stages_of
    from bakery.store import scratch

    if not any(stage.rendered for stage in stages_of(asset.tree)) or find_spec("mitsuba") is None:
        return b""
    from renderers.preview import preview

    with scratch.folder("place") as folder:
        target = Path(folder, "preview.png")
        preview(file_of(asset, folder), target, quality="draft")
        return preview_beside(target, asset.content_hash)


def _description(recipe: str) -> str:
    """What a recipe's text says of itself; "" where it says nothing, or is not as we write them."""
    from bakery.grammar.text import Mapping, Scalar, Source, parse

    try:
        node = parse(Source("recipe", recipe)).root
    except RecipeError:
        return ""
    description = node.get("description") if isinstance(node, Mapping) else None
    return description.text if isinstance(description, Scalar) else ""
