"""The house's docstrings as reStructuredText, for Sphinx's autodoc: sections, and `name : meaning` lines as lists.

Sphinx's own reader of such sections takes what stands behind the colon for a type, and looks every word of it up.
"""

from __future__ import annotations

import re
from itertools import pairwise

SECTIONS = ("Parameters", "Returns", "Yields", "Raises", "Attributes", "Notes", "Examples")
ITEM = re.compile(r"(\S[^:`]{0,70}?) : (.+)")
SPECIAL = re.compile(r"([*|\\]|(?<=\w)_(?!\w))")  # would begin emphasis, a substitution, a reference


def rewritten(lines: list[str]) -> list[str]:
    """Lines of a docstring, indented alike, as lines of reStructuredText."""
    found: list[str] = []
    for block in _blocks(lines):
        if len(block) > 1 and block[0] in SECTIONS and set(block[1]) == {"-"}:
            found += [f".. rubric:: {block[0]}", ""]
            block = block[2:]
        if block and block[0].startswith(">>>"):
            found += block
        elif block and ITEM.match(block[0]):
            found += _list(block)
        else:
            found += [escaped(line) for line in block]
        found.append("")
    return found


def escaped(text: str) -> str:
    """A line without marks of its own but `code`."""
    parts = text.split("`")
    return "`".join(SPECIAL.sub(r"\\\1", part) if i % 2 == 0 else part for i, part in enumerate(parts))


def _list(block: list[str]) -> list[str]:
    """Lines `name : meaning`, with what follows indented or not, as a list."""
    found: list[str] = []
    for line in block:
        for part in line.split(";  "):  # several in a line stand two blanks apart
            item = ITEM.match(part.strip()) if part is not line or not line.startswith(" ") else None
            found.append(f"* **{escaped(item[1])}** – {escaped(item[2])}" if item else f"  {escaped(part.strip())}")
    return found


def _blocks(lines: list[str]) -> list[list[str]]:
    """Paragraphs; a section's heading opens one."""
    blocks: list[list[str]] = [[]]
    for line, after in pairwise([*lines, ""]):
        if not line.strip() or (line in SECTIONS and after.startswith("---")):
            blocks.append([])
        if line.strip():
            blocks[-1].append(line)
    return [block for block in blocks if block]
