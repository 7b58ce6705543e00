"""Grains at many spheres at once, by what loops ask for one by one."""

import numpy as np

from bakery.physics.packing.instances import cumulated_shares, kind, rotation, uniforms
from bakery.system.compiled import njit


def instances(seed, tile, sphere, weights=(1.0,)):
    """Grains at spheres of copies of a tile.

    Parameters
    ----------
    seed : whole number, 0 to 2^64 - 1
    tile : (..., 3) whole numbers, which copy of the tile the sphere's centre lies in: centre + tile * cell; of either sign
    sphere : (...) its number in the tile
    weights : (T,) share of each type of grain in the number

    Returns
    -------
    kind : (...) type of grain, 0 to T - 1
    quaternion : (..., 4) x, y, z, w of the rotation that turns the grain's frame into the world's, uniform over all rotations

    Raises
    ------
    ValueError : a seed out of range, or weights that are none

    Examples
    --------
    >>> kind, quaternion = instances(1, [[0, 0, 0], [-1, 0, 5]], [7, 7], [0.7, 0.3])
    >>> kind.tolist()
    [0, 0]
    """
    if not 0 <= int(seed) < 1 << 64:
        raise ValueError(f"seed {seed}: 0 to 2^64 - 1 is possible")
    shares = cumulated_shares(weights)
    tile, sphere = np.asarray(tile, np.int64), np.asarray(sphere, np.int64)
    if tile.shape[-1:] != (3,):
        raise ValueError(f"tile of shape {tile.shape}: (..., 3) whole numbers are needed")
    shape = np.broadcast_shapes(tile.shape[:-1], sphere.shape)
    flat = [np.array(np.broadcast_to(a, shape), order="C").reshape(-1) for a in (*np.moveaxis(tile, -1, 0), sphere)]
    kinds, quaternions = np.empty(flat[0].size, np.int64), np.empty((flat[0].size, 4))
    _fill(np.uint64(seed), *flat, shares, kinds, quaternions)
    return kinds.reshape(shape), quaternions.reshape(*shape, 4)


@njit(cache=True, nogil=True, error_model="numpy")
def _fill(seed, i, j, k, s, shares, kinds, quaternions):
    for n in range(len(i)):
        a, b, c, d = uniforms(seed, i[n], j[n], k[n], s[n])
        kinds[n] = kind(a, shares)
        quaternions[n] = rotation(b, c, d)
