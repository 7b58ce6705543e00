"""Bodies and what is around them, as paths are given it, and the light that they bring."""

from typing import NamedTuple

import numpy as np

from renderers.materials.bodies import _geometry
from renderers.materials.bodies.bodies import Body
from renderers.transport import steps
from renderers.transport.paths import Colours

_OFF = 1e-6  # of the size of all bodies, that a path is put beyond a boundary which it crosses


class Transport(NamedTuple):
    """How light goes.

    world : `renderers.mitsuba.world.World`;  bodies : list of `Body`;  geometry : `_geometry.Geometry`;  colours : `Colours`
    bent : of each body, ways of light through its boundary (`refraction.Bent`) from each light that paths cannot find through it
    rivals : (bodies,) m sr, how many beams bring light of lamps through boundaries, besides paths (`beams.rivals_of`); 0 where
        none do; None: nowhere
    panes : whether other shapes are of smooth glass
    points, enclosed : lights without extent (`renderers.mitsuba.world.IdealLight`) outside of all bodies whose boundary turns
        light, and inside of one
    lamps : numbers of the bodies that lights reach into, or nearly
    searched : share of the events from which, by chance, ways of `bent` are looked for for all
    """

    world: object
    bodies: list[Body]
    geometry: _geometry.Geometry
    colours: Colours
    bent: list
    rivals: np.ndarray | None = None
    panes: bool = False
    points: tuple = ()
    enclosed: tuple = ()
    lamps: frozenset = frozenset()
    searched: float = 1.0

    @property
    def chained(self):
        """Whether light of lights without extent comes to events by ways that `chains` has to follow."""
        return bool(self.enclosed) or bool(self.points) and any(body.smooth and not body.matched for body in self.bodies)

    @property
    def matched(self):
        """(bodies,) bool, boundaries to which light is blind."""
        return np.array([body.matched for body in self.bodies])

    @property
    def sigma_t(self):
        """(bodies, L) 1/m"""
        return np.array([body.medium.sigma_t for body in self.bodies])

    @property
    def off(self):
        """m, that a path is put beyond a boundary."""
        return _OFF * self.geometry.scale


class Sums(steps.Sums):
    """As `steps.Sums`, of no light by itself; `by_order` without what `gathered` holds.

    gathered : (pixels, 3) of beams, by the tables
    by_paths : whether light counts that paths find by themselves; else only that of beams does
    """

    def __init__(self, pixels, by_paths=True):
        super().__init__(pixels, 0, pixels)
        self.gathered, self.by_paths = np.zeros((pixels, 3)), by_paths

    def add_of_beams(self, paths, added, orders):
        """What beams bring lines of sight, added (n, 3), with so many events more."""
        self.add(paths._replace(order=paths.order + orders), np.full(paths.count, -1), added)

    def add_gathered(self, paths, added):
        """What the tables bring, added (n, 3)."""
        for c in range(3):
            self.gathered[:, c] += np.bincount(paths.pixel, added[:, c], len(self.gathered))
