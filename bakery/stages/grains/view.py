"""What the group `grains` can be asked: the exemplar of each component, its mesh, shape and surface as objects."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bakery.stages.members import Members
from bakery.store.tree import Group, read_text


def view(root: Group) -> Grains:
    """The group as `bakery.open` gives it."""
    return Grains(root["grains"], "grains", wavelength=root["wavelength"].data)


@dataclass(frozen=True)
class Exemplar:
    """One component's grain: a solid in its bounding sphere, the unit sphere (`bakery.physics.shapes.solid`).

    Attributes
    ----------
    vertices, faces : (V, 3) in bounding radii, (F, 3) counterclockwise seen from outside; of a ball they are for pictures only
    ball : whether the grain is exactly the unit ball
    shape : as in the recipe
    surface : `type` with `index`, `reflectance` or `n` and `k`, relative to the host, one number a wavelength; `roughness`
    """

    vertices: np.ndarray
    faces: np.ndarray
    ball: bool
    shape: Mapping
    surface: Mapping


class Grains(Members):
    """The group `grains`: members as they are stored.

    Attributes
    ----------
    exemplars : name of a component -> `Exemplar`
    """

    @cached_property
    def exemplars(self) -> dict[str, Exemplar]:
        return {name: exemplar(part) for name, part in self._group.groups.items()}


def exemplar(component: Group) -> Exemplar:
    """The grain of a component that is as its stage declares."""
    shape, surface = (json.loads(read_text(component[name])) for name in ("shape", "surface"))
    return Exemplar(component["vertices"].data, component["faces"].data, shape["type"] == "sphere", shape, surface)
