"""Closed meshes: what they hold."""

import numpy as np

# A body counts as so much smaller than a region without a boundary of as much volume: Mitsuba holds its vertices in single
# precision, by which its volume is off by 1e-7 and, far from the origin, more
SMALLER = 1e-5


def holds(vertices, faces, point):
    """Whether a point (3,) is in a closed mesh: by the solid angle of its triangles (van Oosterom and Strackee 1983)."""
    a, b, c = (vertices[faces[:, k]] - point for k in range(3))
    la, lb, lc = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
    ab, bc, ca = (np.einsum("fk,fk->f", first, second) for first, second in ((a, b), (b, c), (c, a)))
    angle = 2 * np.arctan2(np.einsum("fk,fk->f", a, np.cross(b, c)), la * lb * lc + ab * lc + bc * la + ca * lb)
    return bool(angle.sum() > 2 * np.pi)


def volume(vertices, faces):
    """Of a closed mesh; below 0 where its faces are turned inward."""
    corner = (vertices - vertices.mean(axis=0))[faces]
    return float(np.einsum("fk,fk->", corner[:, 0], np.cross(corner[:, 1], corner[:, 2]))) / 6


def area(vertices, faces) -> float:
    """Of a mesh."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.sum(np.linalg.norm(np.cross(b - a, c - a), axis=1))) / 2


def chord(vertices, faces) -> float:
    """Mean chord of a closed mesh, in the unit of its vertices (V, 3): 4 V/S of isotropic lines (Cauchy)."""
    return 4 * abs(volume(vertices, faces)) / area(vertices, faces)
