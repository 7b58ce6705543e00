"""One figure: what it shows, and the numbers behind it; notebooks show it inline, `save` writes it."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bakery.draw.files import csv_text
from bakery.draw.html import figure as html_figure
from bakery.draw.style import QUIET, look, saved
from bakery.errors import UsageError

_CSS_INCH = 96  # pixels
_HEAD = 0.24  # inches above a picture for the asset's name


@dataclass(frozen=True)
class Picture:
    """One figure.

    Attributes
    ----------
    name : end of the file name
    title, caption : what is seen, in words
    size : inches
    draw : takes an empty matplotlib Figure
    columns : (heading with unit, values (N,)) of the data shown
    """

    name: str
    title: str
    caption: str
    size: tuple[float, float]
    draw: Callable
    columns: tuple[tuple[str, np.ndarray], ...]

    def save(self, path: str | os.PathLike) -> Path:
        """Write it as PNG or SVG, or its data as CSV, by the ending of the path; what stands there is replaced, as a whole.

        Raises
        ------
        UsageError : another ending, or nothing can be written there
        StoreError : the system refused; what stood there still does
        """
        from bakery.store.put import put

        path = Path(path)
        form = path.suffix.removeprefix(".").lower()
        if form not in ("png", "svg", "csv"):
            better = path / f"{self.name}.png" if path.is_dir() else path.with_suffix(".png")
            raise UsageError(f"{path}: found a name that does not end in .png, .svg or .csv; expected {better}")
        return put(path, csv_text(self.columns) if form == "csv" else drawn(self, (form,))[form])

    def __repr__(self) -> str:
        return f"picture {self.name!r}: {self.title}; .save(FILE) writes it"

    def _repr_html_(self) -> str:
        return html_figure(drawn(self, ("png",))["png"], f"{self.title}. {self.caption}", _CSS_INCH * self.size[0])


def drawn(picture: Picture, forms: Sequence[str] = ("png", "svg"), of: str = "") -> dict[str, bytes]:
    """A picture in each form; the same bytes on every run with the same packages.  `of` (the asset) stands above it."""
    from matplotlib.figure import Figure

    with look(picture.name):
        width, height = picture.size
        figure = Figure(figsize=(width, height + _HEAD if of else height))
        if of:
            head, body = figure.subfigures(2, 1, height_ratios=(_HEAD, height))
            head.text(0.08 / width, 0.45, of, va="center", color=QUIET, fontsize=8.5, parse_math=False)
        picture.draw(body if of else figure)
        return saved(figure, forms)
