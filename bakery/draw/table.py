"""A table of text, for pages."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """Cells that are ready to be read."""

    title: str  # what stands above
    # header, rows: one text a column
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: int = 0  # how many of the first columns hold words; the others hold numbers
    note: str = ""  # a sentence below
