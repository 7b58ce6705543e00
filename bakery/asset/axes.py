"""Which coordinate belongs to which axis of a stored array, from the declarations of the stages."""

import re

import numpy as np

from bakery.family.tree import is_family
from bakery.stages import all_stages
from bakery.stages.conform import FAMILY
from bakery.stages.coordinates import ERROR, coordinate
from bakery.store.tree import Group

# axes of a family's datasets behind those of its points
_OF_POINTS = {name: ("L",) for name in ("sigma_t", "sigma_s", "sigma_a", "albedo", "g")} | {
    "phase": ("L", "A"), "ratios": ("L", "-", "A")}


def axes(root: Group, path: str) -> tuple[str, ...]:
    """The letters of a dataset's axes, such as ("L", "A"); "-" for an axis without a coordinate."""
    member = root[path]
    if path == "wavelength":
        return ("L",)
    if points := of_points(root, path):
        return ("-",) * len(points) + _OF_POINTS.get(path.partition("/")[2], ())
    letters = declared_letters(root, path)
    if len(letters) != member.data.ndim:
        letters = ("-",) * member.data.ndim
    axes = [(letter, coordinate(root, path, letter)) for letter in letters]
    return tuple(letter if axis is not None and axis[1].data.shape == (length,) else "-"
                 for (letter, axis), length in zip(axes, member.data.shape, strict=True))


def of_points(root: Group, path: str) -> list[tuple[str, str, np.ndarray]]:
    """Name, unit and values of a family's axes, over which a dataset of it is tabulated first; none of any other dataset."""
    group, _, inner = path.partition("/")
    if group != FAMILY or not is_family(root) or inner.partition("/")[0] not in (*_OF_POINTS, "members"):
        return []
    groups = root[FAMILY]["axes"].members
    names = sorted(groups, key=lambda name: groups[name].attributes["order"])
    return [(name, groups[name]["value"].units, groups[name]["value"].data) for name in names]


def declared_letters(root: Group, path: str) -> tuple[str, ...]:
    """The letters that a dataset's stage declares for its axes, with a coordinate or without; () where none speaks of it."""
    return _declared(root, path) or _declared(root, path.removesuffix(ERROR))


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
