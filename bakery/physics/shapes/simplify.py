"""Fewer triangles for the same solid: edges are collapsed where that moves the surface least.

Garland & Heckbert, Surface simplification using quadric error metrics, SIGGRAPH 1997: a vertex carries the sum of squared
distances, weighted by area, to the planes of the triangles that it stands for.

Why not pymeshlab's: generated aggregates pass through here, whose bytes would change, and it takes five times as long for the
same loss of volume (`python benchmarks/meshes.py fewer`).
"""

from __future__ import annotations

import numpy as np

from bakery.system.compiled import njit

_TURN = 0.2  # cosine below which a triangle would turn too far
_THIN = 1e-2  # twice the area over summed squared sides (0.29 if equilateral) below which no triangle becomes thinner
_PULL = 1e-7  # weight of the distance to the ends, which decides where planes leave a direction free


def simplified(vertices, faces, target):
    """A closed mesh with about `target` triangles.

    Parameters
    ----------
    vertices : (V, 3) about the size of 1
    faces : (F, 3), closed and wound outward
    target : triangles, at least 4

    Returns
    -------
    vertices : (V', 3), faces : (F', 3) int32; F' exceeds the target where no further edge may collapse, or by one

    Notes
    -----
    Topology is kept.  Nothing guards against crossings between distant parts: `quality.self_crossings` tells.  From
    80,000 triangles of a ball to 20,000 and 1,300, volume falls by 0.02 % and 0.4 %.
    """
    vertices, faces = np.array(vertices, float), np.array(faces, np.int32)
    if len(faces) <= target:
        return vertices, faces
    quadric = _quadrics(vertices, faces)
    while len(faces) > target:  # again, as long as edges that were refused have become free
        before = len(faces)
        faces = faces[_collapse(vertices, faces, quadric, int(target))]
        if len(faces) > 0.98 * before:
            break
    used, numbers = np.unique(faces, return_inverse=True)
    return np.ascontiguousarray(vertices[used]), numbers.reshape(-1, 3).astype(np.int32)


def _quadrics(vertices, faces):
    """(V, 10): xx xy xz yy yz zz, x y z, 1 of area * (n.p + d)^2."""
    corner = vertices[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    double = np.sqrt((normal**2).sum(axis=1))
    with np.errstate(invalid="ignore", divide="ignore"):
        n = np.where(double[:, None] > 0, normal / double[:, None], 0.0)
    plane = np.concatenate([n, -(n * vertices[faces[:, 0]]).sum(axis=1)[:, None]], axis=1)
    pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2), (0, 3), (1, 3), (2, 3), (3, 3))
    q = np.stack([plane[:, i] * plane[:, j] for i, j in pairs], axis=1) * (0.5 * double[:, None])
    total = np.empty((len(vertices), 10))
    for k in range(10):
        total[:, k] = np.bincount(faces.ravel(), np.repeat(q[:, k], 3), len(vertices))
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def _value(q, x, y, z):
    return max(q[0] * x * x + q[3] * y * y + q[5] * z * z + q[9]
               + 2 * (q[1] * x * y + q[2] * x * z + q[4] * y * z + q[6] * x + q[7] * y + q[8] * z), 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _best(v, quadric, a, b, q, at):
    """Where the edge a b collapses to (`at`), and what that costs."""
    for k in range(10):
        q[k] = quadric[a, k] + quadric[b, k]
    cost = _value(q, 0.5 * (v[a, 0] + v[b, 0]), 0.5 * (v[a, 1] + v[b, 1]), 0.5 * (v[a, 2] + v[b, 2]))
    # relative to the middle, with a pull to both ends that makes the system regular
    mx, my, mz = 0.5 * (v[a, 0] + v[b, 0]), 0.5 * (v[a, 1] + v[b, 1]), 0.5 * (v[a, 2] + v[b, 2])
    pull = _PULL * (q[0] + q[3] + q[5]) + 1e-300
    xx, yy, zz, xy, xz, yz = q[0] + pull, q[3] + pull, q[5] + pull, q[1], q[2], q[4]
    gx = q[0] * mx + q[1] * my + q[2] * mz + q[6]
    gy = q[1] * mx + q[3] * my + q[4] * mz + q[7]
    gz = q[2] * mx + q[4] * my + q[5] * mz + q[8]
    cx, cy, cz = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    det = xx * cx + xy * cy + xz * cz
    at[0], at[1], at[2] = mx, my, mz
    if det > 0:
        x = -(cx * gx + cy * gy + cz * gz) / det
        y = -(cy * gx + (xx * zz - xz * xz) * gy + (xy * xz - xx * yz) * gz) / det
        z = -(cz * gx + (xy * xz - xx * yz) * gy + (xx * yy - xy * xy) * gz) / det
        reach = (v[a, 0] - v[b, 0]) ** 2 + (v[a, 1] - v[b, 1]) ** 2 + (v[a, 2] - v[b, 2]) ** 2
        better = _value(q, mx + x, my + y, mz + z)
        if x * x + y * y + z * z <= 4 * reach and better <= cost:
            at[0], at[1], at[2] = mx + x, my + y, mz + z
            cost = better
    # short edges first where the surface is flat
    length = (v[a, 0] - v[b, 0]) ** 2 + (v[a, 1] - v[b, 1]) ** 2 + (v[a, 2] - v[b, 2]) ** 2
    return cost + 1e-9 * (q[0] + q[3] + q[5]) * length


@njit(cache=True, nogil=True, error_model="numpy")
def _sink(cost, item, i, number):
    while True:
        child = 2 * i + 1
        if child >= number:
            return
        if child + 1 < number and cost[child + 1] < cost[child]:
            child += 1
        if cost[i] <= cost[child]:
            return
        cost[i], cost[child] = cost[child], cost[i]
        for k in range(3):
            item[i, k], item[child, k] = item[child, k], item[i, k]
        i = child


@njit(cache=True, nogil=True, error_model="numpy")
def _rise(cost, item, i):
    while i:
        parent = (i - 1) // 2
        if cost[parent] <= cost[i]:
            return
        cost[i], cost[parent] = cost[parent], cost[i]
        for k in range(3):
            item[i, k], item[parent, k] = item[parent, k], item[i, k]
        i = parent


@njit(cache=True, nogil=True, error_model="numpy")
def _bad_turn(v, faces, first, following, vertex, other, at):
    """Whether moving a vertex to `at` turns a triangle over or squeezes it; triangles with `other` vanish."""
    slot = first[vertex]
    while slot >= 0:
        f = slot // 3
        if faces[f, 0] >= 0 and faces[f, 0] != other and faces[f, 1] != other and faces[f, 2] != other:
            k = 0 if faces[f, 0] == vertex else 1 if faces[f, 1] == vertex else 2
            b, c = faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
            ex, ey, ez = v[c, 0] - v[b, 0], v[c, 1] - v[b, 1], v[c, 2] - v[b, 2]
            px, py, pz = v[vertex, 0] - v[b, 0], v[vertex, 1] - v[b, 1], v[vertex, 2] - v[b, 2]
            rx, ry, rz = at[0] - v[b, 0], at[1] - v[b, 1], at[2] - v[b, 2]
            ax, ay, az = ey * pz - ez * py, ez * px - ex * pz, ex * py - ey * px
            bx, by, bz = ey * rz - ez * ry, ez * rx - ex * rz, ex * ry - ey * rx
            old, new = np.sqrt(ax * ax + ay * ay + az * az), np.sqrt(bx * bx + by * by + bz * bz)
            e = ex * ex + ey * ey + ez * ez
            before = e + px * px + py * py + pz * pz + (px - ex) ** 2 + (py - ey) ** 2 + (pz - ez) ** 2
            after = e + rx * rx + ry * ry + rz * rz + (rx - ex) ** 2 + (ry - ey) ** 2 + (rz - ez) ** 2
            if new == 0 or ax * bx + ay * by + az * bz < _TURN * old * new:
                return True
            if new < _THIN * after and new * before < old * after:
                return True
        slot = following[slot]
    return False


@njit(cache=True, nogil=True, error_model="numpy")
def _collapse(v, faces, quadric, target):
    """Collapses edges in place; whether each triangle is left.

    `first` and `following` are lists of the triangle corners at each vertex; a heap entry holds an edge and the sum of the ends'
    numbers of changes, by which old entries are known.
    """
    number_v, number_f = len(v), len(faces)
    first, last = np.full(number_v, -1, np.int64), np.full(number_v, -1, np.int64)
    following = np.full(3 * number_f, -1, np.int64)
    for slot in range(3 * number_f):
        at_v = faces[slot // 3, slot % 3]
        if first[at_v] < 0:
            first[at_v] = slot
        else:
            following[last[at_v]] = slot
        last[at_v] = slot
    changes, mark = np.zeros(number_v, np.int32), np.zeros(number_v, np.int64)
    cost, item = np.empty(2 * number_f + 64), np.empty((2 * number_f + 64, 3), np.int32)
    q, at = np.empty(10), np.empty(3)
    number = 0
    for f in range(number_f):
        for k in range(3):
            a, b = faces[f, k], faces[f, (k + 1) % 3]
            if a < b:
                cost[number] = _best(v, quadric, a, b, q, at)
                item[number, 0], item[number, 1], item[number, 2] = a, b, 0
                number += 1
    for i in range(number // 2, -1, -1):
        _sink(cost, item, i, number)
    left, pass_ = number_f, 0
    while left > target and number:
        a, b, changed = item[0, 0], item[0, 1], item[0, 2]
        number -= 1
        cost[0] = cost[number]
        for k in range(3):
            item[0, k] = item[number, k]
        _sink(cost, item, 0, number)
        if changes[a] < 0 or changes[b] < 0 or changes[a] + changes[b] != changed:
            continue
        # exactly the two corners opposite the edge may see both ends, else the surface would be pinched
        pass_ += 2
        slot = first[a]
        while slot >= 0:
            f = slot // 3
            if faces[f, 0] >= 0:
                for k in range(3):
                    mark[faces[f, k]] = pass_
            slot = following[slot]
        common = 0
        slot = first[b]
        while slot >= 0:
            f = slot // 3
            if faces[f, 0] >= 0:
                for k in range(3):
                    if mark[faces[f, k]] == pass_ and faces[f, k] != a and faces[f, k] != b:
                        mark[faces[f, k]] = pass_ + 1
                        common += 1
            slot = following[slot]
        if common != 2 or left <= 4:
            continue
        _best(v, quadric, a, b, q, at)
        if _bad_turn(v, faces, first, following, a, b, at) or _bad_turn(v, faces, first, following, b, a, at):
            continue
        for k in range(3):
            v[a, k] = at[k]
        for k in range(10):
            quadric[a, k] += quadric[b, k]
        slot = first[b]
        while slot >= 0:
            f = slot // 3
            if faces[f, 0] == a or faces[f, 1] == a or faces[f, 2] == a:
                faces[f, 0] = -1
                left -= 1
            elif faces[f, 0] >= 0:
                for k in range(3):
                    if faces[f, k] == b:
                        faces[f, k] = a
            slot = following[slot]
        # b's corners now are a's; those of triangles that are gone leave the list
        following[last[a]] = first[b]
        last[a] = last[b]
        before = -1
        slot = first[a]
        while slot >= 0:
            if faces[slot // 3, 0] < 0:
                if before < 0:
                    first[a] = following[slot]
                else:
                    following[before] = following[slot]
            else:
                before = slot
            slot = following[slot]
        last[a] = before
        changes[b] = -1
        changes[a] += 1
        if number + 64 > len(cost):
            size = 2 * len(cost)
            longer, wider = np.empty(size), np.empty((size, 3), np.int32)
            longer[:number] = cost[:number]
            wider[:number] = item[:number]
            cost, item = longer, wider
        slot = first[a]
        while slot >= 0:
            f = slot // 3
            k = slot % 3
            b = faces[f, (k + 1) % 3]  # each neighbour once, as the surface is closed
            if number < len(cost):
                cost[number] = _best(v, quadric, a, b, q, at)
                item[number, 0], item[number, 1], item[number, 2] = a, b, changes[a] + changes[b]
                _rise(cost, item, number)
                number += 1
            slot = following[slot]
    alive = np.zeros(number_f, np.bool_)
    for f in range(number_f):
        alive[f] = faces[f, 0] >= 0
    return alive
