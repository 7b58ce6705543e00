"""How far a point is from a closed mesh: the nearest triangle, by the tree that its rays use."""

import math

import numpy as np

from bakery.physics.grains.lanes import BLOCK, BOXES, NODE, TRIANGLES
from bakery.physics.granular.aggregate import in_mesh
from bakery.system.compiled import njit


@njit(cache=True, nogil=True, error_model="numpy")
def distance_to_triangles(tree, middle, scale, p, limit, stack):
    """Distance of p (3,) to the mesh, or `limit` where it is farther.

    tree : nodes, children, blocks of the mesh in units of `scale` about `middle`;  stack : from `bvh.mesh_scratch`
    """
    nodes, children, blocks = tree
    pending, reach = stack[0], stack[1]
    x, y, z = (p[0] - middle[0]) / scale, (p[1] - middle[1]) / scale, (p[2] - middle[2]) / scale
    best = (limit / scale) ** 2
    child, top = np.int64(0), 0
    while True:
        if child < 0:
            for lane in range(TRIANGLES):
                best = min(best, _to_triangle(blocks, ~child * BLOCK + lane, x, y, z))
        else:
            at, base = child * NODE, top
            for b in range(BOXES):
                far = _to_box(nodes, at + b, x, y, z)
                if far >= best:
                    continue
                farther, j = np.int64(children[at + 6 * BOXES + b]), top
                while j > base and reach[j - 1] < far:  # the nearest comes on top
                    reach[j], pending[j] = reach[j - 1], pending[j - 1]
                    j -= 1
                reach[j], pending[j] = far, farther
                top += 1
        while top > 0 and reach[top - 1] >= best:
            top -= 1
        if top == 0:
            return math.sqrt(best) * scale
        top -= 1
        child = np.int64(pending[top])


@njit(cache=True, nogil=True, error_model="numpy")
def _to_box(nodes, at, x, y, z):
    """Square of the distance to a box, whose planes are widened by more than float32 rounds: never too large."""
    dx = max(max(nodes[at] - x, x - nodes[at + 3 * BOXES]), 0.0)
    dy = max(max(nodes[at + BOXES] - y, y - nodes[at + 4 * BOXES]), 0.0)
    dz = max(max(nodes[at + 2 * BOXES] - z, z - nodes[at + 5 * BOXES]), 0.0)
    return dx * dx + dy * dy + dz * dz


@njit(cache=True, nogil=True, error_model="numpy")
def _to_triangle(blocks, at, x, y, z):
    """Square of the distance to the triangle at blocks[at]; infinite at a place that is empty, with all corners at one point.

    Source: Ericson, Real-Time Collision Detection (2005), section 5.1.5.
    """
    step = TRIANGLES
    ax, ay, az = blocks[at], blocks[at + 3 * step], blocks[at + 6 * step]
    ux, uy, uz = blocks[at + step] - ax, blocks[at + 4 * step] - ay, blocks[at + 7 * step] - az
    vx, vy, vz = blocks[at + 2 * step] - ax, blocks[at + 5 * step] - ay, blocks[at + 8 * step] - az
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    if uu + vv == 0.0:
        return np.inf
    x, y, z = x - ax, y - ay, z - az
    p, u, v = (x, y, z), (ux, uy, uz), (vx, vy, vz)
    pu, pv = x * ux + y * uy + z * uz, x * vx + y * vy + z * vz
    s, t = vv * pu - uv * pv, uu * pv - uv * pu  # barycentric, times the square of twice the area
    area = uu * vv - uv * uv
    if s > 0.0 and t > 0.0 and s + t < area:
        return _square(p, u, v, s / area, t / area)
    s = min(max(pu / uu, 0.0), 1.0) if uu > 0.0 else 0.0
    t = min(max(pv / vv, 0.0), 1.0) if vv > 0.0 else 0.0
    third = uu - 2.0 * uv + vv
    w = min(max((uu - uv + pv - pu) / third, 0.0), 1.0) if third > 0.0 else 0.0
    return min(_square(p, u, v, s, 0.0), _square(p, u, v, 0.0, t), _square(p, u, v, 1.0 - w, w))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _square(p, u, v, s, t):
    """Squared length of p - s u - t v."""
    (x, y, z), (ux, uy, uz), (vx, vy, vz) = p, u, v
    dx, dy, dz = x - s * ux - t * vx, y - s * uy - t * vy, z - s * uz - t * vz
    return dx * dx + dy * dy + dz * dz


@njit(cache=True, nogil=True, error_model="numpy")
def deepest_in_mesh(aggregate, points, stack):
    """How far inside of an aggregate's mesh the deepest of points (n, 3) is, in its unit; 0 where none is inside."""
    most, p = 0.0, np.empty(3)
    for i in range(len(points)):
        for k in range(3):
            p[k] = points[i, k]
        if in_mesh(aggregate, p[0], p[1], p[2], stack):
            most = max(most, distance_to_triangles(aggregate.tree, aggregate.middle, aggregate.scale, p, np.inf, stack[0]))
    return most
