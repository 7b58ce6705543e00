"""Small files that are written whole or not at all: pictures, pages, tables, scenes, depfiles."""

import os
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

from bakery.errors import StoreError
from bakery.store.files import FILES
from bakery.store.write import check_target, new_part, write_all


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

    Raises as `put`.  What a power cut between two renames leaves are whole files; what killed writers leave beside them goes
    with the next file that is written in that folder.
    """
    for path in files:
        check_target(path)
    parts = {}
    try:
        with ExitStack() as stack:
            for path, data in files.items():
                target = os.path.realpath(path)  # a symbolic link stays, the file that it names is replaced
                fd, part = stack.enter_context(new_part(target))
                parts[part] = path, target
                # names of files that are no UTF-8 keep their bytes, which is what Make reads in a depfile
                write_all(FILES, fd, data.encode(errors="surrogateescape") if isinstance(data, str) else bytes(data))
                FILES.sync(fd)
            for part, (path, target) in parts.items():  # noqa: B007 the message below names it
                FILES.replace(part, target)
    except OSError as error:
        raise StoreError(f"{path}: not written: {error.strerror}") from error
    return list(files)
