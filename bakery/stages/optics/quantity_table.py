"""A table of quantities with unit and error each: over the wavelengths, between neighbouring ones, or single numbers."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np

from bakery.draw.html import table
from bakery.system.terminal import clean
from bakery.system.terminal import table as lines

SPECTRUM, PAIRS, SCALAR = "wavelength", "interval", ""  # what a quantity goes over
MOST = 8  # columns that are shown


@dataclass(frozen=True)
class Figure:
    """One quantity.

    Attributes
    ----------
    name, units, words : what it is
    values : (L,), (L - 1,) between neighbours by ascending wavelength, or (1,); None where the asset cannot say
    error : like values, absolute
    missing : why values are None, or not a number at some places
    over : `SPECTRUM`, `PAIRS` or `SCALAR`
    """

    name: str
    units: str
    words: str
    values: np.ndarray | None = None
    error: np.ndarray | None = None
    missing: str = ""
    over: str = SPECTRUM


@dataclass(frozen=True)
class QuantityTable:
    """Quantities by name: `table["lidar_ratio"].values`.

    Attributes
    ----------
    path : of the query
    wavelength : (L,) um
    figures : tuple of `Figure`
    """

    path: str
    wavelength: np.ndarray
    figures: tuple[Figure, ...]

    def __getitem__(self, name: str) -> Figure:
        for figure in self.figures:
            if figure.name == name:
                return figure
        raise KeyError(f"{name}; the table holds {', '.join(figure.name for figure in self.figures)}")

    def rows(self, number: Callable[[Any, float | None], str]) -> Iterator[list[list[str]]]:
        """Blocks of rows, the first of each its headings: over wavelengths, over intervals, single numbers."""
        ascending = np.sort(self.wavelength)
        heads = {SPECTRUM: [f"{um:g} um" for um in self.wavelength],
                 PAIRS: [f"{a:g}-{b:g} um" for a, b in zip(ascending, ascending[1:])], SCALAR: ["value"]}
        for over, columns in heads.items():
            figures = [figure for figure in self.figures if figure.over == over and figure.values is not None]
            if figures:
                yield [["quantity", "unit", *(cell for column in columns[:MOST] for cell in (column, "+-"))],
                       *([figure.name, figure.units, *_cells(figure, number)] for figure in figures)]

    def remarks(self) -> list[str]:
        """Quantities that are not available, and why; how many wavelengths are not shown."""
        hidden = len(self.wavelength) - MOST
        cut = [f"{hidden} more wavelengths: wavelength=… asks for some, --json prints all"] if hidden > 0 else []
        why = {}
        for figure in self.figures:
            if figure.missing:
                why.setdefault(figure.missing, []).append(figure.name)
        return [f"{', '.join(names)}: {reason}" for reason, names in why.items()] + cut

    def as_dict(self) -> dict:
        """The same for machines (`--json`); null where there is no number."""
        ascending = np.sort(self.wavelength)

        def plain(values):
            return None if values is None else [float(x) if np.isfinite(x) else None for x in values]

        return {"path": self.path, "wavelength": self.wavelength.tolist(), "intervals": list(map(list, zip(
            ascending.tolist(), ascending[1:].tolist()))), "quantities": {figure.name: {
                "units": figure.units, "description": figure.words, "over": figure.over or None, "value": plain(figure.values),
                "error": plain(figure.error), "missing": figure.missing} for figure in self.figures}}

    def _repr_html_(self) -> str:
        blocks = [table(head, rows, 2) for head, *rows in self.rows(_short)]
        return "".join(blocks) + "".join(f"<p>{escape(remark)}</p>\n" for remark in self.remarks())

    def __repr__(self) -> str:
        blocks = ["\n".join(lines(block, right=range(2, len(block[0])))) for block in self.rows(_short)]
        return "\n\n".join([*blocks, "\n".join(f"# {clean(remark)}" for remark in self.remarks())]).rstrip()


def _cells(figure: Figure, number) -> list[str]:
    errors = figure.error if figure.error is not None else np.full(figure.values.shape, np.nan)
    shown = [(number(value, error) if np.isfinite(value) else "-", number(error, error) if np.isfinite(error) else "-")
             for value, error in zip(figure.values[:MOST], errors[:MOST], strict=True)]
    return [cell for pair in shown for cell in pair]


def _short(value, error) -> str:
    return f"{value:.5g}" if value is not error else f"{value:.2g}"
