"""Text for terminals: any encoding, any width, nothing that a hostile name could do to them."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterable, Sequence

FEWEST_COLUMNS = 20  # narrower terminals wrap by themselves


def clean(value) -> str:
    """Text on one line without control characters: an asset's texts may come from strangers, and terminals obey escapes."""
    text = str(value)
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "backslashreplace").decode() for c in text)


def say(line: str = "") -> None:
    """One line on standard output; what its encoding lacks is written as an escape, what a terminal has no room for is cut."""
    out = sys.stdout
    if out.isatty():
        columns = max(shutil.get_terminal_size().columns, FEWEST_COLUMNS)
        line = line if len(line) <= columns else line[:columns - 1] + (">" if plain(out) else "…")
    write(line + "\n")


def say_all(text: str) -> None:
    """Text of several lines, unchanged when it goes into a file or pipe, made harmless on a terminal."""
    if sys.stdout.isatty():
        for line in text.splitlines():
            say(clean(line))
        return
    write(text)


def write(text: str) -> None:
    """Text on standard output as it is; what the encoding lacks is written as an escape."""
    encoding = sys.stdout.encoding or "ascii"
    try:
        sys.stdout.write(text.encode(encoding, "backslashreplace").decode(encoding))
    except BrokenPipeError:
        # the reader has gone (`bake query … | head`): the rest goes nowhere, the command's exit status stays what it is
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def remark(line: str) -> None:
    """One line on standard error: what is no result; a terminal wraps it."""
    try:
        print(line, file=sys.stderr)
    except (OSError, ValueError):
        pass  # standard error is full or closed: the results are written all the same


def plain(out=None) -> bool:
    """Whether standard output cannot show lines and dots beyond ASCII."""
    try:
        "├└│─…".encode((out or sys.stdout).encoding or "ascii")
    except (UnicodeEncodeError, LookupError):
        return True
    return False


def table(rows: Iterable[Sequence[str]], right: Sequence[int] = ()) -> list[str]:
    """Rows as lines with aligned columns; columns in `right` are flush right."""
    rows = [[str(cell) for cell in row] for row in rows]
    if not rows:
        return []
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    flush = [str.rjust if i in right else str.ljust for i in range(len(widths))]
    return ["  ".join(put(cell, width) for put, cell, width in zip(flush, row, widths, strict=True)).rstrip() for row in rows]
