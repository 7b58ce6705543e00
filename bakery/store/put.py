"""Small files that are written whole or not at all: pictures, pages, tables, scenes, depfiles."""

import os
import secrets
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from bakery.errors import StoreError
from bakery.store.write import check_target


def put(path: Path, data: bytes | str) -> Path:
    """Write a file beside its place and rename it; what stood there stays whole until then.

    Raises
    ------
    UsageError : nothing can be written there: no folder, no right, a folder or device at the path
    StoreError : the system refused
    """
    put_all({path: data})
    return path


def put_all(files: Mapping[Path, bytes | str]) -> list[Path]:
    """Write several files, all of them or none: each is beside its place before the first takes it.

    Raises as `put`.  What a power cut between two renames leaves are whole files.
    """
    for path in files:
        check_target(path)
    parts = {}
    try:
        for path, data in files.items():
            target = os.path.realpath(path)  # a symbolic link stays, the file that it names is replaced
            part = os.path.join(os.path.dirname(target), f".{path.name[:40]}.{secrets.token_hex(6)}.tmp")
            parts[part] = path, target
            with open(part, "xb") as file:
                # names of files that are no UTF-8 keep their bytes, which is what Make reads in a depfile
                file.write(data.encode(errors="surrogateescape") if isinstance(data, str) else data)
                file.flush()
                os.fsync(file.fileno())
        for part, (path, target) in parts.items():  # noqa: B007 the message below names it
            os.replace(part, target)
    except OSError as error:
        raise StoreError(f"{path}: not written: {error.strerror}") from error
    finally:
        for part in parts:
            with suppress(OSError):
                os.unlink(part)
    return list(files)
