"""Folders for what people look at, and tables as CSV."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bakery.errors import UsageError


def folder_for(path: Path) -> Path:
    """The folder, made if it is missing."""
    if str(path) == "-":
        raise UsageError("-: outputs go into a folder, not to standard output; name one with -o")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise UsageError(f"{path}: found a file where a folder should be; choose another with -o") from None
    except OSError as error:
        raise UsageError(f"{path}: the folder cannot be made: {error.strerror}; choose another with -o") from None
    return path


def csv_text(columns: Sequence[tuple[str, Sequence]]) -> str:
    """Columns of equal length as CSV (RFC 4180, but with plain line ends); numbers with all their digits."""
    import csv
    import io

    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([heading for heading, _ in columns])
    writer.writerows(zip(*(_cells(values) for _, values in columns), strict=True))
    return out.getvalue()


def _cells(values) -> list:
    plain = values.tolist() if hasattr(values, "tolist") else values
    return [repr(value) if isinstance(value, float) else value for value in plain]
