"""Every grain of a body by itself: where it is, how large, of which type and how it is turned."""

import itertools
from typing import NamedTuple

import numpy as np

from bakery.kernels import aggregate_scratch, enclosing_sphere, instance, instance_of, lent, rotation_matrix
from bakery.system.compiled import njit

_LANES = 4  # triangles side by side in a block of `Exemplars.blocks`


class Listed(NamedTuple):
    """N grains.

    centre, radius : (N, 3), (N,) units, of their spheres
    kind : (N,) type;  turn : (N, 3, 3) rotation of the exemplar
    """

    centre: np.ndarray
    radius: np.ndarray
    kind: np.ndarray
    turn: np.ndarray


def listed(grains) -> Listed:
    """All of `renderers.materials.grains._grains.Grains`, in the order of the copies of their tile."""
    aggregate = grains.aggregate
    cell, high = aggregate.cell, aggregate.low + aggregate.voxels.shape * aggregate.edge
    copies = itertools.product(*(np.arange(np.floor(a), np.floor(b) + 1) for a, b in zip(aggregate.low / cell, high / cell)))
    points = [np.mod(aggregate.centers, cell) + np.array(copy) * cell for copy in copies]
    points = np.concatenate([point[np.all((point > aggregate.low) & (point < high), axis=1)] for point in points])
    count = len(points)
    present, grain = np.empty(count, bool), Listed(points, np.empty(count), np.empty(count, np.int64), np.empty((count, 3, 3)))
    look_up(grains, *grain, present)
    return Listed(*(values[present] for values in grain))


@njit(cache=True, nogil=True, error_model="numpy")
def look_up(grains, centre, radius, kind, turn, present):
    """Whether spheres with centres near points (N, 3) are there (N,), and what is in them; the points become the centres."""
    grains = lent(grains)
    aggregate, scratch, sphere = grains.aggregate, aggregate_scratch(), np.empty(4, np.int64)
    for i in range(len(centre)):
        present[i] = enclosing_sphere(aggregate, centre[i], sphere, scratch)
        if not present[i]:
            continue
        s, a, b, c = sphere
        for k in range(3):
            centre[i, k] = aggregate.centers[s, k] + sphere[1 + k] * aggregate.cell[k]
        radius[i] = aggregate.radii[s]
        if grains.mixture.values.size > 0:
            kind[i], q = instance_of(grains.seed, a, b, c, s, grains.mixture, centre[i, 0], centre[i, 1], centre[i, 2])
        else:
            kind[i], q = instance(grains.seed, a, b, c, s, grains.shares)
        entries = rotation_matrix(q[0], q[1], q[2], q[3])
        for k in range(9):
            turn[i, k // 3, k % 3] = entries[k]


def exemplar_mesh(grains, kind):
    """Corners (F, 3, 3) of the triangles of a type of grain in its unit sphere; None of a ball."""
    if grains.exemplars.table[kind, 3] > 0.0:
        return None
    first, last = grains.exemplars.offset[kind : kind + 2, 1]
    corners = grains.exemplars.blocks[first:last].reshape(-1, 3, 3, _LANES).transpose(0, 3, 2, 1).reshape(-1, 3, 3)
    return corners[np.any(corners != 0, axis=(1, 2))]
