"""Grains that fill a closed mesh: a tile of spheres repeated without end, of which those exist whose centre is inside.

Nothing is stored of a grain, so two billion take the memory of two thousand: the tile, the mesh, and voxels that say where the
mesh is.  A sphere is known by its number in the tile and the copy of the tile that its centre lies in.  Which grain it holds, and
how that is turned, is a hash of both (`packing.instances`).  Lengths are in the tile's unit, from the corner of copy (0, 0, 0).
"""

import math
from typing import NamedTuple

import numpy as np

from bakery.physics.grains.bvh import Mesh, mesh_scratch, nearest_triangle, triangle_normal
from bakery.physics.granular.field import Field, between, largest, sampled, uniform_field, value
from bakery.physics.granular.flights import flight_to_sphere
from bakery.physics.granular.voxels import (
    CLASS,
    INSIDE,
    NEAR,
    OUTSIDE,
    PARTIAL,
    among,
    classified,
    inside,
    next_voxel,
    voxel_at,
    ways_out,
    within_box,
)
from bakery.physics.packing.cells import counts, tile_grid
from bakery.physics.packing.instances import left_out
from bakery.system.compiled import njit

_LARGEST, _ACROSS = 4.0, 128  # edge of a voxel: at least so many largest radii; at most so many along the mesh
_BEYOND = 1.01  # of the mesh's half diagonal
_ROOM = 1e-6  # of the largest radius: how far beyond the farthest sphere the voxels reach


class Aggregate(NamedTuple):
    """A tile and the mesh that its copies fill, laid out for compiled loops.

    centers (N, 3), radii (N,), cell (3,) : the tile
    m (3,), start, image, owner : its grid (`packing.cells.cells`)
    low, edge (3,), voxels (X, Y, Z) uint8 : where the mesh is (`voxels`)
    tree : nodes, children, blocks of the mesh in units of `scale` about `middle` (3,)
    share : which share of the spheres is there, 0 to 1; empty: all are.  seed (uint64) of the hash that says which
    """

    centers: np.ndarray
    radii: np.ndarray
    cell: np.ndarray
    m: np.ndarray
    start: np.ndarray
    image: np.ndarray
    owner: np.ndarray
    low: np.ndarray
    edge: np.ndarray
    voxels: np.ndarray
    tree: tuple
    middle: np.ndarray
    scale: float
    share: Field
    seed: np.uint64


def aggregate(centers, radii, cell, vertices, faces, share=None, seed=0) -> Aggregate:
    """Copies of a tile in a closed mesh.

    Parameters
    ----------
    centers, radii, cell : (N, 3), (N,), (3,) spheres that do not overlap, in a periodic cuboid
    vertices, faces : (V, 3) in the tile's unit, (F, 3) wound outward, closed
    share : `Field` of the share of the spheres that is there, by where their centres are; all if None
    seed : of the hash that says which

    Notes
    -----
    Voxels cost 2 MB and about a second at most, whatever the number of spheres.
    """
    centers, radii, cell, vertices = (np.array(a, float, order="C") for a in (centers, radii, cell, vertices))
    faces = np.array(faces, np.int64, order="C")
    centers = np.mod(centers, cell)
    lowest, highest = vertices.min(axis=0), vertices.max(axis=0)
    middle, scale = (lowest + highest) / 2, float(np.linalg.norm(highest - lowest)) / 2
    tree = Mesh((vertices - middle) / scale, faces).tree[:3]
    reach = float(radii.max())
    low, high = lowest - (1 + _ROOM) * reach, highest + (1 + _ROOM) * reach
    shape = np.maximum(np.ceil((high - low) / max(_LARGEST * reach, float((high - low).max()) / _ACROSS)), 1).astype(int)
    edge = (high - low) / shape
    voxels = classified(tuple(int(n) for n in shape), low, edge, vertices, faces, tree, middle, scale, reach)
    if share is not None:
        _clear_empty(voxels, low, edge, share)
    m = counts(cell, len(radii))
    return Aggregate(centers, radii, cell, m, *tile_grid(centers, radii, cell, m), low, edge, voxels, tree, middle, scale,
                     share or uniform_field(), np.uint64(seed))


def _clear_empty(voxels, low, edge, share):
    """Takes NEAR from voxels into which no sphere reaches because none is there; a voxel is as wide as the largest radius."""
    from scipy.ndimage import maximum_filter

    full = (largest(share, low, edge, voxels.shape) > 0) & (voxels & CLASS != OUTSIDE)
    voxels[~maximum_filter(full, 3, mode="constant")] &= np.uint8(CLASS)


@njit(cache=True, nogil=True, error_model="numpy")
def aggregate_scratch():
    """Memory of one thread for `first_sphere` and `exists`, overwritten at each call."""
    return mesh_scratch(), np.empty(3), np.empty(4, np.int64), np.empty(3)


# called, and only where a share is left out: paths among grains took a tenth longer with it inside of `exists`
@njit(cache=True, nogil=True, error_model="numpy")
def share_at(aggregate, x, y, z):
    """Share of the spheres that is there, around a point."""
    if aggregate.share.values.size == 0:
        return 1.0
    return value(aggregate.share, between(aggregate.share, x, y, z), 0)


@njit(cache=True, nogil=True, error_model="numpy")
def exists(aggregate, sphere, scratch):
    """Whether the sphere `met` (4,) (number, copy of the tile) is there: its centre is inside of the mesh, and it is not among
    those that are left out."""
    low, edge, voxels = aggregate.low, aggregate.edge, aggregate.voxels
    x = aggregate.centers[sphere[0], 0] + sphere[1] * aggregate.cell[0]
    y = aggregate.centers[sphere[0], 1] + sphere[2] * aggregate.cell[1]
    z = aggregate.centers[sphere[0], 2] + sphere[3] * aggregate.cell[2]
    i, j, k = math.floor((x - low[0]) / edge[0]), math.floor((y - low[1]) / edge[1]), math.floor((z - low[2]) / edge[2])
    if not (0 <= i < voxels.shape[0] and 0 <= j < voxels.shape[1] and 0 <= k < voxels.shape[2]):
        return False
    kind = voxels[i, j, k] & CLASS
    if kind < PARTIAL:
        return False
    if aggregate.share.values.size > 0:
        share = share_at(aggregate, x, y, z)
        if share < 1.0 and left_out(aggregate.seed, sphere[1], sphere[2], sphere[3], sphere[0], share):
            return False
    return inside(aggregate.tree, aggregate.middle, aggregate.scale, x, y, z, scratch[0]) if kind == PARTIAL else True


# the same lines: paths among balls took a tenth longer when `exists` called this
@njit(cache=True, nogil=True, error_model="numpy")
def in_mesh(aggregate, x, y, z, scratch):
    """Whether a point is inside of the mesh."""
    low, edge, voxels = aggregate.low, aggregate.edge, aggregate.voxels
    i, j, k = math.floor((x - low[0]) / edge[0]), math.floor((y - low[1]) / edge[1]), math.floor((z - low[2]) / edge[2])
    if not (0 <= i < voxels.shape[0] and 0 <= j < voxels.shape[1] and 0 <= k < voxels.shape[2]):
        return False
    kind = voxels[i, j, k] & CLASS
    return inside(aggregate.tree, aggregate.middle, aggregate.scale, x, y, z, scratch[0]) if kind == PARTIAL else kind > PARTIAL


@njit(cache=True, nogil=True, error_model="numpy")
def enclosing_sphere(aggregate, p, sphere, scratch):
    """Whether p (3,) lies in a sphere that exists: sphere (4,) becomes it, or -1 and a copy of the tile."""
    m, cell = aggregate.m, aggregate.cell
    i, j, k = math.floor(p[0] / cell[0]), math.floor(p[1] / cell[1]), math.floor(p[2] / cell[2])
    x, y, z = p[0] - i * cell[0], p[1] - j * cell[1], p[2] - k * cell[2]
    a, b = min(int(x / cell[0] * m[0]), m[0] - 1), min(int(y / cell[1] * m[1]), m[1] - 1)
    c = min(int(z / cell[2] * m[2]), m[2] - 1)
    index, image, owner = (a * m[1] + b) * m[2] + c, aggregate.image, aggregate.owner
    for s in range(aggregate.start[index], aggregate.start[index + 1]):
        if (image[s, 0] - x) ** 2 + (image[s, 1] - y) ** 2 + (image[s, 2] - z) ** 2 < image[s, 3]:
            sphere[0], sphere[1], sphere[2], sphere[3] = owner[s, 0], owner[s, 1] + i, owner[s, 2] + j, owner[s, 3] + k
            if exists(aggregate, sphere, scratch):
                return True
    sphere[0], sphere[1], sphere[2], sphere[3] = -1, i, j, k
    return False


@njit(cache=True, nogil=True, error_model="numpy")
def first_sphere(aggregate, p, d, begin, end, left_behind, sphere, scratch):
    """Distance along unit d (3,) from p (3,) to the first sphere that exists; inf where none begins between `begin` and `end`.

    p + begin d lies in no sphere that exists, but for `left` (4,), a sphere (number, copy of the tile), or -1, that the ray has
    just left.  sphere (4,) becomes the sphere.
    """
    low, edge, voxels, cell = aggregate.low, aggregate.edge, aggregate.voxels, aggregate.cell
    grid = cell, aggregate.m, aggregate.start, aggregate.image, aggregate.owner
    _, o, last, to = scratch
    t, stop = within_box(low, edge, voxels.shape, p, d, begin, end)
    if not t < stop:
        return np.inf
    voxel = voxel_at(low, edge, voxels.shape, p[0] + t * d[0], p[1] + t * d[1], p[2] + t * d[2])
    out = ways_out(low, edge, voxel, p, d)
    last[0], last[1], last[2], last[3] = left_behind[0], left_behind[1], left_behind[2], left_behind[3]
    while True:
        leave = min(min(out[0], out[1]), min(out[2], stop))
        near = voxels[voxel] & NEAR
        while near and t < leave:
            if last[0] < 0:
                for axis in range(3):
                    last[1 + axis] = math.floor((p[axis] + t * d[axis]) / cell[axis])
            for axis in range(3):
                o[axis] = p[axis] + t * d[axis] - last[1 + axis] * cell[axis]
            flight = flight_to_sphere(o, d, last, grid, leave - t, sphere, to)
            if flight >= leave - t:
                break
            if exists(aggregate, sphere, scratch):
                return t + flight
            # on from the far side of what is not there, in the same cell
            along = to[0] * d[0] + to[1] * d[1] + to[2] * d[2]
            x, y, z = to[0] - along * d[0], to[1] - along * d[1], to[2] - along * d[2]
            t += along + math.sqrt(max(aggregate.radii[sphere[0]] ** 2 - (x * x + y * y + z * z), 0.0))
            last[0], last[1], last[2], last[3] = sphere[0], sphere[1], sphere[2], sphere[3]
        t = max(t, leave)
        if t >= stop:
            return np.inf
        while min(out[0], min(out[1], out[2])) <= t:
            voxel, out = next_voxel(edge, voxel, out, d)
        if not among(voxel, voxels.shape):
            return np.inf


@njit(cache=True, nogil=True, error_model="numpy")
def within_reach(aggregate, p, d, begin):
    """Distance along unit d (3,) from p (3,), `begin` or more, to the next voxel that some sphere may reach into, or inf."""
    low, edge, voxels = aggregate.low, aggregate.edge, aggregate.voxels
    t, stop = within_box(low, edge, voxels.shape, p, d, begin, np.inf)
    if not t < stop:
        return np.inf
    voxel = voxel_at(low, edge, voxels.shape, p[0] + t * d[0], p[1] + t * d[1], p[2] + t * d[2])
    if voxels[voxel] & NEAR:
        return t
    out = ways_out(low, edge, voxel, p, d)
    while True:
        t = min(out[0], min(out[1], out[2]))
        voxel, out = next_voxel(edge, voxel, out, d)
        if not among(voxel, voxels.shape):
            return np.inf
        if voxels[voxel] & NEAR:
            return max(t, begin)


@njit(cache=True, nogil=True, error_model="numpy")
def mesh_boundary(aggregate, p, d, triangle, scratch):
    """The mesh along unit d (3,) from p (3,), which lies on its triangle `place`, or -1: distance, triangle, whether outward.

    The distance is inf where the mesh lies behind.  Outward: the ray is inside up to there.
    """
    nodes, children, blocks = aggregate.tree
    middle, scale = aggregate.middle, aggregate.scale
    x, y, z = (p[0] - middle[0]) / scale, (p[1] - middle[1]) / scale, (p[2] - middle[2]) / scale
    ahead, square = 0.0, x * x + y * y + z * z
    if square > _BEYOND * _BEYOND:  # the tree's boxes hold for rays from near the mesh
        along = -(x * d[0] + y * d[1] + z * d[2])
        u, v, w = x + along * d[0], y + along * d[1], z + along * d[2]
        half = _BEYOND * _BEYOND - (u * u + v * v + w * w)
        if along <= 0.0 or half <= 0.0:
            return np.inf, -1, False
        ahead = along - math.sqrt(half)
        x, y, z = x + ahead * d[0], y + ahead * d[1], z + ahead * d[2]
    triangle, t = nearest_triangle(nodes, children, blocks, x, y, z, d[0], d[1], d[2], triangle, scratch[0])
    if triangle < 0:
        return np.inf, -1, False
    x, y, z = triangle_normal(blocks, triangle)
    return (ahead + t) * scale, triangle, x * d[0] + y * d[1] + z * d[2] > 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def deep_in_mesh(aggregate, p, d, t):
    """Whether all voxels on the way of length t from p (3,) along d (3,) are inside of the mesh; False where it is not known."""
    low, edge, voxels = aggregate.low, aggregate.edge, aggregate.voxels
    voxel = (math.floor((p[0] - low[0]) / edge[0]), math.floor((p[1] - low[1]) / edge[1]), math.floor((p[2] - low[2]) / edge[2]))
    out = ways_out(low, edge, voxel, p, d)
    while among(voxel, voxels.shape):
        if voxels[voxel] & CLASS != INSIDE:
            return False
        if min(out[0], min(out[1], out[2])) > t:
            return True
        voxel, out = next_voxel(edge, voxel, out, d)
    return False


def depth_in_mesh(aggregate):
    """(X, Y, Z) for each voxel a lower bound of its distance to what is not inside, in units; 0 for voxels not inside.

    Where less than half as many spheres are left as elsewhere counts as outside.
    """
    outside = aggregate.voxels & CLASS != INSIDE
    if aggregate.share.values.size > 0:
        share = largest(aggregate.share, aggregate.low, aggregate.edge, outside.shape)
        outside |= share < 0.5 * share.max()
    return clearance(np.pad(outside, 1, constant_values=True), aggregate.edge)[1:-1, 1:-1, 1:-1]


def mean_share(aggregate):
    """Share of the spheres in the mesh that is there, by the middles of its voxels."""
    if aggregate.share.values.size == 0:
        return 1.0
    volume = np.minimum(aggregate.voxels & CLASS, INSIDE) / INSIDE  # of partial voxels half
    u, v, w = (aggregate.low[axis] + (np.arange(n) + 0.5) * aggregate.edge[axis] for axis, n in enumerate(volume.shape))
    return float(np.average(sampled(aggregate.share, u, v, w), weights=volume)) if volume.any() else 0.0


def clearance(marked, edge):
    """(X, Y, Z) for each voxel of edges (3,) a lower bound of its distance to those marked (X, Y, Z), of which there are some."""
    from scipy.ndimage import distance_transform_edt

    between = distance_transform_edt(~marked, sampling=edge)
    return np.maximum(between - np.linalg.norm(edge), 0.0)  # of middles: half a diagonal each
