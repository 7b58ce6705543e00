"""Types of grain laid out for compiled loops: one table, and the trees of all meshes one after the other."""

from typing import NamedTuple

import numpy as np


class Exemplars(NamedTuple):
    """T types of grain in their unit sphere.

    table : (T, 4) kind of the surface, index, roughness, radius of a ball (0: a mesh)
    offset : (T + 1, 2) where the nodes and the blocks of each begin
    nodes, children, blocks : trees (`Mesh.tree`)
    """

    table: np.ndarray
    offset: np.ndarray
    nodes: np.ndarray
    children: np.ndarray
    blocks: np.ndarray


def exemplars(grains) -> Exemplars:
    """Of grains (T) with `surface`, `mesh` (None: an exact ball) and `radius` of the ball, as `packed.Grain` has them."""
    table, offset, trees = [], [(0, 0)], []
    for grain in grains:
        surface, ball = grain.surface, grain.mesh is None
        table.append((surface.kind, surface.index, surface.roughness, grain.radius if ball else 0.0))
        if not ball:
            trees.append(grain.mesh.tree)
        last = offset[-1]
        offset.append(last if ball else (last[0] + len(trees[-1][0]), last[1] + len(trees[-1][2])))
    if len(trees) == 1:
        nodes, children, blocks, _ = trees[0]
    else:
        nodes = np.concatenate([np.zeros(0, np.float32), *(tree[0] for tree in trees)])
        children, blocks = nodes.view(np.int32), np.concatenate([np.zeros(0), *(tree[2] for tree in trees)])
    return Exemplars(np.array(table, float), np.array(offset, np.int64), nodes, children, blocks)
