"""Which of several tiles grains stand in."""

from typing import NamedTuple

import numpy as np


class Tile(NamedTuple):
    """A tile that was widened until it fills a wished fraction; it is as it was packed where it fills less.

    centers, radii, cell : (N, 3), (N,), (3,), in mean radii
    fraction : 1, of the cell in spheres before that
    """

    centers: np.ndarray
    radii: np.ndarray
    cell: np.ndarray
    fraction: float


def tile_of(packing, medium) -> Tile:
    """The tile in which the grains of a medium stand: that of its `tile_fraction`, which bakes store when they choose it.

    packing : group of an asset, name -> array, or of several such
    medium : the same, with `fraction` (1,), that of the medium.  Where it holds no `tile_fraction`, as in assets of version 6 of
        the stage and before, the choice is that of bakes: the least dense tile that is at least as dense as the medium, or the
        densest
    """
    tiles = [packing] if "centers" in packing else [tile for tile in packing.values() if "centers" in tile]
    fractions, wished = np.array([float(tile["fraction"][0]) for tile in tiles]), float(medium["fraction"][0])
    if "tile_fraction" in medium:
        index = int(np.argmin(np.abs(fractions - float(medium["tile_fraction"][0]))))
    else:
        dense = fractions >= wished * (1 - 1e-9)
        index = int(np.argmin(np.where(dense, fractions, np.inf)) if dense.any() else np.argmax(fractions))
    wider = max(float(fractions[index]) / wished, 1.0) ** (1 / 3)
    centers, radii, cell = (np.asarray(tiles[index][name]) for name in ("centers", "radii", "cell"))
    return Tile(centers * wider, radii, cell * wider, float(fractions[index]))
