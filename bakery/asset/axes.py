"""Which coordinate belongs to which axis of a stored array, from the declarations of the stages."""

from __future__ import annotations

import re

import numpy as np

from bakery.store.tree import Dataset, Group

# letter in a declared shape -> the dataset that holds the coordinate, looked for beside the array, then upwards, then in `medium`
COORDINATES = {"L": "wavelength", "A": "theta", "R": "radius"}


def axes(root: Group, path: str) -> tuple[str, ...]:
    """The letters of a dataset's axes, such as ("L", "A"); "-" for an axis without a coordinate."""
    member = root[path]
    if path == "wavelength":
        return ("L",)
    letters = _declared(root, path) or _declared(root, path.removesuffix("_error"))
    if len(letters) != member.data.ndim:
        letters = ("-",) * member.data.ndim
    lengths = zip(letters, member.data.shape, strict=True)
    return tuple(letter if _fits(root, path, letter, length) else "-" for letter, length in lengths)


def coordinate(root: Group, path: str, letter: str) -> tuple[str, Dataset] | None:
    """Path and dataset of the coordinate of an axis, as seen from the dataset at `path`."""
    name = COORDINATES.get(letter)
    if name is None:
        return None
    parts = path.split("/")[:-1]
    for places in [parts[:n] for n in range(len(parts), -1, -1)] + [["medium"]]:
        here = "/".join([*places, name])
        try:
            found = root[here]
        except KeyError:
            continue
        if isinstance(found, Dataset) and found.data.ndim == 1:
            return here, found
    return None


def standard_error(root: Group, path: str) -> np.ndarray | None:
    """The values of `X_error` beside a Monte Carlo figure X, or None."""
    try:
        found = root[path + "_error"]
    except KeyError:
        return None
    same = isinstance(found, Dataset) and found.data.shape == root[path].data.shape
    return found.data if same else None


def _fits(root: Group, path: str, letter: str, length: int) -> bool:
    found = coordinate(root, path, letter)
    return found is not None and found[1].data.shape == (length,)


def _declared(root: Group, path: str) -> tuple[str, ...]:
    """The letters of the shape that the stage declares for a path; () where no declaration speaks of it."""
    from bakery.stages import all_stages

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
