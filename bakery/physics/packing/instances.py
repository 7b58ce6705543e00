"""Which grain stands at sphere s of copy (i, j, k) of a tile, and how it is turned: a hash, so that nothing need be stored.

Any ray, thread or renderer gets the same answer.  All arithmetic is modulo 2^64; indices count as two's complement:

    hashed(h):  h ^= h >> 30;  h *= 0xBF58476D1CE4E5B9;  h ^= h >> 27;  h *= 0x94D049BB133111EB;  h ^= h >> 31
    h = hashed(seed + G);  for w in i, j, k, s:  h = hashed((h ^ w) + G);  with G = 0x9E3779B97F4A7C15
    u_n = ((hashed(h + n G) >> 12) + 1/2) / 2^52,  n = 0 ... 4

`hashed` and G are those of SplitMix64 (Steele, Lea & Flood 2014).  u_0 picks the grain, u_1, u_2, u_3 its rotation; where a
part of the spheres is left out, u_4 says which.
"""

import math

import numpy as np

from bakery.system.compiled import njit

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)


@njit(cache=True, nogil=True, error_model="numpy")
def hashed(h):
    """A bijection of uint64 in which every bit of h decides on every bit of the result."""
    h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return h ^ (h >> np.uint64(31))


@njit(cache=True, nogil=True, error_model="numpy")
def _word(seed, i, j, k, s):
    """h of a sphere."""
    h = hashed(seed + _GOLDEN)
    h = hashed((h ^ np.uint64(i)) + _GOLDEN)
    h = hashed((h ^ np.uint64(j)) + _GOLDEN)
    h = hashed((h ^ np.uint64(k)) + _GOLDEN)
    return hashed((h ^ np.uint64(s)) + _GOLDEN)


@njit(cache=True, nogil=True, error_model="numpy")
def uniforms(seed, i, j, k, s):
    """Four uniform numbers in (0, 1) of sphere s (int64) in copy i, j, k (int64) of a tile, seed uint64: u_0 ... u_3."""
    h = _word(seed, i, j, k, s)
    bits, unit = np.uint64(12), 2.0**-52
    a = ((hashed(h) >> bits) + 0.5) * unit
    b = ((hashed(h + _GOLDEN) >> bits) + 0.5) * unit
    c = ((hashed(h + np.uint64(2) * _GOLDEN) >> bits) + 0.5) * unit
    d = ((hashed(h + np.uint64(3) * _GOLDEN) >> bits) + 0.5) * unit
    return a, b, c, d


@njit(cache=True, nogil=True, error_model="numpy")
def left_out(seed, i, j, k, s, share):
    """Whether a sphere is none of the `share` of all, 0 to 1, that are there: u_4 is not below it."""
    return ((hashed(_word(seed, i, j, k, s) + np.uint64(4) * _GOLDEN) >> np.uint64(12)) + 0.5) * 2.0**-52 >= share


@njit(cache=True, nogil=True, error_model="numpy")
def kind(u, cumulated):
    """Type of grain: the first whose cumulated share (T,) of the number lies above u; the last share is 1."""
    t = 0
    while u >= cumulated[t]:
        t += 1
    return t


@njit(cache=True, nogil=True, error_model="numpy")
def rotation(u, v, w):
    """Unit quaternion (x, y, z, w), uniform over all rotations (Shoemake, Graphics Gems III, 1992)."""
    a, b = math.sqrt(1.0 - u), math.sqrt(u)
    p, q = 2.0 * math.pi * v, 2.0 * math.pi * w
    return a * math.sin(p), a * math.cos(p), b * math.sin(q), b * math.cos(q)


@njit(cache=True, nogil=True, error_model="numpy")
def rotation_matrix(x, y, z, w):
    """Rows of the rotation matrix of a unit quaternion, nine numbers; it turns the grain's frame into the world's."""
    return (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w),
            2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w),
            2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y))


def cumulated_shares(weights):
    """Cumulated shares (T,) of the number, the last one exactly 1, from weights >= 0 (T,)."""
    weights = np.asarray(weights, float)
    if weights.ndim != 1 or not weights.size or not np.all((weights >= 0) & np.isfinite(weights)) or not weights.sum() > 0:
        raise ValueError(f"weights {weights.tolist()}: one number >= 0 a type of grain is needed, not all of them 0")
    shares = np.cumsum(weights / weights.sum())
    shares[np.flatnonzero(weights)[-1]:] = 1.0  # rounding must not reach a type of weight 0
    return shares


@njit(cache=True, nogil=True, error_model="numpy")
def instance(seed, i, j, k, sphere, shares):
    """Type and rotation of the grain at a sphere of copy (i, j, k) of a tile; compiled.

    seed : uint64;  i, j, k, sphere : int64;  shares : (T,) from `cumulated_shares`

    Returns the type, 0 to T - 1, and the quaternion (x, y, z, w) that turns the grain's frame into the world's; the same as
    `asset.packing`'s instances and the random walks of the bake.
    """
    a, b, c, d = uniforms(seed, i, j, k, sphere)
    return kind(a, shares), rotation(b, c, d)
