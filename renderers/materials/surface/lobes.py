"""Baked layers as compiled loops of wavefronts take them."""

import numpy as np

from renderers.materials.surface import _lobes
from renderers.materials.surface._lobes import Lobes
from renderers.mitsuba import layers
from renderers.threads import run


def of_layer(layer) -> Lobes:
    """Of a `renderers.mitsuba.layers.Layer` without a boundary, which lets no light through."""
    cells = layers.cells_of(layer)
    return Lobes(layer.table, np.ascontiguousarray(cells.below_mu[0]), np.ascontiguousarray(cells.below_phi[0]),
                 np.ascontiguousarray(cells.density[0]), cells.mu**2, cells.phi)


def next_event(lobes, colours, walk, normal, sample, passed) -> np.ndarray:
    """What light samples send by way of a surface, (n, 3) linear sRGB; parameters as those of `_lobes.next_event`."""
    added = np.empty((len(normal), 3))
    run(_lobes.next_event, len(normal), lobes, colours, walk, normal, sample, passed, added)
    return added


def scatter(lobes, walk, normal) -> None:
    """Turns paths at a surface with outward normals (n, 3)."""
    run(_lobes.scatter, len(normal), lobes, walk, normal)
