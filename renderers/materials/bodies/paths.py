"""Paths from the eye, or from the lights, through bodies and the surfaces around them: their state."""

from typing import NamedTuple

import numpy as np

from renderers.transport import paths, wavefront

UNLIMITED = 1 << 40  # events between two surfaces
_WEAK = 0.1  # weight of paths, below which not all of them count


class Paths(NamedTuple):
    """n paths on their way; arrays are changed in place.

    origin, direction : (n, 3) m, unit;  throughput : (n, L);  states : (n,) random streams;  pixel : (n,)
    start : (n,) place of the triangle (`_geometry.Geometry`) that each starts on, or -1
    far, triangle : (n,) distance (m) and place of the first triangle ahead; nan where not known
    drawn, density : (n, 3) m, (n,) 1/sr, where the direction was drawn, and how likely
    single : (n,) whether light samples cannot take the place of the direction;  scattered : (n,) whether an event drew it
    seen : (n,) whether the camera sees where they are, directly or by mirrors and panes
    rival : (n,) sr, after an event and up to the first light beyond the boundary: how likely beams are that bring the same
        (`_beams.rivals`); 0 where none do, inf where they are left to it
    order : (n,) events of all;  events : (n,) since the last surface;  bounces : (n,) events and surfaces
    """

    origin: np.ndarray
    direction: np.ndarray
    throughput: np.ndarray
    states: np.ndarray
    pixel: np.ndarray
    start: np.ndarray
    far: np.ndarray
    triangle: np.ndarray
    drawn: np.ndarray
    density: np.ndarray
    single: np.ndarray
    scattered: np.ndarray
    seen: np.ndarray
    rival: np.ndarray
    order: np.ndarray
    events: np.ndarray
    bounces: np.ndarray

    @classmethod
    def begun(cls, origin, direction, throughput, states, pixel) -> "Paths":
        """Paths in the open, or on a surface."""
        n = len(pixel)
        return cls(origin=np.array(origin, float), direction=np.array(direction, float), throughput=np.array(throughput, float),
                   states=states, pixel=pixel, start=np.full(n, -1), far=np.full(n, np.nan), triangle=np.full(n, -1),
                   drawn=np.array(origin, float), density=np.zeros(n), single=np.ones(n, bool), scattered=np.zeros(n, bool),
                   seen=np.zeros(n, bool), rival=np.zeros(n), order=np.zeros(n, np.int64), events=np.zeros(n, np.int64),
                   bounces=np.zeros(n, np.int64))

    count, of = paths.Paths.count, paths.Paths.of


def thinned(every, counts, share=1.0) -> tuple[np.ndarray, Paths]:
    """A share of paths, by chance, and fewer of little weight: their rows (m,), and copies that stand for all.

    every : `Paths`, of which each draws a number;  counts : (n,) bool, of which
    """
    chance = share * np.minimum(every.throughput.max(axis=1) / _WEAK, 1.0)
    rows = np.flatnonzero(counts & (wavefront.uniforms(every.states, 1)[:, 0] < chance))
    chosen = every.of(rows)
    chosen.throughput[:] /= chance[rows, None]
    return rows, chosen
