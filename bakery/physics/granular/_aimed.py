"""Light that a matt surface sends almost straight back, for the loops of `_goniometer`."""

import math

from bakery.physics.grains.sampling import next_uniform, surface_frame
from bakery.system.compiled import njit

# of walks at their first matt surface, that are aimed almost straight back; root of the phase angle over pi up to which
_AIMED, _NARROW = 0.2, 0.25


@njit(nogil=True, error_model="numpy", forceinline=True)
def aimed(d, n, turned_to, draws):
    """A direction for light that comes in along d to a matt surface, its part along the normal n, and its weight.

    It is that of the surface's lobe, or, by chance, almost straight back, where next to none of that goes and the factors of the
    first order change most (opposition effect): evenly in the root of the phase angle, as cells lie.  The weight is the lobe over
    the density of both (one-sample balance heuristic; Veach and Guibas, SIGGRAPH 1995).
    """
    (bx, by, bz), (dx, dy, dz) = (-d[0], -d[1], -d[2]), turned_to
    if next_uniform(draws.stream, draws.pool) < _AIMED:
        root = _NARROW * next_uniform(draws.stream, draws.pool)
        alpha, azimuth = math.pi * root * root, 2.0 * math.pi * next_uniform(draws.stream, draws.pool)
        sx, sy, sz, tx, ty, tz = surface_frame(bx, by, bz)
        u, v, w = math.sin(alpha) * math.cos(azimuth), math.sin(alpha) * math.sin(azimuth), math.cos(alpha)
        dx, dy, dz = u * sx + v * tx + w * bx, u * sy + v * ty + w * by, u * sz + v * tz + w * bz
    z = dx * n[0] + dy * n[1] + dz * n[2]
    if z <= 0.0:
        return (dx, dy, dz), z, 0.0
    chord = math.sqrt((dx - bx) ** 2 + (dy - by) ** 2 + (dz - bz) ** 2)
    alpha, lobe, chance = 2.0 * math.asin(min(0.5 * chord, 1.0)), z / math.pi, 0.0
    if alpha < math.pi * _NARROW * _NARROW:
        chance = 1.0 / max(4.0 * math.pi * _NARROW * math.sin(alpha) * math.sqrt(math.pi * alpha), 1e-300)
    return (dx, dy, dz), z, lobe / ((1.0 - _AIMED) * lobe + _AIMED * chance)
