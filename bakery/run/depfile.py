"""The list of files that an asset depends on, in the syntax that Make and Ninja read.

One target, all files read, and an empty rule a file (as `gcc -MP` writes), so that a removed input does not stop Make.
"""

from collections.abc import Iterable
from pathlib import Path

from bakery.errors import UsageError
from bakery.store.put import put


def escape(path: str) -> str:
    """A path as Make reads it: space, `#` and `$` guarded.  Make cannot name a file with a line break."""
    if "\n" in path or "\r" in path:
        raise UsageError(f"--depfile: found {path!r}; Make cannot name a file whose path holds a line break")
    return path.replace("$", "$$").replace("#", "\\#").replace(" ", "\\ ")


def text(target: str, files: Iterable[str]) -> str:
    """The depfile's text."""
    names = [escape(name) for name in dict.fromkeys(files)]
    lines = [f"{escape(target)}:" + "".join(f" \\\n  {name}" for name in names), ""]
    for name in names:
        lines += [f"{name}:", ""]
    return "\n".join(lines)


def write(path: Path, target: str, files: Iterable[str]) -> None:
    """Write the depfile by rename, so that Make never reads half of one."""
    put(path, text(target, files))
