"""Aggregates as balls and rods that stand in each other: where they lie, the function that is 0 on their common surface, and how
fine a mesh of it has to be."""

from typing import NamedTuple

import numpy as np

from bakery.physics.shapes import implicit
from bakery.physics.shapes.noise import directions, stream

_STREAM = 13  # of random numbers
_DETAIL = 0.6  # of the thinnest body's radius: step of a grid that sees it
# Triangles that marching makes, over the area of the bodies by themselves and the square of the grid's step: 7.4 for 6 balls, 5.5
# to 6.7 for 6 rods, 4.4 for 20, 3.2 to 3.5 for 64 balls, much of whose area is inside of others
_TRIANGLES = 5.0


class Rods(NamedTuple):
    """Bodies of an aggregate."""

    # start, axis: (N, 3), of rods with round ends; an axis of 0: a ball.  The first body's radius is 1
    start: np.ndarray
    axis: np.ndarray
    radius: np.ndarray  # (N,)
    blend: float  # width over which grooves are filled

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners (3,) of a box around them."""
        ends = np.concatenate([self.start, self.start + self.axis])
        around = np.concatenate([self.radius, self.radius])[:, None] + (self.blend * np.log(len(self.radius)) + 0.1)
        return (ends - around).min(axis=0), (ends + around).max(axis=0)

    @property
    def step(self) -> float:
        """Of the grid in the first try for a mesh; ValueError where none is fine enough (`implicit.first_step`)."""
        return implicit.first_step(*self.box, self.detail)

    @property
    def detail(self) -> float:
        """Largest step of a grid that resolves all of them."""
        return _DETAIL * self.radius.min()

    def distance(self, points):
        """Distance (N,) of points (N, 3) to their union, about; corners between them are filled over `blend`."""
        start, axis, radius, blend = self
        nearest, distances = np.full(len(points), np.inf), np.empty((len(radius), len(points)))
        for k in range(len(radius)):
            apart = points - start[k]
            square = (axis[k] ** 2).sum()
            if square > 0:
                along = np.clip((apart * axis[k]).sum(axis=1) / square, 0.0, 1.0)
                apart -= along[:, None] * axis[k]
            distances[k] = np.sqrt((apart**2).sum(axis=1)) - radius[k]
            np.minimum(nearest, distances[k], out=nearest)
        return nearest - blend * np.log(np.exp((nearest - distances) / blend).sum(axis=0))

    def triangles(self, wanted: int) -> tuple[float, float]:
        """About how many triangles `implicit.surface` makes for a mesh of so many: in all its tries, and in the last one."""
        area = np.sum(4 * np.pi * self.radius**2 + 2 * np.pi * self.radius * np.linalg.norm(self.axis, axis=1))
        first = float(_TRIANGLES * area / self.step**2)
        last = max(first, implicit.SPARE * wanted)
        return first + (last if last > first else 0.0), last


def grown(seed, arrangement, bodies, smallest, length, overlap, blend) -> Rods:
    """Bodies of numbers as `build.aggregate` describes them, which checks them."""
    return Rods(*_placed(stream(seed, _STREAM), arrangement, bodies, smallest, length, overlap), blend)


def _placed(rng, arrangement, count, smallest, length, overlap):
    """Starts (N, 3), axes (N, 3) and radii (N,) of rods with round ends."""
    start, axis, radius = [np.zeros(3)], [np.zeros(3)], [1.0]
    arms = []
    for k in range(1, count):
        radius.append(smallest + (1 - smallest) * rng.random())
        if arrangement == "star":
            # of a few directions the one farthest from those taken
            choice = directions(rng, 16)
            lonely = choice[np.argmin(np.max([choice @ w for w in arms], axis=0))] if arms else choice[0]
            arms.append(lonely)
            radius[k] *= 0.75  # arms are thinner than the centre
            start.append(np.zeros(3))
            axis.append(lonely * radius[k] * length * (0.6 + 0.8 * rng.random()))
            continue
        host = int(rng.random() * k)
        away, along = directions(rng, 2)
        at = start[host] + rng.random() * axis[host] + away * (radius[host] + radius[k] - overlap * min(radius[host], radius[k]))
        axis.append(along * radius[k] * length)
        start.append(at - 0.5 * axis[k])
    return np.array(start), np.array(axis), np.array(radius)
