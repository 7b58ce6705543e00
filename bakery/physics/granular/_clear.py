"""A smooth clear ball, for the loops of `_goniometer`."""

import math

from bakery.physics.grains.sampling import next_uniform
from bakery.physics.grains.surface import fresnel
from bakery.system.compiled import njit


@njit(nogil=True, error_model="numpy", forceinline=True)
def refracted(index, d, n, draws, limits):
    """Light along d that meets a smooth dielectric ball at its outward normal n, until it has left: direction and
    normal there, share of all light left, -1 where it was cut, path inside in radii.

    All its meetings are at one angle: Fresnel's reflectance F is taken once.
    limits : meetings after which it is cut;  whether what is reflected, which alone comes back from one grain, is wanted more
        often than it happens: then it is taken by a chance in proportion to the root of F, and weighs as much less
    """
    (dx, dy, dz), (nx, ny, nz), (depth, wanted) = d, n, limits
    cosine = max(-(dx * nx + dy * ny + dz * nz), 0.0)
    reflectance, beyond = fresnel(cosine, index)
    chance, stays, goes = reflectance, 1.0, 1.0
    if wanted:
        root, complement = math.sqrt(reflectance), math.sqrt(1.0 - reflectance)
        chance, stays, goes = root / (root + complement), root * (root + complement), complement * (root + complement)
    if next_uniform(draws.stream, draws.pool) < chance:
        t = 2.0 * cosine
        return (dx + t * nx, dy + t * ny, dz + t * nz), n, stays, 0.0
    t, over, count, factor = cosine / index - beyond, 1.0 / index, 1, goes
    dx, dy, dz = over * dx + t * nx, over * dy + t * ny, over * dz + t * nz
    t = 2.0 * beyond
    nx, ny, nz = nx + t * dx, ny + t * dy, nz + t * dz
    while next_uniform(draws.stream, draws.pool) < chance:
        if count == depth:
            return (dx, dy, dz), n, -1.0, t * count
        count, factor = count + 1, factor * stays
        dx, dy, dz = dx - t * nx, dy - t * ny, dz - t * nz
        nx, ny, nz = nx + t * dx, ny + t * dy, nz + t * dz
    along = cosine - index * beyond
    over = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
    dx, dy, dz = index * dx + along * nx, index * dy + along * ny, index * dz + along * nz
    return (dx, dy, dz), (nx * over, ny * over, nz * over), factor * goes, t * count
