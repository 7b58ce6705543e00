"""Which coordinate belongs to which axis of a stored array, from the declarations of the stages."""

from __future__ import annotations

import re

from bakery.stages import all_stages
from bakery.stages.coordinates import ERROR, coordinate
from bakery.store.tree import Group


def axes(root: Group, path: str) -> tuple[str, ...]:
    """The letters of a dataset's axes, such as ("L", "A"); "-" for an axis without a coordinate."""
    member = root[path]
    if path == "wavelength":
        return ("L",)
    letters = _declared(root, path) or _declared(root, path.removesuffix(ERROR))
    if len(letters) != member.data.ndim:
        letters = ("-",) * member.data.ndim
    lengths = zip(letters, member.data.shape, strict=True)
    return tuple(letter if _fits(root, path, letter, length) else "-" for letter, length in lengths)


def _fits(root: Group, path: str, letter: str, length: int) -> bool:
    found = coordinate(root, path, letter)
    return found is not None and found[1].data.shape == (length,)


def _declared(root: Group, path: str) -> tuple[str, ...]:
    """The letters of the shape that the stage declares for a path; () where no declaration speaks of it."""
    group, _, inner = path.partition("/")
    attributes = getattr(root.members.get(group), "attributes", {})
    if not inner or "stage" not in attributes:
        return ()
    for stage in all_stages():
        if stage.name != attributes["stage"]:
            continue
        for output in stage.outputs:
            if _stands_for(output.path, inner):
                return tuple(re.findall(r"[A-Z]|\d+", output.shape))
    return ()


def _stands_for(declared: str, path: str) -> bool:
    """Whether a declared path means this one; words in capitals stand for any name."""
    words, names = declared.split("/"), path.split("/")
    return len(words) == len(names) and all(word == name or word.isupper() for word, name in zip(words, names, strict=True))
