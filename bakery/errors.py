"""What can go wrong, as one family of exceptions.

Anything that a user can cause is a `BakeryError`: its text is the whole message and `exit_status` is what the command
line returns.  Any other exception that reaches the user is a bug in bakery.
"""

from dataclasses import dataclass


class BakeryError(Exception):
    """Base class; `exit_status` follows the command line's contract (docs/cli.md)."""

    exit_status = 2

    def ending(self, status: int):
        """The same with an exit status of its own."""
        self.exit_status = status
        return self


class UsageError(BakeryError):
    """The call itself is wrong: unknown option, missing file, impossible output path."""


class AssetError(BakeryError):
    """An asset is damaged, foreign, of another format version, or lacks a stage."""


class StageError(BakeryError):
    """A stage could not deliver: tolerance out of reach, a worker lost, memory exhausted."""

    exit_status = 3


class StoreError(BakeryError):
    """A file could not be written or read: disk full, no permission, lock not granted."""

    exit_status = 3


class Interrupted(BakeryError):
    """The user stopped the bake; finished stages are in the cache."""

    exit_status = 130


@dataclass(frozen=True)
class Problem:
    """One fault of a recipe or of a table it names.

    `found` is what stands there, `expected` what would do; `excerpt` is the line with a caret under the place.
    """

    file: str
    line: int | None
    column: int | None
    key: str
    found: str
    expected: str
    excerpt: str = ""

    def __str__(self) -> str:
        location = self.file if self.line is None else f"{self.file}:{self.line}"
        head = f"{location}: {self.key}: " if self.key else f"{location}: "
        text = head + "; ".join(part for part in (self.found, self.expected) if part)
        return text + ("\n" + self.excerpt if self.excerpt else "")

    def as_dict(self) -> dict:
        """The same for machines (`--json`)."""
        return {"file": self.file, "line": self.line, "column": self.column, "key": self.key, "found": self.found,
                "expected": self.expected}


class RecipeError(BakeryError):
    """All problems of a recipe at once, in the order of their lines."""

    def __init__(self, problems):
        self.problems = sorted(problems, key=lambda p: (p.file, p.line or 0, p.column or 0))
        super().__init__("\n".join(str(p) for p in self.problems))
