"""`bake plot ASSET`: pictures, and the data of each beside it."""

from pathlib import Path

import click

from bakery.cli.options import at_option, json_option, opened, overwrite_option, print_json, print_paths
from bakery.errors import AssetError


@click.command(name="plot", short_help="draw pictures of an asset's contents")
@click.argument("asset", type=click.Path(), metavar="ASSET")
@click.option("-o", "--output", type=click.Path(), metavar="DIR",
              help="Folder of the pictures.  Default: NAME-plots beside the asset.")
@at_option
@overwrite_option
@json_option
def command(asset, output, coordinates, overwrite, as_json):
    """Draw the contents of ASSET: phase functions, cross sections, coefficients, polarisation, grains, tiles; for a family over
    its axes.

    Each picture is written as PNG and as SVG, with its data as CSV; the paths are printed.
    """
    import bakery
    from bakery.draw.files import csv_text, folder_filled
    from bakery.draw.picture import drawn
    from bakery.report.figures import pictures, title_of
    from bakery.store.outputs import by_suffix, check_outputs
    from bakery.store.put import put

    shown = opened(asset, coordinates)
    if isinstance(shown, bakery.Family) and len(shown.members) == 1:  # nothing lies between: its only place is drawn
        shown = shown.at(**shown.members[0].at)
    root = shown.tree
    figures = list(pictures(root))
    if not figures:
        raise AssetError(f"{asset}: holds nothing to draw; `bake inspect {asset}` shows its contents")
    stem = Path(shown.path).stem
    where = Path(output) if output else Path(shown.path).with_name(f"{stem}-plots")
    written = []
    with folder_filled(where) as folder:
        names = [f"{stem}_{picture.name}.{form}" for picture in figures for form in ("png", "svg", "csv")]
        check_outputs(by_suffix(folder / name for name in names), [asset], overwrite)
        for picture in figures:
            files = drawn(picture, of=title_of(root)) | {"csv": csv_text(picture.columns)}
            paths = {form: str(put(folder / f"{stem}_{picture.name}.{form}", data)) for form, data in files.items()}
            written.append({"name": picture.name, "title": picture.title, "caption": picture.caption, "files": paths})
            if not as_json:
                print_paths(paths.values())
    if as_json:
        print_json(written)
