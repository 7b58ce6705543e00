"""Paths from the eye, or from the lights, through bodies and the surfaces around them."""

import numpy as np

from renderers.transport import wavefront
from renderers.transport.paths import Paths

UNLIMITED = 1 << 40  # events between two surfaces
_WEAK = 0.1  # weight of paths, below which not all of them count


def starting(origin, direction, waves, states, pixel) -> Paths:
    """Paths in the open, or on a surface."""
    origin = np.array(origin, float)
    return Paths.begun(origin, np.array(direction, float), waves, states, pixel, drawn=origin.copy(), far=np.nan, triangle=-1,
                       start=-1, events=0, scattered=False, seen=False, rival=0.0)


def thinned(every, counts, share=1.0) -> tuple[np.ndarray, Paths]:
    """A share of paths, by chance, and fewer of little weight: their rows (m,), and copies that stand for all.

    every : `Paths`, of which each draws a number;  counts : (n,) bool, of which
    """
    chance = share * np.minimum(every.throughput.max(axis=1) / _WEAK, 1.0)
    rows = np.flatnonzero(counts & (wavefront.uniforms(every.states, 1)[:, 0] < chance))
    chosen = every.of(rows)
    chosen.throughput[:] /= chance[rows, None]
    return rows, chosen
