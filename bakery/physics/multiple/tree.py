"""The quadtree of a stored table: what its corners and cells must be, before anything is laid out from them."""

from collections.abc import Iterable

import numpy as np

ASPECT = 2  # cells are squares of half the side of the plane: two roots, side by side in v
COARSE = 4  # depth of the coarsest cells
DEEPEST = 8  # of a table that is read: bakery's go to 6, and each level takes four times the memory


def depth(corner) -> int:
    """Depth of the smallest cells of corners (N, 2)."""
    return int(corner[:, 0].max(initial=1)).bit_length() - 1


def broken(corner, node_bounds) -> Iterable[str]:
    """Broken rules of corners (N, 2) and cells (M, 4), in words; no corner at all is the table of what scatters nothing."""
    if not len(corner):
        return
    size = 1 << (levels := depth(corner))
    if not COARSE <= levels <= DEEPEST:
        yield f"corner goes to {corner[:, 0].max()}: cells of depth {levels}, where {COARSE} to {DEEPEST} are read"
        return
    coarse = (corner % (size >> COARSE) == 0).all(axis=1)
    if (corner < 0).any() or (corner > (size, ASPECT * size)).any() \
            or len(np.unique(corner[coarse], axis=0)) != (2**COARSE + 1) * (ASPECT * 2**COARSE + 1):
        yield "corner does not hold all places of the coarsest level, or holds others than those of the tree"
    elif (smallest := (node_bounds[:, 1] - node_bounds[:, 0]).min()) != 1 / size:
        yield f"corner is for cells of 1/{size} of the plane, the smallest of node_bounds is {smallest:.6g}"
