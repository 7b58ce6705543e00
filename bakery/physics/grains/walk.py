"""Rays through the bounding sphere of a grain until they leave: `Walker.trace`.

This is the seam for other tracers: whatever fills `Paths` from entries and a seed can stand in for `Walker`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bakery.physics.grains._walk import followed
from bakery.physics.grains.bvh import Mesh
from bakery.physics.grains.sampling import ABSORBED, CONTRADICTED, CUT, LEFT, MISSED, coat, philox, stream
from bakery.physics.grains.surface import Surface

__all__ = ["ABSORBED", "CONTRADICTED", "CUT", "EVENTS_MAX", "LEFT", "MISSED", "Paths", "Walker", "philox"]
EVENTS_MAX = 100_000


class Paths(NamedTuple):
    """What became of n rays."""

    # (n,) MISSED the grain, LEFT the sphere after a hit, ABSORBED (by the surface or by roulette), CONTRADICTED (inside where the
    # surface says outside, or the reverse: a mesh that is not closed, or rounding), CUT after `events_max` hits
    status: np.ndarray
    # start, leave: (n, 3) R, on the bounding sphere;  leave is undefined unless the ray missed or left
    start: np.ndarray
    leave: np.ndarray
    # incoming, outgoing: (n, 3) unit directions of travel
    incoming: np.ndarray
    outgoing: np.ndarray
    inside: np.ndarray  # (n,) R, path length inside the grain
    # (n, C) 1, per channel; of a path that was cut, what it carried; 0 for ABSORBED and CONTRADICTED, 1 for MISSED
    weight: np.ndarray
    events: np.ndarray  # (n,) meetings with the surface

    @classmethod
    def empty(cls, count, channels) -> Paths:
        """Room for the records of `count` rays."""
        return cls(np.empty(count, np.int8), *(np.empty((count, 3)) for _ in range(4)), np.empty(count),
                   np.empty((count, channels)), np.empty(count, np.int64))


@dataclass(frozen=True)
class Walker:
    """Traces rays against a mesh in numba, on any machine."""

    mesh: Mesh  # of the grain
    surface: Surface  # of the grain; its channels are one or as many as mu's
    mu: np.ndarray  # (C,) 1/R, absorption coefficient of the interior
    events_max: int = EVENTS_MAX  # meetings with the surface after which a path is cut; what it carried is recorded as lost

    def trace(self, uniform, first, replicate, key) -> Paths:
        """Follow the rays of `uniform` (n, 4), numbers in [0, 1): direction (2), place on the disc across it (2).

        first, replicate : path i draws its random numbers from the stream (first + i, replicate) of the key (two words of 32
        bits), whatever else is traced.
        """
        paths = Paths.empty(len(uniform), len(self.mu))
        grid = self.mesh.grid._replace(count=tuple(map(int, self.mesh.grid.count)))
        followed(grid, coat(self.surface, self.mu), self.events_max, uniform, stream(first, replicate, key), paths)
        return paths
