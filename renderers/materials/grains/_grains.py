"""Surfaces of explicit grains along rays: which one a ray meets next, and where."""

import math
from typing import NamedTuple

import numpy as np

from bakery import kernels
from bakery.kernels import (
    aggregate_scratch,
    enclosing_sphere,
    first_sphere,
    instance,
    instance_of,
    nearest_triangle,
    rotation_matrix,
    triangle_normal,
)
from bakery.system.compiled import njit

NOWHERE, UNKNOWN = -1, -2  # in place of a sphere: a ray starts in none; it is not known where it starts
OFF = -3  # it starts on a baked surface (`far`), and meets grains only where it comes into a mesh
_AHEAD = 1.0 / 128  # radii that a ray starts outside of a sphere: a grain may touch it


class Grains(NamedTuple):
    """An aggregate's grains.  Lengths are in `unit`, m, the mean radius of its spheres.

    aggregate : of the spheres;  seed (uint64), shares (T,) : `bakery.kernels.instance` makes grains of them
    exemplars : the T types of grain
    channels : (T, 2, L) of their surfaces;  absorption : (T, L) 1/unit, of their inside
    chance : (X, Y, Z) float32, with which a meeting with a rough or matt surface in each voxel samples a light
    mixture : (T numbers) cumulated shares in place of `shares`; empty: they do not vary
    """

    aggregate: kernels.Aggregate
    unit: float
    seed: np.uint64
    shares: np.ndarray
    exemplars: kernels.Exemplars
    channels: np.ndarray
    absorption: np.ndarray
    chance: np.ndarray
    mixture: kernels.Field = kernels.uniform_field()


@njit(cache=True, nogil=True, error_model="numpy")
def scratch():
    """Memory of one thread for `next_surface`, overwritten at each call."""
    return aggregate_scratch(), np.empty(4, np.int64)


@njit(cache=True, nogil=True, error_model="numpy")
def _ball(radius, point, ray, triangle, normal):
    """As `_in_sphere` for a ball about the origin."""
    (x, y, z), (dx, dy, dz) = point, ray
    along = x * dx + y * dy + z * dz
    if triangle >= 0:  # on the ball: its other side, or nothing
        if along >= 0.0:
            return np.inf
        t = -2.0 * along
    else:
        px, py, pz = x - along * dx, y - along * dy, z - along * dz
        square = radius * radius - (px * px + py * py + pz * pz)
        if square <= 0.0:
            return np.inf
        half = math.sqrt(square)
        t = -along - half if -along - half > 0.0 else half - along
        if t <= 0.0:
            return np.inf
    nx, ny, nz = x + t * dx, y + t * dy, z + t * dz
    over = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
    normal[0], normal[1], normal[2] = nx * over, ny * over, nz * over
    return t


# forceinline: a call hands over every array of the tuple, which took a quarter of the time of a path
@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _in_sphere(grains, sphere, centre, point, ray, at, normal, scratch):
    """Distance at which a ray from a point meets the grain of a sphere, both in the unit sphere; inf where it does not.

    centre : three numbers, of the sphere, in units;  point, ray : three numbers, origin and unit direction
    at : (2,) triangle that the ray starts on, or -1; becomes the triangle that it meets, and the type of grain
    normal : (3,) becomes the outward one
    """
    shares, (table, offset, nodes, children, blocks) = grains.shares, grains.exemplars
    (x, y, z), (dx, dy, dz) = point, ray
    kind, turn = 0, (0.0, 0.0, 0.0, 1.0)
    if grains.mixture.values.size > 0:
        cx, cy, cz = centre
        kind, turn = instance_of(grains.seed, sphere[1], sphere[2], sphere[3], sphere[0], grains.mixture, cx, cy, cz)
    elif len(shares) > 1 or table[0, 3] == 0.0:
        kind, turn = instance(grains.seed, sphere[1], sphere[2], sphere[3], sphere[0], shares)
    at[1] = kind
    if table[kind, 3] > 0.0:  # a ball: nobody sees how it is turned
        t = _ball(table[kind, 3], point, ray, at[0], normal)
        at[0] = 0 if t < np.inf else -1
        return t
    xx, xy, xz, yx, yy, yz, zx, zy, zz = rotation_matrix(turn[0], turn[1], turn[2], turn[3])
    low, high = offset[kind, 0], offset[kind + 1, 0]
    triangles = blocks[offset[kind, 1] : offset[kind + 1, 1]]
    at[0], t = nearest_triangle(
        nodes[low:high], children[low:high], triangles, xx * x + yx * y + zx * z, xy * x + yy * y + zy * z,
        xz * x + yz * y + zz * z, xx * dx + yx * dy + zx * dz, xy * dx + yy * dy + zy * dz, xz * dx + yz * dy + zz * dz, at[0],
        scratch)
    if at[0] < 0:
        return np.inf
    x, y, z = triangle_normal(triangles, at[0])
    normal[0], normal[1], normal[2] = xx * x + xy * y + xz * z, yx * x + yy * y + yz * z, zx * x + zy * y + zz * z
    return t


# inlined, as the one below: paths among balls take 5 % less time
@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def on_grain(grains, sphere, centre, offset, d, span, at, normal, scratch):
    """Distance along unit d (3,) to the surface of the grain of a sphere whose centre is `offset` away; inf where it is not met.

    centre, offset : three numbers, in units
    span : from where on the surface is looked for, and radii that the grain is looked for before that
    at, normal : as in `_in_sphere`
    """
    radius, (begin, ahead), (x, y, z) = grains.aggregate.radii[sphere[0]], span, offset
    start = begin - ahead * radius
    point = (start * d[0] - x) / radius, (start * d[1] - y) / radius, (start * d[2] - z) / radius
    t = start + radius * _in_sphere(grains, sphere, centre, point, (d[0], d[1], d[2]), at, normal, scratch)
    return max(t, begin)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def far_side(x, y, z, d, radius):
    """Distance along unit d (3,) to where a ray leaves a sphere whose centre is (x, y, z) away."""
    along = x * d[0] + y * d[1] + z * d[2]
    x, y, z = x - along * d[0], y - along * d[1], z - along * d[2]
    return along + math.sqrt(max(radius * radius - (x * x + y * y + z * z), 0.0))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def next_surface(grains, p, d, far, sphere, at, normal, scratch):
    """Distance along unit d (3,) from p (3,), in units, to the next surface of a grain before `far`; inf where there is none.

    sphere : (4,) number and copy of the tile of that whose grain the ray starts on, with at[0] its triangle; or NOWHERE, or
        UNKNOWN.  It becomes the sphere of the grain that is met, at (2,) its triangle and the type of grain, normal (3,) its
        outward normal; all are of no meaning where nothing is met, but that at[0] is -1 unless a surface comes after `far`
    """
    aggregate = grains.aggregate
    of_mesh, behind = scratch
    begin = 0.0
    if sphere[0] == UNKNOWN:
        enclosing_sphere(aggregate, p, sphere, of_mesh)
        at[0] = -1
    inside = sphere[0] >= 0
    while True:
        ahead = 0.0
        if not inside:
            behind[0], behind[1], behind[2], behind[3] = sphere[0], sphere[1], sphere[2], sphere[3]
            begin = first_sphere(aggregate, p, d, begin, far, behind, sphere, of_mesh)
            ahead, at[0] = _AHEAD, -1
            if begin == np.inf:
                return np.inf
        inside = False
        cx = aggregate.centers[sphere[0], 0] + sphere[1] * aggregate.cell[0]
        cy = aggregate.centers[sphere[0], 1] + sphere[2] * aggregate.cell[1]
        cz = aggregate.centers[sphere[0], 2] + sphere[3] * aggregate.cell[2]
        x, y, z = cx - p[0], cy - p[1], cz - p[2]
        t = on_grain(grains, sphere, (cx, cy, cz), (x, y, z), d, (begin, ahead), at, normal, of_mesh[0])
        if t < np.inf:
            return t if t < far else np.inf
        begin = max(begin, far_side(x, y, z, d, aggregate.radii[sphere[0]]))
