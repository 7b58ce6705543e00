"""Small files that are written whole or not at all: pictures, pages, tables, scenes."""

from __future__ import annotations

import os
import secrets
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from bakery.errors import StoreError, UsageError
from bakery.store.write import check_target


def folder_for(path: Path) -> Path:
    """The folder, made if it is missing."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise UsageError(f"{path}: found a file where a folder should be; choose another with -o") from None
    except OSError as error:
        raise UsageError(f"{path}: the folder cannot be made: {error.strerror}; choose another with -o") from None
    return path


def put(path: Path, data: bytes | str) -> Path:
    """Write a file beside its place and rename it; what stood there stays whole until then.

    Raises
    ------
    UsageError : nothing can be written there: no folder, no right, a folder or device at the path
    StoreError : the system refused
    """
    check_target(path)
    data = data.encode() if isinstance(data, str) else data
    target = os.path.realpath(path)  # a symbolic link stays, the file that it names is replaced
    part = os.path.join(os.path.dirname(target), f".{path.name[:40]}.{secrets.token_hex(6)}.tmp")
    try:
        with open(part, "xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, target)
    except OSError as error:
        raise StoreError(f"{path}: not written: {error.strerror}") from error
    finally:
        with suppress(OSError):
            os.unlink(part)
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
