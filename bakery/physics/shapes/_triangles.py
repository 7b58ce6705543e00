"""Loops over triangles: a tree of boxes, and crossings of triangles with each other."""

import numpy as np

from bakery.system.compiled import njit

LEAF = 4  # triangles
_STACK = 128
_BOUND = 7.8e-16  # rounding of the determinant below, relative to the sum of its terms' magnitudes (Shewchuk 1997)


@njit(cache=True, nogil=True, error_model="numpy")
def boxes(vertices, faces, order):
    """Bounds (2 P, 6) of a complete binary tree over the triangles in this order: node 1 is the root, P the number of leaves."""
    leaves = 1
    while leaves * LEAF < len(order):
        leaves *= 2
    box = np.empty((2 * leaves, 6))
    box[:, :3] = np.inf
    box[:, 3:] = -np.inf
    for i in range(len(order)):
        node = leaves + i // LEAF
        for corner in range(3):
            for k in range(3):
                x = vertices[faces[order[i], corner], k]
                box[node, k] = min(box[node, k], x)
                box[node, 3 + k] = max(box[node, 3 + k], x)
    for node in range(leaves - 1, 0, -1):
        for k in range(3):
            box[node, k] = min(box[2 * node, k], box[2 * node + 1, k])
            box[node, 3 + k] = max(box[2 * node, 3 + k], box[2 * node + 1, 3 + k])
    return box


@njit(cache=True, nogil=True, error_model="numpy")
def _side(p, a, b, c, d):
    """Sign of the volume of the tetrahedron a b c d (points p[.]); 0 where rounding hides it."""
    adx, ady, adz = p[a, 0] - p[d, 0], p[a, 1] - p[d, 1], p[a, 2] - p[d, 2]
    bdx, bdy, bdz = p[b, 0] - p[d, 0], p[b, 1] - p[d, 1], p[b, 2] - p[d, 2]
    cdx, cdy, cdz = p[c, 0] - p[d, 0], p[c, 1] - p[d, 1], p[c, 2] - p[d, 2]
    bc, cb, ca, ac, ab, ba = bdx * cdy, cdx * bdy, cdx * ady, adx * cdy, adx * bdy, bdx * ady
    value = adz * (bc - cb) + bdz * (ca - ac) + cdz * (ab - ba)
    bound = _BOUND * ((abs(bc) + abs(cb)) * abs(adz) + (abs(ca) + abs(ac)) * abs(bdz) + (abs(ab) + abs(ba)) * abs(cdz))
    return 1 if value > bound else -1 if value < -bound else 0


@njit(cache=True, nogil=True, error_model="numpy")
def _pierces(p, s, e, a, b, c):
    """Whether the open segment s e passes from one side of the triangle a b c to the other, its rim included."""
    if _side(p, a, b, c, s) * _side(p, a, b, c, e) >= 0:
        return False
    u, v, w = _side(p, s, e, a, b), _side(p, s, e, b, c), _side(p, s, e, c, a)
    return (u >= 0 and v >= 0 and w >= 0) or (u <= 0 and v <= 0 and w <= 0)


@njit(cache=True, nogil=True, error_model="numpy")
def _overlap_flat(p, triangle, other_triangle):
    """Whether two triangles overlap, seen along the axis that is nearest to the normal of the first: no side separates them."""
    a, b, c = triangle
    nx = (p[b, 1] - p[a, 1]) * (p[c, 2] - p[a, 2]) - (p[b, 2] - p[a, 2]) * (p[c, 1] - p[a, 1])
    ny = (p[b, 2] - p[a, 2]) * (p[c, 0] - p[a, 0]) - (p[b, 0] - p[a, 0]) * (p[c, 2] - p[a, 2])
    nz = (p[b, 0] - p[a, 0]) * (p[c, 1] - p[a, 1]) - (p[b, 1] - p[a, 1]) * (p[c, 0] - p[a, 0])
    i, j = 0, 1
    if abs(nx) >= abs(ny) and abs(nx) >= abs(nz):
        i, j = 1, 2
    elif abs(ny) >= abs(nz):
        i, j = 0, 2
    for turn in range(2):
        first, second = (triangle, other_triangle) if turn == 0 else (other_triangle, triangle)
        for k in range(3):
            a, b, c = first[k], first[(k + 1) % 3], first[(k + 2) % 3]
            ex, ey = p[b, i] - p[a, i], p[b, j] - p[a, j]
            l, r = ex * (p[c, j] - p[a, j]), ey * (p[c, i] - p[a, i])
            excess = l - r
            apart = abs(excess) > _BOUND * (abs(l) + abs(r))  # a triangle seen from its edge separates nothing
            for d in second:
                l, r = ex * (p[d, j] - p[a, j]), ey * (p[d, i] - p[a, i])
                if (l - r) * excess > 0 and abs(l - r) > _BOUND * (abs(l) + abs(r)):
                    apart = False
            if apart:
                return False
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _cross(p, a, b):
    """Whether two triangles share more than the corners and the edge that they have in common."""
    shared = 0
    lone_one, lone_two = -1, -1  # with one shared corner: its place in each
    for i in range(3):
        for j in range(3):
            if a[i] == b[j]:
                shared += 1
                lone_one, lone_two = i, j
    flat = True
    sides_one, sides_two = 0, 0
    for i in range(3):
        if a[i] != b[0] and a[i] != b[1] and a[i] != b[2]:
            s = _side(p, b[0], b[1], b[2], a[i])
            flat &= s == 0
            sides_one += s
        if b[i] != a[0] and b[i] != a[1] and b[i] != a[2]:
            s = _side(p, a[0], a[1], a[2], b[i])
            flat &= s == 0
            sides_two += s
    if flat:
        return _overlap_flat(p, a, b)
    if shared >= 2 or abs(sides_one) == 3 - shared or abs(sides_two) == 3 - shared:
        return False
    for i in range(3):
        if (shared == 0 or i == (lone_one + 1) % 3) and _pierces(p, a[i], a[(i + 1) % 3], b[0], b[1], b[2]) \
                or (shared == 0 or i == (lone_two + 1) % 3) and _pierces(p, b[i], b[(i + 1) % 3], a[0], a[1], a[2]):
            # where all is flat to rounding, signs of 0 look like a rim that is met
            return _overlap_flat(p, a, b)
    return False


@njit(cache=True, nogil=True, error_model="numpy")
def self_crossings(vertices, faces, order, box, limit):
    """Pairs of triangles (K, 2) that cross or overlap, at most `limit`."""
    leaves = len(box) // 2
    pairs = np.empty((limit, 2), np.int32)
    number = 0
    stack = np.empty(_STACK, np.int64)
    low, high = np.empty(3), np.empty(3)
    for i in range(len(order)):
        corners = (faces[order[i], 0], faces[order[i], 1], faces[order[i], 2])
        for k in range(3):
            low[k] = min(vertices[corners[0], k], vertices[corners[1], k], vertices[corners[2], k])
            high[k] = max(vertices[corners[0], k], vertices[corners[1], k], vertices[corners[2], k])
        stack[0] = 1
        top = 1
        while top:
            top -= 1
            node = stack[top]
            if box[node, 0] > high[0] or box[node, 1] > high[1] or box[node, 2] > high[2] \
                    or box[node, 3] < low[0] or box[node, 4] < low[1] or box[node, 5] < low[2]:
                continue
            if node < leaves:
                last = node
                while last < leaves:
                    last = 2 * last + 1
                if (last - leaves + 1) * LEAF <= i:  # all of it lies before i: seen from there
                    continue
                stack[top] = 2 * node
                stack[top + 1] = 2 * node + 1
                top += 2
                continue
            for j in range(max((node - leaves) * LEAF, i + 1), min((node - leaves + 1) * LEAF, len(order))):
                two = (faces[order[j], 0], faces[order[j], 1], faces[order[j], 2])
                if _cross(vertices, corners, two):
                    pairs[number, 0], pairs[number, 1] = order[i], order[j]
                    number += 1
                    if number == limit:
                        return pairs
    return pairs[:number]
