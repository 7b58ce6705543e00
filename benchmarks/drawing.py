"""What the benchmarks that draw an asset beside a reference do alike: each picture as PNG, its data as CSV, paths printed."""

import argparse
from collections.abc import Callable
from pathlib import Path

import bakery
from bakery.draw.files import csv_text
from bakery.draw.picture import drawn
from bakery.report.figures import title_of


def main(description: str, pictures: Callable) -> None:
    """Draws `pictures(root)` of the asset on the command line."""
    parser = argparse.ArgumentParser(description=description.partition("\n")[0])
    parser.add_argument("asset", type=Path)
    parser.add_argument("-o", "--output", type=Path, default=Path(), help="folder of the pictures; the current one by default")
    options = parser.parse_args()
    root = bakery.open(options.asset).tree
    options.output.mkdir(parents=True, exist_ok=True)
    for picture in pictures(root):
        place = options.output / f"{options.asset.stem}_{picture.name}"
        for form, data in (drawn(picture, ("png",), title_of(root)) | {"csv": csv_text(picture.columns).encode()}).items():
            place.with_suffix(f".{form}").write_bytes(data)
        print(place.with_suffix(".png"))
