"""Text for terminals: any encoding, any width, nothing that a hostile name could do to them."""

import os
import re
import shutil
import sys
import textwrap
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager

FEWEST_COLUMNS = 20  # narrower terminals wrap by themselves
_BELOW = " " * 6  # before what goes on in the next line
_in_pipes = False  # whether files and pipes have columns


def clean(value) -> str:
    """Text on one line without control characters: an asset's texts may come from strangers, and terminals obey escapes."""
    text = str(value)
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "backslashreplace").decode() for c in text)


def say(line: str = "") -> None:
    """One line on standard output; what its encoding lacks is written as an escape, on a terminal it goes on below itself."""
    for part in wrapped(line, room()):
        write(part + "\n")


@contextmanager
def columns_in_pipes() -> Iterator[None]:
    """Lines within are as long as the environment's COLUMNS says also on a file or pipe: for pages, of which no program reads
    lines.  Some programs (such as runners of tests) export COLUMNS to all that they start."""
    global _in_pipes
    _in_pipes = True
    try:
        yield
    finally:
        _in_pipes = False


def room() -> int | None:
    """Columns of the terminal that standard output is; of a file or pipe None, lines may be of any length, but for
    `columns_in_pipes`."""
    if sys.stdout.isatty():
        return max(shutil.get_terminal_size().columns, FEWEST_COLUMNS)
    columns = os.environ.get("COLUMNS", "") if _in_pipes else ""
    return max(int(columns), FEWEST_COLUMNS) if re.fullmatch(r"[0-9]{1,9}", columns) and int(columns) else None


def wrapped(line: str, columns: int | None) -> list[str]:
    """A line as lines of at most so many columns, indented below the first; words (paths, hashes) stay whole."""
    if columns is None or len(line) <= columns:
        return [line]
    indent = " " * min(len(line) - len(line.lstrip()) + 2, columns // 2)
    return textwrap.wrap(line, columns, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def say_all(text: str) -> None:
    """Text of several lines, unchanged when it goes into a file or pipe, made harmless on a terminal."""
    if sys.stdout.isatty():
        for line in text.splitlines():
            say(clean(line))
        return
    write(text)


def write(text: str) -> None:
    """Text on standard output as it is; what the encoding lacks is written as an escape."""
    sys.stdout.write(_encodable(text, sys.stdout))


def remark(line: str) -> None:
    """One line on standard error: what is no result; a terminal wraps it."""
    try:
        print(_encodable(line, sys.stderr), file=sys.stderr)
    except (OSError, ValueError):
        pass  # standard error is full or closed: the results are written all the same


def _encodable(text: str, stream) -> str:
    encoding = getattr(stream, "encoding", None) or "utf-8"
    return text.encode(encoding, "backslashreplace").decode(encoding)


def plain(out=None) -> bool:
    """Whether standard output cannot show lines and dots beyond ASCII."""
    try:
        "├└│─…".encode((out or sys.stdout).encoding or "ascii")
    except (UnicodeEncodeError, LookupError):
        return True
    return False


def table(rows: Iterable[Sequence[str]], right: Sequence[int] = ()) -> list[str]:
    """Rows as lines with aligned columns; columns in `right` are flush right.

    On a terminal with too few columns a row goes on in the next line; cells much longer than others move only their own row.
    """
    rows = [[str(cell) for cell in row] for row in rows]
    if not rows:
        return []
    columns, indices = room(), range(len(rows[0]))
    widths = [max(len(row[i]) for row in rows) for i in indices]
    flush = [str.rjust if i in right else str.ljust for i in indices]
    if columns is None or sum(widths) + 2 * (len(widths) - 1) <= columns:
        return ["  ".join(pad(cell, width) for pad, cell, width in zip(flush, row, widths, strict=True)).rstrip() for row in rows]
    usual = max(2 * columns // 5, 8)
    widths = [max((len(row[i]) for row in rows if len(row[i]) <= usual), default=0) for i in indices]
    return [line for row in rows for line in _flowing([pad(cell, width) for pad, cell, width in
                                                       zip(flush, row, widths, strict=True)], columns)]


def _flowing(cells: Sequence[str], columns: int) -> list[str]:
    """Cells of one row, as many on a line as there is room for."""
    lines = [cells[0]]
    for cell in cells[1:]:
        longer = f"{lines[-1]}  {cell}"
        if len(longer.rstrip()) <= columns:
            lines[-1] = longer
        elif cell.strip():
            lines.append(_BELOW + cell.strip())
    return [line.rstrip() for line in lines]


@contextmanager
def warned(say=remark):
    """What Python warns of inside of the `with` is said in a line, each text once; say : function of the line."""
    with warnings.catch_warnings():
        warnings.simplefilter("default", UserWarning)
        warnings.showwarning = lambda message, *_: say(f"warning: {message}")
        yield
