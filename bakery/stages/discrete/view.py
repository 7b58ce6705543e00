"""What the group `discrete` can be asked: its particles' classes in one list, and the class of each particle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bakery.stages.members import Members
from bakery.store.tree import Group


@dataclass(frozen=True)
class Classes:
    """All classes of a medium of separate particles, K of them: component by component, by ascending radius.

    Attributes
    ----------
    names : of the components, in the recipe's order
    component : (K,) index of each class's component
    radius : (K,) um
    share : (K,) of all particles, adds up to 1
    extinction, scattering : (L, K) um^2
    spread : (L, K) 1, relative variance of the extinction within the class
    phase : (L, K, A) 1/sr float32, at theta (A,) rad
    """

    names: tuple[str, ...]
    component: np.ndarray
    radius: np.ndarray
    share: np.ndarray
    extinction: np.ndarray
    scattering: np.ndarray
    spread: np.ndarray
    phase: np.ndarray
    theta: np.ndarray


def classes_of(group: Group) -> Classes:
    """The classes of a `discrete` group."""
    parts = group.groups
    names = sorted(parts, key=lambda name: int(parts[name]["index"].data[0]))
    ordered = [parts[name] for name in names]

    def joined(name, axis=0):
        return np.concatenate([np.asarray(part[name].data) for part in ordered], axis=axis)

    counts = [part["radius"].data.size for part in ordered]
    fraction = np.repeat([float(part["fraction"].data[0]) for part in ordered], counts)
    share = fraction * joined("share")
    return Classes(tuple(names), np.repeat(np.arange(len(names)), counts), joined("radius"), share / share.sum(),
                   joined("extinction", 1), joined("scattering", 1), joined("spread", 1), joined("phase", 1), group["theta"].data)


def kinds_of(group: Group) -> np.ndarray:
    """Class of each stored particle, (N,) uint16, as `classes_of` counts them."""
    classes = classes_of(group)
    radius, component = group["radius"].data, group["component"].data
    out = np.empty(len(radius), np.uint16)
    for c in range(len(classes.names)):
        of_component = np.flatnonzero(classes.component == c)
        of = component == c
        out[of] = of_component[0] + np.searchsorted(classes.radius[of_component].astype(np.float32), radius[of])
    return out


def view(root: Group) -> Discrete:
    """The group as `bakery.open` gives it."""
    return Discrete(root["discrete"])


class Discrete(Members):
    """The group `discrete`: datasets by name, and its classes."""

    def __init__(self, group: Group):
        super().__init__(group, "discrete")

    def classes(self) -> Classes:
        """All classes of particles in one list."""
        return classes_of(self._group)

    def kinds(self) -> np.ndarray:
        """Class of each stored particle, (N,) uint16; AttributeError where none is stored."""
        if "position" not in self:
            raise AttributeError("this realisation is procedural: no particle is stored")
        return kinds_of(self._group)
